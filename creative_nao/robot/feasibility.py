"""Which trajectories the robot's body refuses: thresholds on a performance, each with its reason.

Whether a trajectory is too fast or does not move is judged on its angles alone, elsewhere; here only what a body adds.
"""

from __future__ import annotations

import dataclasses
import math

from creative_nao.errors import SettingsError
from creative_nao.robot.performance import Performance

PHYSICAL_FAILURES: tuple[str, ...] = ("joint_limit", "fell", "self_collision", "torque_saturated", "tracking_error")
"""Outcomes in the order of precedence: what was asked for first, then what explains what follows it."""


@dataclasses.dataclass(frozen=True)
class PhysicalLimits:
    """From where on a performance counts as failed.

    The six basic actions pass with room to spare: they leave no range, hardly touch themselves, spend at most 1.5 % of
    the time at a torque limit, and miss by 0.032 rad. At 1.5 times their speed, which is as fast as an appropriate
    action may be, they still pass (15 %, 0.058 rad).
    """

    joint_limit_rad: float = 0.03
    """The trajectory may leave a joint's range by this much: gear play and encoder offset of taught recordings."""
    self_collision_share: float = 0.05
    """The robot may touch itself for this share of the time: gloves brush in passing, they do not lean."""
    torque_saturated_share: float = 0.20
    """One motor may work at its torque limit for this share of the time: bursts at the start of punches."""
    tracking_error_rad: float = 0.08
    """Mean error of the worst joint: beyond it the motion seen is another one than the motion asked for."""

    def __post_init__(self) -> None:
        """Check that no threshold is negative or not a number."""
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise SettingsError(f"`{field.name}` should be a number of at least 0, but is {value}.")


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
