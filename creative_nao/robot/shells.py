"""What the robot looks like and where it can be touched: primitive shapes on its links, no meshes.

Contact shapes follow the outlines of the robot's shells within a few millimetres and carry no mass (the links do).
Visual shapes are drawn only. Left limbs are listed, right ones mirrored. Lengths in metres, in the link's own joint
frame.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from creative_nao.robot.tables import LEFT, Vector, other_side

CONTACT_GROUP = 3
"""MuJoCo hides geoms of this group unless asked."""

PAINTS: dict[str, dict[str, Any]] = {
    "shell": {"rgba": (0.93, 0.94, 0.95, 1), "specular": 0.45, "shininess": 0.6},
    "shade": {"rgba": (0.74, 0.76, 0.79, 1), "specular": 0.35, "shininess": 0.5},
    "joint": {"rgba": (0.20, 0.21, 0.24, 1), "specular": 0.25, "shininess": 0.3},
    "accent": {"rgba": (0.10, 0.42, 0.78, 1), "specular": 0.5, "shininess": 0.6},
    "glove": {"rgba": (0.82, 0.08, 0.10, 1), "specular": 0.6, "shininess": 0.7},
    "lace": {"rgba": (0.97, 0.95, 0.90, 1), "specular": 0.1, "shininess": 0.1},
    "sole": {"rgba": (0.28, 0.29, 0.32, 1), "specular": 0.1, "shininess": 0.1},
    "eye": {"rgba": (0.25, 0.85, 1.0, 1), "emission": 0.9, "specular": 0.2, "shininess": 0.2},
    "lens": {"rgba": (0.03, 0.03, 0.04, 1), "specular": 0.9, "shininess": 0.9},
}


@dataclasses.dataclass(frozen=True)
class Shape:
    """One primitive on a link; `contact` shapes collide and are hidden, the others are only drawn."""

    link: str
    kind: str
    size: tuple[float, ...]
    at: Vector = (0.0, 0.0, 0.0)
    turn: Vector = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw [rad] (MuJoCo's euler sequence xyz)."""
    paint: str = "shell"
    ends: tuple[float, ...] = ()
    """Both ends of a capsule or cylinder, instead of `at` and `turn`."""
    contact: bool = False
    name: str = ""


def _touch(link: str, kind: str, size: tuple[float, ...], *, name: str, **place: Any) -> Shape:
    return Shape(link, kind, size, name=name, contact=True, **place)


_Q = math.pi / 2

CONTACTS: tuple[Shape, ...] = (
    _touch("Torso", "box", (0.048, 0.060, 0.050), at=(0.003, 0, 0.065), name="chest"),
    _touch("Torso", "capsule", (0.033,), ends=(0, -0.055, 0.100, 0, 0.055, 0.100), name="shoulders"),
    _touch("Torso", "capsule", (0.045,), ends=(0, 0, -0.050, 0, 0, 0.020), name="belly"),
    _touch("Head", "ellipsoid", (0.060, 0.066, 0.057), at=(-0.001, 0, 0.0573), name="skull"),
    _touch("LUpperArm", "capsule", (0.033,), ends=(0, 0.006, 0, 0.085, 0.012, 0), name="LUpperArm"),
    _touch("LForearm", "capsule", (0.025,), ends=(0.005, 0.002, 0.002, 0.045, 0.002, 0.002), name="LForearm"),
    _touch("LHand", "sphere", (0.033,), at=(0.052, 0, 0), name="LFist"),
    _touch("LPelvis", "sphere", (0.035,), at=(-0.0225, -0.0025, 0.008), name="LPelvis"),
    _touch("LThigh", "capsule", (0.040,), ends=(-0.006, 0, -0.012, 0.012, 0.004, -0.082), name="LThigh"),
    _touch("LTibia", "capsule", (0.040,), ends=(0.008, 0, -0.012, -0.006, 0.006, -0.085), name="LTibia"),
    _touch("LFoot", "box", (0.0751, 0.0444, 0.010), at=(0.0244, 0.0056, -0.03519), name="LFoot"),
)
"""Contact shapes of trunk, head and left limbs; the foot's lower face is the sole."""

SEPARATE: tuple[tuple[str, str], ...] = (
    ("Torso", "Head"),
    ("Torso", "LUpperArm"),
    ("Torso", "LPelvis"),
    ("Torso", "LThigh"),
    ("LPelvis", "LThigh"),
    ("LUpperArm", "LForearm"),
    ("LUpperArm", "LHand"),
    ("LTibia", "LFoot"),
    ("LPelvis", "RPelvis"),
    ("LFoot", "RFoot"),  # the boxes have corners where the feet are round: at Crouch, the manufacturer's, they overlap
)
"""Pairs of links whose shells overlap near their common joints by design: they never collide."""

