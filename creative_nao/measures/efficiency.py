"""How much a search found for its trying: beside the oracle, action by action."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import ShapeError
from creative_nao.measures.checks import refuse_where


def oracle_share(rewards: ArrayLike, oracle_rewards: ArrayLike) -> float:
    """Return what a search earned as a share of what the greedy oracle earned with as many actions; 1 is the ceiling.

    Args:
        rewards: Of each action of the search, shape (n,).
        oracle_rewards: Of each action of the oracle (`farthest_points`), shape (n,) or longer.

    Raises:
        ShapeError: If shapes do not fit, or the oracle earned nothing.

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

    Args:
        rewards: Of each action of the search, shape (n,).
        oracle_rewards: Of each action of the oracle, shape (n,) or longer.

    Raises:
        ShapeError: If shapes do not fit.

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
    earned, most = np.asarray(rewards, dtype=np.float64), np.asarray(oracle_rewards, dtype=np.float64)
    if earned.ndim != 1 or most.ndim != 1 or not 1 <= len(earned) <= len(most):
        raise ShapeError(
            "`rewards` and `oracle_rewards` should have shapes (n,) and (n,) or longer, with n at least 1, but have "
            f"{earned.shape} and {most.shape}."
        )
    for name, values in (("rewards", earned), ("oracle_rewards", most)):
        refuse_where(~np.isfinite(values), values, name, "finite numbers")
    return earned, most[: len(earned)]
