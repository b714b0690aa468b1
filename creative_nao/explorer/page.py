"""The page of one browser tab: the maps, the robots and the tools beside them, and where they stand."""

from __future__ import annotations

import weakref

import numpy as np
from nicegui import events, run, ui

from creative_nao.errors import CreativeNaoError
from creative_nao.exchange import FORMATS, WRITABLE
from creative_nao.explorer.colours import NAMES, is_physical
from creative_nao.explorer.map_pane import KEYS_HELP
from creative_nao.explorer.markup import thumbnail
from creative_nao.explorer.memory_service import (
    as_coordinate,
    less_like,
    more_like,
    spoken,
    surprise,
)
from creative_nao.explorer.physics_service import STATIC, player_controls
from creative_nao.explorer.recordings import MAX_UPLOAD_BYTES, export, read_upload
from creative_nao.explorer.registry import NONE
from creative_nao.explorer.state import MAX_NOTE, Favourite
from creative_nao.explorer.tab import STEP, Tab
from creative_nao.explorer.view import ALL

POLL_S = 0.3


def build_page(tab: Tab) -> None:
    """Lay the page out: of one memory the map left, robot and curves right; of two a column each, with one player."""
    ui.page_title("Memory explorer")
    ui.add_css((STATIC / "page.css").read_text(encoding="utf-8"))
    ui.add_body_html(f"<script>{(STATIC / 'zoom.js').read_text(encoding='utf-8')}</script>")
    ui.label(" and ".join(f"Memory {panel.loaded.name}" for panel in tab.memory_panels)).classes("text-lg")
    toolbar(tab)
    twin = len(tab.memory_panels) > 1
    with ui.element("div").classes("cn-page cn-twin" if twin else "cn-page"):
        for number, panel in enumerate(tab.memory_panels, start=1):
            with _area("map", number):
                if twin:
                    ui.label(f"Memory {panel.loaded.name}").classes("cn-name-of-side")
                tab.build_map(panel.map)
        for number, panel in enumerate(tab.memory_panels, start=1):
            with _area("robot", number):
                panel.build_robot(tab.app_state.physics_service)
                if not twin:
                    player(tab)
                    panel.build_description()
                    favourites(tab)
        if twin:
            with _area("player"):
                player(tab)
            for number, panel in enumerate(tab.memory_panels, start=1):
                with _area("words", number):
                    ui.label(f"Memory {panel.loaded.name}").classes("cn-name-of-side")
                    panel.build_description()
        with _area("tools"):
            movement_tools(tab)
            exchange(tab)
        if twin:
            with _area("keep"):
                favourites(tab)

    async def show_fine_maps() -> None:
        if all(panel.loaded.finished.is_set() for panel in tab.memory_panels):
            waiting.deactivate()
            await tab.map_state.work()

    waiting = ui.timer(1.0, show_fine_maps)


def _area(name: str, number: int = 1) -> ui.element:
    return ui.element("div").classes(f"cn-at-{name}{number if number > 1 else ''}")