LOOKS: tuple[Shape, ...] = (
    # Trunk: broad chest, narrow waist, dark hip block, coloured chest panels and the round chest button.
    Shape("Torso", "ellipsoid", (0.054, 0.078, 0.062), at=(0.000, 0, 0.072)),
    Shape("Torso", "ellipsoid", (0.047, 0.056, 0.085), at=(0.001, 0, 0.010), paint="shade"),
    Shape("Torso", "ellipsoid", (0.045, 0.060, 0.034), at=(-0.010, 0, -0.068)),
    Shape("Torso", "ellipsoid", (0.030, 0.024, 0.030), at=(0.000, 0, -0.096), paint="joint"),
    Shape("Torso", "ellipsoid", (0.030, 0.060, 0.070), at=(-0.032, 0, 0.050), paint="shade"),
    Shape(
        "Torso", "ellipsoid", (0.012, 0.026, 0.040), at=(0.0445, 0.036, 0.072), turn=(0.45, 0.0, 0.50), paint="accent"
    ),
    Shape(
        "Torso",
        "ellipsoid",
        (0.012, 0.026, 0.040),
        at=(0.0445, -0.036, 0.072),
        turn=(-0.45, 0.0, -0.50),
        paint="accent",
    ),
    Shape("Torso", "cylinder", (0.0125, 0.004), at=(0.0525, 0, 0.055), turn=(0, _Q, 0), paint="joint"),
    Shape("Torso", "cylinder", (0.0095, 0.0045), at=(0.0535, 0, 0.055), turn=(0, _Q, 0), paint="eye"),
    Shape("Torso", "cylinder", (0.030, 0.006), at=(0, 0, 0.126), paint="joint"),
    Shape("Neck", "cylinder", (0.020, 0.016), at=(0, 0, -0.006), paint="joint"),
    # Head: wide skull, dark band, ring eyes, coloured ears, a small mouth camera.
    Shape("Head", "ellipsoid", (0.058, 0.060, 0.055), at=(-0.001, 0, 0.0583)),
    Shape("Head", "ellipsoid", (0.046, 0.047, 0.036), at=(0.004, 0, 0.031), paint="shade"),
    Shape("Head", "ellipsoid", (0.030, 0.013, 0.014), at=(-0.004, 0, 0.1035), paint="accent"),
    *(
        shape
        for side in (1, -1)
        for shape in (
            Shape(
                "Head",
                "ellipsoid",
                (0.0055, 0.0150, 0.0165),
                at=(0.0520, side * 0.0245, 0.0570),
                turn=(0, 0.02, side * 0.42),
                paint="joint",
            ),
            Shape(
                "Head",
                "ellipsoid",
                (0.0055, 0.0115, 0.0128),
                at=(0.0533, side * 0.0251, 0.0570),
                turn=(0, 0.02, side * 0.42),
                paint="eye",
            ),
            Shape(
                "Head",
                "ellipsoid",
                (0.0055, 0.0060, 0.0066),
                at=(0.0552, side * 0.0258, 0.0570),
                turn=(0, 0.02, side * 0.42),
                paint="lens",
            ),
            Shape(
                "Head", "cylinder", (0.0270, 0.0065), at=(-0.004, side * 0.0585, 0.0560), turn=(_Q, 0, 0), paint="shade"
            ),
            Shape(
                "Head",
                "cylinder",
                (0.0225, 0.0050),
                at=(-0.004, side * 0.0625, 0.0560),
                turn=(_Q, 0, 0),
                paint="accent",
            ),
            Shape(
                "Head", "cylinder", (0.0110, 0.0050), at=(-0.004, side * 0.0640, 0.0560), turn=(_Q, 0, 0), paint="lens"
            ),
        )
    ),
    Shape("Head", "sphere", (0.0060,), at=(0.0545, 0, 0.0790), paint="lens"),
    Shape("Head", "ellipsoid", (0.0060, 0.0110, 0.0050), at=(0.0490, 0, 0.0235), paint="lens"),
    # Arm: dark shoulder, coloured pad, white upper arm, dark elbow, white forearm, red glove with a light cuff.
    Shape("LShoulder", "cylinder", (0.028, 0.020), at=(0, -0.018, 0), turn=(_Q, 0, 0), paint="joint"),
    Shape("LUpperArm", "ellipsoid", (0.040, 0.033, 0.038), at=(0.004, 0.006, 0)),
    Shape("LUpperArm", "ellipsoid", (0.022, 0.006, 0.024), at=(0.004, 0.0355, 0), paint="accent"),
    Shape("LUpperArm", "capsule", (0.0275,), ends=(0.025, 0.009, 0, 0.072, 0.013, 0)),
    Shape("LUpperArm", "cylinder", (0.0235,), ends=(0.075, 0.014, 0, 0.103, 0.015, 0), paint="joint"),
    Shape("LElbow", "sphere", (0.0235,), paint="joint"),
    Shape("LElbow", "cylinder", (0.0120, 0.0255), paint="accent"),
    Shape("LForearm", "capsule", (0.0245,), ends=(0.018, 0.001, 0.001, 0.040, 0.001, 0.001)),
    Shape("LHand", "cylinder", (0.0262,), ends=(0.002, 0, 0, 0.021, 0, 0), paint="lace"),
    Shape("LHand", "cylinder", (0.0268,), ends=(0.008, 0, 0, 0.013, 0, 0), paint="glove"),
    Shape("LHand", "ellipsoid", (0.0360, 0.0345, 0.0365), at=(0.0500, 0, -0.001), paint="glove"),
    Shape("LHand", "ellipsoid", (0.0250, 0.0330, 0.0260), at=(0.0600, 0, -0.006), paint="glove"),
    Shape("LHand", "capsule", (0.0115,), ends=(0.036, -0.024, 0.016, 0.062, -0.021, 0.018), paint="glove"),
    # Leg: white thigh and shin with dark joints, coloured shin guard, rounded foot on a dark sole.
    Shape("LPelvis", "sphere", (0.032,), at=(-0.0180, -0.0025, 0.008), paint="joint"),
    Shape("LHip", "sphere", (0.026,), at=(-0.005, 0, 0), paint="joint"),
    Shape("LThigh", "ellipsoid", (0.041, 0.039, 0.056), at=(0.001, 0.003, -0.034), turn=(0, -0.12, 0)),
    Shape("LThigh", "capsule", (0.033,), ends=(0.004, 0.003, -0.040, 0.010, 0.003, -0.078)),
    Shape("LThigh", "ellipsoid", (0.020, 0.006, 0.030), at=(0.000, 0.0405, -0.034), paint="accent"),
    Shape("LTibia", "cylinder", (0.030, 0.033), at=(0.002, 0.003, 0), turn=(_Q, 0, 0), paint="joint"),
    Shape("LTibia", "ellipsoid", (0.039, 0.037, 0.060), at=(0.001, 0.004, -0.048), turn=(0, 0.08, 0)),
    Shape("LTibia", "ellipsoid", (0.010, 0.020, 0.034), at=(0.0335, 0.004, -0.042), turn=(0, 0.06, 0), paint="accent"),
    Shape("LTibia", "capsule", (0.028,), ends=(-0.002, 0.004, -0.060, -0.003, 0.005, -0.085)),
    Shape("LAnkle", "cylinder", (0.022, 0.027), turn=(_Q, 0, 0), paint="joint"),
    Shape("LFoot", "ellipsoid", (0.080, 0.043, 0.036), at=(0.0244, 0.0056, -0.0300)),
    Shape("LFoot", "ellipsoid", (0.024, 0.024, 0.020), at=(0.0540, 0.0056, -0.0105), paint="accent"),
    Shape("LFoot", "ellipsoid", (0.082, 0.046, 0.0130), at=(0.0244, 0.0056, -0.0330), paint="sole"),
)
"""Visual shapes of trunk, head and left limbs."""

_LEFT_LINKS = frozenset(link.name for link in LEFT)


def mirrored(shape: Shape) -> Shape:
    """Return the twin of a left shape on the right limb: reflected in the plane y = 0."""
    roll, pitch, yaw = shape.turn
    signs = (1, -1, 1, 1, -1, 1)
    return dataclasses.replace(
        shape,
        link=other_side(shape.link),
        name=other_side(shape.name),
        at=(shape.at[0], -shape.at[1], shape.at[2]),
        turn=(-roll, pitch, -yaw),
        ends=tuple(value * sign for value, sign in zip(shape.ends, signs, strict=False)),
    )


def shapes() -> tuple[Shape, ...]:
    """Return all shapes of the robot, contact shapes first."""
    listed = CONTACTS + LOOKS
    return listed + tuple(mirrored(shape) for shape in listed if shape.link in _LEFT_LINKS)


def separated_pairs() -> tuple[tuple[str, str], ...]:
    """Return the pairs of links that never collide, on both sides."""
    both = set(SEPARATE) | {(other_side(one), other_side(two)) for one, two in SEPARATE}
    unique = {frozenset(pair) for pair in both}
    return tuple(sorted((min(pair), max(pair)) for pair in unique))
