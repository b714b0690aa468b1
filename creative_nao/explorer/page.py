"""The page of one browser tab: map left, robot and curves right. What it holds dies with the tab."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import events, run, ui
from nicegui.elements.scene.scene_object3d import Object3D

from creative_nao.explorer import discover, panels
from creative_nao.explorer.attribution_strip import strip_html
from creative_nao.explorer.body import angles_message
from creative_nao.explorer.charting import Charting
from creative_nao.explorer.curves import curves_svg
from creative_nao.explorer.map_view import COLOURINGS, Mark, map_address, overlay, to_pb
from creative_nao.explorer.maps import content_hash
from creative_nao.explorer.mind import Mind, Recall, as_coordinate
from creative_nao.explorer.session import MAX_POINTS, Session
from creative_nao.explorer.stage import Stage
from creative_nao.explorer.words import OUTCOME_WORDS, describe, spoken
from creative_nao.pb_space import nearest_cell
from creative_nao.pb_space.palette import action_letter

STATIC = Path(__file__).with_name("static")
KEYS_HELP = "arrow keys move by one cell, with Shift by ten; 1 to 6 go to a basic action; Space pauses; R surprises; "
KEYS_HELP += "S keeps; U goes back"
_ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, 1), "ArrowDown": (0, -1)}
_KEYS = "['ArrowLeft','ArrowRight','ArrowUp','ArrowDown','1','2','3','4','5','6','r','s','u']"


@dataclass
class Exhibit:
    """What all tabs share: the memory, its map, the robot and the favourites."""

    mind: Mind
    charting: Charting
    stage: Stage
    session: Session
    crowd: np.ndarray | None = None
    """Points of a run folder's agents, shape (n, 2)."""


class RobotView(Object3D, component=STATIC / "robot.js"):
    """The robot in the scene of a tab."""

    def __init__(self, description: dict[str, Any]) -> None:
        super().__init__(description)

    def perform(self, movement: dict[str, Any], ghost: dict[str, Any] | None) -> None:
        """Let the browser play a movement, with the nearest basic action as a ghost."""
        self.run_method("perform", movement, ghost)


