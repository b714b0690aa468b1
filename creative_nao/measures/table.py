"""One column of the paper's Table I: how much of a set of actions is appropriate, learned and new."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.measures.diversity import N_DRAWS, N_SAMPLES, Draws, diversity, novelty
from creative_nao.measures.dtw import Trajectories
from creative_nao.measures.outcome import PAPER_CRITERIA, BasicActions, Criteria, Scores, score


@dataclass(frozen=True, eq=False)
class Table:
    """The figures of Table I for one set of actions.

    Attributes:
        unlearned_pct: Share that is appropriate and far from every basic action [%].
        learned_pct: Share that is appropriate and close to one [%].
        appropriate_pct: Their sum [%].
        fluctuating_pct: Share that is too fast [%].
        non_moving_pct: Share that stands still [%].
        novelty: Distance to the nearest basic action over random samples [rad]; None without an appropriate action.
        diversity: Distance between actions over random samples [rad]; None with fewer than two appropriate actions.
        n_trajectories: Size of the set.
    """

    unlearned_pct: float
    learned_pct: float
    appropriate_pct: float
    fluctuating_pct: float
    non_moving_pct: float
    novelty: Draws | None
    diversity: Draws | None
    n_trajectories: int


def table(
    trajectories: Trajectories,
    demos: BasicActions,
    *,
    rng: np.random.Generator | int = 0,
    n_samples: int = N_SAMPLES,
    n_draws: int = N_DRAWS,
    criteria: Criteria = PAPER_CRITERIA,
    scores: Scores | None = None,
) -> Table:
    """Return the figures of Table I for a set of actions.

    Args:
        trajectories: A list of (n_steps, n_joints) arrays or one (n, n_steps, n_joints) array [rad].
        demos: The basic actions.
        rng: A generator, or a seed for one; novelty draws first.
        n_samples: Actions in a sample.
        n_draws: Number of samples.
        criteria: Where the lines between the outcomes are drawn.
        scores: What `score` said of the same trajectories and criteria, if already known.

    Raises:
        ShapeError: If there are no trajectories or shapes do not fit.
    """
    scores = score(trajectories, demos, criteria) if scores is None else scores
    generator = np.random.default_rng(rng)
    n_appropriate = int(scores.appropriate.sum())
    how = {"rng": generator, "n_samples": n_samples, "n_draws": n_draws, "appropriate": scores.appropriate}
    return Table(
        unlearned_pct=scores.share_pct("unlearned"),
        learned_pct=scores.share_pct("learned"),
        appropriate_pct=100.0 * n_appropriate / len(scores) if len(scores) else float("nan"),
        fluctuating_pct=scores.share_pct("fluctuating"),
        non_moving_pct=scores.share_pct("non_moving"),
        novelty=novelty(trajectories, demos, **how) if n_appropriate else None,
        diversity=diversity(trajectories, demos, **how) if n_appropriate > 1 else None,
        n_trajectories=len(scores),
    )
