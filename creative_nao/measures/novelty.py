"""Novelty: how far generated actions lie from the nearest thing the robot was taught."""

from __future__ import annotations

import numpy as np

from creative_nao.measures.appropriateness import PAPER_CRITERIA, BasicActions, Criteria, is_appropriate
from creative_nao.measures.draws import N_DRAWS, N_SAMPLES, Draws, check_mask, draw_samples, summarise
from creative_nao.measures.dtw import Trajectories, dtw_matrix


def novelty(
    trajectories: Trajectories,
    demos: BasicActions,
    *,
    rng: np.random.Generator | int = 0,
    n_samples: int = N_SAMPLES,
    n_draws: int = N_DRAWS,
    criteria: Criteria = PAPER_CRITERIA,
    appropriate: np.ndarray | None = None,
) -> Draws:
    """Return the paper's novelty: the mean distance of randomly drawn actions to the nearest basic action, repeated.

    Only appropriate actions are drawn; the others count as filtered out.

    Args:
        trajectories: A list of (n_steps, n_joints) arrays or one (n, n_steps, n_joints) array [rad].
        demos: The basic actions.
        rng: A generator, or a seed for one.
        n_samples: Actions in a sample; where fewer are appropriate, all of them.
        n_draws: Number of samples.
        criteria: What makes an action appropriate.
        appropriate: Which actions are, shape (n,) of bool, if already known; else it is worked out.

    Raises:
        ShapeError: If no action is appropriate, or shapes do not fit.
    """
    allowed = is_appropriate(trajectories, demos, criteria) if appropriate is None else np.asarray(appropriate)
    check_mask(allowed, len(trajectories))
    samples = draw_samples(allowed, rng, n_samples, n_draws)
    drawn, place = np.unique(samples, return_inverse=True)
    nearest = dtw_matrix([trajectories[k] for k in drawn], list(demos.trajectories)).min(axis=1)
    return summarise(nearest[place].reshape(samples.shape).mean(axis=1), samples.shape[1])
