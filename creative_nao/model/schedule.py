"""How the closed-loop ratio changes over training (Eq. 5): constant as in the paper, annealed, or random per epoch."""

from __future__ import annotations

import numpy as np

from creative_nao.model.config import TrainingSettings

_STREAM = 1
"""Keeps the draws of the ratio apart from those of the initial weights, which use the same seed."""


def closed_loop_ratios(training: TrainingSettings, start: int, stop: int) -> np.ndarray:
    """Return the closed-loop ratio of each epoch from `start` to `stop`, counted from 0.

    The ratio of an epoch depends on the settings alone, not on where a run was interrupted or how long it is.

    Args:
        training: `closed_loop_ratio`, `schedule`, `anneal_epochs` and `seed` matter.
        start: First epoch.
        stop: Epoch after the last.

    Returns:
        Shape (stop - start,), float64, in [0, 1].
    """
    final = training.closed_loop_ratio
    if training.schedule == "annealed":
        return final * np.minimum(np.arange(start, stop) / training.anneal_epochs, 1.0)
    if training.schedule == "random":
        rng = np.random.default_rng([training.seed, _STREAM])
        return final * rng.uniform(size=stop)[start:]
    return np.full(stop - start, final)


def candidates(training: TrainingSettings, ratios: np.ndarray) -> np.ndarray:
    """Tell which epochs may be the best one: those whose ratio lies within a tenth of the one asked for.

    The loss is easier at a lower ratio, so that losses of different ratios say nothing about each other.

    Args:
        training: The settings.
        ratios: Closed-loop ratio of each epoch.

    Returns:
        Shape of `ratios`, bool; all True for a constant ratio.
    """
    return ratios >= 0.9 * training.closed_loop_ratio
