"""The robot of the page: its shapes as JSON for the browser, its performances in physics, films of them."""

from __future__ import annotations

import tempfile
import threading
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from creative_nao.joints import JOINTS
from creative_nao.robot import (
    Performance,
    Performer,
    Scene,
    first_failure,
    imagined_frames,
    pictures,
    write_gif,
    write_mp4,
)  # fmt: skip
from creative_nao.robot.performance import has_fallen, tilt_rad

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
    texture = int(model.mat_texid[material].max()) if material >= 0 else -1
    if texture >= 0:  # the page has none: its mean colour is what one sees from afar
        start, n_channels = model.tex_adr[texture], model.tex_nchannel[texture]
        size = model.tex_width[texture] * model.tex_height[texture] * n_channels
        texels = model.tex_data[start : start + size].reshape(-1, n_channels)
        colour = np.append(colour[:3] * texels[:, :3].mean(axis=0) / 255, colour[3])
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


FILM_FRAME_S = 0.1
FILM_PX = 320


class RobotService:
    """One robot for all tabs; performances happen one after the other."""

    def __init__(self) -> None:
        self.robot = BrowserRobot()
        self._lock = threading.Lock()
        self._performer: Performer | None = None

    def perform(self, trajectory: np.ndarray, dt_s: float) -> dict[str, Any]:
        """Perform joint angles [rad], shape (n_steps, 8), at a tick [s]; return a clip with what the body made of it.

        `failure`: the first of `robot.PHYSICAL_FAILURES`, or None; `hits`: when [s] and with what force [N] the bag
        was hit; `fell`: when the robot fell [s], or None; `error`: mean error of the worst joint [rad].
        """
        performance = self._perform(trajectory, dt_s)
        assert performance.frames is not None
        root = performance.frames[:, self.robot.scene.index.torso_qpos :][:, :7]
        down = [frame for frame, row in enumerate(root) if has_fallen(row[2:3], tilt_rad(row[None, 3:]))]
        return self.robot.clip(performance) | {
            "failure": first_failure(performance),
            "hits": [[round(time_s, 3), round(force_n, 1)] for time_s, force_n in performance.hits.moments],
            "fell": round(down[0] * performance.frame_dt_s, 2) if down else None,
            "error": round(float(performance.mean_error_rad.max()), 4),
        }

    def film(self, trajectory: np.ndarray, dt_s: float, ending: str, physics: bool) -> bytes:
        """Return a film of a movement, with or without physics; `ending` is gif or mp4."""
        if physics:
            frames = self._perform(trajectory, dt_s).frames
            assert frames is not None
            frames = frames[:: max(1, round(FILM_FRAME_S / 0.05))]
        else:
            frames = imagined_frames(self.robot.scene, trajectory, dt_s, frame_dt_s=FILM_FRAME_S)
        with self._lock, tempfile.TemporaryDirectory() as folder:
            images = pictures(self.robot.scene, frames, camera="close", width=FILM_PX, height=FILM_PX, shadows=True)
            write_film = write_gif if ending == "gif" else write_mp4
            return write_film(images, Path(folder) / f"movement.{ending}", frame_dt_s=FILM_FRAME_S).read_bytes()

    def _perform(self, trajectory: np.ndarray, dt_s: float) -> Performance:
        with self._lock:
            if self._performer is None:
                self._performer = Performer(self.robot.scene)
            return self._performer.perform(trajectory, dt_s, keep_frames=True)
