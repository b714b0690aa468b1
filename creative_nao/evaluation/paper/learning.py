"""Learning curves as numbers: how fast the loss falls and how unsteadily."""

from __future__ import annotations

import numpy as np

from creative_nao.model import Memory

LEVEL = 0.01
"""Share of its first value that the loss has to fall below to count as converged; the paper names no criterion."""

WARM_UP = 0.1
"""Share of the training that is left out of the unsteadiness: there the loss falls steeply in every condition."""


def epochs_to_level(memory: Memory, level: float = LEVEL) -> int | None:
    """Return the first epoch whose loss is at most `level` times the first one; None if there is none.

    The curve that a memory keeps has at most 5000 points, so the answer is exact to a spacing of them.
    """
    history = memory.loss_history
    below = np.flatnonzero(history <= level * history[0])
    return int(below[0]) * memory.loss_every + 1 if len(below) else None


def unsteadiness(memory: Memory) -> float:
    """Return the mean change of log10(loss) from one kept point of the curve to the next, without the first tenth.

    Curves are compared at the same spacing only, which networks trained for the same number of epochs have.
    """
    history = memory.loss_history[int(WARM_UP * len(memory.loss_history)) :]
    return float(np.abs(np.diff(np.log10(history.astype(np.float64)))).mean()) if len(history) > 1 else 0.0
