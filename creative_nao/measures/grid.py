"""A grid over descriptors: how many kinds of action were found, and how good the best of each is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.checks import refuse_where


@dataclass(frozen=True)
class GridQuality:
    """Figures of a filled grid.

    Attributes:
        qd_score: Sum over the filled cells of the best quality in each (Pugh et al. 2015); more is better.
        coverage: Share of the cells that hold something, in [0, 1] (Mouret and Clune 2015); more is better.
        n_filled: Cells that hold something.
    """

    qd_score: float
    coverage: float
    n_filled: int


def grid_quality(
    descriptors: ArrayLike, qualities: ArrayLike, low: ArrayLike, high: ArrayLike, n_cells: int = 8
) -> GridQuality:
    """Put items into the cells of a grid by their descriptors and keep the best of each cell.

    Args:
        descriptors: Where each item lies, shape (n, n_dims); beyond the range it falls into the outermost cell.
        qualities: How good it is, shape (n,), at least 0, so that a filled cell never counts against.
        low: Lower end of each descriptor, shape (n_dims,).
        high: Upper end, above `low`.
        n_cells: Cells along each dimension.

    Raises:
        ShapeError: If shapes do not fit, a value is not finite or a quality negative.
        SettingsError: If a range is empty or `n_cells` below 1.

    Example:
        >>> grid_quality([[0.1], [0.2], [0.9]], [1.0, 3.0, 2.0], low=[0], high=[1], n_cells=2)
        GridQuality(qd_score=5.0, coverage=1.0, n_filled=2)
    """
    places, values = np.asarray(descriptors, dtype=np.float64), np.asarray(qualities, dtype=np.float64)
    lowest, highest = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    if places.ndim != 2 or values.shape != places.shape[:1] or not lowest.shape == highest.shape == places.shape[1:]:
        raise ShapeError(
            "`descriptors`, `qualities`, `low` and `high` should have shapes (n, n_dims), (n,), (n_dims,) and "
            f"(n_dims,), but have {places.shape}, {values.shape}, {lowest.shape} and {highest.shape}."
        )
    refuse_where(~np.isfinite(places), places, "descriptors", "finite numbers")
    refuse_where(~(np.isfinite(values) & (values >= 0)), values, "qualities", "numbers finite and at least 0")
    if n_cells < 1 or not (lowest < highest).all():
        raise SettingsError(f"a grid needs `n_cells` of at least 1 and `low` below `high`, but has {n_cells} cells.")
    cells = np.clip((places - lowest) / (highest - lowest) * n_cells, 0, n_cells - 1).astype(np.int64)
    best: dict[tuple[int, ...], float] = {}
    for cell, value in zip(map(tuple, cells.tolist()), values.tolist(), strict=True):
        best[cell] = max(value, best.get(cell, 0.0))
    return GridQuality(float(sum(best.values())), len(best) / n_cells ** places.shape[1], len(best))