def toolbar(tab: Tab) -> None:
    """Lay out what is common to all maps of a tab."""
    state = tab.map_state

    def refresh() -> None:
        working = state.share is not None
        poll.active = poll.active or working
        note.text = ""
        if (view := state.view) is not None:
            digits = view.digits - 1
            window = " and ".join(
                f"PB {place} {low:.{digits}f} to {low + view.width:.{digits}f}"
                for place, low in ((1, view.left), (2, view.bottom))
            )
            cells = "finer cells come" if working else "cells of the whole map"
            if (n := state.fineness) is not None:
                cells = f"{n} x {n} finer cells"
            note.text = f"{ALL / view.width:.3g} times nearer: {window}; {cells}"

    def show_progress() -> None:
        share = state.share
        progress.set_visibility(share is not None)
        progress.value = round(share or 0.0, 2)
        poll.active = share is not None

    dark = ui.dark_mode(None)
    with ui.row().classes("items-center gap-2 w-full cn-toolbar"):
        first, *others = (panel.loaded for panel in tab.memory_panels)
        names = [NONE, *(name for name in tab.app_state.registry.names if name != first.name)]
        beside = ui.select(
            names, value=others[0].name if others else NONE, label="Beside it",
            on_change=lambda: tab.go_beside(str(beside.value)),
        ).props("dense options-dense").classes("w-28")  # fmt: skip
        physical = first.physical is not None or any(other.physical is not None for other in others)
        colour = ui.select(
            {name: text for name, text in NAMES.items() if physical or not is_physical(name)},
            value=state.colour, label="Colour", on_change=lambda: tab.look_at(state.view, str(colour.value)),
        ).props("dense options-dense").classes("w-44")  # fmt: skip
        for text, label, factor in (("+", "Zoom in", STEP), ("\N{MINUS SIGN}", "Zoom out", 1 / STEP)):
            button = ui.button(text, on_click=lambda _, by=factor: tab.zoom(by)).classes("w-9")
            button.props(f'dense outline no-caps aria-label="{label}"')
        ui.button("Whole map", on_click=lambda: tab.look_at(None, state.colour)).props("dense no-caps outline")
        note = ui.label("").props("aria-live=polite").classes("cn-note text-sm")
        ui.space()
        taught = tab.app_state.taught
        ui.link("Teach", f"/teach?taught={taught}" if taught else "/teach").classes("px-2")
        ui.button("Keys", on_click=lambda: ui.notify(KEYS_HELP)).props("flat no-caps dense")
        ui.button("Dark / light", on_click=lambda: dark.set_value(not dark.value)).props("flat no-caps dense")
    progress = ui.linear_progress(0, show_value=False, size="3px").classes("cn-progress")
    progress.props('aria-label="Working the map out"')
    progress.set_visibility(False)
    poll = ui.timer(POLL_S, show_progress, active=False)
    tab.refresh_toolbar = refresh


def player(tab: Tab) -> None:
    """Lay out the player with the switches of physics and ghosts."""

    def show_ghosts() -> None:
        for panel in tab.memory_panels:
            panel.ghost_shown = bool(ghosts.value)
            panel.replay()

    with ui.row().classes("w-full items-center gap-2"):
        player_controls()
        tab.physics = ui.switch("Physics", on_change=lambda: tab.show(tab.points, keep=False))
        ghosts = ui.switch("Ghost of the nearest", value=True, on_change=show_ghosts)


def movement_tools(tab: Tab) -> None:
    """Lay out point or path, the PB point as numbers, and the buttons that find movements."""

    async def go() -> None:
        await tab.show(np.array([[as_coordinate(tab.pb_1.value), as_coordinate(tab.pb_2.value)]]))

    async def more() -> None:
        kept = [favourite.points[-1] for favourite in tab.app_state.session.favourites(tab.first.key)[-3:]]
        await tab.show(more_like(tab.first.pb_map, np.array([tuple(tab.points[-1]), *kept]), tab.rng)[None])

    async def walk() -> None:
        await tab.show(tab.first.service.memory.pb[[int(start.value or 0), int(end.value or 0)]])

    with ui.row().classes("items-center gap-2"):
        tab.mode = ui.toggle(["point", "path"], value="point").props("no-caps dense aria-label='click or draw'")
        tab.pb_1, tab.pb_2 = (
            ui.number(name, value=0, min=-1, max=1, step=0.01, format="%.3f").props("dense").classes("w-24")
            for name in ("PB 1", "PB 2")
        )
        ui.button("Go", on_click=go).props("dense no-caps")
    with ui.row().classes("items-center gap-2"):
        for text, action in (
            ("Surprise me", lambda: tab.show(surprise(tab.first.pb_map, tab.rng)[None])),
            ("More like this", more),
            ("Less like this", lambda: tab.show(less_like(tab.first.pb_map, tab.points[-1:], tab.rng)[None])),
            ("Back", tab.back),
        ):
            ui.button(text, on_click=action).props("dense no-caps outline")
    names = {place: spoken(name) for place, name in enumerate(tab.first.service.names)}
    with ui.row().classes("items-center gap-2"):
        start = ui.select(names, value=0, label="A path from").props("dense options-dense").classes("w-32")
        end = ui.select(names, value=len(names) - 1, label="to").props("dense options-dense").classes("w-32")
        ui.button("Walk", on_click=walk).props("dense no-caps outline")


