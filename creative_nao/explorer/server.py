"""Serving the explorer on this machine: who may ask, few page builds at a time, and what ends with a tab."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Iterable
from contextlib import AsyncExitStack
from urllib.parse import urlsplit

from nicegui import app, run, ui
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from creative_nao.errors import SettingsError
from creative_nao.explorer.page import build_page
from creative_nao.explorer.state import page_address
from creative_nao.explorer.tab import AppState, Tab
from creative_nao.explorer.teach_page import TeachTab
from creative_nao.explorer.teach_training import TrainingSessions

AT_ONCE = 2  # one page that waits for a second memory to be loaded shall not keep all others waiting


class ConcurrencyLimit:
    """ASGI middleware that limits concurrent page builds, in the order in which the requests came.

    Building a page takes 0.1 s in which nothing else is answered. Pages let in together finish together, the first as
    late as the last, and may outlive the minute that a page is kept for its socket. A page's turn ends when its answer
    begins, so a reader who takes the answer slowly keeps nobody waiting.
    """

    def __init__(self, app: ASGIApp, paths: tuple[str, ...]) -> None:
        self._app, self._paths = app, paths
        self._places = asyncio.Semaphore(AT_ONCE)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand a request on, a page's when its turn has come."""
        if scope["type"] != "http" or scope["path"] not in self._paths:
            await self._app(scope, receive, send)
            return
        async with AsyncExitStack() as turn:
            await turn.enter_async_context(self._places)

            async def answering(message: Message) -> None:
                await turn.aclose()  # at the first message; later there is nothing left to close
                await send(message)

            await self._app(scope, receive, answering)


LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")


def is_welcome(headers: Iterable[tuple[bytes, bytes]]) -> bool:
    """Tell whether a request names one of our hosts and comes from a page of ours, or from no page at all.

    A foreign Host is a name that somebody pointed at this machine (DNS rebinding); a foreign Origin is another site's
    page opening a socket here.
    """
    values = {key.decode("latin-1").lower(): value.decode("latin-1") for key, value in headers}
    host, origin = values.get("host", ""), values.get("origin")
    try:
        local = urlsplit(f"//{host}").hostname in LOCAL_HOSTS
        return local and (origin is None or urlsplit(origin).netloc == host)
    except ValueError:
        return False


class LocalOnly:
    """ASGI middleware: 403 for what `is_welcome` refuses, for pages and sockets alike."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or hand on."""
        if scope["type"] not in ("http", "websocket") or is_welcome(scope["headers"]):
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await send({"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"text/plain")]})
            await send({"type": "http.response.body", "body": b"This page answers only to its own host."})


MAX_TABS = 200  # more are refused: each holds a page's worth of state


class Tabs:
    """The open tabs of one server."""

    def __init__(self) -> None:
        self._tabs: dict[str, Tab | TeachTab] = {}

    def __len__(self) -> int:
        return len(self._tabs)

    def admits(self, tab: Tab | TeachTab) -> bool:
        """Keep the tab being built until it goes, then close it; one too many is closed at once, with a message."""
        if len(self._tabs) >= MAX_TABS:
            tab.close()
            ui.label(f"{MAX_TABS} tabs are open. Close some, wait a minute and reload this page.")
            return False
        client = ui.context.client
        key = client.id
        self._tabs[key] = tab
        client.on_delete(lambda: self._release(key))
        return True

    def _release(self, key: str) -> None:
        if (tab := self._tabs.pop(key, None)) is not None:
            tab.close()


RECONNECT_S = 30.0
"""How long a tab that has gone quiet, such as a sleeping laptop's, is waited for before its memory is freed."""

PAGES = ("/", "/teach")

ANSWER_S = 60.0  # how long a page may take to be built: a second memory has to be loaded and its coarse map made


def mount(started: AppState) -> Tabs:
    """Register the page and return the register of its open tabs. Importing registers nothing."""
    tabs, sessions = Tabs(), TrainingSessions()

    @ui.page(PAGES[0], response_timeout=ANSWER_S)
    async def page(
        x: str = "0", y: str = "0", path: str = "", beside: str = "", view: str = "", colour: str = "", taught: str = ""
    ) -> None:
        trainer = sessions.hold(taught)
        app_state = started if trainer is None or trainer.app_state is None else trainer.app_state
        place = page_address(x, y, path, beside, view, colour)
        second = place.beside or app_state.registry.beside
        wanted = second in app_state.registry.names and second != app_state.registry.first.name
        loaded = await run.io_bound(app_state.registry.get, second) if wanted else None
        tab = Tab(app_state, place, loaded, lambda: sessions.release(taught))
        if not tabs.admits(tab):
            return
        if taught and app_state is started:
            ui.notify("The memory taught in the page is gone; this is the server's own.", type="warning")
        build_page(tab)
        ui.timer(0, tab.open, once=True)

    @ui.page(PAGES[1], title="Teach the robot")
    def teach(taught: str = "") -> None:
        tab = TeachTab(started, sessions, taught)
        if not tabs.admits(tab):
            return
        tab.build()
        ui.timer(0, tab.open, once=True)

    return tabs


def claim_port(host: str, port: int) -> None:
    """Make sure that the port is free; SettingsError if it is not, or may not be used."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SettingsError(f"port {port} on {host} cannot be used: {reason}; choose another with --port") from error


def serve(app_state: AppState, *, host: str, port: int, show: bool) -> None:
    """Serve until Ctrl-C, and `show` the page; only with a `host` other than 127.0.0.1 can other machines reach it."""
    mount(app_state)
    app.add_middleware(ConcurrencyLimit, paths=PAGES)
    if host in LOCAL_HOSTS:
        app.add_middleware(LocalOnly)
    app_state.registry.start()
    with contextlib.suppress(KeyboardInterrupt):
        ui.run(
            host=host, port=port, show=show, reload=False, show_welcome_message=False, title="Memory explorer",
            reconnect_timeout=RECONNECT_S,
        )  # fmt: skip
