"""Kinesthetic teaching: a hand leads the robot's limp arms through an action, and the robot records its joints.

A hand is a spring and a damper around a forearm, no stronger than a person's. The arm is dragged, not set: it lags in a
fast punch, sags under its weight, and stops where the robot's body is in the way. `shortcomings` says whether a set of
taught actions is fit to learn from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import creative_nao.robot  # noqa: F401 - it chooses how MuJoCo draws, which must come before MuJoCo

# isort: split

import mujoco
import numpy as np

from creative_nao.demonstrations.dataset import Demonstrations
from creative_nao.demonstrations.keyframes import (
    ACTIONS,
    DT_S,
    DURATION_S,
    GUARD,
    N_STEPS,
    GuidanceVariation,
    GuidedPath,
    both_arms,
    keyframes,
    vary,
)
from creative_nao.joints import ENCODER_STEP_RAD, JOINTS, limits, read_encoder
from creative_nao.schema import Field, record

if TYPE_CHECKING:
    from creative_nao.robot.scene import Scene

# The bindings of MuJoCo have no static types.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false

FOREARMS = ("nao/RForearm", "nao/LForearm")  # bodies that the hands hold, right first as in `joints.JOINTS`

HELD_AT_M = (0.045, 0.0, 0.0)  # where the hands hold, in the frame of the forearm: just before the wrist
SETTLE_S = 0.5  # held still in the first posture before the recording starts [s]
FRAME_DT_S = 0.05  # time between the snapshots kept for a film [s]

SPEED_RANGE_RAD_S = (5.0, 6.0)
"""Where the largest speed over a tick, over the whole set, should lie: brisk, and within what the motors can do."""

GUARD_TOLERANCE_RAD = 0.12
"""How far from the guard an action may start and end [rad]; every generated action starts at the mean."""

MIN_DISTANCE_RAD = 20.0
"""Smallest warping distance between two of the six: twice the distance up to which an action counts as learned."""


@record
class Grip:
    """How firmly a hand holds. With the defaults the arm is 0.01 rad off on average, up to 0.2 rad in a fast punch.

    Attributes:
        stiffness_n_m: Pull per distance [N/m].
        damping_ns_m: Pull per difference of speed [N s/m].
        turn_stiffness_nm: Twist per angle [N m/rad].
        turn_damping_nms: Twist per difference of turning speed [N m s/rad].
        max_force_n: The strongest pull [N].
        max_torque_nm: The strongest twist [N m].
    """

    stiffness_n_m: Annotated[float, Field(ge=0, le=5000)] = 1200.0
    damping_ns_m: Annotated[float, Field(ge=0, le=60)] = 20.0
    turn_stiffness_nm: Annotated[float, Field(ge=0, le=30)] = 6.0
    turn_damping_nms: Annotated[float, Field(ge=0, le=0.5)] = 0.1
    max_force_n: Annotated[float, Field(ge=0, le=500)] = 60.0
    max_torque_nm: Annotated[float, Field(ge=0, le=50)] = 3.0


class Hand:
    """One hand on one body (its id) of a compiled `mujoco.MjModel`."""

    def __init__(self, model: Any, body: int, grip: Grip) -> None:
        self._model, self._body, self._grip = model, body, grip
        self._jacobian = np.zeros((3, model.nv)), np.zeros((3, model.nv))

    def pose(self, data: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return where the held point is [m] and how the body is turned (3 x 3); needs fresh kinematics."""
        turned = data.xmat[self._body].reshape(3, 3).copy()
        return data.xpos[self._body] + turned @ np.array(HELD_AT_M), turned

    def drag(self, data: Any, place: np.ndarray, attitude: np.ndarray, velocity: np.ndarray, spin: np.ndarray) -> float:
        """Add the hand's pull and twist to `data.qfrc_applied`, kinematics up to date; return the size of the pull [N].

        The hand wants the held point at `place` [m] and the body turned by `attitude`, shape (3, 3). It moves at
        `velocity` [m/s] and turns at `spin` in the world frame [rad/s]. All but `attitude` have the shape (3,).
        """
        here, turned = self.pose(data)
        along, about = self._jacobian
        mujoco.mj_jac(self._model, data, along, about, here, self._body)
        grip = self._grip
        pull = grip.stiffness_n_m * (place - here) + grip.damping_ns_m * (velocity - along @ data.qvel)
        twist = grip.turn_stiffness_nm * _rotation_vector(attitude @ turned.T)
        twist += grip.turn_damping_nms * (spin - about @ data.qvel)
        pull = _at_most(pull, grip.max_force_n)
        data.qfrc_applied += along.T @ pull + about.T @ _at_most(twist, grip.max_torque_nm)
        return float(np.linalg.norm(pull))


