"""The four figures of Table I under another way to score: same movements, same random draws."""

from __future__ import annotations

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.evaluation.paper.variants import SCORINGS, Scoring
from creative_nao.measures import Criteria, is_appropriate
from creative_nao.measures.draws import N_DRAWS, N_SAMPLES, draw_samples

FIGURES = ("appropriateness_pct", "learned_pct", "novelty", "diversity")


def learned_threshold(demos: Demonstrations, scoring: Scoring) -> float:
    """Return the distance up to which an action is learned, in the unit of the scoring's own distance.

    The paper's 10 means nothing in another unit; the same share of the mean distance between two basic actions does.
    """
    several = list(demos.trajectories)
    upper = np.triu_indices(len(several), 1)
    usual, changed = (float(one.distances(several, several)[upper].mean()) for one in (SCORINGS[0], scoring))
    return Criteria().learned_threshold * changed / usual


def rescore(
    trajectories: np.ndarray, demos: Demonstrations, scoring: Scoring, seed: int | list[int]
) -> dict[str, float | None]:
    """Return the four figures.

    Args:
        trajectories: A whole grid of generated movements [rad], shape (n, n_steps, n_joints).
        demos: The basic actions.
        scoring: The way to score.
        seed: Of the draws of novelty and diversity.

    Returns:
        Shares in %, novelty and diversity in the unit of the scoring's distance; None where nothing can be measured.
    """
    appropriate = is_appropriate(trajectories, demos, scoring.criteria)
    usable = np.flatnonzero(appropriate)
    nearest = np.full(len(trajectories), np.inf)
    if len(usable):
        nearest[usable] = scoring.distances(trajectories[usable], list(demos.trajectories)).min(axis=1)
    found: dict[str, float | None] = {
        "appropriateness_pct": 100.0 * float(appropriate.mean()),
        "learned_pct": 100.0 * float(np.mean(nearest <= learned_threshold(demos, scoring))),
        "novelty": None,
        "diversity": None,
    }
    if len(usable) > 1:
        rng = np.random.default_rng(seed)
        found["novelty"] = float(nearest[draw_samples(appropriate, rng, N_SAMPLES, N_DRAWS)].mean())
        samples = draw_samples(appropriate, rng, N_SAMPLES, N_DRAWS, at_least=2)
        upper = np.triu_indices(samples.shape[1], 1)
        apart = [scoring.distances(trajectories[sample], trajectories[sample])[upper].mean() for sample in samples]
        found["diversity"] = float(np.mean(apart))
    return found
