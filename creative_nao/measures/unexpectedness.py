"""Unexpectedness: how rarely would chance have found something as new?"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import ShapeError
from creative_nao.measures.checks import refuse_where


def unexpectedness(distances: ArrayLike, expected: ArrayLike) -> np.ndarray:
    """Return the surprisal of actions [bit], shape (n,): at least 0; higher is less expected.

    Novelty asks how far an action lies from what is known; unexpectedness how rarely one lies as far (the distinction
    of Barto, Mirolli and Baldassarre 2013). It is -log2 of the share of expected actions that are at least as new,
    (count + 1) / (n_expected + 1), so that the most that n expected actions can tell is log2(n + 1).

    Args:
        distances: Of each action to what is known [rad], shape (n,), such as `Scores.novelty`.
        expected: The same of the actions that were to be expected, such as those drawn from the grid; shape (m,).

    Raises:
        ShapeError: If shapes do not fit or a distance is not a number of at least 0.

    Example:
        >>> unexpectedness([0.0, 2.5, 9.0], expected=[1.0, 2.0, 3.0]).tolist()
        [0.0, 1.0, 2.0]
    """
    found, usual = np.asarray(distances, dtype=np.float64), np.asarray(expected, dtype=np.float64)
    if found.ndim != 1 or usual.ndim != 1 or not len(usual):
        raise ShapeError(
            "`distances` and `expected` should have shapes (n,) and (m,) with m at least 1, but have "
            f"{found.shape} and {usual.shape}."
        )
    for name, values in (("distances", found), ("expected", usual)):
        refuse_where(~(values >= 0), values, name, "numbers of at least 0")
    as_new = len(usual) - np.searchsorted(np.sort(usual), found, side="left")
    return -np.log2((as_new + 1) / (len(usual) + 1)) + 0.0
