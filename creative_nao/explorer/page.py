"""The page of one browser tab: map left, robot and curves right. What it holds dies with the tab."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from nicegui import background_tasks, events, run, ui

from creative_nao.explorer import discover, layout, panels
from creative_nao.explorer.address import Place
from creative_nao.explorer.charting import Charting
from creative_nao.explorer.look import Look
from creative_nao.explorer.map_pane import MapPane, as_pixel
from creative_nao.explorer.map_view import Mark
from creative_nao.explorer.mind import Mind, Recall, as_coordinate
from creative_nao.explorer.robot_view import player_controls
from creative_nao.explorer.session import MAX_POINTS, Session
from creative_nao.explorer.shelf import NONE, Shelf
from creative_nao.explorer.side import Side
from creative_nao.explorer.stage import Stage
from creative_nao.explorer.subject import Subject
from creative_nao.explorer.toolbar import STEP, Toolbar
from creative_nao.explorer.view import View

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
        (layout.alone if len(self.sides) == 1 else layout.twin)(self)
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
            await self.show(discover.surprise(self.exhibit.charting.chart, self.rng)[None])
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
