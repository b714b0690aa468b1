"""Random samples of generated actions: what novelty and diversity are means over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.errors import SettingsError, ShapeError

N_SAMPLES = 30
"""Actions in a sample, as in the paper."""

N_DRAWS = 30
"""Samples drawn, as in the paper."""


@dataclass(frozen=True, eq=False)
class Draws:
    """A measure over repeated random samples.

    Attributes:
        mean: Mean over the samples.
        std: Standard deviation over the samples (n - 1 in the denominator; 0 for a single sample).
        values: The measure of each sample, shape (n_draws,).
        n_samples: Actions in each sample: as many as asked for, or all where there were fewer.
    """

    mean: float
    std: float
    values: np.ndarray
    n_samples: int


def draw_samples(
    available: np.ndarray, rng: np.random.Generator | int, n_samples: int, n_draws: int, at_least: int = 1
) -> np.ndarray:
    """Draw samples of the available actions, each without repetition.

    Where fewer than `n_samples` are available, each sample holds all of them: the measure is then exact and its
    standard deviation 0. The same seed draws the same actions for novelty and for diversity.

    Args:
        available: Whether each action may be drawn, shape (n,) of bool.
        rng: A generator, or a seed for one.
        n_samples: Actions in a sample.
        n_draws: Number of samples.
        at_least: How many available actions the measure needs to exist at all.

    Returns:
        Indices of the drawn actions, shape (n_draws, n_samples or fewer).

    Raises:
        ShapeError: If fewer than `at_least` actions are available.
        SettingsError: If a number is below one.
    """
    for name, value in {"n_samples": n_samples, "n_draws": n_draws}.items():
        if value < 1:
            raise SettingsError(f"`{name}` should be at least 1, but is {value}.")
    if n_samples < at_least:
        raise SettingsError(f"`n_samples` should be at least {at_least} for this measure, but is {n_samples}.")
    indices = np.flatnonzero(available)
    if len(indices) < at_least:
        raise ShapeError(
            f"`trajectories` should hold at least {at_least} appropriate actions to draw from, "
            f"but {len(indices)} of {len(available)} are appropriate."
        )
    generator = np.random.default_rng(rng)
    size = min(n_samples, len(indices))
    return np.array([np.sort(generator.choice(indices, size=size, replace=False)) for _ in range(n_draws)])


def summarise(values: np.ndarray, n_samples: int) -> Draws:
    """Join the measure of each sample, shape (n_draws,), into its mean and spread."""
    std = float(values.std(ddof=1)) if len(values) > 1 else 0.0
    return Draws(float(values.mean()), std, values, n_samples)


def check_mask(appropriate: np.ndarray, n: int) -> None:
    """Refuse a mask that does not say yes or no for each of `n` trajectories.

    Raises:
        ShapeError: If its shape or type is another.
    """
    if appropriate.shape != (n,) or appropriate.dtype != bool:
        raise ShapeError(
            f"`appropriate` should be a mask of shape ({n},), one bool for each trajectory, "
            f"but is {appropriate.dtype} of shape {appropriate.shape}."
        )
