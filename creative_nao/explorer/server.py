"""Serving the explorer: one memory, this machine only unless told otherwise."""

from __future__ import annotations

import contextlib
import socket

from nicegui import app, run, ui

from creative_nao.errors import SettingsError
from creative_nao.explorer.address import place_of
from creative_nao.explorer.in_turn import InTurn
from creative_nao.explorer.page import Exhibit, Tab
from creative_nao.explorer.school import School
from creative_nao.explorer.security import LOCAL_HOSTS, LocalOnly
from creative_nao.explorer.tabs import Tabs
from creative_nao.explorer.teach_page import TeachTab

RECONNECT_S = 30.0
"""How long a tab that has gone quiet, such as a sleeping laptop's, is waited for before its memory is freed."""

PAGES = ("/", "/teach")

ANSWER_S = 60.0
"""How long a page may take to be built: a second memory has to be loaded and its coarse map made."""


def mount(started: Exhibit) -> Tabs:
    """Register the page and return the register of its open tabs. Importing registers nothing."""
    tabs, school = Tabs(), School()

    @ui.page(PAGES[0], response_timeout=ANSWER_S)
    async def page(
        x: str = "0", y: str = "0", path: str = "", beside: str = "", view: str = "", colour: str = "", taught: str = ""
    ) -> None:
        desk = school.hold(taught)
        exhibit = started if desk is None or desk.exhibit is None else desk.exhibit
        place = place_of(x, y, path, beside, view, colour)
        second = place.beside or exhibit.shelf.beside
        wanted = second in exhibit.shelf.names and second != exhibit.shelf.first.name
        tab = Tab(exhibit, place, await run.io_bound(exhibit.shelf.get, second) if wanted else None)
        if not tabs.admits(tab, lambda: school.let_go(taught)):
            return
        if taught and exhibit is started:
            ui.notify("The memory taught in the page is gone; this is the server's own.", type="warning")
        tab.build()
        ui.timer(0, tab.open, once=True)

    @ui.page(PAGES[1], title="Teach the robot")
    def teach(taught: str = "") -> None:
        tab = TeachTab(started, school, taught)
        if not tabs.admits(tab):
            return
        tab.build()
        ui.timer(0, tab.open, once=True)

    return tabs


def claim_port(host: str, port: int) -> None:
    """Make sure that the port is free.

    Raises:
        SettingsError: If it is not, or may not be used.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SettingsError(f"port {port} on {host} cannot be used: {reason}; choose another with --port") from error


def serve(exhibit: Exhibit, *, host: str, port: int, show: bool) -> None:
    """Serve until Ctrl-C.

    Args:
        exhibit: What to show.
        host: Address to listen on; only with another than 127.0.0.1 can other machines reach the page.
        port: Port to listen on.
        show: Open the page in the user's browser.
    """
    mount(exhibit)
    app.add_middleware(InTurn, paths=PAGES)
    if host in LOCAL_HOSTS:
        app.add_middleware(LocalOnly)
    exhibit.shelf.start()
    with contextlib.suppress(KeyboardInterrupt):
        ui.run(
            host=host, port=port, show=show, reload=False, show_welcome_message=False, title="Memory explorer",
            reconnect_timeout=RECONNECT_S,
        )  # fmt: skip
