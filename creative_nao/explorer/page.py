"""The page of one browser tab: map left, robot and curves right. What it holds dies with the tab.

Also here:
- The bar above the maps: a second memory beside the first, colours, zoom, and how far the finer cells are.
- Where things stand on the page: one memory with its robot beside the map, or two memories side by side.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from nicegui import background_tasks, events, run, ui

from creative_nao.explorer import panels
from creative_nao.explorer.colours import NAMES, is_of_body
from creative_nao.explorer.map_pane import KEYS_HELP, Look, MapPane, Mark, as_pixel
from creative_nao.explorer.memory_panel import Side
from creative_nao.explorer.memory_service import Mind, Recall, as_coordinate
from creative_nao.explorer.physics_service import Stage, player_controls
from creative_nao.explorer.registry import NONE, Charting, Shelf, Subject
from creative_nao.explorer.state import MAX_POINTS, Place, Session
from creative_nao.explorer.view import ALL, View

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


def alone(tab: Tab) -> None:
    """Lay one memory out: map left, robot and curves right, on a phone one below the other."""
    (side,) = tab.sides
    with ui.element("div").classes("cn-page"):
        with _area("map"):
            side.map.build(tab)
        with _area("robot"):
            side.build_robot(tab.exhibit.stage)
            tab.build_player()
            side.build_told()
            panels.favourites(tab)
        with _area("tools"):
            tab.build_tools()


def twin(tab: Tab) -> None:
    """Lay two memories out in two columns, on a phone one below the other; one player drives both robots."""
    with ui.element("div").classes("cn-page cn-twin"):
        for number, side in enumerate(tab.sides, start=1):
            with _area("map", number):
                ui.label(f"Memory {side.subject.name}").classes("cn-name-of-side")
                side.map.build(tab)
        for number, side in enumerate(tab.sides, start=1):
            with _area("robot", number):
                side.build_robot(tab.exhibit.stage)
        with _area("player"):
            tab.build_player()
        for number, side in enumerate(tab.sides, start=1):
            with _area("told", number):
                ui.label(f"Memory {side.subject.name}").classes("cn-name-of-side")
                side.build_told()
        with _area("tools"):
            tab.build_tools()
        with _area("keep"):
            panels.favourites(tab)


def _area(name: str, number: int = 1) -> ui.element:
    return ui.element("div").classes(f"cn-at-{name}{number if number > 1 else ''}")


STATIC = Path(__file__).with_name("static")
_ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, 1), "ArrowDown": (0, -1)}
MAX_FACTOR = 16
"""How far one turn of a wheel may zoom."""
_ZOOMS = {"+": STEP, "=": STEP, "-": 1 / STEP}


@dataclass
class Exhibit:
    """What all tabs share: the memories with their maps, the robot and the favourites."""

    shelf: Shelf
    stage: Stage
    session: Session
    crowd: np.ndarray | None = None
    """Points of a run folder's agents, shape (n, 2)."""
    taught: str = ""
    """Name of the apprentice that the memory is of, if it was taught in the page."""

    @property
    def mind(self) -> Mind:
        """The memory that the page is about."""
        return self.shelf.first.mind

    @property
    def charting(self) -> Charting:
        """Its map."""
        return self.shelf.first.charting


