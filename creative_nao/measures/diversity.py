"""Diversity: how far generated actions lie from each other."""

from __future__ import annotations

import numpy as np

from creative_nao.errors import ShapeError
from creative_nao.measures.appropriateness import PAPER_CRITERIA, BasicActions, Criteria, is_appropriate
from creative_nao.measures.draws import N_DRAWS, N_SAMPLES, Draws, check_mask, draw_samples, summarise
from creative_nao.measures.dtw import Trajectories, dtw_matrix


def mean_pairwise_distance(trajectories: Trajectories) -> float:
    """Return the mean distance over all pairs of different trajectories [rad].

    Raises:
        ShapeError: If there are fewer than two.
    """
    if len(trajectories) < 2:
        raise ShapeError(f"`trajectories` should hold at least two actions, but holds {len(trajectories)}.")
    distances = dtw_matrix(trajectories)
    return float(distances[np.triu_indices(len(distances), k=1)].mean())


def reward_scale(demos: BasicActions) -> float:
    """Return the mean distance between the basic actions [rad], the unit in which the environments pay novelty."""
    return mean_pairwise_distance(list(demos.trajectories))


def diversity(
    trajectories: Trajectories,
    demos: BasicActions | None = None,
    *,
    rng: np.random.Generator | int = 0,
    n_samples: int = N_SAMPLES,
    n_draws: int = N_DRAWS,
    criteria: Criteria = PAPER_CRITERIA,
    appropriate: np.ndarray | None = None,
) -> Draws:
    """Return the paper's diversity: the mean distance between randomly drawn actions, repeated.

    Args:
        trajectories: A list of (n_steps, n_joints) arrays or one (n, n_steps, n_joints) array [rad].
        demos: The basic actions; with them only appropriate actions are drawn, without them every action may be.
        rng: A generator, or a seed for one.
        n_samples: Actions in a sample, at least two; where fewer are available, all of them.
        n_draws: Number of samples.
        criteria: What makes an action appropriate.
        appropriate: Which actions are, shape (n,) of bool, if already known.

    Raises:
        ShapeError: If fewer than two actions are available, or shapes do not fit.
    """
    if appropriate is not None:
        allowed = np.asarray(appropriate)
    elif demos is not None:
        allowed = is_appropriate(trajectories, demos, criteria)
    else:
        allowed = np.ones(len(trajectories), dtype=bool)
    check_mask(allowed, len(trajectories))
    samples = draw_samples(allowed, rng, n_samples, n_draws, at_least=2)
    values = np.array([mean_pairwise_distance([trajectories[k] for k in sample]) for sample in samples])
    return summarise(values, samples.shape[1])
