"""The result of a trajectory performed by the robot, and the limits beyond which it counts as a physical failure.

Whether a trajectory is too fast or does not move is judged on its angles alone; here only what a body adds.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from creative_nao.schema import NonNegative, record

FALL_HEIGHT_M = 0.24  # the robot has fallen when the torso sinks below this height; in the guard it stands at 0.32 m
FALL_TILT_RAD = 0.6
"""... or leans farther than this: the centre of mass is then outside the feet."""
HIT_FORCE_N = 0.5  # a touch of the bag counts as a hit above this force
HIT_PAUSE_S = 0.10  # touches closer than this belong to one hit
PHYSICAL_FAILURES: tuple[str, ...] = ("joint_limit", "fell", "self_collision", "torque_saturated", "tracking_error")
"""Outcomes in the order of precedence: what was asked for first, then what explains what follows it."""


@dataclasses.dataclass(frozen=True)
class Hits:
    """Contacts of the robot with the bag, counted from the net force between them."""

    count: int
    """Hits, separated by at least 0.1 s without contact."""
    peak_force_n: float
    impulse_ns: float
    """Force integrated over the performance [N s]."""
    moments: tuple[tuple[float, float], ...] = ()
    """When each hit began [s], and its largest force [N]."""

    @classmethod
    def from_force(cls, force: np.ndarray, step_s: float) -> Hits:
        """Count hits in the force on the bag [N], one value a physics step of `step_s` seconds."""
        touching = np.flatnonzero(force > HIT_FORCE_N)
        starts = np.flatnonzero(np.diff(touching, prepend=-len(force)) * step_s > HIT_PAUSE_S)
        peaks = np.maximum.reduceat(force[touching], starts) if len(starts) else starts
        moments = tuple(zip((touching[starts] * step_s).tolist(), peaks.tolist(), strict=True))
        return cls(len(starts), float(force.max(initial=0.0)), float(force.sum() * step_s), moments)


@dataclasses.dataclass(frozen=True, eq=False)
class Performance:
    """The result of one trajectory, performed by the robot in the ring; arrays over joints in the order of `JOINTS`.

    Errors compare target and joint angle every 10 ms, from the first posture on; the way there from the guard counts
    only for falling.
    """

    measured: np.ndarray
    """Encoder readings at each tick [rad], shape (n_steps, 8), whole 12-bit counts; row 0 is read at the start."""
    commanded: np.ndarray
    """The trajectory asked for [rad], shape (n_steps, 8)."""
    dt_s: float
    mean_error_rad: np.ndarray
    """Mean absolute tracking error, shape (8,)."""
    max_error_rad: np.ndarray
    """Largest tracking error, shape (8,)."""
    saturated_share: np.ndarray
    """Share of the time with the motor at its torque limit, shape (8,)."""
    limit_excess_rad: float
    """How far the trajectory leaves the joint ranges at most; commands are clipped to the ranges."""
    self_collision_share: float
    """Share of the time in which the robot touches itself."""
    fell: bool
    lowest_torso_m: float
    largest_tilt_rad: float
    hits: Hits
    fist_peak_speed_m_s: np.ndarray
    """Right and left, in the world frame, shape (2,)."""
    frames: np.ndarray | None = None
    """Every few steps the whole `qpos`, shape (n_frames, nq), if asked for; frame 0 is the first posture."""
    frame_dt_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """From the first posture to the last [s]."""
        return (len(self.commanded) - 1) * self.dt_s


def has_fallen(height_m: np.ndarray, tilt_rad: np.ndarray) -> bool:
    """Tell whether the torso ever sank or leaned too far; numbers that are not finite count as a fall."""
    upright = (height_m > FALL_HEIGHT_M) & (tilt_rad < FALL_TILT_RAD)
    return not bool(upright.all())


def tilt_rad(quaternions: np.ndarray) -> np.ndarray:
    """Return the angle between the torso's own z axis and the vertical [rad]; shape (n, 4) to (n,)."""
    x, y = quaternions[:, 1], quaternions[:, 2]
    return np.arccos(np.clip(1 - 2 * (x * x + y * y), -1, 1))


@record
class PhysicalLimits:
    """From where on a performance counts as failed.

    The six basic actions pass with room to spare: they leave no range, hardly touch themselves, spend at most 1.5 % of
    the time at a torque limit, and miss by 0.032 rad. At 1.5 times their speed, which is as fast as an appropriate
    action may be, they still pass (15 %, 0.058 rad).
    """

    joint_limit_rad: NonNegative = 0.03
    """The trajectory may leave a joint's range by this much: gear play and encoder offset of taught recordings."""
    self_collision_share: NonNegative = 0.05
    """The robot may touch itself for this share of the time: gloves brush in passing, they do not lean."""
    torque_saturated_share: NonNegative = 0.20
    """One motor may work at its torque limit for this share of the time: bursts at the start of punches."""
    tracking_error_rad: NonNegative = 0.08
    """Mean error of the worst joint: beyond it the motion seen is another one than the motion asked for."""


def failures(performance: Performance, limits: PhysicalLimits | None = None) -> tuple[str, ...]:
    """Return all of `PHYSICAL_FAILURES` that a performance trips, in their order; empty if the body did what was asked.

    A trajectory beyond the joint ranges was never performable; a fall explains any collision, torque and error after
    it; the error comes last because it follows from the others.
    """
    limits = limits or PhysicalLimits()
    tripped = {
        "joint_limit": performance.limit_excess_rad > limits.joint_limit_rad,
        "fell": performance.fell,
        "self_collision": performance.self_collision_share > limits.self_collision_share,
        "torque_saturated": bool((performance.saturated_share > limits.torque_saturated_share).any()),
        # Written so that an error that is not a number trips.
        "tracking_error": not bool((performance.mean_error_rad <= limits.tracking_error_rad).all()),
    }
    return tuple(name for name in PHYSICAL_FAILURES if tripped[name])


def first_failure(performance: Performance, limits: PhysicalLimits | None = None) -> str | None:
    """Return the first of the failures, the one that explains the others, or None if the body did what was asked."""
    return next(iter(failures(performance, limits)), None)
