"""The robot of a page: its scene, and the controls of the one player that everything moving follows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui
from nicegui.elements.scene.scene_object3d import Object3D

from creative_nao.explorer.body import Body

STATIC = Path(__file__).with_name("static")


class RobotView(Object3D, component=STATIC / "robot.js"):
    """The robot in the scene of a tab."""

    def __init__(self, description: dict[str, Any]) -> None:
        super().__init__(description)

    def perform(self, movement: dict[str, Any], ghost: dict[str, Any] | None = None) -> None:
        """Let the browser play a movement, with the nearest basic action as a ghost."""
        self.run_method("perform", movement, ghost)


def robot_scene(body: Body, replay: Callable[[], object], label: str) -> RobotView:
    """Lay out a scene with the robot; `replay` is called when it is ready, and again when the browser lost it."""
    with ui.element("div").classes("cn-scene"):
        ui.label("The robot needs WebGL. Without it, the sentence and the curves below still tell all.").classes(
            "cn-behind"
        )
        camera = ui.scene.perspective_camera(fov=50)
        scene = ui.scene(grid=False, fps=240, background_color="#c9d3de", camera=camera).classes("w-full h-full")
        scene.props("role=img aria-label='" + label.replace("'", " ") + "'")
        with scene:
            robot = RobotView(body.description())
        scene.move_camera(x=0.62, y=-0.6, z=0.52, look_at_x=0.08, look_at_y=0, look_at_z=0.33, duration=0)
        scene.on("init", replay)
    return robot


def player_controls() -> None:
    """Lay out play, loop, speed, the time and its slider; the browser's player finds them by itself."""
    for what in ("Play", "Loop", "Speed"):
        ui.button(what).props(f"dense no-caps outline data-player={what.lower()}")
    ui.element("input").classes("cn-scrub").props(
        'type=range min=0 max=1000 value=0 data-player=scrub aria-label="Time"'
    )
    ui.element("span").props("data-player=clock").classes("text-sm")
