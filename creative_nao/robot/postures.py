"""Postures of the whole robot: the manufacturer's predefined ones and the boxing guard.

A posture is a mapping from joint name to angle [rad]; joints it leaves out stand at zero. Left and right are mirrored.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.joints import GUARD_ARM_RAD, JOINTS, MIRROR_SIGN
from creative_nao.schema import checked


def keeps_sign(joint: str) -> bool:
    """Tell whether a joint has the same sign on both sides: pitch, HipYawPitch and Hand do, roll and yaw change it."""
    return joint.endswith(("Pitch", "Hand"))


def _mirrored(both_sides: dict[str, float], **others: float) -> dict[str, float]:
    """Return a posture from the joints of the left limbs, named without the leading L, and those of one side."""
    left = {"L" + joint: angle for joint, angle in both_sides.items()}
    right = {"R" + joint: angle if keeps_sign(joint) else -angle for joint, angle in both_sides.items()}
    return {**left, **right, **others}


_TABLE = tomllib.loads(Path(__file__).with_name("postures.toml").read_text(encoding="utf-8"))
_GUARD_ARMS = np.concatenate([GUARD_ARM_RAD, np.array(GUARD_ARM_RAD) * MIRROR_SIGN]).tolist()
_TABLE["Guard"] |= dict(zip(JOINTS, _GUARD_ARMS, strict=True))
POSTURES: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {name: _mirrored(**angles) for name, angles in _TABLE.items()}
)
"""The manufacturer's StandZero, Stand, StandInit and Crouch, and the project's own boxing Guard."""


def posture(name: str) -> dict[str, float]:
    """Return a copy of a known posture [rad]; NotFoundError if none has this name, SettingsError if it is no text."""
    if checked(str, name, "name") not in POSTURES:
        raise NotFoundError(
            f"no posture `{name}`{nearest_name(name, POSTURES)}; the known ones are {', '.join(POSTURES)}."
        )
    return dict(POSTURES[name])


def arm_angles(name: str) -> np.ndarray:
    """Return the eight arm angles [rad] of a posture, in the order of `joints.JOINTS`."""
    angles = posture(name)
    return np.array([angles.get(joint, 0.0) for joint in JOINTS])
