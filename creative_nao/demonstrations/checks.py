"""Is a set of taught boxing actions fit to learn from? What is wrong is said in words, nothing is mended."""

from __future__ import annotations

import numpy as np

from creative_nao.demonstrations.dataset import Demonstrations
from creative_nao.demonstrations.keyframes import GUARD, both_arms
from creative_nao.demonstrations.teaching import Lesson
from creative_nao.joints import ENCODER_STEP_RAD, limits

SPEED_RANGE_RAD_S = (5.0, 6.0)
"""Where the largest speed over a tick, over the whole set, should lie: brisk, and within what the motors can do."""

GUARD_TOLERANCE_RAD = 0.12
"""How far from the guard an action may start and end [rad]; every generated action starts at the mean."""

MIN_DISTANCE_RAD = 20.0
"""Smallest warping distance between two of the six: twice the distance up to which an action counts as learned."""


def shortcomings(lessons: list[Lesson], demos: Demonstrations) -> list[str]:
    """Return what is wrong with what was taught, one sentence each; an empty list when all is well.

    Looked at: joint ranges, the largest speed over the set, the guard at both ends, the robot touching itself. How far
    the actions are from each other is measured where the measures may be used (`cli/teach.py`).
    """
    found = []
    low, high = limits(demos.joints)
    guard = both_arms(GUARD, GUARD)
    for lesson, angles in zip(lessons, demos.trajectories, strict=True):
        beyond = np.maximum(low - angles, angles - high)
        if beyond.max() > ENCODER_STEP_RAD:
            joint = demos.joints[int(beyond.max(axis=0).argmax())]
            found.append(f"{lesson.name} leaves the range of {joint} by {beyond.max():.3f} rad.")
        for when, posture in {"starts": angles[0], "ends": angles[-1]}.items():
            away = np.abs(posture - guard)
            if away.max() > GUARD_TOLERANCE_RAD:
                found.append(
                    f"{lesson.name} {when} {away.max():.3f} rad from the guard at {demos.joints[int(away.argmax())]}, "
                    f"expected at most {GUARD_TOLERANCE_RAD}."
                )
        if lesson.self_contact_share > 0:
            found.append(f"{lesson.name}: the robot touches itself for {lesson.self_contact_share:.1%} of the time.")
    slowest, fastest = SPEED_RANGE_RAD_S
    if not slowest <= demos.max_speed <= fastest:
        found.append(f"the largest speed is {demos.max_speed:.2f} rad/s, expected {slowest} to {fastest}.")
    return found
