"""Every figure of the robot: lengths, masses, inertias, joint ranges and motors of a NAO H25, hardware V6.

The tables give the trunk, the head and the left limbs; `links` mirrors the left limbs to the right by rule. Frames: x
forward, y to the robot's left, z up, all parallel to the torso at the zero pose (standing, arms pointing forward).

Sources (tags in the tables): [L] manufacturer's link table V3.3 and later, equal in V4, V5, V6; [J] manufacturer's H25
joint table; [U6] masses, centres of mass and inertias of the published V6 robot description, inertias averaged over the
left link and the mirrored right one; [UE] effort limits of the published V4 to V6 descriptions; [DS6] NAO6 data sheet:
motor speed divided by gear ratio, gear ratio squared for the class of rotor inertia.
"""

from __future__ import annotations

import dataclasses

Vector = tuple[float, float, float]

TOTAL_MASS_KG = 5.35975
"""Sum of the link masses [U6]; the complete robot is sold as 5.48 kg."""

SOLE_BELOW_ANKLE_M = 0.04519
"""Height of the ankle axes above the sole [L]."""

THIGH_M = 0.1000
TIBIA_M = 0.1029
"""Hip to knee and knee to ankle [L]."""

FIST_IN_HAND_M: Vector = (0.05775, 0.0, -0.01231)
"""Centre of the closed hand in the WristYaw frame [L]; y is mirrored with the rest."""

FINGERS_KG = 0.001
"""Mass of the fingers of a hand [kg]: an estimate, taken off the published mass of the hand, which contains them."""

_DIAGONAL = 0.5**0.5


@dataclasses.dataclass(frozen=True)
class Motor:
    """What turns a joint: the figures shared by all joints that carry the same motor and gear."""

    effort_nm: float
    """Largest torque at the joint [N m] [UE]."""
    speed_rad_s: float
    """Largest speed of the joint [rad/s] [DS6 for head and arms, UE for the legs: the lower of the two]."""
    armature: float
    """Rotor inertia felt at the joint [kg m2]; unpublished, estimated from rotor size times gear ratio squared."""


_HEAD_YAW = Motor(1.547, 7.46, 0.003)
_HEAD_PITCH = Motor(1.532, 6.47, 0.003)
_SHOULDER_PITCH = Motor(1.329, 7.94, 0.003)
_SHOULDER_ROLL = Motor(1.783, 6.47, 0.003)
_ELBOW_YAW = Motor(1.547, 7.46, 0.003)
_ELBOW_ROLL = Motor(1.532, 6.47, 0.003)
_WRIST_YAW = Motor(0.4075, 17.38, 0.0005)
_HAND = Motor(0.292, 24.27, 0.0003)
_LEG_SLOW = Motor(3.348, 4.162, 0.020)
_LEG_FAST = Motor(3.023, 6.402, 0.008)


@dataclasses.dataclass(frozen=True)
class Link:
    """One rigid part and the hinge that carries it."""

    name: str
    parent: str
    joint: str
    motor: Motor
    axis: Vector
    range_rad: tuple[float, float]
    offset_mm: Vector
    """Joint origin in the parent's joint frame [mm] [L]."""
    mass_kg: float
    com_mm: Vector
    """Centre of mass in the link's own joint frame [mm] [U6]."""
    inertia_e6: tuple[float, float, float, float, float, float]
    """xx, yy, zz, xy, xz, yz about the centre of mass [1e-6 kg m2], tensor elements [U6]."""


@dataclasses.dataclass(frozen=True)
class Trunk:
    """The torso: the root of the tree, without a hinge."""

    name: str = "Torso"
    mass_kg: float = 1.04956
    com_mm: Vector = (-4.13, 0.0, 43.42)
    inertia_e6: tuple[float, float, float, float, float, float] = (3083.61, 2883.50, 1592.40, 14.31, -33.02, -27.08)


TORSO = Trunk()

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_HIP_AXIS = (0.0, _DIAGONAL, -_DIAGONAL)

# fmt: off
HEAD: tuple[Link, ...] = (
    Link("Neck", "Torso", "HeadYaw", _HEAD_YAW, _Z, (-2.0857, 2.0857), (0, 0, 126.5),
         0.07842, (-0.01, 0, -27.42), (16.03, 17.04, 5.53, 0.00, 0.00, -0.05)),
    Link("Head", "Neck", "HeadPitch", _HEAD_PITCH, _Y, (-0.6720, 0.5149), (0, 0, 0),
         0.65973, (1.09, 1.46, 57.19), (770.97, 680.37, 714.70, 4.77, 9.62, -18.58)),
)
"""Trunk to head."""

