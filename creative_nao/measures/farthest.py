"""The best an explorer could do: always pick the action farthest from everything known so far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.errors import SettingsError
from creative_nao.measures.appropriateness import PAPER_CRITERIA, BasicActions, Criteria, is_appropriate
from creative_nao.measures.diversity import reward_scale
from creative_nao.measures.draws import check_mask
from creative_nao.measures.dtw import Trajectories, dtw_matrix


@dataclass(frozen=True, eq=False)
class FarthestPoints:
    """A greedy selection of actions.

    Attributes:
        indices: The chosen trajectories in the order of choice, shape (n,).
        rewards: What each choice earns: its smallest distance to the basic actions and to the choices before it,
            divided by the mean distance between the basic actions, shape (n,). They never rise.
    """

    indices: np.ndarray
    rewards: np.ndarray

    @property
    def total(self) -> float:
        """Sum of the rewards: the score of the greedy oracle."""
        return float(self.rewards.sum())


def farthest_points(
    trajectories: Trajectories,
    demos: BasicActions,
    n_actions: int = 30,
    appropriate: np.ndarray | None = None,
    criteria: Criteria = PAPER_CRITERIA,
) -> FarthestPoints:
    """Choose actions greedily, each the farthest from the basic actions and from those chosen before (the oracle).

    The choice is exact: each pick costs one column of distances, from every candidate to the action picked last.
    Of equally far ones the first is taken. Greedy is not the best possible set, but no order of single choices that
    looks one step ahead earns more at any step.

    Args:
        trajectories: A list of (n_steps, n_joints) arrays or one (n, n_steps, n_joints) array [rad].
        demos: The basic actions.
        n_actions: How many to choose; fewer are returned where fewer are appropriate.
        appropriate: Which may be chosen, shape (n,) of bool; worked out when None.
        criteria: What makes an action appropriate.

    Raises:
        ShapeError: If the mask does not fit or shapes do not.
        SettingsError: If `n_actions` is below one.
    """
    if n_actions < 1:
        raise SettingsError(f"`n_actions` should be at least 1, but is {n_actions}.")
    allowed = is_appropriate(trajectories, demos, criteria) if appropriate is None else np.asarray(appropriate)
    check_mask(allowed, len(trajectories))
    candidates = np.flatnonzero(allowed)
    if isinstance(trajectories, np.ndarray):
        pool: Trajectories = trajectories[candidates]
    else:
        pool = [np.asarray(trajectories[k]) for k in candidates.tolist()]
    scale = reward_scale(demos)
    known = list(demos.trajectories)
    chosen: list[int] = []
    rewards: list[float] = []
    nearest = np.full(len(candidates), np.inf)
    while len(chosen) < min(n_actions, len(candidates)):
        nearest = np.minimum(nearest, dtw_matrix(pool, known).min(axis=1))
        nearest[chosen] = -np.inf
        pick = int(np.argmax(nearest))
        chosen.append(pick)
        rewards.append(float(nearest[pick]) / scale)
        known = [np.asarray(pool[pick])]
    return FarthestPoints(candidates[chosen], np.array(rewards))