def _rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """Return axis times angle [rad] of a rotation matrix (3 x 3), exact below half a turn."""
    quaternion, vector = np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


def _at_most(vector: np.ndarray, largest: float) -> np.ndarray:
    size = float(np.linalg.norm(vector))
    return vector * (largest / size) if size > largest else vector


@dataclass(frozen=True, eq=False)
class Lesson:
    """One action, taught.

    Attributes:
        name: Of the basic action.
        recorded: Encoder readings at every tick [rad], shape (50, 8).
        meant: The key postures' own curve at the same ticks [rad], shape (50, 8).
        led: Where the hands wanted the arms [rad], shape (50, 8): `meant` with a person's variation.
        mean_pull_n: Mean pull of the two hands [N].
        max_pull_n: Largest pull of either hand [N].
        self_contact_share: Share of the time in which the robot touches itself.
        frames: `qpos` of the whole robot every `FRAME_DT_S`, shape (n_frames, nq), for a film.
    """

    name: str
    recorded: np.ndarray
    meant: np.ndarray
    led: np.ndarray
    mean_pull_n: float
    max_pull_n: float
    self_contact_share: float
    frames: np.ndarray


class Teacher:
    """Leads the limp arms of one robot through actions."""

    def __init__(self, grip: Grip | None = None, variation: GuidanceVariation | None = None) -> None:
        self.variation = variation or GuidanceVariation()
        self.scene = _scene_with_stand()
        model = self._model = self.scene.model
        self._data, self._wanted = mujoco.MjData(model), mujoco.MjData(model)
        self.scene.stiffness.set(JOINTS, 0.0)
        bodies = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in FOREARMS]
        self._hands = [Hand(model, body, grip or Grip()) for body in bodies]
        touch = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, "nao/self_contact")
        self._self_contact = int(model.sensor_adr[touch])

    def teach(self, name: str, rng: np.random.Generator) -> Lesson:
        """Lead the arms through one of `keyframes.ACTIONS`, else NotFoundError, and record it."""
        movement = keyframes(name)
        path = vary(movement, self.variation, rng)
        step_s = self._model.opt.timestep
        every, n = round(DT_S / step_s), round(DURATION_S / step_s)
        times = np.arange(-round(SETTLE_S / step_s), n + 1) * step_s
        poses = self._hand_poses(path, times)
        data, arm = self._data, self.scene.index.arm_qpos
        self.scene.place(data, "Guard")
        data.mocap_pos[0] = data.xpos[self.scene.index.torso]  # the weld keeps the trunk where the stand is put
        data.mocap_quat[0] = data.xquat[self.scene.index.torso]
        data.qpos[arm] = path.at(np.zeros(1))[0]
        angles, pulls, touching, frames = [], [], [], []
        for k, time in enumerate(times):
            mujoco.mj_step1(self._model, data)
            data.qfrc_applied[:] = 0.0
            pull = [hand.drag(data, *poses[side][k]) for side, hand in enumerate(self._hands)]
            if time >= 0:
                angles.append(data.qpos[arm].copy())
                pulls.append(pull)
                touching.append(data.sensordata[self._self_contact] > 0)
                if (len(angles) - 1) % round(FRAME_DT_S / step_s) == 0:
                    frames.append(data.qpos.copy())
            mujoco.mj_step2(self._model, data)
        ticks = np.arange(N_STEPS) * DT_S
        return Lesson(
            name=name,
            recorded=read_encoder(np.array(angles)[::every]),
            meant=movement.at(ticks),
            led=path.at(ticks),
            mean_pull_n=float(np.mean(pulls)),
            max_pull_n=float(np.max(pulls)),
            self_contact_share=float(np.mean(touching)),
            frames=np.array(frames),
        )

    def _hand_poses(self, path: GuidedPath, times: np.ndarray) -> list[list[tuple[np.ndarray, ...]]]:
        """Return by forward kinematics for each hand and time the forearm's place, attitude, velocity and spin."""
        model, wanted, step_s = self._model, self._wanted, self._model.opt.timestep
        self.scene.place(wanted, "Guard")
        held: list[list[tuple[np.ndarray, np.ndarray]]] = [[], []]
        for posture in path.at(np.maximum(times, 0.0)):
            wanted.qpos[self.scene.index.arm_qpos] = posture
            mujoco.mj_kinematics(model, wanted)
            for hand, poses in zip(self._hands, held, strict=True):
                poses.append(hand.pose(wanted))
        moving: list[list[tuple[np.ndarray, ...]]] = [[], []]
        for poses, states in zip(held, moving, strict=True):
            for pose, before, after in zip(poses, [poses[0], *poses], [*poses[1:], poses[-1]], strict=False):
                velocity = (after[0] - before[0]) / (2.0 * step_s)
                states.append((*pose, velocity, _rotation_vector(after[1] @ before[1].T) / (2.0 * step_s)))
        return moving


