"""How much a set of actions covers, of a reference or of a grid of descriptors, and how much a search found.

Density and coverage: Naeem et al. 2020, arXiv:2002.09797. QD score: Pugh et al. 2015.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.dtw import as_numbers, refuse_where
from creative_nao.schema import Count, checked

NEAREST_K = 5  # neighbours that make the ball around a reference item, as in the paper's examples


@dataclass(frozen=True)
class DensityCoverage:
    """How a generated set lies beside a reference set."""

    density: float
    """Mean number of reference items' balls that a generated item lies in over k; 1 expected of one distribution."""
    coverage: float
    """Share of the reference items in whose ball a generated item lies, in [0, 1]; more is better."""


def density_coverage(
    reference_distances: np.ndarray, distances: np.ndarray, nearest_k: int = NEAREST_K
) -> DensityCoverage:
    """Return density and coverage from distances of any kind, such as `dtw_matrix` gives.

    The ball of a reference item reaches as far as its k-th nearest neighbour in the reference.

    Args:
        reference_distances: Between reference items, shape (n, n).
        distances: From each reference item to each generated one, shape (n, m).
        nearest_k: k, at least 1 and below n.

    Example:
        Reference 0, 1, 2, 3 on a line; with k = 1 each ball is 1 wide. 0.5 lies in two balls, 9 in none:

        >>> line, generated = np.arange(4.0), np.array([0.5, 9.0])
        >>> density_coverage(abs(line[:, None] - line), abs(line[:, None] - generated), nearest_k=1)
        DensityCoverage(density=1.0, coverage=0.5)
    """
    own, between = as_numbers(reference_distances, "reference_distances"), as_numbers(distances, "distances")
    n = own.shape[0] if own.ndim else 0
    if own.shape != (n, n) or between.ndim != 2 or len(between) != n or not between.shape[1]:
        raise ShapeError(
            f"`reference_distances` and `distances` should have shapes (n, n) and (n, m), but have {own.shape} and "
            f"{between.shape}."
        )
    for name, values in (("reference_distances", own), ("distances", between)):
        refuse_where(~(values >= 0), values, name, "numbers of at least 0")
    if not checked(Count, nearest_k, "nearest_k") < n:
        raise SettingsError(f"`nearest_k` should be at least 1 and below {n}, but is {nearest_k}.")
    # Place 0 of the sorted row is the item itself.
    radii = np.partition(own, nearest_k, axis=1)[:, nearest_k]
    inside = between < radii[:, None]
    # A row of the paper's coverage asks for the nearest generated item alone, which is the same question.
    return DensityCoverage(float(inside.sum(axis=0).mean() / nearest_k), float(inside.any(axis=1).mean()))


