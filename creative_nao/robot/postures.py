"""Postures of the whole robot: the manufacturer's predefined ones and the boxing guard.

A posture is a mapping from joint name to angle [rad]; joints it leaves out stand at zero. Left and right are mirrored.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.joints import GUARD_ARM_RAD, JOINTS, MIRROR_SIGN
from creative_nao.schema import checked

THIGH_M = 0.1000
TIBIA_M = 0.1029
"""Hip to knee and knee to ankle, as in `nao.xml`."""


def keeps_sign(joint: str) -> bool:
    """Tell whether a joint has the same sign on both sides: pitch, HipYawPitch and Hand do, roll and yaw change it."""
    return joint.endswith(("Pitch", "Hand"))


def _mirrored(both_sides: dict[str, float], **others: float) -> dict[str, float]:
    """Return a posture from the joints of the left limbs, named without the leading L, and those of one side."""
    left = {"L" + joint: angle for joint, angle in both_sides.items()}
    right = {"R" + joint: angle if keeps_sign(joint) else -angle for joint, angle in both_sides.items()}
    return {**left, **right, **others}


def leg_angles(side: str, *, forward_m: float, height_m: float, spread_rad: float) -> dict[str, float]:
    """Return the leg angles that put a flat sole `forward_m` ahead of the hip and `height_m` (ankle to hip) below it.

    Two-link inverse kinematics in the leg's own plane, which leans outward by `spread_rad`; the torso stays upright.
    The knee bends forward.

    Args:
        side: "L" or "R".
        forward_m: Ankle ahead of the hip [m].
        height_m: Height of the hip above the ankle [m]; the leg can span at most 0.2029 m.
        spread_rad: Outward lean of the leg [rad].
    """
    down = height_m / math.cos(spread_rad)
    reach = math.hypot(forward_m, down)
    knee_inside = math.acos((THIGH_M**2 + TIBIA_M**2 - reach**2) / (2 * THIGH_M * TIBIA_M))
    thigh_to_reach = math.acos((THIGH_M**2 + reach**2 - TIBIA_M**2) / (2 * THIGH_M * reach))
    knee = math.pi - knee_inside
    hip_pitch = -math.atan2(forward_m, down) - thigh_to_reach
    outward = spread_rad if side == "L" else -spread_rad
    return {
        f"{side}HipRoll": outward,
        f"{side}HipPitch": hip_pitch,
        f"{side}KneePitch": knee,
        f"{side}AnklePitch": -hip_pitch - knee,
        f"{side}AnkleRoll": -outward,
    }


def _guard() -> dict[str, float]:
    """Boxing stance: the left foot ahead, knees bent so that the legs can give, both fists before the chest."""
    right = np.array(GUARD_ARM_RAD)
    arms = dict(zip(JOINTS, np.concatenate([right, right * MIRROR_SIGN]).tolist(), strict=True))
    ahead = {"L": 0.025, "R": -0.025}
    legs = [leg_angles(side, forward_m=ahead[side], height_m=0.192, spread_rad=0.12) for side in ahead]
    return {"HeadPitch": 0.05, **arms, **legs[0], **legs[1]}


_TABLE = tomllib.loads(Path(__file__).with_name("postures.toml").read_text(encoding="utf-8"))
POSTURES: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {name: _mirrored(**angles) for name, angles in _TABLE.items()} | {"Guard": _guard()}
)
"""The manufacturer's StandZero, Stand, StandInit and Crouch, and the project's own boxing Guard."""


def posture(name: str) -> dict[str, float]:
    """Return a copy of a known posture [rad].

    Raises:
        NotFoundError: If no posture has this name.
        SettingsError: If it is no text.
    """
    if checked(str, name, "name") not in POSTURES:
        raise NotFoundError(
            f"no posture `{name}`{nearest_name(name, POSTURES)}; the known ones are {', '.join(POSTURES)}."
        )
    return dict(POSTURES[name])


def arm_angles(name: str) -> np.ndarray:
    """Return the eight arm angles [rad] of a posture, in the order of `joints.JOINTS`."""
    angles = posture(name)
    return np.array([angles.get(joint, 0.0) for joint in JOINTS])
