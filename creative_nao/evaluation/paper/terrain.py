"""The shape of a map as numbers: how many regions, how long their borders, how rugged and how even."""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.measures import dtw_matrix, dtw_pairs
from creative_nao.pb_space import PBMap
from creative_nao.pb_space.landscape import landscape


def terrain_figures(charted: PBMap, demos: Demonstrations) -> dict[str, Any]:
    """Return the figures of a map's shape.

    Args:
        charted: The map, with trajectories.
        demos: The basic actions.

    Returns:
        `n_regions`, `border_length`, `ruggedness`, `evenness`: see `pb_space.landscape`, its nearest regions, the
        borders of all colours, the mean over all pairs of neighbours and the evenness of the learned regions.
        `steep_step_pct`: of the steps between two neighbouring grid points that both give a usable action, the share
        over which the action changes by more than the smallest distance between two basic actions [%].
    """
    shape = landscape(charted)
    return {
        "n_regions": shape.n_nearest_regions,
        "border_length": shape.border_length,
        "ruggedness": None if shape.ruggedness is None else shape.ruggedness.mean,
        "evenness": shape.learned_evenness,
        "steep_step_pct": steep_step_pct(charted, demos),
    }


def steep_step_pct(charted: PBMap, demos: Demonstrations) -> float:
    """Return the share of steep steps [%]; 0 when no two neighbours are usable."""
    assert charted.trajectories is not None
    between = dtw_matrix(list(demos.trajectories))
    smallest = float(between[np.triu_indices(len(between), 1)].min())
    place = np.arange(charted.resolution**2).reshape(charted.resolution, -1)
    first = np.concatenate([place[:, :-1].ravel(), place[:-1].ravel()])
    second = np.concatenate([place[:, 1:].ravel(), place[1:].ravel()])
    usable = charted.appropriate[first] & charted.appropriate[second]
    if not usable.any():
        return 0.0
    return 100.0 * float(np.mean(dtw_pairs(charted.trajectories, first[usable], second[usable]) > smallest))
