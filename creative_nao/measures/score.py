"""What each generated action is: learned, unlearned, fluctuating or non-moving, and how far from what was taught."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike

from creative_nao.measures.appropriateness import (
    BLOCK,
    PAPER_CRITERIA,
    BasicActions,
    Criteria,
    check_same_joints,
    is_fluctuating,
    is_non_moving,
)
from creative_nao.measures.dtw import Trajectories, dtw_matrix

OUTCOMES = ("learned", "unlearned", "fluctuating", "non_moving")
"""Every trajectory has exactly one of these."""
APPROPRIATE = ("learned", "unlearned")
"""Outcomes of what a robot can use."""


@dataclass(frozen=True, eq=False)
class Scores:
    """The measures of n trajectories.

    Attributes:
        outcome: One of `OUTCOMES` each, shape (n,) of str.
        novelty: Distance to the nearest basic action [rad], shape (n,).
        nearest: Which basic action that is, shape (n,) of int.
        distances: Distance to every basic action [rad], shape (n, n_actions).
        appropriate: Whether the outcome is learned or unlearned, shape (n,) of bool.
    """

    outcome: np.ndarray
    novelty: np.ndarray
    nearest: np.ndarray
    distances: np.ndarray
    appropriate: np.ndarray

    def __len__(self) -> int:
        return len(self.outcome)

    def share_pct(self, outcome: str) -> float:
        """Return how many of the trajectories have this outcome [%]; NaN when there are none."""
        return 100.0 * float(np.mean(self.outcome == outcome)) if len(self) else float("nan")


def score(
    trajectories: Trajectories,
    demos: BasicActions,
    criteria: Criteria = PAPER_CRITERIA,
    dtype: DTypeLike = np.float64,
) -> Scores:
    """Score trajectories against the basic actions.

    A trajectory gets the same scores alone, in a map of 40,000 and in any piece of that map. Memory beside the input is
    bounded by the block size and the result.

    Args:
        trajectories: A list of (n_steps, n_joints) arrays, whose lengths may differ, or one (n, n_steps, n_joints)
            array [rad], at the tick of `demos`. One alone is `trajectory[None]`.
        demos: The basic actions: anything with `.trajectories` and `.dt_s`.
        criteria: Where the lines between the outcomes are drawn.
        dtype: Arithmetic of the distances. float32 saves a third of the time on large maps; a distance that equals the
            threshold to seven digits may then fall on its other side.

    Raises:
        ShapeError: If a trajectory does not have the joints of the basic actions or is not finite.

    Example:
        >>> from creative_nao.demonstrations import load_demonstrations
        >>> demos = load_demonstrations()
        >>> scores = score(demos.trajectories, demos)
        >>> scores.outcome[0], float(scores.novelty[0]), int(scores.nearest[2])
        (np.str_('learned'), 0.0, 2)
    """
    check_same_joints(trajectories, demos)
    basic = list(demos.trajectories)
    distances = np.zeros((len(trajectories), len(basic)))
    for start in range(0, len(trajectories), 2 * BLOCK):
        distances[start : start + 2 * BLOCK] = dtw_matrix(trajectories[start : start + 2 * BLOCK], basic, dtype)
    nearest = distances.argmin(axis=1)
    novelty = distances.min(axis=1)
    outcome = np.where(novelty <= criteria.learned_threshold, "learned", "unlearned").astype("<U11")
    if len(outcome):
        outcome[is_non_moving(trajectories, demos, criteria)] = "non_moving"
        outcome[is_fluctuating(trajectories, demos, criteria)] = "fluctuating"
    return Scores(outcome, novelty, nearest, distances, np.isin(outcome, APPROPRIATE))
