"""The six basic boxing actions as key postures, each thrown three times from a common guard and back to it.

A punch is written once, for the right arm, as a list of `(seconds, posture)`: how long the arm takes to reach the
posture. The left arm mirrors it; the other arm keeps the guard. Between two key postures every joint follows the
minimum-jerk curve, the usual description of a person's point-to-point movement (Flash and Hogan 1985): at rest at both
ends, `10 s^3 - 15 s^4 + 6 s^5` of the way at the share `s` of the time.

The key postures are our own. Fists, arms, head and thighs stay more than 1 cm apart, and each wind-up is large: the six
have to be told apart, by whoever watches and by the distance between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from creative_nao.errors import NotFoundError, SettingsError, nearest_name
from creative_nao.joints import GUARD_ARM_RAD, MIRROR_SIGN

DT_S = 0.15
"""Time between two postures of a basic action, the network's tick [s]."""

N_STEPS = 50
"""Postures in a basic action: 7.5 s."""

N_REPEATS = 3
"""How often a basic action throws its punch."""

DURATION_S = (N_STEPS - 1) * DT_S
"""Time from the first posture to the last [s]."""

LEAD_S = 0.3
"""How long the guard is held before the first punch [s]."""

Posture = tuple[float, float, float, float]
"""ShoulderPitch, ShoulderRoll, ElbowYaw and ElbowRoll of the right arm [rad]."""

GUARD: Posture = GUARD_ARM_RAD
"""The common start and end."""

PUNCHES: dict[str, tuple[tuple[float, Posture], ...]] = {
    # The lead arm goes straight out from the guard, without a wind-up, and straight back.
    "jab": (
        (0.40, (0.15, -0.05, 0.6, 0.1)),
        (0.15, (0.15, -0.05, 0.6, 0.1)),
        (0.70, GUARD),
    ),
    # The rear arm is pulled back first, then goes out as far as it can.
    "straight": (
        (0.60, (1.2, -0.35, 0.9, 1.5)),
        (0.45, (0.05, -0.05, 0.5, 0.1)),
        (0.20, (0.05, -0.05, 0.5, 0.1)),
        (0.90, GUARD),
    ),
    # The elbow goes out to the side and up, then the bent arm sweeps inward at shoulder height.
    "hook": (
        (0.70, (0.9, -1.1, 0.6, 1.1)),
        (0.45, (0.1, -0.9, 0.1, 1.2)),
        (0.45, (0.05, 0.1, 0.0, 1.1)),
        (0.60, GUARD),
    ),
    # The fist drops beside the hip, then rises before the face with the elbow bent.
    "uppercut": (
        (0.75, (1.7, -0.3, 1.2, 0.8)),
        (0.30, (0.9, -0.15, 1.2, 1.2)),
        (0.45, (-0.35, 0.0, 1.2, 1.3)),
        (0.70, GUARD),
    ),
}
"""Each punch as `(seconds to reach it, posture of the right arm)`; it begins and ends in the guard."""

ACTIONS: dict[str, tuple[str, str]] = {
    "left_jab": ("left", "jab"),
    "right_straight": ("right", "straight"),
    "left_hook": ("left", "hook"),
    "right_hook": ("right", "hook"),
    "left_uppercut": ("left", "uppercut"),
    "right_uppercut": ("right", "uppercut"),
}
"""The six basic actions in the paper's order: name to (arm, punch)."""


@dataclass(frozen=True)
class Movement:
    """Key postures over time, joined by minimum-jerk segments.

    Attributes:
        times_s: When each key posture is reached [s], rising from 0, shape (n_keys,).
        postures: The key postures [rad], shape (n_keys, n_joints).
    """

    times_s: np.ndarray
    postures: np.ndarray

    def __post_init__(self) -> None:
        """Refuse keys that do not follow each other in time."""
        if len(self.times_s) != len(self.postures) or len(self.times_s) < 2 or np.any(np.diff(self.times_s) <= 0):
            raise SettingsError(
                "`times_s` should rise from key to key, one time for each of at least two postures, but is "
                f"{np.asarray(self.times_s).tolist()} for {len(self.postures)} postures."
            )

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """Return the postures [rad] at `times_s` [s], shape (n, n_joints); the end postures are held outside."""
        times = np.clip(times_s, self.times_s[0], self.times_s[-1])
        segment = np.clip(np.searchsorted(self.times_s, times, side="right") - 1, 0, len(self.times_s) - 2)
        begin, end = self.times_s[segment], self.times_s[segment + 1]
        s = ((times - begin) / (end - begin))[:, None]
        way = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        return self.postures[segment] + way * (self.postures[segment + 1] - self.postures[segment])


def both_arms(right: Posture, left: Posture) -> np.ndarray:
    """Join two arm postures, both written as the right arm's, into one of the order `joints.JOINTS`, shape (8,)."""
    return np.concatenate([right, np.asarray(left) * MIRROR_SIGN])


def keyframes(name: str) -> Movement:
    """Return the key postures of one basic action: the guard, three punches at even intervals, the guard.

    Args:
        name: One of `ACTIONS`.

    Returns:
        A movement of `DURATION_S` seconds over the eight joints of `joints.JOINTS`.

    Raises:
        NotFoundError: If there is no such basic action.

    Example:
        >>> left_jab = keyframes("left_jab")
        >>> left_jab.at(np.arange(N_STEPS) * DT_S).shape
        (50, 8)
    """
    if name not in ACTIONS:
        raise NotFoundError(
            f"no basic action `{name}`{nearest_name(name, ACTIONS)}; there are {', '.join(f'`{a}`' for a in ACTIONS)}."
        )
    arm, punch = ACTIONS[name]
    keys = PUNCHES[punch]
    pause = (DURATION_S - LEAD_S) / N_REPEATS - sum(seconds for seconds, _ in keys)
    steps: Sequence[tuple[float, Posture]] = [(LEAD_S, GUARD), *[*keys, (pause, GUARD)] * N_REPEATS]
    times = np.concatenate([[0.0], np.cumsum([seconds for seconds, _ in steps])])
    arms = [GUARD, *[posture for _, posture in steps]]
    postures = [both_arms(a, GUARD) if arm == "right" else both_arms(GUARD, a) for a in arms]
    return Movement(times, np.array(postures))