class Tab:
    """One browser tab. Its attributes are its user's state.

    Args:
        exhibit: What it shares with all tabs.
        place: Where it is.
        beside: A second memory that follows every step beside the first.
    """

    def __init__(self, exhibit: Exhibit, place: Place | None = None, beside: Subject | None = None) -> None:
        place = Place() if place is None else place
        self.exhibit = exhibit
        self.mind = exhibit.mind
        self.key = exhibit.shelf.first.key
        self.client = ui.context.client
        self.beside = beside.name if beside is not None else NONE if exhibit.shelf.beside else ""
        self.rng = np.random.default_rng()
        self.points = place.points
        self.sides = [Side(subject) for subject in (exhibit.shelf.first, beside) if subject is not None]
        self.toolbar = Toolbar(self)
        self.look = Look([side.map for side in self.sides], self._looked)
        self.look.set(place.view, place.colour)
        self.marks: list[Mark] = []
        self.trail: list[np.ndarray] = []
        self.refresh_favourites: Callable[[], object] = lambda: None
        self.drawing: list[tuple[float, float]] = []
        self._numbers = itertools.count(1)
        self._latest = 0

    @property
    def recall(self) -> Recall | None:
        """The movement of the first memory."""
        return self.sides[0].recall

    def build(self) -> None:
        """Lay the page out."""
        ui.page_title("Memory explorer")
        ui.add_css((STATIC / "page.css").read_text(encoding="utf-8"))
        ui.add_body_html(f"<script>{(STATIC / 'zoom.js').read_text(encoding='utf-8')}</script>")
        self.dark = ui.dark_mode(None)
        ui.label(" and ".join(f"Memory {side.subject.name}" for side in self.sides)).classes("text-lg")
        self.toolbar.build()
        (alone if len(self.sides) == 1 else twin)(self)
        self.status = self.sides[0].status
        if not all(side.subject.charting.finished.is_set() for side in self.sides):
            self.poll = ui.timer(1.0, self._finer)

    def build_player(self) -> None:
        """Lay out what plays the robots."""
        with ui.row().classes("w-full items-center gap-2"):
            player_controls()
            self.physics = ui.switch("Physics", on_change=lambda: self.show(self.points, keep=False))
            ui.switch("Ghost of the nearest", value=True, on_change=self._ghosts)

    def build_tools(self) -> None:
        """Lay out the tools: point or path, numbers, discovering, exchanging."""
        with ui.row().classes("items-center gap-2"):
            self.mode = ui.toggle(["point", "path"], value="point").props("no-caps dense aria-label='click or draw'")
            self.pb_1, self.pb_2 = (
                ui.number(name, value=0, min=-1, max=1, step=0.01, format="%.3f").props("dense").classes("w-24")
                for name in ("PB 1", "PB 2")
            )
            ui.button("Go", on_click=self._typed).props("dense no-caps")
        panels.discovery(self)
        panels.exchange(self)

    def close(self) -> None:
        """End the tab's work and let go of what it holds; what is still being computed is not shown any more."""
        self.look.call_off()
        self._latest = next(self._numbers)
        self.marks, self.trail, self.drawing = [], [], []

    async def open(self) -> None:
        """Show what the address asks for."""
        await self.show(self.points, keep=False)
        await self.look.work()

    async def show(self, points: np.ndarray, keep: bool = True) -> None:
        """Let the robot do what lies at a point or along a path; the last call wins."""
        self._latest = number = next(self._numbers)
        if keep and len(self.trail) < 1000:
            self.trail.append(self.points)
        self.points = np.asarray(points, dtype=np.float64)
        self.redraw()
        recalls = [await run.io_bound(side.subject.mind.recall, self.points) for side in self.sides]
        if number == self._latest:
            await self.present(*(one for one in recalls if one is not None))

    async def present(self, *recalls: Recall) -> None:
        """Show movements that have been made or recognised; a memory of which there is none is asked for its own."""
        number = self._latest
        for side in self.sides[len(recalls) :]:
            made = await run.io_bound(side.subject.mind.recall, self.points)
            recalls = (*recalls, made) if made is not None else recalls
        if number != self._latest:
            return
        digits = self.sides[0].map.frame().digits
        for side, recall in zip(self.sides, recalls, strict=False):
            side.present(recall, digits)
        pb = recalls[0].pb
        self.pb_1.value, self.pb_2.value = round(pb[0], digits), round(pb[1], digits)
        self.remember()
        self._follow()
        for side in self.sides if self.physics.value else ():
            if number == self._latest:
                await side.perform(self)

    def remember(self) -> None:
        """Write into the address where we are."""
        address = Place(self.points, self.beside, self.look.view, self.look.colour, self.exhibit.taught).address()
        self.client.run_javascript(f'history.replaceState({{}}, "", {json.dumps(address)})')

    def redraw(self) -> None:
        """Draw the marks on the maps anew."""
        points = np.array(self.drawing) if self.drawing else self.points
        for side in self.sides:
            side.map.redraw(points, self)

    def go_beside(self, name: str) -> None:
        """Open the page anew, where it is, with another memory beside or, by `shelf.NONE`, without."""
        if name == NONE and not self.exhibit.shelf.beside:
            name = ""
        ui.navigate.to(Place(self.points, name, self.look.view, self.look.colour, self.exhibit.taught).address())

    async def back(self) -> None:
        """Go back to where we were before."""
        if self.trail:
            await self.show(self.trail.pop(), keep=False)

    async def zoom(self, factor: float, around: tuple[float, float] | None = None) -> None:
        """Go so many times nearer to a PB point, by default to the one shown or, if it is out of sight, the middle."""
        frame = self.sides[0].map.frame()
        here = (float(self.points[-1, 0]), float(self.points[-1, 1]))
        if around is None:
            around = here if frame.shows(here) else (frame.left + frame.width / 2, frame.bottom + frame.width / 2)
        await self.look_at(frame.zoomed(factor, around), self.look.colour)

    async def look_at(self, view: View | None, colour: str) -> None:
        """Show a window of the map, or with None the whole, in some colours."""
        if (view, colour) != (self.look.view, self.look.colour):
            self.look.set(view, colour)
            self.remember()
            await self.look.work()

    def _follow(self) -> None:
        """Bring a window along to where the movement shown lies."""
        view = self.look.view
        if view is None or all(view.shows(point) for point in self.points):
            return
        moved = view.following(self.points[-1]) if len(self.points) == 1 else None
        background_tasks.create(self.look_at(moved, self.look.colour))

    def _looked(self) -> None:
        self.toolbar.tell()
        self.redraw()

    async def touched(self, pane: MapPane, event: events.GenericEventArguments) -> None:
        """Go to the point under the pointer, or draw."""
        kind, pb = event.args.get("mouse_event_type"), pane.pb_of(event)
        if self.mode.value == "point":
            if kind != "pointerup":
                await self.show(np.array([pb]), keep=kind == "pointerdown")
            return
        if kind == "pointerdown":
            self.drawing = [pb]
        elif self.drawing and pb != self.drawing[-1] and len(self.drawing) < MAX_POINTS:
            self.drawing.append(pb)
        if kind == "pointerup" and self.drawing:
            drawn, self.drawing = np.array(self.drawing), []
            await self.show(drawn)
        else:
            self.redraw()

    def hovered(self, pane: MapPane, event: events.GenericEventArguments) -> None:
        """Say what lies under the pointer, in every memory."""
        pb = pane.pb_of(event)
        for side in self.sides:
            side.map.tell(pb, self.look.colour)

    async def zoomed(self, pane: MapPane, event: events.GenericEventArguments) -> None:
        """Zoom by wheel or fingers."""
        x, y, factor = (event.args.get(key) for key in ("image_x", "image_y", "factor"))
        if isinstance(factor, int | float) and 1 / MAX_FACTOR <= factor <= MAX_FACTOR:
            await self.zoom(factor, pane.frame().to_pb(as_pixel(x), as_pixel(y)))

    async def pressed(self, event: events.GenericEventArguments) -> None:
        """Do what a key says."""
        key = str(event.args.get("key"))
        if key in _ARROWS:
            step = self.sides[0].map.cell() * (10 if event.args.get("shiftKey") else 1)
            moved = self.points[-1] + step * np.array(_ARROWS[key])
            await self.show(np.clip(moved, -1, 1)[None], keep=False)
        elif key in _ZOOMS:
            await self.zoom(_ZOOMS[key])
        elif key == "0":
            await self.look_at(None, self.look.colour)
        elif key.isdigit() and int(key) <= len(self.mind.names):
            await self.show(self.mind.memory.pb[int(key) - 1][None])
        elif key == "r":
            await self.show(panels.surprise(self.exhibit.charting.chart, self.rng)[None])
        elif key == "u":
            await self.back()
        elif key == "s":
            panels.keep(self)

    async def _typed(self) -> None:
        await self.show(np.array([[as_coordinate(self.pb_1.value), as_coordinate(self.pb_2.value)]]))

    def _ghosts(self, event: events.ValueChangeEventArguments[bool | None]) -> None:
        for side in self.sides:
            side.ghost(bool(event.value))

    async def _finer(self) -> None:
        if all(side.subject.charting.finished.is_set() for side in self.sides):
            self.poll.deactivate()
            await self.look.work()

    def theme(self) -> None:
        """Change between dark and light."""
        self.dark.value = not self.dark.value