@dataclass(frozen=True)
class GridQuality:
    """Figures of a filled grid."""

    qd_score: float
    """Sum over the filled cells of the best quality in each (Pugh et al. 2015); more is better."""
    coverage: float
    """Share of the cells that hold something, in [0, 1] (Mouret and Clune 2015); more is better."""
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

    Example:
        >>> grid_quality([[0.1], [0.2], [0.9]], [1.0, 3.0, 2.0], low=[0], high=[1], n_cells=2)
        GridQuality(qd_score=5.0, coverage=1.0, n_filled=2)
    """
    places, values = as_numbers(descriptors, "descriptors"), as_numbers(qualities, "qualities")
    lowest, highest = as_numbers(low, "low"), as_numbers(high, "high")
    if places.ndim != 2 or values.shape != places.shape[:1] or not lowest.shape == highest.shape == places.shape[1:]:
        raise ShapeError(
            "`descriptors`, `qualities`, `low` and `high` should have shapes (n, n_dims), (n,), (n_dims,) and "
            f"(n_dims,), but have {places.shape}, {values.shape}, {lowest.shape} and {highest.shape}."
        )
    refuse_where(~np.isfinite(places), places, "descriptors", "finite numbers")
    refuse_where(~(np.isfinite(values) & (values >= 0)), values, "qualities", "numbers finite and at least 0")
    if not (checked(Count, n_cells, "n_cells") and (lowest < highest).all()):
        raise SettingsError(f"a grid needs `n_cells` of at least 1 and `low` below `high`, but has {n_cells} cells.")
    cells = np.clip((places - lowest) / (highest - lowest) * n_cells, 0, n_cells - 1).astype(np.int64)
    best: dict[tuple[int, ...], float] = {}
    for cell, value in zip(map(tuple, cells.tolist()), values.tolist(), strict=True):
        best[cell] = max(value, best.get(cell, 0.0))
    return GridQuality(float(sum(best.values())), len(best) / n_cells ** places.shape[1], len(best))


def oracle_share(rewards: ArrayLike, oracle_rewards: ArrayLike) -> float:
    """Return what a search earned as a share of what the greedy oracle earned with as many actions; 1 is the ceiling.

    `rewards` are those of each action of the search, shape (n,), `oracle_rewards` those of the oracle
    (`farthest_points`), shape (n,) or longer. An oracle that earned nothing is a ShapeError.

    Example:
        >>> oracle_share([1.0, 0.0], [2.0, 2.0, 1.0])
        0.25
    """
    earned, most = _both(rewards, oracle_rewards)
    if not most.sum() > 0:
        raise ShapeError("`oracle_rewards` should have a sum above 0, but has none: there was nothing to find.")
    return float(earned.sum() / most.sum())


def regret(rewards: ArrayLike, oracle_rewards: ArrayLike) -> np.ndarray:
    """Return how far a search was behind the greedy oracle after each action, shape (n,); lower is better.

    The arguments are those of `oracle_share`.

    Example:
        >>> regret([1.0, 0.0], [2.0, 2.0, 1.0]).tolist()
        [1.0, 3.0]
    """
    earned, most = _both(rewards, oracle_rewards)
    return np.cumsum(most) - np.cumsum(earned)


def first_novel(outcomes: Sequence[str]) -> int | None:
    """Return at which action, counted from 1, the first `unlearned` one came: usable and not taught; None if never.

    Example:
        >>> first_novel(["fluctuating", "learned", "unlearned"])
        3
    """
    return next((place for place, outcome in enumerate(outcomes, start=1) if outcome == "unlearned"), None)


def _both(rewards: ArrayLike, oracle_rewards: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    earned, most = as_numbers(rewards, "rewards"), as_numbers(oracle_rewards, "oracle_rewards")
    if earned.ndim != 1 or most.ndim != 1 or not 1 <= len(earned) <= len(most):
        raise ShapeError(
            "`rewards` and `oracle_rewards` should have shapes (n,) and (n,) or longer, with n at least 1, but have "
            f"{earned.shape} and {most.shape}."
        )
    for name, values in (("rewards", earned), ("oracle_rewards", most)):
        refuse_where(~np.isfinite(values), values, name, "finite numbers")
    return earned, most[: len(earned)]


def unexpectedness(distances: ArrayLike, expected: ArrayLike) -> np.ndarray:
    """Return the surprisal of actions [bit], shape (n,): at least 0; higher is less expected.

    Novelty asks how far an action lies from what is known; unexpectedness how rarely one lies as far (the distinction
    of Barto, Mirolli and Baldassarre 2013). It is -log2 of the share of expected actions that are at least as new,
    (count + 1) / (n_expected + 1), so that the most that n expected actions can tell is log2(n + 1).

    Args:
        distances: Of each action to what is known [rad], shape (n,), such as `Scores.novelty`.
        expected: The same of the actions that were to be expected, such as those drawn from the grid; shape (m,).

    Example:
        >>> unexpectedness([0.0, 2.5, 9.0], expected=[1.0, 2.0, 3.0]).tolist()
        [0.0, 1.0, 2.0]
    """
    found, usual = as_numbers(distances, "distances"), as_numbers(expected, "expected")
    if found.ndim != 1 or usual.ndim != 1 or not len(usual):
        raise ShapeError(
            "`distances` and `expected` should have shapes (n,) and (m,) with m at least 1, but have "
            f"{found.shape} and {usual.shape}."
        )
    for name, values in (("distances", found), ("expected", usual)):
        refuse_where(~(values >= 0), values, name, "numbers of at least 0")
    as_new = len(usual) - np.searchsorted(np.sort(usual), found, side="left")
    return -np.log2((as_new + 1) / (len(usual) + 1)) + 0.0
