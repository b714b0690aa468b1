"""A person's hand around a forearm: a spring and a damper, no stronger than a hand is.

The hand wants the forearm at a place and in an attitude; it pulls and twists towards them. So the arm is dragged, not
set: it lags in a fast punch, sags under its weight, and stops where the robot's body is in the way.
"""

# The bindings of MuJoCo and the element types of dm_control have no static types.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import creative_nao.robot  # noqa: F401 - it chooses how MuJoCo draws, which must come before MuJoCo

# isort: split
import mujoco
import numpy as np

from creative_nao.errors import SettingsError


@dataclass(frozen=True)
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

    stiffness_n_m: float = 1200.0
    damping_ns_m: float = 20.0
    turn_stiffness_nm: float = 6.0
    turn_damping_nms: float = 0.1
    max_force_n: float = 60.0
    max_torque_nm: float = 3.0

    def __post_init__(self) -> None:
        """Refuse a hand that cannot be simulated."""
        for field, largest in {
            "stiffness_n_m": 5000.0,
            "damping_ns_m": 60.0,
            "turn_stiffness_nm": 30.0,
            "turn_damping_nms": 0.5,
            "max_force_n": 500.0,
            "max_torque_nm": 50.0,
        }.items():
            value = getattr(self, field)
            if not 0.0 <= value <= largest:
                raise SettingsError(f"`{field}` should be between 0 and {largest:g}, but is {value}.")


class Hand:
    """One hand on one body of a compiled model.

    Args:
        model: The compiled `mujoco.MjModel`.
        body: Id of the body that is held.
        held_at: Where the hand holds it, in the body's frame [m].
        grip: How firmly.
    """

    def __init__(self, model: Any, body: int, held_at: tuple[float, float, float], grip: Grip) -> None:
        self._model = model
        self._body = body
        self._held_at = np.array(held_at)
        self._grip = grip
        self._jacobian = np.zeros((3, model.nv)), np.zeros((3, model.nv))

    def pose(self, data: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return where the held point is [m] and how the body is turned (3 x 3); needs fresh kinematics."""
        turned = data.xmat[self._body].reshape(3, 3).copy()
        return data.xpos[self._body] + turned @ self._held_at, turned

    def drag(self, data: Any, place: np.ndarray, attitude: np.ndarray, velocity: np.ndarray, spin: np.ndarray) -> float:
        """Add the hand's pull and twist to `data.qfrc_applied` and return the size of the pull [N].

        Args:
            data: The `mujoco.MjData` of the robot, kinematics up to date.
            place: Where the hand wants the held point [m], shape (3,).
            attitude: How it wants the body turned, shape (3, 3).
            velocity: How fast the hand moves [m/s], shape (3,).
            spin: How fast it turns, in the world frame [rad/s], shape (3,).
        """
        here, turned = self.pose(data)
        along, about = self._jacobian
        mujoco.mj_jac(self._model, data, along, about, here, self._body)
        grip = self._grip
        pull = grip.stiffness_n_m * (place - here) + grip.damping_ns_m * (velocity - along @ data.qvel)
        twist = grip.turn_stiffness_nm * rotation_vector(attitude @ turned.T)
        twist += grip.turn_damping_nms * (spin - about @ data.qvel)
        pull = _at_most(pull, grip.max_force_n)
        twist = _at_most(twist, grip.max_torque_nm)
        data.qfrc_applied += along.T @ pull + about.T @ twist
        return float(np.linalg.norm(pull))


def rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """Return axis times angle [rad] of a rotation matrix (3 x 3), exact below half a turn."""
    quaternion, vector = np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


def _at_most(vector: np.ndarray, largest: float) -> np.ndarray:
    size = float(np.linalg.norm(vector))
    return vector * (largest / size) if size > largest else vector
