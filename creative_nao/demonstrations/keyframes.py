"""The six basic boxing actions as key postures, each thrown three times from a common guard and back to it.

Between two key postures every joint follows the minimum-jerk curve, the usual description of a person's point-to-point
movement (Flash and Hogan 1985): at rest at both ends, `10 s^3 - 15 s^4 + 6 s^5` of the way at the share `s` of the
time. The key postures (`punches.toml`) are our own. Fists, arms, head and thighs stay more than 1 cm apart, and each
wind-up is large: the six have to be told apart, by whoever watches and by the distance between them.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from creative_nao.errors import NotFoundError, SettingsError, nearest_name
from creative_nao.exchange.motion import DT_S
from creative_nao.joints import GUARD_ARM_RAD, JOINTS, MIRROR_SIGN, limits
from creative_nao.schema import Field, checked, record

N_STEPS = 50  # postures in a basic action: 7.5 s
N_REPEATS = 3  # how often a basic action throws its punch

DURATION_S = (N_STEPS - 1) * DT_S  # time from the first posture to the last [s]
LEAD_S = 0.3  # how long the guard is held before the first punch [s]
END_STOP_MARGIN_RAD = 0.03  # how far from the end stops of the joints a hand stays [rad]

Posture = tuple[float, float, float, float]
"""ShoulderPitch, ShoulderRoll, ElbowYaw and ElbowRoll of the right arm [rad]."""

GUARD: Posture = GUARD_ARM_RAD  # the common start and end

PUNCHES = tomllib.loads(Path(__file__).with_name("punches.toml").read_text(encoding="utf-8"))
"""Each punch as the file describes it: `keys` and `back_s`."""

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
    """Return the key postures of one of `ACTIONS`: the guard, three punches at even intervals, the guard.

    Returns:
        A movement of `DURATION_S` seconds over the eight joints of `joints.JOINTS`.

    Raises:
        NotFoundError: If there is no such basic action.

    Example:
        >>> left_jab = keyframes("left_jab")
        >>> left_jab.at(np.arange(N_STEPS) * DT_S).shape
        (50, 8)
    """
    if checked(str, name, "name") not in ACTIONS:
        raise NotFoundError(
            f"no basic action `{name}`{nearest_name(name, ACTIONS)}; there are {', '.join(f'`{a}`' for a in ACTIONS)}."
        )
    arm, punch = ACTIONS[name]
    out = [(seconds, tuple(posture)) for seconds, *posture in PUNCHES[punch]["keys"]]
    keys = [*out, (PUNCHES[punch]["back_s"], GUARD)]
    pause = (DURATION_S - LEAD_S) / N_REPEATS - sum(seconds for seconds, _ in keys)
    steps = [(LEAD_S, GUARD), *[*keys, (pause, GUARD)] * N_REPEATS]
    times = np.concatenate([[0.0], np.cumsum([seconds for seconds, _ in steps])])
    arms = [GUARD, *[posture for _, posture in steps]]
    postures = [both_arms(a, GUARD) if arm == "right" else both_arms(GUARD, a) for a in arms]
    return Movement(times, np.array(postures))


@record
class GuidanceVariation:
    """How much a person's guidance varies. Zero everywhere gives the key postures exactly.

    Attributes:
        timing: Standard deviation of the logarithm of each segment's duration; 0.04 is about 4 %.
        reach: Standard deviation of each key posture's distance from the guard, as a share of it.
        drift_rad: Standard deviation of a slow wander of each joint, below 0.4 Hz [rad].
        tremor_rad: Standard deviation of the hand's tremor in each joint, 8 to 12 Hz [rad].
    """

    timing: Annotated[float, Field(ge=0, le=0.5)] = 0.04
    reach: Annotated[float, Field(ge=0, le=0.5)] = 0.03
    drift_rad: Annotated[float, Field(ge=0, le=0.5)] = 0.02
    tremor_rad: Annotated[float, Field(ge=0, le=0.1)] = 0.004


def _wobble(
    rng: np.random.Generator, band_hz: tuple[float, float], deviation_rad: float, n_joints: int, n_sines: int = 6
) -> Callable[[np.ndarray], np.ndarray]:
    """Draw a sum of sines per joint: the deviation [rad], shape (n, n_joints), at any times [s]."""
    frequencies = rng.uniform(*band_hz, size=(n_sines, n_joints))
    phases = rng.uniform(0.0, 2.0 * np.pi, size=(n_sines, n_joints))
    amplitude = deviation_rad * np.sqrt(2.0 / n_sines)

    def at(times_s: np.ndarray) -> np.ndarray:
        angle = 2.0 * np.pi * frequencies * np.asarray(times_s)[:, None, None] + phases
        return amplitude * np.sin(angle).sum(axis=1)

    return at


@dataclass(frozen=True)
class GuidedPath:
    """The path along which a hand leads the arms: varied key postures, plus two deviations [rad] at any times [s]."""

    movement: Movement
    drift: Callable[[np.ndarray], np.ndarray]
    tremor: Callable[[np.ndarray], np.ndarray]

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """Return the postures [rad] the hand leads to at `times_s` [s], shape (n, 8), within the joints' ranges."""
        low, high = limits(JOINTS)
        path = self.movement.at(times_s) + self.drift(times_s) + self.tremor(times_s)
        return np.clip(path, low + END_STOP_MARGIN_RAD, high - END_STOP_MARGIN_RAD)


def vary(movement: Movement, variation: GuidanceVariation, rng: np.random.Generator) -> GuidedPath:
    """Return the path of a hand that means `movement` but, like every hand, does not hit it exactly.

    The first and the last posture stay the guard and the total duration stays as it is; every key posture between them
    is reached a little early or late and a little short or far. Held postures stay held.
    """
    checked(Movement, movement, "movement")
    checked(GuidanceVariation, variation, "variation")
    checked(np.random.Generator, rng, "rng")
    durations = np.diff(movement.times_s)
    durations = durations * np.exp(variation.timing * rng.standard_normal(len(durations)))
    durations *= movement.times_s[-1] / durations.sum()
    times = np.concatenate([[0.0], np.cumsum(durations)])

    guard = movement.postures[0]
    moved = movement.postures - guard
    scale = 1.0 + variation.reach * rng.standard_normal(len(moved))
    for key in range(1, len(moved)):
        if np.array_equal(moved[key], moved[key - 1]):
            scale[key] = scale[key - 1]
    n_joints = movement.postures.shape[1]
    return GuidedPath(
        Movement(times, guard + scale[:, None] * moved),
        drift=_wobble(rng, (0.05, 0.4), variation.drift_rad, n_joints),
        tremor=_wobble(rng, (8.0, 12.0), variation.tremor_rad, n_joints),
    )
