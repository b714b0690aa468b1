"""The panels beside map and robot: discovering, exchanging, favourites.

Also here:
- Finding movements: a surprise, more or less like this one, and a way from one basic action to another.
- A movement at a glance: its eight joints as tiny lines on the colour of the nearest basic action.
- Movements into and out of the page: uploads are parsed in memory, downloads are made in a folder of our own.
"""

from __future__ import annotations

import tempfile
import weakref
from base64 import b64encode
from collections.abc import Callable, Sequence
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

import numpy as np
from nicegui import events, run, ui

from creative_nao.errors import CreativeNaoError, FileFormatError, SettingsError
from creative_nao.exchange import FORMATS, Motion, Recording, recognise, write
from creative_nao.exchange.keys import to_motion
from creative_nao.explorer.map_pane import Mark
from creative_nao.explorer.memory_service import Mind, Recall, spoken
from creative_nao.explorer.state import MAX_NOTE, Favourite
from creative_nao.joints import JOINTS
from creative_nao.maps import PBMap
from creative_nao.maps.colours import action_colour

if TYPE_CHECKING:
    from creative_nao.explorer.page import Tab


NEAR = 0.12
"""How far `more_like` steps, as standard deviation in each PB unit."""
FAR_SHARE = 0.9
"""`less_like` draws from the farthest tenth."""


def surprise(chart: PBMap, rng: np.random.Generator) -> np.ndarray:
    """Return a random point whose movement is appropriate and new, shape (2,).

    Raises:
        SettingsError: If the map has no such point.
    """
    return _draw(chart, (chart.outcome == "unlearned").astype(float), rng)


def more_like(chart: PBMap, liked: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an appropriate point near one of those liked, shape (n, 2): a mutated child of one of them."""
    parent = liked[rng.integers(len(liked))]
    squared = ((chart.pb - parent) ** 2).sum(axis=1) / NEAR**2
    return _draw(chart, np.where(squared > 1e-12, np.exp(-squared / 2), 0.0) * chart.appropriate, rng)


def less_like(chart: PBMap, shunned: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an appropriate point far from all of those shunned, shape (n, 2)."""
    distance = np.min([((chart.pb - one) ** 2).sum(axis=1) for one in shunned], axis=0)
    usable = np.flatnonzero(chart.appropriate)
    weight = np.zeros(len(chart.pb))
    if usable.size:
        weight[usable] = distance[usable] >= np.quantile(distance[usable], FAR_SHARE)
    return _draw(chart, weight, rng)


def way(learned_pb: np.ndarray, first: int, last: int) -> np.ndarray:
    """Return the path from one basic action's point to another's, shape (2, 2)."""
    return np.array([learned_pb[first], learned_pb[last]])


def _draw(chart: PBMap, weight: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    total = float(weight.sum())
    if not total > 0:
        raise SettingsError("this memory's map has no such movement")
    return chart.pb[rng.choice(len(weight), p=weight / total)].copy()


WIDTH, HEIGHT = 96, 56


def thumbnail(mind: Mind, points: Sequence[tuple[float, float]]) -> str:
    """Return an SVG picture as a data address."""
    recall = mind.recall(np.array(points))
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


def export(recall: Recall, mind: Mind, format_name: str) -> tuple[str, bytes, tuple[str, ...]]:
    """Return file name, content and changes of a movement in one of the exchange formats.

    A movement too fast or too wide is clipped and slowed down for formats that a robot plays, and kept otherwise.
    """
    one = FORMATS[format_name]
    metadata = {"memory": mind.memory.name, "pb": [list(map(float, point)) for point in recall.points]}
    motion = Motion(recall.trajectory, mind.memory.dt_s, JOINTS, metadata if one.holds_metadata else {})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"movement{one.endings[0]}"
        done = write(path, motion, format_name, unsafe="clip" if one.for_robots else "keep")
        return path.name, path.read_bytes(), done.changes


def discovery(tab: Tab) -> None:
    """Lay out the buttons that find movements."""

    async def show_surprise() -> None:
        await tab.show(surprise(tab.exhibit.charting.chart, tab.rng)[None])

    async def more() -> None:
        await tab.show(more_like(tab.exhibit.charting.chart, _liked(tab), tab.rng)[None])

    async def less() -> None:
        await tab.show(less_like(tab.exhibit.charting.chart, tab.points[-1:], tab.rng)[None])

    async def walk() -> None:
        await tab.show(way(tab.mind.memory.pb, int(start.value or 0), int(end.value or 0)))

    with ui.row().classes("items-center gap-2"):
        for text, action in (
            ("Surprise me", show_surprise), ("More like this", more), ("Less like this", less), ("Back", tab.back),
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
            made = await run.io_bound(export, tab.recall, tab.mind, format_name)
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
    recording = await run.io_bound(read_upload, name, content, tab.mind.memory.dt_s)
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
