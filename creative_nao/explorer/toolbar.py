"""The bar above the maps: a second memory beside the first, colours, zoom, and how far the finer cells are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nicegui import ui

from creative_nao.explorer.colours import NAMES, is_of_body
from creative_nao.explorer.map_pane import KEYS_HELP
from creative_nao.explorer.shelf import NONE
from creative_nao.explorer.view import ALL

if TYPE_CHECKING:
    from creative_nao.explorer.page import Tab

STEP = 2.0
"""How much nearer a key or a button brings."""
POLL_S = 0.3


class Toolbar:
    """What is common to all maps of a tab."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab

    def build(self) -> None:
        """Lay the bar out."""
        tab = self._tab
        with ui.row().classes("items-center gap-2 w-full cn-toolbar"):
            names = [NONE, *(name for name in tab.exhibit.shelf.names if name != tab.sides[0].subject.name)]
            second = tab.sides[1].subject.name if len(tab.sides) > 1 else NONE
            self.beside = ui.select(names, value=second, label="Beside it", on_change=self._chosen)
            self.beside.props("dense options-dense").classes("w-28")
            self.colour = ui.select(self._colours(), value=tab.look.colour, label="Colour", on_change=self._recoloured)
            self.colour.props("dense options-dense").classes("w-44")
            for text, label, factor in (("+", "Zoom in", STEP), ("\N{MINUS SIGN}", "Zoom out", 1 / STEP)):
                ui.button(text, on_click=lambda _, by=factor: tab.zoom(by)).props(
                    f'dense outline no-caps aria-label="{label}"'
                ).classes("w-9")
            ui.button("Whole map", on_click=lambda: tab.look_at(None, tab.look.colour)).props("dense no-caps outline")
            self.note = ui.label("").props("aria-live=polite").classes("cn-note text-sm")
            ui.space()
            taught = tab.exhibit.taught
            ui.link("Teach", f"/teach?taught={taught}" if taught else "/teach").classes("px-2")
            ui.button("Keys", on_click=lambda: ui.notify(KEYS_HELP)).props("flat no-caps dense")
            ui.button("Dark / light", on_click=tab.theme).props("flat no-caps dense")
        self.progress = ui.linear_progress(0, show_value=False, size="3px").classes("cn-progress")
        self.progress.props('aria-label="Working the map out"')
        self.progress.set_visibility(False)
        self._poll = ui.timer(POLL_S, self._look_at_work, active=False)

    def tell(self) -> None:
        """Say what the maps show."""
        look = self._tab.look
        if look.share is not None:
            self._poll.active = True
        if look.view is None:
            self.note.text = ""
            return
        view = look.view
        digits = view.digits - 1
        window = " and ".join(
            f"PB {place} {low:.{digits}f} to {low + view.width:.{digits}f}"
            for place, low in ((1, view.left), (2, view.bottom))
        )
        fine = look.fineness
        cells = "finer cells come" if look.share is not None else "cells of the whole map"
        if fine is not None:
            cells = f"{fine} x {fine} finer cells"
        self.note.text = f"{ALL / view.width:.3g} times nearer: {window}; {cells}"

    def _look_at_work(self) -> None:
        share = self._tab.look.share
        self.progress.set_visibility(share is not None)
        self.progress.value = round(share or 0.0, 2)
        if share is None:
            self._poll.active = False

    def _chosen(self) -> None:
        self._tab.go_beside(str(self.beside.value))

    def _colours(self) -> dict[str, str]:
        embodied = any(side.subject.physical is not None for side in self._tab.sides)
        return {name: text for name, text in NAMES.items() if embodied or not is_of_body(name)}

    async def _recoloured(self) -> None:
        await self._tab.look_at(self._tab.look.view, str(self.colour.value))
