"""What came out when the robot performed a trajectory: measured angles and everything that can have gone wrong."""

from __future__ import annotations

import dataclasses

import numpy as np

FALL_HEIGHT_M = 0.24
"""The robot has fallen when the torso sinks below this height; in the guard it stands at 0.32 m."""
FALL_TILT_RAD = 0.6
"""... or leans farther than this: the centre of mass is then outside the feet."""
HIT_FORCE_N = 0.5
"""A touch of the bag counts as a hit above this force."""
HIT_PAUSE_S = 0.10
"""Touches closer than this belong to one hit."""


@dataclasses.dataclass(frozen=True)
class Hits:
    """What the bag felt of the robot."""

    count: int
    """Hits, separated by at least 0.1 s without contact."""
    peak_force_n: float
    impulse_ns: float
    """Force integrated over the performance [N s]."""

    @classmethod
    def from_force(cls, force: np.ndarray, step_s: float) -> Hits:
        """Count hits in the force on the bag [N], one value a physics step of `step_s` seconds."""
        touching = np.flatnonzero(force > HIT_FORCE_N)
        starts = np.diff(touching, prepend=-len(force)) * step_s > HIT_PAUSE_S
        return cls(int(starts.sum()), float(force.max(initial=0.0)), float(force.sum() * step_s))


@dataclasses.dataclass(frozen=True, eq=False)
class Performance:
    """One trajectory, performed by the robot standing in the ring. Arrays over joints are in the order of `JOINTS`.

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