class Tab:
    """One browser tab. Its attributes are its user's state."""

    def __init__(self, exhibit: Exhibit) -> None:
        self.exhibit = exhibit
        self.mind = exhibit.mind
        self.key = content_hash(exhibit.mind.memory)
        self.rng = np.random.default_rng()
        self.points = np.zeros((1, 2))
        self.recall: Recall | None = None
        self.movement: tuple[dict[str, Any], dict[str, Any] | None] | None = None
        self.marks: list[Mark] = []
        self.trail: list[np.ndarray] = []
        self.refresh_favourites: Callable[[], object] = lambda: None
        self.drawing: list[tuple[float, float]] = []
        self._numbers = itertools.count(1)
        self._latest = 0

    def build(self) -> None:
        """Lay the page out."""
        ui.page_title("Memory explorer")
        ui.add_css((STATIC / "page.css").read_text(encoding="utf-8"))
        self.dark = ui.dark_mode(None)
        with ui.row().classes("w-full items-center justify-between"):
            ui.label(f"Memory {self.mind.memory.name}").classes("text-lg")
            with ui.row().classes("items-center"):
                ui.button("Keys", on_click=lambda: ui.notify(KEYS_HELP)).props("flat no-caps dense")
                ui.button("Dark / light", on_click=self._theme).props("flat no-caps dense")
        with ui.element("div").classes("cn-page"):
            with ui.element("div").classes("cn-at-map"):
                self._build_map()
            with ui.element("div").classes("cn-at-robot"):
                self._build_robot()
                self.status = ui.label("The robot remembers ...").classes("cn-status")
                self.status.props("role=status aria-live=polite").mark("status")
                self.curves = ui.html("", sanitize=False).classes("w-full")  # numbers and fixed names only
                panels.favourites(self)
            with ui.element("div").classes("cn-at-tools"):
                self._build_tools()
        if not self.exhibit.charting.finished.is_set():
            self.poll = ui.timer(1.0, self._finer)

    def _build_map(self) -> None:
        chart = self.exhibit.charting.chart
        self.map = ui.interactive_image(map_address(chart), events=["pointerdown", "pointermove", "pointerup"])
        label = f"Map of the PB space: {KEYS_HELP}"
        self.map.classes("cn-map").mark("map").props(f'tabindex=0 role=application aria-label="{label}"')
        touched = "(e) => { if ((e.buttons & 1) || e.mouse_event_type === 'pointerup') emit(e) }"
        self.map.on("mouse", self._touched, throttle=0.06, js_handler=touched)
        self.map.on("mouse", self._hovered, throttle=0.15, js_handler="(e) => { if (!e.buttons) emit(e) }")
        pressed = (
            f"(e) => {{ if ({_KEYS}.includes(e.key) && !e.ctrlKey && !e.metaKey) {{ e.preventDefault(); emit(e) }} }}"
        )
        self.map.on("keydown", self._pressed, args=["key", "shiftKey"], throttle=0.03, js_handler=pressed)
        self.hover = ui.label("").classes("cn-hover text-sm")

    def _build_tools(self) -> None:
        with ui.row().classes("items-center gap-2"):
            self.mode = ui.toggle(["point", "path"], value="point").props("no-caps dense aria-label='click or draw'")
            self.colouring = ui.select(list(COLOURINGS), value=COLOURINGS[0], label="Colour", on_change=self._recolour)
            self.colouring.props("dense options-dense").classes("w-36")
            self.first = (
                ui.number("PB 1", value=0, min=-1, max=1, step=0.01, format="%.3f").props("dense").classes("w-20")
            )
            self.second = (
                ui.number("PB 2", value=0, min=-1, max=1, step=0.01, format="%.3f").props("dense").classes("w-20")
            )
            ui.button("Go", on_click=self._typed).props("dense no-caps")
        panels.discovery(self)
        panels.exchange(self)
        with ui.expansion("Legend").classes("w-full"):
            for place, name in enumerate(self.mind.names):
                ui.label(f"{action_letter(place)}  {spoken(name)}").classes("text-sm")
            ui.label("strong colour: like the basic action; faint: new; hatched: too fast or not moving").classes(
                "text-sm"
            )

    def _build_robot(self) -> None:
        with ui.element("div").classes("cn-scene"):
            ui.label("The robot needs WebGL. Without it, the sentence and the curves below still tell all.").classes(
                "cn-behind"
            )
            camera = ui.scene.perspective_camera(fov=50)
            scene = ui.scene(grid=False, fps=240, background_color="#c9d3de", camera=camera).classes("w-full h-full")
            scene.props('role=img aria-label="The robot performing the movement"')
            with scene:
                self.robot = RobotView(self.exhibit.stage.body.description())
            scene.move_camera(x=0.62, y=-0.6, z=0.52, look_at_x=0.08, look_at_y=0, look_at_z=0.33, duration=0)
            scene.on("init", self._replay)
        with ui.row().classes("w-full items-center gap-2"):
            for what in ("Play", "Loop", "Speed"):
                ui.button(what).props(f"dense no-caps outline data-player={what.lower()}")
            ui.element("input").classes("cn-scrub").props(
                'type=range min=0 max=1000 value=0 data-player=scrub aria-label="Time"'
            )
            ui.element("span").props("data-player=clock").classes("text-sm")
            self.physics = ui.switch("Physics", on_change=lambda: self.show(self.points, keep=False))
            self.ghostly = ui.switch("Ghost of the nearest", value=True, on_change=self._replay)

    async def show(self, points: np.ndarray, keep: bool = True) -> None:
        """Let the robot do what lies at a point or along a path; the last call wins."""
        self._latest = number = next(self._numbers)
        if keep and len(self.trail) < 1000:
            self.trail.append(self.points)
        self.points = np.asarray(points, dtype=np.float64)
        self.redraw()
        recall = await run.io_bound(self.mind.recall, self.points)
        if number == self._latest and recall is not None:
            await self.present(recall, number)

    async def present(self, recall: Recall, number: int | None = None) -> None:
        """Show a movement that has been made or recognised."""
        number = self._latest if number is None else number
        dt_s = self.mind.memory.dt_s
        basic = self.mind.memory.demonstrations.trajectories[recall.nearest]
        self.recall = recall
        self.movement = angles_message(recall.trajectory, dt_s), angles_message(basic, dt_s)
        self._replay()
        self.status.text = describe(recall, self.mind)
        self.curves.content = curves_svg(recall, self.mind) + strip_html(recall, self.mind)
        pb = recall.pb
        self.first.value, self.second.value = round(pb[0], 3), round(pb[1], 3)
        ui.navigate.history.replace(address(self.points))
        if self.physics.value:
            performed = await run.io_bound(self.exhibit.stage.perform, recall.trajectory, dt_s)
            if number == self._latest and performed is not None:
                self.movement = performed[0], None
                self._replay()
                self.status.text = f"{describe(recall, self.mind)}; {performed[1]}"

    def redraw(self) -> None:
        """Draw the marks on the map anew."""
        points = np.array(self.drawing) if self.drawing else self.points
        self.map.content = overlay(self.exhibit.charting.chart, points, self.marks, self.exhibit.crowd)

    async def back(self) -> None:
        """Go back to where we were before."""
        if self.trail:
            await self.show(self.trail.pop(), keep=False)

    def _replay(self) -> None:
        if self.movement is not None:
            movement, ghost = self.movement
            self.robot.perform(movement, ghost if self.ghostly.value else None)

    async def _touched(self, event: events.GenericEventArguments) -> None:
        kind, pb = event.args.get("mouse_event_type"), self._pb_of(event)
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

    def _hovered(self, event: events.GenericEventArguments) -> None:
        pb, chart = self._pb_of(event), self.exhibit.charting.chart
        cell = int(nearest_cell(np.array([pb]), chart.resolution)[0])
        name = spoken(chart.names[chart.nearest[cell]])
        self.hover.text = (
            f"{pb[0]:.3f}, {pb[1]:.3f}: {OUTCOME_WORDS[str(chart.outcome[cell])]}, "
            f"nearest {name}, novelty {chart.distance[cell]:.1f}"
        )

    def _pb_of(self, event: events.GenericEventArguments) -> tuple[float, float]:
        x, y = (as_coordinate_px(event.args.get(key)) for key in ("image_x", "image_y"))
        return to_pb(x, y, self.exhibit.charting.chart.resolution)

    async def _pressed(self, event: events.GenericEventArguments) -> None:
        key = str(event.args.get("key"))
        if key in _ARROWS:
            step = 2 / (self.exhibit.charting.chart.resolution - 1) * (10 if event.args.get("shiftKey") else 1)
            moved = self.points[-1] + step * np.array(_ARROWS[key])
            await self.show(np.clip(moved, -1, 1)[None], keep=False)
        elif key.isdigit() and int(key) <= len(self.mind.names):
            await self.show(self.mind.memory.pb[int(key) - 1][None])
        elif key == "r":
            await self.show(discover.surprise(self.exhibit.charting.chart, self.rng)[None])
        elif key == "u":
            await self.back()
        elif key == "s":
            panels.keep(self)

    async def _typed(self) -> None:
        await self.show(np.array([[as_coordinate(self.first.value), as_coordinate(self.second.value)]]))

    def _recolour(self) -> None:
        self.map.set_source(map_address(self.exhibit.charting.chart, str(self.colouring.value)))

    def _finer(self) -> None:
        if self.exhibit.charting.finished.is_set():
            self.poll.deactivate()
            self._recolour()
            self.redraw()

    def _theme(self) -> None:
        self.dark.value = not self.dark.value


def as_coordinate_px(value: object) -> float:
    """Return a pixel from anything a browser sends; what is no number counts as the middle of the map."""
    return 300.0 if not isinstance(value, int | float) or value != value else float(min(max(value, 0), 600))


def address(points: np.ndarray) -> str:
    """Return the page's address that shows the same again."""
    if len(points) == 1:
        return f"/?x={points[0, 0]:.6g}&y={points[0, 1]:.6g}"
    return "/?path=" + "_".join(f"{x:.3f},{y:.3f}" for x, y in points)


def points_of(x: object, y: object, path: str) -> np.ndarray:
    """Return the points that an address asks for; what cannot be read is the middle of the map."""
    pairs = [pair.split(",") for pair in path.split("_")[:MAX_POINTS]] if path else []
    points = [[as_coordinate(pair[0]), as_coordinate(pair[1])] for pair in pairs if len(pair) == 2]
    return np.array(points if points else [[as_coordinate(x), as_coordinate(y)]])
