"""Density and coverage: how generated actions lie among those of a reference (Naeem et al. 2020, arXiv:2002.09797)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.checks import refuse_where

NEAREST_K = 5
"""Neighbours that make the ball around a reference item, as in the paper's examples."""


@dataclass(frozen=True)
class DensityCoverage:
    """Attributes of a generated set beside a reference set.

    Attributes:
        density: How many balls of reference items a generated item lies in, divided by k; at least 0, 1 is expected
            where both sets come from one distribution. High where generated items crowd where the reference does.
        coverage: Share of the reference items in whose ball a generated item lies, in [0, 1]; more is better.
    """

    density: float
    coverage: float


def density_coverage(
    reference_distances: np.ndarray, distances: np.ndarray, nearest_k: int = NEAREST_K
) -> DensityCoverage:
    """Return density and coverage from distances of any kind, such as `dtw_matrix` gives.

    The ball of a reference item reaches as far as its k-th nearest neighbour in the reference.

    Args:
        reference_distances: Between reference items, shape (n, n).
        distances: From each reference item to each generated one, shape (n, m).
        nearest_k: k, at least 1 and below n.

    Raises:
        SettingsError: If k is out of range.
        ShapeError: If shapes do not fit or a distance is not a number of at least 0.

    Example:
        Reference 0, 1, 2, 3 on a line; with k = 1 each ball is 1 wide. 0.5 lies in two balls, 9 in none:

        >>> line, generated = np.arange(4.0), np.array([0.5, 9.0])
        >>> density_coverage(abs(line[:, None] - line), abs(line[:, None] - generated), nearest_k=1)
        DensityCoverage(density=1.0, coverage=0.5)
    """
    own, between = np.asarray(reference_distances), np.asarray(distances)
    n = len(own)
    if own.shape != (n, n) or between.ndim != 2 or len(between) != n or not between.shape[1]:
        raise ShapeError(
            f"`reference_distances` and `distances` should have shapes (n, n) and (n, m), but have {own.shape} and "
            f"{between.shape}."
        )
    for name, values in (("reference_distances", own), ("distances", between)):
        refuse_where(~(values >= 0), values, name, "numbers of at least 0")
    if not 1 <= nearest_k < n:
        raise SettingsError(f"`nearest_k` should be at least 1 and below {n}, but is {nearest_k}.")
    # Place 0 of the sorted row is the item itself.
    radii = np.partition(own, nearest_k, axis=1)[:, nearest_k]
    inside = between < radii[:, None]
    # A row of the paper's coverage asks for the nearest generated item alone, which is the same question.
    return DensityCoverage(float(inside.sum(axis=0).mean() / nearest_k), float(inside.any(axis=1).mean()))
