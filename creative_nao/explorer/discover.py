"""Finding movements: a surprise, more or less like this one, and a way from one basic action to another."""

from __future__ import annotations

import numpy as np

from creative_nao.errors import SettingsError
from creative_nao.pb_space import PBMap

NEAR = 0.12
"""How far `more_like` steps, as standard deviation in each PB unit."""
FAR_SHARE = 0.9
"""`less_like` draws from the farthest tenth."""


def surprise(chart: PBMap, rng: np.random.Generator) -> np.ndarray:
    """Return a random point whose movement is appropriate and new, shape (2,).

    Raises:
        SettingsError: If the map has no such point.
    """
    return _draw(chart, (chart.outcome == "unlearned").astype(float), rng)


def more_like(chart: PBMap, liked: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an appropriate point near one of those liked, shape (n, 2): a mutated child of one of them."""
    parent = liked[rng.integers(len(liked))]
    squared = ((chart.pb - parent) ** 2).sum(axis=1) / NEAR**2
    return _draw(chart, np.where(squared > 1e-12, np.exp(-squared / 2), 0.0) * chart.appropriate, rng)


def less_like(chart: PBMap, shunned: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return an appropriate point far from all of those shunned, shape (n, 2)."""
    distance = np.min([((chart.pb - one) ** 2).sum(axis=1) for one in shunned], axis=0)
    usable = np.flatnonzero(chart.appropriate)
    weight = np.zeros(len(chart.pb))
    if usable.size:
        weight[usable] = distance[usable] >= np.quantile(distance[usable], FAR_SHARE)
    return _draw(chart, weight, rng)


def way(learned_pb: np.ndarray, first: int, last: int) -> np.ndarray:
    """Return the path from one basic action's point to another's, shape (2, 2)."""
    return np.array([learned_pb[first], learned_pb[last]])


def _draw(chart: PBMap, weight: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    total = float(weight.sum())
    if not total > 0:
        raise SettingsError("this memory's map has no such movement")
    return chart.pb[rng.choice(len(weight), p=weight / total)].copy()
