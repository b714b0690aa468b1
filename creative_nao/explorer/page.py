"""The page of one browser tab: the map or two maps, the robots, the tools, and where they stand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from nicegui import ui

from creative_nao.explorer import panels
from creative_nao.explorer.colours import NAMES, is_of_body
from creative_nao.explorer.map_pane import KEYS_HELP
from creative_nao.explorer.memory_service import as_coordinate
from creative_nao.explorer.physics_service import player_controls
from creative_nao.explorer.registry import NONE
from creative_nao.explorer.tab import STEP, Tab
from creative_nao.explorer.view import ALL

STATIC = Path(__file__).with_name("static")
POLL_S = 0.3


def build_page(tab: Tab) -> None:
    """Lay the page out."""
    ui.page_title("Memory explorer")
    ui.add_css((STATIC / "page.css").read_text(encoding="utf-8"))
    ui.add_body_html(f"<script>{(STATIC / 'zoom.js').read_text(encoding='utf-8')}</script>")
    tab.dark = ui.dark_mode(None)
    ui.label(" and ".join(f"Memory {panel.loaded.name}" for panel in tab.memory_panels)).classes("text-lg")
    Toolbar(tab).build()
    (alone if len(tab.memory_panels) == 1 else twin)(tab)
    tab.status = tab.memory_panels[0].status
    if not all(panel.loaded.progressive_map.finished.is_set() for panel in tab.memory_panels):
        tab.poll = ui.timer(1.0, tab.fine_maps_ready)


class Toolbar:
    """What is common to all maps of a tab."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        tab.refresh_toolbar = self.tell

    def build(self) -> None:
        """Lay the bar out."""
        tab = self._tab
        with ui.row().classes("items-center gap-2 w-full cn-toolbar"):
            names = [NONE, *(name for name in tab.app_state.registry.names if name != tab.memory_panels[0].loaded.name)]
            second = tab.memory_panels[1].loaded.name if len(tab.memory_panels) > 1 else NONE
            self.beside = ui.select(names, value=second, label="Beside it", on_change=self._chosen)
            self.beside.props("dense options-dense").classes("w-28")
            self.colour = ui.select(
                self._colours(), value=tab.map_state.colour, label="Colour", on_change=self._recoloured
            )
            self.colour.props("dense options-dense").classes("w-44")
            for text, label, factor in (("+", "Zoom in", STEP), ("\N{MINUS SIGN}", "Zoom out", 1 / STEP)):
                ui.button(text, on_click=lambda _, by=factor: tab.zoom(by)).props(
                    f'dense outline no-caps aria-label="{label}"'
                ).classes("w-9")
            ui.button("Whole map", on_click=lambda: tab.look_at(None, tab.map_state.colour)).props(
                "dense no-caps outline"
            )
            self.note = ui.label("").props("aria-live=polite").classes("cn-note text-sm")
            ui.space()
            taught = tab.app_state.taught
            ui.link("Teach", f"/teach?taught={taught}" if taught else "/teach").classes("px-2")
            ui.button("Keys", on_click=lambda: ui.notify(KEYS_HELP)).props("flat no-caps dense")
            ui.button("Dark / light", on_click=tab.theme).props("flat no-caps dense")
        self.progress = ui.linear_progress(0, show_value=False, size="3px").classes("cn-progress")
        self.progress.props('aria-label="Working the map out"')
        self.progress.set_visibility(False)
        self._poll = ui.timer(POLL_S, self._look_at_work, active=False)

    def tell(self) -> None:
        """Say what the maps show."""
        map_state = self._tab.map_state
        if map_state.share is not None:
            self._poll.active = True
        if map_state.view is None:
            self.note.text = ""
            return
        view = map_state.view
        digits = view.digits - 1
        window = " and ".join(
            f"PB {place} {low:.{digits}f} to {low + view.width:.{digits}f}"
            for place, low in ((1, view.left), (2, view.bottom))
        )
        fine = map_state.fineness
        cells = "finer cells come" if map_state.share is not None else "cells of the whole map"
        if fine is not None:
            cells = f"{fine} x {fine} finer cells"
        self.note.text = f"{ALL / view.width:.3g} times nearer: {window}; {cells}"

    def _look_at_work(self) -> None:
        share = self._tab.map_state.share
        self.progress.set_visibility(share is not None)
        self.progress.value = round(share or 0.0, 2)
        if share is None:
            self._poll.active = False

    def _chosen(self) -> None:
        self._tab.go_beside(str(self.beside.value))

    def _colours(self) -> dict[str, str]:
        embodied = any(panel.loaded.physical is not None for panel in self._tab.memory_panels)
        return {name: text for name, text in NAMES.items() if embodied or not is_of_body(name)}

    async def _recoloured(self) -> None:
        await self._tab.look_at(self._tab.map_state.view, str(self.colour.value))


def alone(tab: Tab) -> None:
    """Lay one memory out: map left, robot and curves right, on a phone one below the other."""
    (panel,) = tab.memory_panels
    with ui.element("div").classes("cn-page"):
        with _area("map"):
            panel.map.build(tab)
        with _area("robot"):
            panel.build_robot(tab.app_state.physics_service)
            _player(tab)
            panel.build_told()
            panels.favourites(tab)
        with _area("tools"):
            _tools(tab)


def twin(tab: Tab) -> None:
    """Lay two memories out in two columns, on a phone one below the other; one player drives both robots."""
    with ui.element("div").classes("cn-page cn-twin"):
        for number, panel in enumerate(tab.memory_panels, start=1):
            with _area("map", number):
                ui.label(f"Memory {panel.loaded.name}").classes("cn-name-of-side")
                panel.map.build(tab)
        for number, panel in enumerate(tab.memory_panels, start=1):
            with _area("robot", number):
                panel.build_robot(tab.app_state.physics_service)
        with _area("player"):
            _player(tab)
        for number, panel in enumerate(tab.memory_panels, start=1):
            with _area("told", number):
                ui.label(f"Memory {panel.loaded.name}").classes("cn-name-of-side")
                panel.build_told()
        with _area("tools"):
            _tools(tab)
        with _area("keep"):
            panels.favourites(tab)


def _area(name: str, number: int = 1) -> ui.element:
    return ui.element("div").classes(f"cn-at-{name}{number if number > 1 else ''}")


def _player(tab: Tab) -> None:
    with ui.row().classes("w-full items-center gap-2"):
        player_controls()
        tab.physics = ui.switch("Physics", on_change=lambda: tab.show(tab.points, keep=False))
        ui.switch("Ghost of the nearest", value=True, on_change=tab.show_ghosts)


def _tools(tab: Tab) -> None:
    """Lay out the tools: point or path, numbers, discovering, exchanging."""

    async def go() -> None:
        await tab.show(np.array([[as_coordinate(tab.pb_1.value), as_coordinate(tab.pb_2.value)]]))

    with ui.row().classes("items-center gap-2"):
        tab.mode = ui.toggle(["point", "path"], value="point").props("no-caps dense aria-label='click or draw'")
        tab.pb_1, tab.pb_2 = (
            ui.number(name, value=0, min=-1, max=1, step=0.01, format="%.3f").props("dense").classes("w-24")
            for name in ("PB 1", "PB 2")
        )
        ui.button("Go", on_click=go).props("dense no-caps")
    panels.discovery(tab)
    panels.exchange(tab)
