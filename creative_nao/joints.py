"""The eight arm joints that carry an action: names, order, limits. Nothing else in the project fixes the order.

Names, signs and the zero pose are NAOqi's: the left arm mirrors the right by changing the sign of roll and yaw.
Ranges are those of the NAO H25 documentation, equal in V4, V5 and V6 [rad].
"""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.errors import ShapeError

JOINTS: tuple[str, ...] = (
    "RShoulderPitch",
    "RShoulderRoll",
    "RElbowYaw",
    "RElbowRoll",
    "LShoulderPitch",
    "LShoulderRoll",
    "LElbowYaw",
    "LElbowRoll",
)
"""Order of the columns of every trajectory."""

N_JOINTS = len(JOINTS)

LIMITS_RAD: dict[str, tuple[float, float]] = {
    "RShoulderPitch": (-2.0857, 2.0857),
    "RShoulderRoll": (-1.3265, 0.3142),
    "RElbowYaw": (-2.0857, 2.0857),
    "RElbowRoll": (0.0349, 1.5446),
    "LShoulderPitch": (-2.0857, 2.0857),
    "LShoulderRoll": (-0.3142, 1.3265),
    "LElbowYaw": (-2.0857, 2.0857),
    "LElbowRoll": (-1.5446, -0.0349),
}
"""Smallest and largest angle of each joint [rad]."""

_MAX_SPEED_RAD_S = {"ShoulderPitch": 7.94, "ShoulderRoll": 6.47, "ElbowYaw": 7.46, "ElbowRoll": 6.47}
MAX_SPEED_RAD_S: dict[str, float] = {joint: _MAX_SPEED_RAD_S[joint[1:]] for joint in JOINTS}
"""No-load speed of each joint, from the NAO6 motor data and gear ratios [rad/s]."""

ENCODER_STEP_RAD = 2.0 * np.pi / 4096  # one count of the 12-bit joint encoders [rad]

MIRROR_SIGN: np.ndarray = np.array([1.0, -1.0, -1.0, -1.0])
"""Factor that turns (ShoulderPitch, ShoulderRoll, ElbowYaw, ElbowRoll) of one arm into the other arm's."""


GUARD_ARM_RAD: tuple[float, float, float, float] = (0.9, -0.15, 0.9, 1.4)
"""Right arm in the boxing guard, where every basic action begins and ends: ShoulderPitch, ShoulderRoll, ElbowYaw,
ElbowRoll [rad]; elbows down, fists before the chest. The left arm mirrors it."""


def limits(joints: tuple[str, ...] = JOINTS) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and the upper limits [rad] of `joints`, each of shape (n_joints,)."""
    pairs = np.array([LIMITS_RAD[joint] for joint in joints])
    return pairs[:, 0].copy(), pairs[:, 1].copy()


def read_encoder(angles: np.ndarray) -> np.ndarray:
    """Round joint angles [rad] of any shape to whole counts of the 12-bit encoders, as the robot reports them."""
    return np.round(np.asarray(angles, dtype=np.float64) / ENCODER_STEP_RAD) * ENCODER_STEP_RAD


def joint_angles(values: Any, called: str, joints: tuple[str, ...], least: int = 1) -> np.ndarray:
    """Return an own float64 copy of angles, shape (n_steps >= least, n_joints); messages say what they are called.

    Raises:
        ShapeError: If they are no finite numbers of that shape.
    """
    try:
        if isinstance(values, np.ma.MaskedArray):  # the angles under its mask would be taken for measured ones
            raise TypeError
        angles = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ShapeError(f"`{called}` should be an array of numbers, but is {type(values).__name__}.") from None
    if angles.ndim != 2 or angles.shape[1] != len(joints) or len(angles) < least:
        raise ShapeError(
            f"`{called}` should have shape (n_steps >= {least}, {len(joints)}), one column for each of "
            f"{', '.join(joints)}, but has {angles.shape}."
        )
    broken = np.argwhere(~np.isfinite(angles))
    if len(broken):
        row, column = broken[0]
        raise ShapeError(f"`{called}` should hold finite angles, but {joints[column]} at step {row} is not a number.")
    return angles