LEFT: tuple[Link, ...] = (
    Link("LShoulder", "Torso", "LShoulderPitch", _SHOULDER_PITCH, _Y, (-2.0857, 2.0857), (0, 98, 100),
         0.09304, (-1.65, -26.63, 0.14), (18.30, 13.90, 20.19, 2.06, 0.00, -0.37)),
    Link("LUpperArm", "LShoulder", "LShoulderRoll", _SHOULDER_ROLL, _Z, (-0.3142, 1.3265), (0, 0, 0),
         0.15777, (24.55, 5.63, 3.30), (95.29, 272.74, 248.17, -40.11, -13.74, -4.35)),
    Link("LElbow", "LUpperArm", "LElbowYaw", _ELBOW_YAW, _X, (-2.0857, 2.0857), (105, 15, 0),
         0.06483, (-27.44, 0, -0.14), (5.60, 26.62, 27.63, 0.00, 0.29, 0.00)),
    Link("LForearm", "LElbow", "LElbowRoll", _ELBOW_ROLL, _Z, (-1.5446, -0.0349), (0, 0, 0),
         0.07761, (25.56, 2.81, 0.76), (24.70, 38.43, 35.95, 3.24, 1.24, 0.14)),
    Link("LHand", "LForearm", "LWristYaw", _WRIST_YAW, _X, (-1.8238, 1.8238), (55.95, 0, 0),
         0.18533 - FINGERS_KG, (34.34, -0.88, 3.08), (68.65, 135.76, 133.23, -5.60, -2.87, -0.50)),
    Link("LFingers", "LHand", "LHand", _HAND, (0.0, -1.0, 0.0), (0.0, 1.0), (57.75, 0, -12.31),
         FINGERS_KG, (10.0, 0, 0), (0.20, 0.20, 0.20, 0.00, 0.00, 0.00)),
    Link("LPelvis", "Torso", "LHipYawPitch", _LEG_SLOW, _HIP_AXIS, (-1.1453, 0.7408), (0, 50, -85),
         0.06981, (-7.81, -11.14, 26.61), (27.64, 49.74, 51.83, 1.08, -1.77, 4.88)),
    Link("LHip", "LPelvis", "LHipRoll", _LEG_SLOW, _X, (-0.3795, 0.7905), (0, 0, 0),
         0.14053, (-15.49, 0.29, -5.15), (23.85, 60.82, 54.37, -0.63, 7.12, -0.21)),
    Link("LThigh", "LHip", "LHipPitch", _LEG_FAST, _Y, (-1.5359, 0.4841), (0, 0, 0),
         0.38968, (1.38, 2.21, -53.73), (510.23, 465.93, 301.22, 2.07, 56.70, -7.50)),
    Link("LTibia", "LThigh", "LKneePitch", _LEG_FAST, _Y, (-0.0923, 2.1125), (0, 0, -100),
         0.30142, (4.53, 2.25, -49.36), (446.55, 387.90, 184.63, 3.84, -35.15, 5.51)),
    Link("LAnkle", "LTibia", "LAnklePitch", _LEG_FAST, _Y, (-1.1864, 0.9227), (0, 0, -102.9),
         0.13416, (0.45, 0.29, 6.85), (32.20, 67.97, 54.85, -0.03, 4.28, 0.28)),
    Link("LFoot", "LAnkle", "LAnkleRoll", _LEG_SLOW, _X, (-0.3979, 0.7690), (0, 0, 0),
         0.17184, (25.42, 3.30, -32.39), (87.22, 352.59, 412.49, 8.63, -2.23, 0.43)),
)
"""Left arm, then left leg. Knee and ankle pitch ranges are the part of [J] that holds on both sides."""
# fmt: on


def keeps_sign(joint: str) -> bool:
    """Tell whether a joint has the same sign on both sides: pitch, HipYawPitch and Hand do, roll and yaw change it."""
    return joint.endswith(("Pitch", "Hand"))


def other_side(name: str) -> str:
    """Return the name of the same part or joint on the other side; names of trunk and head come back unchanged."""
    swap = {"L": "R", "R": "L"}
    return swap[name[0]] + name[1:] if name[:1] in swap else name


def mirrored(link: Link) -> Link:
    """Return the right twin of a left link: reflected in the plane y = 0, with NAOqi's signs of the joints.

    A reflection turns the axis (x, y, z) into (-x, y, -z) at an equal angle. Joints that change sign keep the axis
    instead and have the range turned round.
    """
    x, y, z = link.offset_mm
    com_x, com_y, com_z = link.com_mm
    xx, yy, zz, xy, xz, yz = link.inertia_e6
    low, high = link.range_rad
    same_sign = keeps_sign(link.joint)
    axis = (-link.axis[0], link.axis[1], -link.axis[2]) if same_sign else link.axis
    return dataclasses.replace(
        link,
        name=other_side(link.name),
        parent=other_side(link.parent),
        joint=other_side(link.joint),
        axis=axis,
        range_rad=(low, high) if same_sign else (-high, -low),
        offset_mm=(x, -y, z),
        com_mm=(com_x, -com_y, com_z),
        inertia_e6=(xx, yy, zz, -xy, xz, -yz),
    )


def links() -> tuple[Link, ...]:
    """Return all 26 links with a hinge, parents before children: head, left arm and leg, right arm and leg."""
    return HEAD + LEFT + tuple(mirrored(link) for link in LEFT)
