"""Robot, ring and bag put together, and where their parts stand in the compiled model.

Building takes about a tenth of a second; everything that simulates can share one scene.
"""

# MuJoCo and PyMJCF tell type checkers nothing about their members.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportMissingImports=false
from __future__ import annotations

import dataclasses
import functools
from typing import Any

import mujoco
import numpy as np

from creative_nao.joints import JOINTS
from creative_nao.robot.arena import PHYSICS_STEP_S, Ring
from creative_nao.robot.bag import Bag
from creative_nao.robot.modelling import mjcf
from creative_nao.robot.nao import MOTOR_JOINTS, Nao
from creative_nao.robot.postures import POSTURES, posture
from creative_nao.robot.servos import ServoSettings, Stiffness
from creative_nao.robot.tables import links

ALL_JOINTS: tuple[str, ...] = tuple(link.joint for link in links())
"""The 26 hinges."""

BAG_FORCE = "bag_force"
"""Sensor of the net force between robot and bag [N], in the world frame; absent without a bag."""


@dataclasses.dataclass(frozen=True)
class Index:
    """Where the robot stands in the arrays of a compiled model (rows in the order of `joints.JOINTS` for the arms)."""

    qpos: dict[str, int]
    """Each hinge's row in `data.qpos`."""
    dof: dict[str, int]
    """Each hinge's row in `data.qvel`."""
    actuator: dict[str, int]
    """Each motor's row in `data.ctrl`."""
    arm_qpos: np.ndarray
    arm_dof: np.ndarray
    arm_actuator: np.ndarray
    torso: int
    """Body id of the torso."""
    torso_qpos: int
    """First of the seven rows of the free joint in `data.qpos`."""
    robot_geoms: np.ndarray
    """Shape (n_geoms,), True for the robot's contact shapes."""
    fist_geoms: np.ndarray
    """Geom ids of the right and the left fist."""
    bag_geom: int
    """Geom id of the bag, -1 without a bag."""
    floor_geom: int

    @classmethod
    def of(cls, model: Any, prefix: str = "nao/") -> Index:
        """Look the names up once; `prefix` is the scope under which the robot was attached."""

        def row(kind: Any, name: str) -> int:
            return mujoco.mj_name2id(model, kind, name)

        hinge = {joint: row(mujoco.mjtObj.mjOBJ_JOINT, prefix + joint) for joint in ALL_JOINTS}
        qpos = {joint: int(model.jnt_qposadr[number]) for joint, number in hinge.items()}
        dof = {joint: int(model.jnt_dofadr[number]) for joint, number in hinge.items()}
        motor = {joint: row(mujoco.mjtObj.mjOBJ_ACTUATOR, prefix + joint) for joint in MOTOR_JOINTS}
        torso = row(mujoco.mjtObj.mjOBJ_BODY, prefix + "Torso")
        base = int(model.body_rootid[torso])
        names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, number) or "" for number in range(model.ngeom)]
        touchable = np.array(model.geom_contype) != 0
        return cls(
            qpos=qpos,
            dof=dof,
            actuator=motor,
            arm_qpos=np.array([qpos[joint] for joint in JOINTS]),
            arm_dof=np.array([dof[joint] for joint in JOINTS]),
            arm_actuator=np.array([motor[joint] for joint in JOINTS]),
            torso=torso,
            torso_qpos=int(model.jnt_qposadr[model.body_jntadr[base]]),
            robot_geoms=touchable & np.array([name.startswith(prefix) for name in names]),
            fist_geoms=np.array([row(mujoco.mjtObj.mjOBJ_GEOM, prefix + name) for name in ("RFist", "LFist")]),
            bag_geom=row(mujoco.mjtObj.mjOBJ_GEOM, "bag/leather"),
            floor_geom=row(mujoco.mjtObj.mjOBJ_GEOM, "floor"),
        )


