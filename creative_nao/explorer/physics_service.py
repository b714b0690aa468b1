"""The robot of the page: its shapes as JSON for the browser, its performances in physics, the player."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from nicegui import ui
from nicegui.elements.scene.scene_object3d import Object3D

from creative_nao.joints import JOINTS
from creative_nao.robot import Performance, Performer, Scene, first_failure

# MuJoCo tells type checkers nothing about its members.
# pyright: reportAttributeAccessIssue=false


VISIBLE_GROUP = 1
SHAPES = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
}


class BrowserRobot:
    """The robot in its ring, standing in the guard before the bag.

    Its `description` is all that the browser needs to build it, JSON values: `bodies`, parents first, with name,
    parent, pose in the parent at zero arm angles and shapes; and `hinges`: for each of `joints.JOINTS`, the body that
    it turns and its axis in that body.
    """

    def __init__(self) -> None:
        self.scene = Scene()
        model = self.scene.model
        data = mujoco.MjData(model)
        data.qpos[:] = self.scene.guard_qpos()
        data.qpos[self.scene.index.arm_qpos] = 0.0
        mujoco.mj_kinematics(model, data)
        places, turns = _in_parent(model, data)
        visible = np.flatnonzero((model.geom_group == VISIBLE_GROUP) & np.isin(model.geom_type, list(SHAPES)))
        bodies = [
            {
                "name": _name(model, body),
                "parent": _name(model, int(model.body_parentid[body])),
                "pos": _rounded(places[body]),
                "quat": _rounded(turns[body][[1, 2, 3, 0]]),
                "shapes": [_shape(model, int(geom)) for geom in visible if model.geom_bodyid[geom] == body],
            }
            for body in range(model.nbody)
        ]
        hinges = []
        for joint in JOINTS:
            hinge = model.joint(f"nao/{joint}")
            hinges.append({"body": _name(model, int(hinge.bodyid[0])), "axis": _rounded(hinge.axis)})
        self.description: dict[str, Any] = {"bodies": bodies, "hinges": hinges}

    def clip(self, performance: Performance) -> dict[str, Any]:
        """Return a physical performance with frames as poses in the parents of every body that moves.

        `dt` [s] between frames, `n` frames, and `tracks`: body, flat positions [m], flat quaternions (x, y, z, w).
        """
        assert performance.frames is not None
        model = self.scene.model
        data = mujoco.MjData(model)
        poses = []
        for qpos in performance.frames:
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            poses.append(_in_parent(model, data))
        places, turns = (np.array(part) for part in zip(*poses, strict=True))
        agree = np.where((turns[1:] * turns[:-1]).sum(-1, keepdims=True) < 0, -1.0, 1.0)
        turns[1:] *= agree.cumprod(axis=0)  # a quaternion and its negative are one pose; blending needs neighbours
        moving = np.ptp(places, axis=0).max(-1) + np.ptp(turns, axis=0).max(-1) > 1e-5
        tracks = [
            {
                "body": _name(model, int(body)),
                "places": _rounded(places[:, body].ravel(), 5),
                "turns": _rounded(turns[:, body][:, [1, 2, 3, 0]].ravel(), 5),
            }
            for body in np.flatnonzero(moving)
        ]
        return {"dt": performance.frame_dt_s, "n": len(places), "tracks": tracks}


def angles_message(trajectory: np.ndarray, dt_s: float) -> dict[str, Any]:
    """Return a movement without physics as the browser takes it: the tick [s] and the angles, tick by tick [rad]."""
    return {"dt": dt_s, "angles": np.round(trajectory, 5).tolist()}


def _in_parent(model: Any, data: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return place (nbody, 3) and turn (nbody, 4; w first) of each body in its parent."""
    places, turns = np.zeros((model.nbody, 3)), np.zeros((model.nbody, 4))
    turns[0, 0] = 1.0
    back, ahead = np.zeros(4), np.zeros(3)
    for body in range(1, model.nbody):
        parent = int(model.body_parentid[body])
        mujoco.mju_negQuat(back, data.xquat[parent])
        ahead[:] = data.xpos[body] - data.xpos[parent]
        mujoco.mju_rotVecQuat(places[body], ahead, back)
        mujoco.mju_mulQuat(turns[body], back, data.xquat[body])
    return places, turns


