"""Serving the explorer on this machine: who may ask, few page builds at a time, and what ends with a tab."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
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
EVERY_ADDRESS = ("0.0.0.0", "::", "")  # noqa: S104 - what `--host` may say, not what we bind to by ourselves
MAX_BODY_BYTES = 4_000_000
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; object-src 'none'; base-uri 'self'; form-action 'self'; "
    "frame-ancestors 'none'"
)
HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


def is_welcome(headers: Iterable[tuple[bytes, bytes]], hosts: Iterable[str], addresses: bool = False) -> bool:
    """Tell whether a request names one of our `hosts` and comes from a page of ours, or from no page at all.

    A foreign Host is a name that somebody pointed at this machine (DNS rebinding); a number is no name, so with
    `addresses` any is taken. A foreign Origin, or a request that the browser says another site has made, is another
    site's page asking here; only a link that the user follows may come from one.
    """
    values = {key.decode("latin-1").lower(): value.decode("latin-1") for key, value in headers}
    host, origin = values.get("host", ""), values.get("origin")
    try:
        name = "" if "@" in host else urlsplit(f"//{host}").hostname or ""
        ours = name in hosts or (addresses and _is_address(name))
        if not ours or (origin is not None and urlsplit(origin).netloc.lower() != host.lower()):
            return False
    except ValueError:
        return False
    followed = values.get("sec-fetch-mode") == "navigate" and values.get("sec-fetch-dest") == "document"
    return values.get("sec-fetch-site", "none") in ("none", "same-origin") or (followed and origin is None)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


class Gate:
    """ASGI middleware: 403 for what `is_welcome` refuses, 413 for too large a body, our headers on every answer."""

    def __init__(self, app: ASGIApp, host: str = LOCAL_HOSTS[0], allowed: tuple[str, ...] = ()) -> None:
        self._app, self._addresses = app, host in EVERY_ADDRESS
        self._hosts = frozenset(name.lower() for name in (*LOCAL_HOSTS, *allowed, host) if name not in EVERY_ADDRESS)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or hand on."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
        elif not is_welcome(scope["headers"], self._hosts, self._addresses):
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008})
            else:
                await _refuse(send, 403, b"This page answers only to its own host and its own pages.")
        elif scope["type"] == "websocket":
            await self._app(scope, receive, send)
        else:
            await self._answer(scope, receive, send)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        told = dict(scope["headers"]).get(b"content-length", b"0")
        if not told.isdigit() or int(told) > MAX_BODY_BYTES:
            await _refuse(send, 413, TOO_LARGE)
            return
        n_bytes, begun = 0, False

        async def counted() -> Message:
            nonlocal n_bytes
            message = await receive()
            n_bytes += len(message.get("body", b""))
            return message if n_bytes <= MAX_BODY_BYTES else {"type": "http.disconnect"}

        async def headed(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", ()), *HEADERS]}
            if begun or n_bytes <= MAX_BODY_BYTES:
                begun = True
                await send(message)

        try:
            await self._app(scope, counted, headed)
        except Exception:
            if n_bytes <= MAX_BODY_BYTES:  # else the application was told that the client is gone
                raise
        if n_bytes > MAX_BODY_BYTES and not begun:
            await _refuse(send, 413, TOO_LARGE)


TOO_LARGE = b"A request may have %d bytes." % MAX_BODY_BYTES


async def _refuse(send: Send, status: int, reason: bytes) -> None:
    headers = [(b"content-type", b"text/plain"), (b"connection", b"close"), *HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": reason})


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


def serve(app_state: AppState, *, host: str, port: int, show: bool, allowed: tuple[str, ...] = ()) -> None:
    """Serve until Ctrl-C, and `show` the page; only with a `host` other than 127.0.0.1 can other machines reach it.

    `allowed` are names by which it may be asked for besides this machine's own and `host`.
    """
    mount(app_state)
    app.add_middleware(ConcurrencyLimit, paths=PAGES)
    app.add_middleware(Gate, host=host, allowed=allowed)
    app_state.registry.start()
    with contextlib.suppress(KeyboardInterrupt):
        ui.run(
            host=host, port=port, show=show, reload=False, show_welcome_message=False, title="Memory explorer",
            reconnect_timeout=RECONNECT_S,
        )  # fmt: skip
