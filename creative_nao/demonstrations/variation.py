"""How a person's hand differs from the key postures: timing, reach, slow drift and tremor, all from one generator.

Every part is a function of continuous time, so the same hand can be followed at the physics step or at the tick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.demonstrations.keyframes import Movement
from creative_nao.errors import SettingsError
from creative_nao.joints import JOINTS, limits


@dataclass(frozen=True)
class Variation:
    """How much a person's guidance varies. Zero everywhere gives the key postures exactly.

    Attributes:
        timing: Standard deviation of the logarithm of each segment's duration; 0.04 is about 4 %.
        reach: Standard deviation of each key posture's distance from the guard, as a share of it.
        drift_rad: Standard deviation of a slow wander of each joint, below 0.4 Hz [rad].
        tremor_rad: Standard deviation of the hand's tremor in each joint, 8 to 12 Hz [rad].
    """

    timing: float = 0.04
    reach: float = 0.03
    drift_rad: float = 0.02
    tremor_rad: float = 0.004

    def __post_init__(self) -> None:
        """Refuse settings that no hand has."""
        for field, largest in {"timing": 0.5, "reach": 0.5, "drift_rad": 0.5, "tremor_rad": 0.1}.items():
            value = getattr(self, field)
            if not 0.0 <= value <= largest:
                raise SettingsError(f"`{field}` should be between 0 and {largest}, but is {value}.")


@dataclass(frozen=True)
class Wobble:
    """A sum of sines per joint: a smooth random signal that can be evaluated at any time.

    Attributes:
        frequencies_hz: Shape (n_sines, n_joints).
        phases: Shape (n_sines, n_joints) [rad].
        amplitude: Of each sine [rad].
    """

    frequencies_hz: np.ndarray
    phases: np.ndarray
    amplitude: float

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """Return the deviation [rad] at `times_s` [s], shape (n, n_joints)."""
        angle = 2.0 * np.pi * self.frequencies_hz * np.asarray(times_s)[:, None, None] + self.phases
        return self.amplitude * np.sin(angle).sum(axis=1)


def draw_wobble(
    rng: np.random.Generator, band_hz: tuple[float, float], deviation_rad: float, n_joints: int, n_sines: int = 6
) -> Wobble:
    """Draw a wobble whose frequencies lie in `band_hz` and whose standard deviation is `deviation_rad`."""
    frequencies = rng.uniform(*band_hz, size=(n_sines, n_joints))
    phases = rng.uniform(0.0, 2.0 * np.pi, size=(n_sines, n_joints))
    return Wobble(frequencies, phases, deviation_rad * np.sqrt(2.0 / n_sines))


@dataclass(frozen=True)
class GuidedPath:
    """The path along which a hand leads the arms.

    Attributes:
        movement: The varied key postures.
        drift: Slow wander.
        tremor: Fast wander.
        margin_rad: How far from the end stops the hand stays [rad].
    """

    movement: Movement
    drift: Wobble
    tremor: Wobble
    margin_rad: float = 0.03

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """Return the postures [rad] the hand leads to at `times_s` [s], shape (n, 8), within the joints' ranges."""
        low, high = limits(JOINTS)
        path = self.movement.at(times_s) + self.drift.at(times_s) + self.tremor.at(times_s)
        return np.clip(path, low + self.margin_rad, high - self.margin_rad)


def vary(movement: Movement, variation: Variation, rng: np.random.Generator) -> GuidedPath:
    """Return the path of a hand that means `movement` but, like every hand, does not hit it exactly.

    The first and the last posture stay the guard and the total duration stays as it is; every key posture between them
    is reached a little early or late and a little short or far. Held postures stay held.

    Args:
        movement: What is meant; its first posture is the guard.
        variation: How much the hand varies.
        rng: Source of all randomness.
    """
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
        drift=draw_wobble(rng, (0.05, 0.4), variation.drift_rad, n_joints),
        tremor=draw_wobble(rng, (8.0, 12.0), variation.tremor_rad, n_joints),
    )