def _name(model: Any, body: int) -> str:
    return model.body(body).name or "world"


def _shape(model: Any, geom: int) -> dict[str, Any]:
    material = int(model.geom_matid[geom])
    colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    return {
        "kind": SHAPES[mujoco.mjtGeom(int(model.geom_type[geom]))],
        "size": _rounded(model.geom_size[geom]),
        "pos": _rounded(model.geom_pos[geom]),
        "quat": _rounded(model.geom_quat[geom][[1, 2, 3, 0]]),
        "colour": "#" + "".join(f"{round(255 * channel):02x}" for channel in np.clip(colour[:3], 0, 1)),
        "opacity": round(float(colour[3]), 3),
    }


def _rounded(values: np.ndarray, digits: int = 6) -> list[float]:
    return np.round(np.asarray(values, dtype=np.float64), digits).tolist()


class PhysicsService:
    """One robot for all tabs; performances happen one after the other."""

    def __init__(self) -> None:
        self.robot = BrowserRobot()
        self._lock = threading.Lock()
        self._performer: Performer | None = None

    def perform(self, trajectory: np.ndarray, dt_s: float) -> tuple[dict[str, Any], str]:
        """Perform joint angles [rad], shape (n_steps, 8), at a tick [s]; return a clip and the result in words."""
        with self._lock:
            if self._performer is None:
                self._performer = Performer(self.robot.scene)
            performance = self._performer.perform(trajectory, dt_s, keep_frames=True)
            clip = self.robot.clip(performance)
        failure = first_failure(performance)
        hits = performance.hits
        hit = f"{hits.count} hits of the bag, hardest {hits.peak_force_n:.0f} N" if hits.count else "the bag is not hit"
        verdict = f"the body refuses: {failure.replace('_', ' ')}" if failure else "the body can do it"
        return clip, f"{verdict}; {hit}; mean error {performance.mean_error_rad.max():.3f} rad"


STATIC = Path(__file__).with_name("static")


class RobotView(Object3D, component=STATIC / "robot.js"):
    """The robot in the scene of a tab; its argument is `BrowserRobot.description`."""

    def perform(self, movement: dict[str, Any], ghost: dict[str, Any] | None = None) -> None:
        """Let the browser play a movement, with the nearest basic action as a ghost."""
        self.run_method("perform", movement, ghost)


def robot_scene(robot: BrowserRobot, replay: Callable[[], object], label: str) -> RobotView:
    """Lay out a scene with the robot; `replay` is called when it is ready, and again when the browser lost it."""
    with ui.element("div").classes("cn-scene"):
        ui.label("The robot needs WebGL. Without it, the sentence and the curves below still tell all.").classes(
            "cn-behind"
        )
        camera = ui.scene.perspective_camera(fov=50)
        scene = ui.scene(grid=False, fps=240, background_color="#c9d3de", camera=camera).classes("w-full h-full")
        scene.props("role=img aria-label='" + label.replace("'", " ") + "'")
        with scene:
            shown = RobotView(robot.description)
        scene.move_camera(x=0.62, y=-0.6, z=0.52, look_at_x=0.08, look_at_y=0, look_at_z=0.33, duration=0)
        scene.on("init", replay)
    return shown


def player_controls() -> None:
    """Lay out play, loop, speed, the time and its slider; the browser's player finds them by itself."""
    for what in ("Play", "Loop", "Speed"):
        ui.button(what).props(f"dense no-caps outline data-player={what.lower()}")
    ui.element("input").classes("cn-scrub").props(
        'type=range min=0 max=1000 value=0 data-player=scrub aria-label="Time"'
    )
    ui.element("span").props("data-player=clock").classes("text-sm")