def exchange(tab: Tab) -> None:
    """Lay out export and import."""

    async def download(format_name: str) -> None:
        recall = tab.memory_panels[0].recall
        if recall is None:
            return
        try:
            exported = await run.io_bound(export, recall, tab.first.service, format_name)
        except CreativeNaoError as error:
            ui.notify(str(error), type="negative")
            return
        if exported is not None:
            name, content, changes = exported
            for change in changes:
                ui.notify(change)
            ui.download.content(content, name)

    weakly = weakref.ref(tab)  # the web framework keeps handlers of uploads in a cache that outlives the page

    async def receive(event: events.UploadEventArguments) -> None:
        if (here := weakly()) is None:
            return
        try:
            content, dt_s = await event.file.read(), here.first.service.memory.dt_s
            recording = await run.io_bound(read_upload, event.file.name, content, dt_s)
            if recording is None:
                return
            status = here.memory_panels[0].status
            status.text = "Recognising the recording ..."
            recognised = await run.io_bound(here.first.service.recognise, recording.motion.angles)
            if recognised is None:
                return
            point, distance, recall = recognised
            here.marks["R"] = tuple(point)
            here.points = point[None]
            here.redraw()
            await here.present(recall)
            status.text = f"Recording, recognised at R with DTW {distance:.2f} rad left. {status.text}"
        except CreativeNaoError as error:
            here.memory_panels[0].status.text = f"Not a movement: {error}"
        finally:
            upload.reset()

    with ui.row().classes("items-center gap-2 w-full"):
        with ui.dropdown_button("Export", auto_close=True).props("dense no-caps outline"):
            for name in WRITABLE:
                ui.item(f"{name}: {FORMATS[name].purpose}", on_click=lambda _, name=name: download(name))
        upload = ui.upload(
            label="Drop a recording (CSV, ...)", auto_upload=True, on_upload=receive,
            max_file_size=MAX_UPLOAD_BYTES, max_files=1,
        )  # fmt: skip
        upload.on("rejected", lambda: ui.notify(f"A recording may have {MAX_UPLOAD_BYTES} bytes."))
        upload.props('flat bordered aria-label="Drop a recorded movement"').classes("w-60 cn-upload")


def favourites(tab: Tab) -> None:
    """Lay out the favourites; a removed one can be kept again at once."""
    session, removed = tab.app_state.session, list[Favourite]()

    async def remove(favourite: Favourite) -> None:
        if await tab.change_favourites(session.remove, favourite):
            undo.set_visibility(True)
            removed.append(favourite)

    async def restore() -> None:
        if removed and await tab.change_favourites(session.add, removed[-1]):
            removed.pop()
        undo.set_visibility(bool(removed))

    async def add() -> None:
        await tab.keep_favourite(note.value or "")
        note.value = ""

    async def recall(favourite: Favourite) -> None:
        await tab.show(np.array(favourite.points))
        if favourite.beside in tab.app_state.registry.names and favourite.beside != tab.beside:
            tab.go_beside(favourite.beside)

    def card(favourite: Favourite) -> None:
        movement = tab.first.service.recall(np.array(favourite.points))
        with ui.card().classes("p-1 gap-0 items-center"):
            picture = ui.image(thumbnail(movement)).classes("w-24 h-14 cursor-pointer")
            picture.props('tabindex=0 role=button aria-label="Recall a favourite"')
            for event in ("click", "keydown.enter"):
                picture.on(event, lambda _: recall(favourite))
            ui.label(favourite.note or " ").classes("text-xs max-w-24 truncate")
            ui.button("Remove", on_click=lambda: remove(favourite)).props("flat dense no-caps size=sm")

    def refresh() -> None:
        cards.clear()
        with cards:
            for favourite in session.favourites(tab.first.key)[-24:]:
                card(favourite)

    with ui.row().classes("items-center gap-2"):
        note = ui.input("Note").props(f"dense maxlength={MAX_NOTE}")
        ui.button("Keep as favourite", on_click=add).props("dense no-caps outline")
        undo = ui.button("Undo removal", on_click=restore).props("dense no-caps flat")
        undo.set_visibility(False)
    cards = ui.row().classes("gap-2")  # no `ui.refreshable`: it would hold the last tab for ever
    tab.refresh_favourites = refresh
    refresh()
