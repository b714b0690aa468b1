"""Robot, ring and bag as one MuJoCo model, the rows of their parts in its arrays, and the settings of the servos.

The model is `scene.xml`, which puts `nao.xml` and `bag.xml` into `ring.xml`; `nao_sources.csv` names the source of each
figure of the robot. Compiling takes a hundredth of a second; everything that simulates can share one scene.
"""

# The bindings of MuJoCo have no static types.
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from creative_nao.errors import SettingsError
from creative_nao.joints import JOINTS
from creative_nao.robot.postures import posture
from creative_nao.schema import NonNegative, UnitInterval, checked, record

NAO_XML = Path(__file__).with_name("nao.xml")
"""The robot alone, as an MJCF file: no floor, no light, no option; give it a free joint when attaching it."""
BAG_XML = Path(__file__).with_name("bag.xml")
"""The punching bag alone; its root is the hook."""
RING_XML = Path(__file__).with_name("ring.xml")
"""The empty ring: floor, ropes, lights, cameras, physics options."""
SCENE_XML = Path(__file__).with_name("scene.xml")
"""All three together, as `Scene` loads them."""

BAG_FORCE = "bag_force"  # sensor of the net force between robot and bag [N], in the world frame; absent without a bag
PERFORMANCE_SENSORS: dict[str, tuple[str, ...]] = {
    "torque": tuple(f"nao/{joint}_torque" for joint in JOINTS),
    "self": ("nao/self_contact",),
    "bag": (BAG_FORCE,),
    "fists": ("nao/RFist_velocity", "nao/LFist_velocity"),
}
"""All sensors that a performance reads, by what they are read for."""
_LEG_PARTS = ("Hip", "Knee", "Ankle")


@dataclasses.dataclass(frozen=True)
class Index:
    """Rows and ids of the robot's parts in the arrays of a compiled model (arms in the order of `joints.JOINTS`)."""

    qpos: dict[str, int]
    """Row of each of the 26 hinges in `data.qpos`."""
    dof: dict[str, int]
    """Row of each hinge in `data.qvel`."""
    actuator: dict[str, int]
    """Row of each of the 25 motors in `data.ctrl`; one motor, named after the left, turns both HipYawPitch hinges."""
    arm_qpos: np.ndarray
    arm_actuator: np.ndarray
    arm_effort_nm: np.ndarray
    """Largest torque of the arm motors [N m], shape (8,)."""
    torso: int
    """Body id of the torso."""
    torso_qpos: int
    """First of the seven rows of the free joint in `data.qpos`."""
    feet: np.ndarray
    """Body ids of the right and the left foot."""
    soles: np.ndarray
    """Geom ids of the right and the left sole."""
    robot_geoms: np.ndarray
    """Shape (n_geoms,), True for the robot's contact shapes."""
    bag_geom: int
    """Geom id of the bag, -1 without a bag."""
    floor_geom: int

    @classmethod
    def of(cls, model: Any, prefix: str = "nao/") -> Index:
        """Look the names up once; `prefix` is that under which the robot was attached."""
        kinds = mujoco.mjtObj

        def row(kind: Any, name: str) -> int:
            return mujoco.mj_name2id(model, kind, name)

        def rows(kind: Any, count: int) -> dict[str, int]:
            names = [mujoco.mj_id2name(model, kind, number) or "" for number in range(count)]
            return {name.removeprefix(prefix): n for n, name in enumerate(names) if name.startswith(prefix)}

        joints = rows(kinds.mjOBJ_JOINT, model.njnt)
        hinges = {name: n for name, n in joints.items() if model.jnt_type[n] == mujoco.mjtJoint.mjJNT_HINGE}
        qpos = {joint: int(model.jnt_qposadr[number]) for joint, number in hinges.items()}
        actuator = rows(kinds.mjOBJ_ACTUATOR, model.nu)
        arm_actuator = np.array([actuator[joint] for joint in JOINTS])
        torso = row(kinds.mjOBJ_BODY, prefix + "Torso")
        base = int(model.body_rootid[torso])
        named = np.zeros(model.ngeom, dtype=bool)
        named[list(rows(kinds.mjOBJ_GEOM, model.ngeom).values())] = True
        return cls(
            qpos=qpos,
            dof={joint: int(model.jnt_dofadr[number]) for joint, number in hinges.items()},
            actuator=actuator,
            arm_qpos=np.array([qpos[joint] for joint in JOINTS]),
            arm_actuator=arm_actuator,
            arm_effort_nm=model.actuator_forcerange[arm_actuator, 1].copy(),
            torso=torso,
            torso_qpos=int(model.jnt_qposadr[model.body_jntadr[base]]),
            feet=np.array([row(kinds.mjOBJ_BODY, f"{prefix}{side}Foot") for side in "RL"]),
            soles=np.array([row(kinds.mjOBJ_GEOM, f"{prefix}{side}Foot") for side in "RL"]),
            robot_geoms=named & (np.array(model.geom_contype) != 0),
            bag_geom=row(kinds.mjOBJ_GEOM, "bag/leather"),
            floor_geom=row(kinds.mjOBJ_GEOM, "floor"),
        )


