"""Postures of the whole robot: the manufacturer's predefined ones and the boxing guard.

A posture is a mapping from joint name to angle [rad]; joints it leaves out stand at zero. Left and right are mirrored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.joints import GUARD_ARM_RAD, JOINTS, MIRROR_SIGN
from creative_nao.schema import checked

THIGH_M = 0.1000
TIBIA_M = 0.1029
"""Hip to knee and knee to ankle, as in `nao.xml`."""

STANCE_HEIGHT_M = 0.192
"""Hip above ankle in the boxing stance: knees bent, so that the legs can give."""
STANCE_STAGGER_M = 0.025
"""The left foot stands this far ahead of the hip, the right one as far behind."""
STANCE_SPREAD_RAD = 0.12
"""Legs apart by this hip roll on each side."""


def keeps_sign(joint: str) -> bool:
    """Tell whether a joint has the same sign on both sides: pitch, HipYawPitch and Hand do, roll and yaw change it."""
    return joint.endswith(("Pitch", "Hand"))


def both_sides(**left: float) -> dict[str, float]:
    """Return a posture from angles of the left limbs, given without the leading L; the right side is mirrored."""
    posture = {}
    for joint, angle in left.items():
        posture["L" + joint] = angle
        posture["R" + joint] = angle if keeps_sign(joint) else -angle
    return posture


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
    """Boxing stance: left foot forward, knees bent, soles flat, both fists before the chest."""
    legs = {"height_m": STANCE_HEIGHT_M, "spread_rad": STANCE_SPREAD_RAD}
    right = np.array(GUARD_ARM_RAD)
    arms = dict(zip(JOINTS, np.concatenate([right, right * MIRROR_SIGN]).tolist(), strict=True))
    return {
        "HeadPitch": 0.05,
        **arms,
        **leg_angles("L", forward_m=STANCE_STAGGER_M, **legs),
        **leg_angles("R", forward_m=-STANCE_STAGGER_M, **legs),
    }


POSTURES: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "StandZero": both_sides(ShoulderRoll=0.0087, ElbowRoll=-0.0349),
        "Stand": {"HeadPitch": -0.17}
        | both_sides(
            ShoulderPitch=1.4426,
            ShoulderRoll=0.2245,
            ElbowYaw=-1.2023,
            ElbowRoll=-0.4173,
            HipYawPitch=-0.17,
            HipRoll=0.1191,
            HipPitch=0.1274,
            KneePitch=-0.0923,
            AnklePitch=0.0874,
            AnkleRoll=-0.1108,
            Hand=0.3,
        )
        | {"LWristYaw": 0.1, "RWristYaw": 0.1},
        "StandInit": both_sides(
            ShoulderPitch=1.4,
            ShoulderRoll=0.3,
            ElbowYaw=-1.39,
            ElbowRoll=-1.01,
            HipPitch=-0.45,
            KneePitch=0.7,
            AnklePitch=-0.35,
            Hand=0.25,
        ),
        "Crouch": {"HeadPitch": 0.1}
        | both_sides(
            ShoulderPitch=1.3969,
            ShoulderRoll=0.1596,
            ElbowYaw=-0.7917,
            ElbowRoll=-1.0737,
            WristYaw=0.15,
            HipYawPitch=-0.25,
            HipRoll=-0.08,
            HipPitch=-0.7,
            KneePitch=2.11,
            AnklePitch=-1.18,
            AnkleRoll=0.077,
        ),
        "Guard": _guard(),
    }
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