def teach(
    rng: np.random.Generator,
    *,
    actions: tuple[str, ...] = tuple(ACTIONS),
    grip: Grip | None = None,
    variation: GuidanceVariation | None = None,
) -> list[Lesson]:
    """Teach basic actions, named as in `keyframes.ACTIONS`, to the simulated robot, one lesson each.

    Every action has a generator of its own, so that leaving one out does not change the others after it.
    """
    teacher = Teacher(grip, variation)
    streams = dict(zip(ACTIONS, rng.spawn(len(ACTIONS)), strict=True))
    return [teacher.teach(name, streams.get(name, rng)) for name in actions]


def as_demonstrations(lessons: list[Lesson]) -> Demonstrations:
    """Return what was recorded as a set of basic actions."""
    return Demonstrations(tuple(lesson.name for lesson in lessons), [lesson.recorded for lesson in lessons])


def _scene_with_stand() -> Scene:
    """Build the ring without the bag, the robot's trunk welded to a stand that can be put anywhere."""
    from creative_nao.robot.scene import Scene

    scene = Scene(with_bag=False)
    spec = scene.spec
    spec.worldbody.add_body(name="stand", mocap=True)
    # The solver takes constraints in their order, and the last bits depend on it: the stand comes before the hips, as
    # in the shipped recordings.
    hips = spec.equality("nao/hip_yaw_pitch")
    coupling = {name: getattr(hips, name) for name in ("name", "type", "objtype", "name1", "name2")}
    coupling |= {name: np.array(getattr(hips, name)) for name in ("data", "solref", "solimp")}
    spec.delete(hips)
    weld = np.array([0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0])  # anchor, relative place and attitude, torque scale
    kind, of = mujoco.mjtEq.mjEQ_WELD, mujoco.mjtObj.mjOBJ_BODY
    spec.add_equality(name="stand", type=kind, objtype=of, name1="stand", name2="nao/Torso", data=weld)
    spec.add_equality(**coupling)
    return scene


def shortcomings(lessons: list[Lesson], demos: Demonstrations) -> list[str]:
    """Return what is wrong with what was taught, one sentence each; an empty list when all is well.

    Looked at: joint ranges, the largest speed over the set, the guard at both ends, the robot touching itself. How far
    the actions are from each other is measured where the measures may be used (`cli/teach.py`).
    """
    found = []
    low, high = limits(demos.joints)
    guard = both_arms(GUARD, GUARD)
    for lesson, angles in zip(lessons, demos.trajectories, strict=True):
        beyond = np.maximum(low - angles, angles - high)
        if beyond.max() > ENCODER_STEP_RAD:
            joint = demos.joints[int(beyond.max(axis=0).argmax())]
            found.append(f"{lesson.name} leaves the range of {joint} by {beyond.max():.3f} rad.")
        for when, posture in {"starts": angles[0], "ends": angles[-1]}.items():
            away = np.abs(posture - guard)
            if away.max() > GUARD_TOLERANCE_RAD:
                found.append(
                    f"{lesson.name} {when} {away.max():.3f} rad from the guard at {demos.joints[int(away.argmax())]}, "
                    f"expected at most {GUARD_TOLERANCE_RAD}."
                )
        if lesson.self_contact_share > 0:
            found.append(f"{lesson.name}: the robot touches itself for {lesson.self_contact_share:.1%} of the time.")
    slowest, fastest = SPEED_RANGE_RAD_S
    if not slowest <= demos.max_speed <= fastest:
        found.append(f"the largest speed is {demos.max_speed:.2f} rad/s, expected {slowest} to {fastest}.")
    return found
