"""Kinesthetic teaching: a person leads the robot's limp arms through an action, and the robot records its joints.

The robot stands in the guard, its trunk held as by a stand; legs and head are stiff, the arms have stiffness 0. Two
hands hold the forearms near the wrists and follow a varied version of the key postures (`variation.py`) with the
strength of hands (`grip.py`). What is recorded are the readings of the 12-bit encoders at every tick.
"""

# The bindings of MuJoCo and the element types of dm_control have no static types.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import creative_nao.robot  # noqa: F401 - it chooses how MuJoCo draws, which must come before MuJoCo

# isort: split
import mujoco
import numpy as np

from creative_nao.demonstrations.dataset import Demonstrations
from creative_nao.demonstrations.grip import Grip, Hand, rotation_vector
from creative_nao.demonstrations.keyframes import ACTIONS, DT_S, DURATION_S, N_STEPS, keyframes
from creative_nao.demonstrations.variation import GuidedPath, Variation, vary
from creative_nao.joints import JOINTS, read_encoder

if TYPE_CHECKING:
    from creative_nao.robot.scene import Scene

FOREARMS = ("nao/RForearm", "nao/LForearm")
"""Bodies that the hands hold, right first as in `joints.JOINTS`."""
HELD_AT_M = (0.045, 0.0, 0.0)
"""Where the hands hold, in the frame of the forearm: just before the wrist."""

SETTLE_S = 0.5
"""Held still in the first posture before the recording starts [s]."""

FRAME_DT_S = 0.05
"""Time between the snapshots kept for a film [s]."""


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
    """Leads the limp arms of one robot through actions.

    Args:
        grip: How firmly the hands hold.
        variation: How the person differs from the key postures.
    """

    def __init__(self, grip: Grip | None = None, variation: Variation | None = None) -> None:
        self.variation = variation or Variation()
        self.scene = _scene_with_stand()
        model = self._model = self.scene.model
        self._data, self._wanted = mujoco.MjData(model), mujoco.MjData(model)
        self.scene.stiffness.set(JOINTS, 0.0)
        bodies = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in FOREARMS]
        self._hands = [Hand(model, body, HELD_AT_M, grip or Grip()) for body in bodies]
        touch = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, "nao/self_contact")
        self._self_contact = int(model.sensor_adr[touch])

    def teach(self, name: str, rng: np.random.Generator) -> Lesson:
        """Lead the arms through one basic action and record it.

        Args:
            name: One of `keyframes.ACTIONS`.
            rng: Source of all variation.

        Raises:
            NotFoundError: If there is no such basic action.
        """
        movement = keyframes(name)
        path = vary(movement, self.variation, rng)
        step_s = self._model.opt.timestep
        every, n = round(DT_S / step_s), round(DURATION_S / step_s)
        times = np.arange(-round(SETTLE_S / step_s), n + 1) * step_s
        poses = self._hand_poses(path, times)
        data, arm = self._data, self.scene.index.arm_qpos
        self.scene.place(data, "Guard")
        self._hold_trunk()
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
        """Return for each hand and time where it wants the forearm: place, attitude, velocity and spin.

        Found by the robot's own forward kinematics of the posture that the person has in mind.
        """
        model, wanted, step_s = self._model, self._wanted, self._model.opt.timestep
        self.scene.place(wanted, "Guard")
        places: list[list[tuple[np.ndarray, np.ndarray]]] = [[], []]
        for posture in path.at(np.maximum(times, 0.0)):
            wanted.qpos[self.scene.index.arm_qpos] = posture
            mujoco.mj_kinematics(model, wanted)
            for side, hand in enumerate(self._hands):
                places[side].append(hand.pose(wanted))
        poses = []
        for held in places:
            moving = []
            for k, (place, attitude) in enumerate(held):
                before, after = held[max(k - 1, 0)], held[min(k + 1, len(held) - 1)]
                velocity = (after[0] - before[0]) / (2.0 * step_s)
                spin = rotation_vector(after[1] @ before[1].T) / (2.0 * step_s)
                moving.append((place, attitude, velocity, spin))
            poses.append(moving)
        return poses

    def _hold_trunk(self) -> None:
        """Put the stand where the trunk is; the weld between the two then keeps it there."""
        data, index = self._data, self.scene.index
        data.mocap_pos[0] = data.xpos[index.torso]
        data.mocap_quat[0] = data.xquat[index.torso]


def teach(
    rng: np.random.Generator,
    *,
    actions: tuple[str, ...] = tuple(ACTIONS),
    grip: Grip | None = None,
    variation: Variation | None = None,
) -> list[Lesson]:
    """Teach basic actions to the simulated robot, one lesson each.

    Every action has a generator of its own, so that leaving one out does not change the others after it.

    Args:
        rng: Source of all variation.
        actions: Names from `keyframes.ACTIONS`.
        grip: How firmly the hands hold.
        variation: How the person differs from the key postures.
    """
    teacher = Teacher(grip, variation)
    streams = dict(zip(ACTIONS, rng.spawn(len(ACTIONS)), strict=True))
    return [teacher.teach(name, streams.get(name, rng)) for name in actions]


def as_demonstrations(lessons: list[Lesson], record: dict[str, Any] | None = None) -> Demonstrations:
    """Return what was recorded as a set of basic actions."""
    return Demonstrations(
        tuple(lesson.name for lesson in lessons), [lesson.recorded for lesson in lessons], DT_S, JOINTS, record or {}
    )


def _scene_with_stand() -> Scene:
    """Build the ring without the bag, the robot's trunk welded to a stand that can be put anywhere."""
    from creative_nao.robot.scene import Scene

    scene = Scene(with_bag=False)
    root = scene.arena.mjcf_model
    stand = root.worldbody.add("body", name="stand", mocap=True)
    root.equality.add("weld", name="stand", body1=stand, body2=scene.robot.body("Torso"), relpose=(0, 0, 0, 1, 0, 0, 0))
    return scene
