"""What one browser tab shows and does; all of it ends with the tab."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from nicegui import background_tasks, events, run, ui

from creative_nao.errors import CreativeNaoError
from creative_nao.explorer.map_pane import MapPane, MapState, as_pixel
from creative_nao.explorer.markup import curves_svg, marks_svg, strip_html
from creative_nao.explorer.memory_service import Recall, describe, surprise
from creative_nao.explorer.physics_service import PhysicsService, angles_message, robot_scene
from creative_nao.explorer.registry import NONE, LoadedMemory, MemoryRegistry
from creative_nao.explorer.state import MAX_NOTE, MAX_POINTS, Favourite, PageAddress, Session
from creative_nao.explorer.view import View

STEP = 2.0  # how much nearer a key or a button brings
_ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, 1), "ArrowDown": (0, -1)}
MAX_FACTOR = 16  # how far one turn of a wheel may zoom
_ZOOMS = {"+": STEP, "=": STEP, "-": 1 / STEP}
_KEYS = "['ArrowLeft','ArrowRight','ArrowUp','ArrowDown','0','1','2','3','4','5','6','r','s','u','+','=','-']"
_TOUCHED = "(e) => { if (!window.mapPinch && ((e.buttons & 1) || e.mouse_event_type === 'pointerup')) emit(e) }"
_HOVERED = "(e) => { if (!e.buttons) emit(e) }"
_PRESSED = f"(e) => {{ if ({_KEYS}.includes(e.key) && !e.ctrlKey && !e.metaKey) {{ e.preventDefault(); emit(e) }} }}"


@dataclass
class AppState:
    """What all tabs share: the memories with their maps, the robot and the favourites."""

    registry: MemoryRegistry
    physics_service: PhysicsService
    session: Session
    agent_points: np.ndarray | None = None  # of a run folder's agents, shape (n, 2)
    taught: str = ""  # name of the trainer that the memory is of, if it was taught in the page


class MemoryPanel:
    """One memory in a tab: its map, its robot, and the movement shown, `recall`, in words and curves."""

    def __init__(self, loaded: LoadedMemory) -> None:
        self.loaded = loaded
        self.map = MapPane(loaded)
        self.recall: Recall | None = None
        self._movement: tuple[dict[str, Any], dict[str, Any] | None] | None = None
        self.ghost_shown = True  # whether the nearest basic action is seen

    def build_robot(self, physics_service: PhysicsService) -> None:
        """Lay the robot out."""
        label = f"The robot performing the movement of memory {self.loaded.name}"
        self.robot = robot_scene(physics_service.robot, self.replay, label)

    def build_description(self) -> None:
        """Lay out the movement in words and curves."""
        self.status = ui.label("The robot remembers ...").classes("cn-status")
        self.status.props("role=status aria-live=polite").mark("status")
        self.curves = ui.html("", sanitize=False).classes("w-full")  # numbers and fixed names only

    def present(self, recall: Recall, digits: int = 3) -> None:
        """Show a movement that has been made or recognised; its PB is written with so many decimals."""
        memory = self.loaded.service.memory
        basic = memory.demonstrations.trajectories[recall.nearest]
        self.recall = recall
        self._movement = angles_message(recall.trajectory, memory.dt_s), angles_message(basic, memory.dt_s)
        self.replay()
        self.status.text = describe(recall, self.loaded.service, digits)
        self.curves.content = curves_svg(recall, self.loaded.service) + strip_html(recall, self.loaded.service)

    async def perform(self, physics_service: PhysicsService) -> None:
        """Let the simulated robot perform the movement shown, and say what its body made of it."""
        recall = self.recall
        if recall is None:
            return
        dt_s = self.loaded.service.memory.dt_s
        performed = await run.io_bound(physics_service.perform, recall.trajectory, dt_s)
        if performed is not None and recall is self.recall:
            self._movement = performed[0], None
            self.replay()
            self.status.text = f"{self.status.text}; {performed[1]}"

    def replay(self) -> None:
        """Let the browser play the movement again."""
        if self._movement is not None:
            movement, ghost = self._movement
            self.robot.perform(movement, ghost if self.ghost_shown else None)


class Tab:
    """One browser tab. Its attributes are its user's state; a memory `beside` follows every step of the first."""

    mode: ui.toggle  # whether a click goes to a point or draws a path
    pb_1: ui.number
    pb_2: ui.number
    physics: ui.switch  # whether the movement is performed in physics

    def __init__(
        self, app_state: AppState, place: PageAddress, beside: LoadedMemory | None, closed: Callable[[], object]
    ) -> None:
        self._closed = closed
        self.app_state = app_state
        self.first = app_state.registry.first  # the memory that letters, surprises and favourites are of
        self.client = ui.context.client
        self.beside = beside.name if beside is not None else NONE if app_state.registry.beside else ""
        self.rng = np.random.default_rng()
        self.points = place.points
        self.memory_panels = [MemoryPanel(loaded) for loaded in (self.first, beside) if loaded is not None]
        self.map_state = MapState([panel.map for panel in self.memory_panels], self._maps_changed)
        self.map_state.set(place.view, place.colour)
        self.marks: dict[str, Sequence[float]] = {}
        self.trail: list[np.ndarray] = []
        self.refresh_favourites: Callable[[], object] = lambda: None
        self.refresh_toolbar: Callable[[], object] = lambda: None
        self.drawing: list[tuple[float, float]] = []
        self._latest = 0

    def close(self) -> None:
        """End the tab's work and drop what it holds; what is still being computed is not shown any more."""
        self._closed()
        self.map_state.cancel()
        self._latest += 1
        self.marks, self.trail, self.drawing = {}, [], []

    async def open(self) -> None:
        """Show what the address asks for."""
        await self.show(self.points, keep=False)
        await self.map_state.work()

    async def show(self, points: np.ndarray, keep: bool = True) -> None:
        """Let the robot do what lies at a point or along a path; the last call wins."""
        self._latest += 1
        if keep and len(self.trail) < 1000:
            self.trail.append(self.points)
        self.points = np.asarray(points, dtype=np.float64)
        self.redraw()
        await self.present()

    async def present(self, *recalls: Recall) -> None:
        """Show movements that were recognised; a memory of which there is none is asked for its own."""
        number = self._latest
        for panel in self.memory_panels[len(recalls) :]:
            recall = await run.io_bound(panel.loaded.service.recall, self.points)
            recalls = (*recalls, recall) if recall is not None else recalls
        if number != self._latest or not recalls:
            return
        digits = self.memory_panels[0].map.frame().digits
        for panel, recall in zip(self.memory_panels, recalls, strict=False):
            panel.present(recall, digits)
        pb = recalls[0].pb
        self.pb_1.value, self.pb_2.value = round(pb[0], digits), round(pb[1], digits)
        self.remember()
        self._follow()
        for panel in self.memory_panels if self.physics.value else ():
            if number == self._latest:
                await panel.perform(self.app_state.physics_service)

    def remember(self) -> None:
        """Write into the address where we are."""
        self.client.run_javascript(f'history.replaceState({{}}, "", {json.dumps(self.address(self.beside))})')

    def address(self, beside: str) -> str:
        """Return the address of where we are, with a second memory of this name beside."""
        state = self.map_state
        return PageAddress(self.points, beside, state.view, state.colour, self.app_state.taught).address()

    def redraw(self) -> None:
        """Draw the marks on the maps anew."""
        points = np.array(self.drawing) if self.drawing else self.points
        for place, panel in enumerate(self.memory_panels):
            agent_points = self.app_state.agent_points if place == 0 else None
            learned_pb = panel.loaded.service.memory.pb
            panel.map.image.content = marks_svg(panel.map.frame(), learned_pb, points, self.marks, agent_points)

    def go_beside(self, name: str) -> None:
        """Open the page anew, where it is, with another memory beside or, by `registry.NONE`, without."""
        ui.navigate.to(self.address("" if name == NONE and not self.app_state.registry.beside else name))

    async def back(self) -> None:
        """Go back to where we were before."""
        if self.trail:
            await self.show(self.trail.pop(), keep=False)

    async def zoom(self, factor: float, around: tuple[float, float] | None = None) -> None:
        """Go so many times nearer to a PB point, by default to the one shown or, if it is out of sight, the middle."""
        frame = self.memory_panels[0].map.frame()
        here = (float(self.points[-1, 0]), float(self.points[-1, 1]))
        if around is None:
            around = here if frame.shows(here) else (frame.left + frame.width / 2, frame.bottom + frame.width / 2)
        await self.look_at(frame.zoomed(factor, around), self.map_state.colour)

    async def look_at(self, view: View | None, colour: str) -> None:
        """Show a window of the map, or with None the whole, in some colours."""
        if (view, colour) != (self.map_state.view, self.map_state.colour):
            self.map_state.set(view, colour)
            self.remember()
            await self.map_state.work()

    def _follow(self) -> None:
        """Bring a window along to where the movement shown lies."""
        view = self.map_state.view
        if view is None or all(view.shows(point) for point in self.points):
            return
        moved = view.following(self.points[-1]) if len(self.points) == 1 else None
        background_tasks.create(self.look_at(moved, self.map_state.colour))

    def _maps_changed(self) -> None:
        self.refresh_toolbar()
        self.redraw()

    def build_map(self, pane: MapPane) -> None:
        """Lay one of the maps out; what a person does to it comes here."""
        pane.build()
        image = pane.image
        image.on("mouse", lambda e: self.touched(pane, e), throttle=0.06, js_handler=_TOUCHED)
        image.on("mouse", lambda e: self.hovered(pane, e), throttle=0.15, js_handler=_HOVERED)
        image.on("keydown", self.pressed, args=["key", "shiftKey"], throttle=0.03, js_handler=_PRESSED)
        image.on("mapzoom", lambda e: self.zoomed(pane, e), js_handler="(e) => emit(e.detail)")

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
        for panel in self.memory_panels:
            panel.map.describe(pane.pb_of(event), self.map_state.colour)

    async def zoomed(self, pane: MapPane, event: events.GenericEventArguments) -> None:
        """Zoom by wheel or fingers."""
        x, y, factor = (event.args.get(key) for key in ("image_x", "image_y", "factor"))
        if isinstance(factor, int | float) and 1 / MAX_FACTOR <= factor <= MAX_FACTOR:
            await self.zoom(factor, pane.frame().to_pb(as_pixel(x), as_pixel(y)))

    async def pressed(self, event: events.GenericEventArguments) -> None:
        """Do what a key says."""
        key = str(event.args.get("key"))
        if key in _ARROWS:
            cell = np.ptp(self.memory_panels[0].map.finest().pb[:2, 0])
            moved = self.points[-1] + cell * (10 if event.args.get("shiftKey") else 1) * np.array(_ARROWS[key])
            await self.show(np.clip(moved, -1, 1)[None], keep=False)
        elif key in _ZOOMS:
            await self.zoom(_ZOOMS[key])
        elif key == "0":
            await self.look_at(None, self.map_state.colour)
        elif key.isdigit() and int(key) <= len(self.first.service.names):
            await self.show(self.first.service.memory.pb[int(key) - 1][None])
        elif key == "r":
            await self.show(surprise(self.first.pb_map, self.rng)[None])
        elif key == "u":
            await self.back()
        elif key == "s":
            await self.keep_favourite()

    async def keep_favourite(self, note: str = "") -> None:
        """Keep the movement shown as a favourite."""
        if self.memory_panels[0].recall is not None:
            points = tuple((float(x), float(y)) for x, y in self.points)
            beside = self.memory_panels[1].loaded.name if len(self.memory_panels) > 1 else ""
            favourite = Favourite(self.first.key, points, note[:MAX_NOTE], beside)
            await self.change_favourites(self.app_state.session.add, favourite)

    async def change_favourites(self, change: Callable[[Favourite], None], favourite: Favourite) -> bool:
        """Change the favourites and show them; tell the user when they cannot be written."""
        try:
            await run.io_bound(change, favourite)
        except (OSError, CreativeNaoError) as error:
            ui.notify(f"The favourites stay as they were: {error}", type="negative")
            return False
        self.refresh_favourites()
        return True