def place(model: Any, data: Any, index: Index, name: str) -> None:
    """Put the robot into a named posture with its soles on the floor, servos at the same angles, everything at rest.

    The torso leans so that the soles are flat, and is set so that the middle between the ankles lies at x = y = 0.

    Raises:
        NotFoundError: If no posture has this name.
    """
    angles = posture(name)
    mujoco.mj_resetData(model, data)
    for joint, row in index.qpos.items():
        data.qpos[row] = angles.get(joint, 0.0)
    for joint, row in index.actuator.items():
        data.ctrl[row] = angles.get(joint, 0.0)
    start = index.torso_qpos
    data.qpos[start : start + 7] = (0, 0, 1, 1, 0, 0, 0)
    mujoco.mj_kinematics(model, data)
    feet = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"nao/{side}Foot") for side in "RL"]
    sole_to_torso = data.xmat[feet[0]].reshape(3, 3)
    # Only the lean about y is undone: yaw of the feet may stay, and roll cancels between both sides.
    lean = np.arctan2(-sole_to_torso[2, 0], sole_to_torso[0, 0])
    data.qpos[start + 3 : start + 7] = (np.cos(lean / 2), 0, -np.sin(lean / 2), 0)
    mujoco.mj_kinematics(model, data)
    soles = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, f"nao/{side}Foot") for side in "RL"]
    lowest = min(_lowest_corner(model, data, geom) for geom in soles)
    middle = data.xpos[feet].mean(axis=0)
    data.qpos[start : start + 3] -= (middle[0], middle[1], lowest)
    mujoco.mj_forward(model, data)


def _lowest_corner(model: Any, data: Any, geom: int) -> float:
    axes = data.geom_xmat[geom].reshape(3, 3)
    return float(data.geom_xpos[geom, 2] - np.abs(axes[2]) @ model.geom_size[geom])


class Scene:
    """The ring with the robot on its own feet before the bag.

    Args:
        with_bag: Whether the bag hangs there; teaching goes without.
        servos: Gains of the servos.

    Attributes:
        arena, robot, bag: The composer entities (`bag` may be None). Add to `arena.mjcf_model` before `physics` is
            first used, for instance a mocap body welded to a forearm.
    """

    def __init__(self, *, with_bag: bool = True, servos: ServoSettings | None = None) -> None:
        self.arena = Ring()
        self.robot = Nao(servos=servos)
        self.arena.add_free_entity(self.robot)
        self.bag: Bag | None = None
        if with_bag:
            self.bag = Bag()
            self.arena.attach(self.bag, self.arena.hook)
            self.arena.mjcf_model.sensor.add(
                "contact", name=BAG_FORCE, geom1=self.bag.geom, subtree2=self.robot.body("Torso"),
                data="force", reduce="netforce",
            )  # fmt: skip

    @functools.cached_property
    def physics(self) -> Any:
        """The compiled `dm_control.mjcf.Physics`, made at first use."""
        physics = mjcf.Physics.from_mjcf_model(self.arena.mjcf_model)
        place(physics.model.ptr, physics.data.ptr, Index.of(physics.model.ptr), "Guard")
        return physics

    @functools.cached_property
    def model(self) -> Any:
        """The compiled `mujoco.MjModel`: of `physics`, or the one a composer environment compiled (see `adopt`)."""
        return self.physics.model.ptr

    def adopt(self, physics: Any) -> None:
        """Use the model that a `composer.Environment` compiled from `arena`, instead of compiling one here."""
        for cached in ("physics", "index", "stiffness"):
            self.__dict__.pop(cached, None)
        self.__dict__["model"] = physics.model.ptr

    @functools.cached_property
    def index(self) -> Index:
        """Rows of the robot in the model's arrays."""
        return Index.of(self.model)

    @functools.cached_property
    def stiffness(self) -> Stiffness:
        """Sets how strong the motors are."""
        return Stiffness(self.model, self.index.actuator)

    def guard_qpos(self) -> np.ndarray:
        """Return `qpos` of the robot standing in the guard before the resting bag, shape (nq,)."""
        data = mujoco.MjData(self.model)
        self.place(data, "Guard")
        return data.qpos.copy()

    def place(self, data: Any, name: str) -> None:
        """Put the robot of `data` into a named posture, at rest on its soles (see `place`)."""
        place(self.model, data, self.index, name)


__all__ = ["ALL_JOINTS", "PHYSICS_STEP_S", "POSTURES", "Index", "Scene", "place"]
