"""The panels beside map and robot: discovering, exchanging, favourites."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from nicegui import events, run, ui

from creative_nao.errors import CreativeNaoError
from creative_nao.exchange import FORMATS
from creative_nao.explorer import discover, recordings
from creative_nao.explorer.map_view import Mark
from creative_nao.explorer.session import MAX_NOTE, Favourite
from creative_nao.explorer.thumbnails import thumbnail
from creative_nao.explorer.words import spoken

if TYPE_CHECKING:
    from creative_nao.explorer.page import Tab


def discovery(tab: Tab) -> None:
    """Lay out the buttons that find movements."""

    async def surprise() -> None:
        await tab.show(discover.surprise(tab.exhibit.charting.chart, tab.rng)[None])

    async def more() -> None:
        await tab.show(discover.more_like(tab.exhibit.charting.chart, _liked(tab), tab.rng)[None])

    async def less() -> None:
        await tab.show(discover.less_like(tab.exhibit.charting.chart, tab.points[-1:], tab.rng)[None])

    async def walk() -> None:
        await tab.show(discover.way(tab.mind.memory.pb, int(start.value or 0), int(end.value or 0)))

    with ui.row().classes("items-center gap-2"):
        for text, action in (
            ("Surprise me", surprise), ("More like this", more), ("Less like this", less), ("Back", tab.back),
        ):  # fmt: skip
            ui.button(text, on_click=action).props("dense no-caps outline")
    names = {place: spoken(name) for place, name in enumerate(tab.mind.names)}
    with ui.row().classes("items-center gap-2"):
        start = ui.select(names, value=0, label="A path from").props("dense options-dense").classes("w-32")
        end = ui.select(names, value=len(names) - 1, label="to").props("dense options-dense").classes("w-32")
        ui.button("Walk", on_click=walk).props("dense no-caps outline")


def _liked(tab: Tab) -> np.ndarray:
    kept = [one.points[-1] for one in tab.exhibit.session.favourites(tab.key)]
    return np.array([tuple(tab.points[-1]), *kept[-3:]])


def exchange(tab: Tab) -> None:
    """Lay out export and import."""

    async def download(format_name: str) -> None:
        if tab.recall is None:
            return
        try:
            made = await run.io_bound(recordings.export, tab.recall, tab.mind, format_name)
        except CreativeNaoError as error:
            ui.notify(str(error), type="negative")
            return
        if made is not None:
            for change in made[2]:
                ui.notify(change)
            ui.download.content(made[1], made[0])

    weakly = weakref.ref(tab)  # the web framework keeps handlers of uploads in a cache that outlives the page

    async def receive(event: events.UploadEventArguments) -> None:
        here = weakly()
        if here is None:
            return
        try:
            content = await event.file.read()
            await _recognise(here, event.file.name, content)
        except CreativeNaoError as error:
            here.status.text = f"Not a movement: {error}"
        finally:
            upload.reset()

    with ui.row().classes("items-center gap-2 w-full"):
        with ui.dropdown_button("Export", auto_close=True).props("dense no-caps outline"):
            for name, one in FORMATS.items():
                ui.item(f"{name}: {one.purpose}", on_click=lambda _, name=name: download(name))
        upload = ui.upload(
            label="Drop a recording (CSV, ...)", auto_upload=True, on_upload=receive,
            max_file_size=recordings.MAX_UPLOAD_BYTES, max_files=1,
        )  # fmt: skip
        upload.on("rejected", lambda: ui.notify(f"A recording may have {recordings.MAX_UPLOAD_BYTES} bytes."))
        upload.props('flat bordered aria-label="Drop a recorded movement"').classes("w-60 cn-upload")


async def _recognise(tab: Tab, name: str, content: bytes) -> None:
    recording = await run.io_bound(recordings.read_upload, name, content, tab.mind.memory.dt_s)
    if recording is None:
        return
    tab.status.text = "Recognising the recording ..."
    found = await run.io_bound(tab.mind.recognise, recording.motion.angles)
    if found is None:
        return
    point, distance, recall = found
    tab.marks = [*(mark for mark in tab.marks if mark.letter != "R"), Mark((float(point[0]), float(point[1])), "R")]
    tab.points = point[None]
    tab.redraw()
    await tab.present(recall)
    tab.status.text = f"Recording, recognised at R with DTW {distance:.2f} rad left. {tab.status.text}"


def keep(tab: Tab, note: str = "") -> None:
    """Keep the movement shown as a favourite."""
    if tab.recall is not None:
        points = tuple((float(x), float(y)) for x, y in tab.points)
        beside = tab.sides[1].subject.name if len(tab.sides) > 1 else ""
        _changed(tab, tab.exhibit.session.add, Favourite(tab.key, points, note[:MAX_NOTE], beside))


def _changed(tab: Tab, change: Callable[[Favourite], None], favourite: Favourite) -> bool:
    """Change the favourites and show them; tell the user when they cannot be written."""
    try:
        change(favourite)
    except (OSError, CreativeNaoError) as error:
        ui.notify(f"The favourites stay as they were: {error}", type="negative")
        return False
    tab.refresh_favourites()
    return True


def favourites(tab: Tab) -> None:
    """Lay out the favourites; a removed one can be kept again at once."""

    def forget(favourite: Favourite) -> None:
        if _changed(tab, tab.exhibit.session.remove, favourite):
            undo.set_visibility(True)
            forgotten.append(favourite)

    def restore() -> None:
        if forgotten and _changed(tab, tab.exhibit.session.add, forgotten[-1]):
            forgotten.pop()
        undo.set_visibility(bool(forgotten))

    def add() -> None:
        keep(tab, note.value or "")
        note.value = ""

    async def recall(favourite: Favourite) -> None:
        await tab.show(np.array(favourite.points))
        if favourite.beside in tab.exhibit.shelf.names and favourite.beside != tab.beside:
            tab.go_beside(favourite.beside)

    def listed() -> None:
        shelf.clear()
        with shelf:
            for favourite in tab.exhibit.session.favourites(tab.key)[-24:]:
                with ui.card().classes("p-1 gap-0 items-center"):
                    picture = ui.image(thumbnail(tab.mind, favourite.points)).classes("w-24 h-14 cursor-pointer")
                    picture.props('tabindex=0 role=button aria-label="Recall a favourite"').on(
                        "click", lambda _, one=favourite: recall(one)
                    ).on("keydown.enter", lambda _, one=favourite: recall(one))
                    ui.label(favourite.note or " ").classes("text-xs max-w-24 truncate")
                    ui.button("Remove", on_click=lambda _, one=favourite: forget(one)).props(
                        "flat dense no-caps size=sm"
                    )

    forgotten: list[Favourite] = []
    with ui.row().classes("items-center gap-2"):
        note = ui.input("Note").props(f"dense maxlength={MAX_NOTE}")
        ui.button("Keep as favourite", on_click=add).props("dense no-caps outline")
        undo = ui.button("Undo removal", on_click=restore).props("dense no-caps flat")
        undo.set_visibility(False)
    shelf = ui.row().classes("gap-2")  # no `ui.refreshable`: it would hold the last tab for ever
    tab.refresh_favourites = listed
    listed()