def place(model: Any, data: Any, index: Index, name: str) -> None:
    """Put the robot into a named posture with its soles on the floor, servos at the same angles, everything at rest.

    The torso leans so that the soles are flat, and is set so that the middle between the ankles lies at x = y = 0.
    NotFoundError says that no posture has this name.
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
    sole_to_torso = data.xmat[index.feet[0]].reshape(3, 3)
    # Only the lean about y is undone: yaw of the feet may stay, and roll cancels between both sides.
    lean = np.arctan2(-sole_to_torso[2, 0], sole_to_torso[0, 0])
    data.qpos[start + 3 : start + 7] = (np.cos(lean / 2), 0, -np.sin(lean / 2), 0)
    mujoco.mj_kinematics(model, data)
    lowest = min(
        float(data.geom_xpos[sole, 2] - np.abs(data.geom_xmat[sole].reshape(3, 3)[2]) @ model.geom_size[sole])
        for sole in index.soles
    )
    middle = data.xpos[index.feet].mean(axis=0)
    data.qpos[start : start + 3] -= (middle[0], middle[1], lowest)
    mujoco.mj_forward(model, data)


@record
class ServoSettings:
    """Gains of the position servos; none are published, these track brisk punches within the torque limits.

    The defaults are the gains of `nao.xml`.
    """

    arm_kp: NonNegative = 20.0
    """Proportional gain of arms and head [N m/rad]."""
    arm_kd: NonNegative = 0.4
    """Derivative gain of arms and head [N m s/rad]."""
    leg_kp: NonNegative = 120.0
    """Proportional gain of the legs [N m/rad]; at half of it the trunk sways twice as far under a punch."""
    leg_kd: NonNegative = 2.0
    """Derivative gain of the legs [N m s/rad]."""
    hand_kp: NonNegative = 1.0
    """Proportional gain of the fingers [N m per unit of opening]."""
    hand_kd: NonNegative = 0.02
    """Derivative gain of the fingers."""
    damping: NonNegative = 0.05
    """Viscous friction of every joint [N m s/rad]; at twice as much a quick uppercut spends 3 % of its time at the
    torque limit of the shoulder."""
    friction_loss: NonNegative = 0.03
    """Dry friction of every joint [N m]."""

    def apply(self, model: Any) -> None:
        """Give these gains and this friction to a compiled `mujoco.MjModel`."""
        index = Index.of(model)
        for joint, row in index.actuator.items():
            part = "leg" if any(leg in joint for leg in _LEG_PARTS) else "hand" if joint.endswith("Hand") else "arm"
            kp, kd = getattr(self, f"{part}_kp"), getattr(self, f"{part}_kd")
            model.actuator_gainprm[row, 0] = kp
            model.actuator_biasprm[row, 1:3] = -kp, -kd
        rows = list(index.dof.values())
        model.dof_damping[rows] = self.damping
        model.dof_frictionloss[rows] = self.friction_loss


class Stiffness:
    """Sets the stiffness of single joints at run time, by scaling the torque limits of the compiled model.

    0 makes the joint limp, 1 allows the full torque. The compiled model, in which `actuator_ids` says where each
    joint's actuator stands, is shared by everyone who simulates with it: set it back to 1.
    """

    def __init__(self, model: Any, actuator_ids: dict[str, int]) -> None:
        self._model, self._ids = model, dict(actuator_ids)
        self._full_range = model.actuator_forcerange.copy()

    def set(self, joints: tuple[str, ...], stiffness: float) -> None:
        """Limit the torque of `joints`, each with a motor of its own, to `stiffness` (0 to 1) times their full torque.

        SettingsError says that `stiffness` lies outside 0 to 1 or a joint has no motor of its own.
        """
        stiffness = checked(UnitInterval, stiffness, "stiffness")
        unknown = [joint for joint in joints if joint not in self._ids]
        if unknown:
            raise SettingsError(
                f"`joints` should name motorised joints, but {unknown[0]!r} is none of {list(self._ids)}."
            )
        rows = np.array([self._ids[joint] for joint in joints], dtype=int)
        self._model.actuator_forcerange[rows] = stiffness * self._full_range[rows]

    def reset(self) -> None:
        """Give every joint its full torque again."""
        self._model.actuator_forcerange[:] = self._full_range


class Scene:
    """The ring with the robot on its own feet before the bag, which teaching goes without.

    `servos` are the gains of its servos; None for those of `nao.xml`, which are `ServoSettings()`.

    Attributes:
        spec: The `mujoco.MjSpec` that `model` is compiled from. Add to it before `model` is first used, for instance
            a mocap body welded to a forearm.
    """

    def __init__(self, *, with_bag: bool = True, servos: ServoSettings | None = None) -> None:
        self.spec = mujoco.MjSpec.from_file(str(SCENE_XML))
        self._servos = servos
        if not with_bag:
            self.spec.delete(self.spec.sensor(BAG_FORCE))
            self.spec.delete(self.spec.body("bag"))

    @classmethod
    def from_model(cls, model: Any) -> Scene:
        """Return a scene that uses a model compiled elsewhere from the same files, such as by dm_control's composer."""
        scene = cls()
        scene.model = model
        return scene

    @functools.cached_property
    def model(self) -> Any:
        """The compiled `mujoco.MjModel`, made at first use."""
        model = self.spec.compile()
        if self._servos is not None:
            self._servos.apply(model)
        return model

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


def bare_scene(*, with_bag: bool = True, servos: ServoSettings | None = None) -> Scene:
    """Return a scene for computing only: nothing that is drawn, no sensor that no performance reads.

    The states are bit for bit those of the full scene, since what is left away has no mass and touches nothing; a
    performance takes about a sixth less time (`benchmarks/physics.py pool`). The arguments are those of `Scene`.
    """
    scene = Scene(with_bag=with_bag, servos=servos)
    read = {name for names in PERFORMANCE_SENSORS.values() for name in names}
    unread = [sensor for sensor in scene.spec.sensors if sensor.name not in read]
    drawn = [geom for geom in scene.spec.geoms if geom.contype == 0 and geom.conaffinity == 0]
    for element in (*unread, *drawn, *scene.spec.cameras, *scene.spec.lights):
        scene.spec.delete(element)
    return scene
