"""The panels beside map and robot: finding movements, import and export, favourites."""

from __future__ import annotations

import tempfile
import weakref
from base64 import b64encode
from collections.abc import Sequence
from pathlib import Path, PurePath

import numpy as np
from nicegui import events, run, ui

from creative_nao.errors import CreativeNaoError, FileFormatError
from creative_nao.exchange import FORMATS, Motion, Recording, recognise, write
from creative_nao.exchange.keys import to_motion
from creative_nao.explorer.map_pane import Mark
from creative_nao.explorer.memory_service import MemoryService, Recall, less_like, more_like, spoken, surprise, way
from creative_nao.explorer.state import MAX_NOTE, Favourite
from creative_nao.explorer.tab import Tab
from creative_nao.joints import JOINTS
from creative_nao.maps.figure_style import action_colour

WIDTH, HEIGHT = 96, 56


def thumbnail(service: MemoryService, points: Sequence[tuple[float, float]]) -> str:
    """Return an SVG picture as a data address."""
    recall = service.recall(np.array(points))
    angles = recall.trajectory
    low, high = angles.min(), angles.max()
    y = HEIGHT - 4 - (angles - low) / max(high - low, 1e-9) * (HEIGHT - 8)
    x = np.linspace(2, WIDTH - 2, len(angles))
    lines = "".join(
        f'<polyline points="{" ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, column, strict=True))}"/>' for column in y.T
    )
    colour = action_colour(recall.nearest)
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}">'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/><rect width="{WIDTH}" height="3" fill="{colour}"/>'
        f'<g fill="none" stroke="#22262B" stroke-width="0.8">{lines}</g></svg>'
    )
    return f"data:image/svg+xml;base64,{b64encode(svg.encode()).decode()}"


MAX_UPLOAD_BYTES = 2_000_000
MAX_TICKS = 2000
_ENDINGS = {ending for one in FORMATS.values() for ending in one.endings}


def read_upload(name: str, content: bytes, dt_s: float) -> Recording:
    """Read an uploaded movement at a tick [s]; of its name only a known ending counts, and no file is made.

    Raises:
        FileFormatError: If it is too large or too long, or holds no movement.
        SettingsError: If its format is not recognised.
    """
    if len(content) > MAX_UPLOAD_BYTES:
        raise FileFormatError(f"a recording may have {MAX_UPLOAD_BYTES} bytes, this one has {len(content)}")
    ending = PurePath(name).suffix.lower()
    source = Path(f"recording{ending if ending in _ENDINGS else '.csv'}")
    format_name = recognise(source, content)
    motion, notes = to_motion(FORMATS[format_name].read(source, content), source, dt_s, JOINTS)
    if not 2 <= len(motion.angles) <= MAX_TICKS:
        raise FileFormatError(
            f"a recording should have 2 to {MAX_TICKS} ticks of {dt_s} s, but has {len(motion.angles)}"
        )
    return Recording(motion, format_name, notes)


def export(recall: Recall, service: MemoryService, format_name: str) -> tuple[str, bytes, tuple[str, ...]]:
    """Return file name, content and changes of a movement in one of the exchange formats.

    A movement too fast or too wide is clipped and slowed down for formats that a robot plays, and kept otherwise.
    """
    one = FORMATS[format_name]
    metadata = {"memory": service.memory.name, "pb": [list(map(float, point)) for point in recall.points]}
    motion = Motion(recall.trajectory, service.memory.dt_s, JOINTS, metadata if one.holds_metadata else {})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"movement{one.endings[0]}"
        done = write(path, motion, format_name, unsafe="clip" if one.for_robots else "keep")
        return path.name, path.read_bytes(), done.changes


def discovery(tab: Tab) -> None:
    """Lay out the buttons that find movements."""

    async def show_surprise() -> None:
        await tab.show(surprise(tab.app_state.progressive_map.chart, tab.rng)[None])

    async def more() -> None:
        await tab.show(more_like(tab.app_state.progressive_map.chart, _liked(tab), tab.rng)[None])

    async def less() -> None:
        await tab.show(less_like(tab.app_state.progressive_map.chart, tab.points[-1:], tab.rng)[None])

    async def walk() -> None:
        await tab.show(way(tab.service.memory.pb, int(start.value or 0), int(end.value or 0)))

    with ui.row().classes("items-center gap-2"):
        for text, action in (
            ("Surprise me", show_surprise), ("More like this", more), ("Less like this", less), ("Back", tab.back),
        ):  # fmt: skip
            ui.button(text, on_click=action).props("dense no-caps outline")
    names = {place: spoken(name) for place, name in enumerate(tab.service.names)}
    with ui.row().classes("items-center gap-2"):
        start = ui.select(names, value=0, label="A path from").props("dense options-dense").classes("w-32")
        end = ui.select(names, value=len(names) - 1, label="to").props("dense options-dense").classes("w-32")
        ui.button("Walk", on_click=walk).props("dense no-caps outline")


def _liked(tab: Tab) -> np.ndarray:
    kept = [one.points[-1] for one in tab.app_state.session.favourites(tab.key)]
    return np.array([tuple(tab.points[-1]), *kept[-3:]])


def exchange(tab: Tab) -> None:
    """Lay out export and import."""

    async def download(format_name: str) -> None:
        if tab.recall is None:
            return
        try:
            made = await run.io_bound(export, tab.recall, tab.service, format_name)
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
            max_file_size=MAX_UPLOAD_BYTES, max_files=1,
        )  # fmt: skip
        upload.on("rejected", lambda: ui.notify(f"A recording may have {MAX_UPLOAD_BYTES} bytes."))
        upload.props('flat bordered aria-label="Drop a recorded movement"').classes("w-60 cn-upload")


async def _recognise(tab: Tab, name: str, content: bytes) -> None:
    recording = await run.io_bound(read_upload, name, content, tab.service.memory.dt_s)
    if recording is None:
        return
    tab.status.text = "Recognising the recording ..."
    found = await run.io_bound(tab.service.recognise, recording.motion.angles)
    if found is None:
        return
    point, distance, recall = found
    tab.marks = [*(mark for mark in tab.marks if mark.letter != "R"), Mark((float(point[0]), float(point[1])), "R")]
    tab.points = point[None]
    tab.redraw()
    await tab.present(recall)
    tab.status.text = f"Recording, recognised at R with DTW {distance:.2f} rad left. {tab.status.text}"


def favourites(tab: Tab) -> None:
    """Lay out the favourites; a removed one can be kept again at once."""

    def forget(favourite: Favourite) -> None:
        if tab.change_favourites(tab.app_state.session.remove, favourite):
            undo.set_visibility(True)
            forgotten.append(favourite)

    def restore() -> None:
        if forgotten and tab.change_favourites(tab.app_state.session.add, forgotten[-1]):
            forgotten.pop()
        undo.set_visibility(bool(forgotten))

    def add() -> None:
        tab.keep_favourite(note.value or "")
        note.value = ""

    async def recall(favourite: Favourite) -> None:
        await tab.show(np.array(favourite.points))
        if favourite.beside in tab.app_state.registry.names and favourite.beside != tab.beside:
            tab.go_beside(favourite.beside)

    def listed() -> None:
        cards.clear()
        with cards:
            for favourite in tab.app_state.session.favourites(tab.key)[-24:]:
                with ui.card().classes("p-1 gap-0 items-center"):
                    picture = ui.image(thumbnail(tab.service, favourite.points)).classes("w-24 h-14 cursor-pointer")
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
    cards = ui.row().classes("gap-2")  # no `ui.refreshable`: it would hold the last tab for ever
    tab.refresh_favourites = listed
    listed()
