"""Measures of a set of actions: novelty, diversity, Table I, the greedy oracle's choice and the Vendi score.

Novelty and diversity are means over random samples of the appropriate actions, as in the paper.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from creative_nao.errors import SettingsError, ShapeError, shown
from creative_nao.measures.dtw import Trajectories, as_numbers, count_trajectories, dtw_matrix, refuse_where
from creative_nao.measures.outcome import (
    PAPER_CRITERIA,
    BasicActions,
    Criteria,
    Scores,
    check_basic_actions,
    is_appropriate,
    score,
)  # fmt: skip
from creative_nao.schema import Count, Positive, checked

N_SAMPLES = N_DRAWS = 30  # actions in a sample, and samples drawn, as in the paper
LENGTH_SCALE_RAD = 10.0  # distance at which actions are alike to 1/e: the threshold of learned actions [rad]


@dataclass(frozen=True, eq=False)
class Draws:
    """A measure over repeated random samples."""

    mean: float
    std: float
    """Standard deviation over the samples (n - 1 in the denominator; 0 for a single sample)."""
    values: np.ndarray = field(repr=False)
    """The measure of each sample, shape (n_draws,)."""
    n_samples: int
    """Actions in each sample: as many as asked for, or all where there were fewer."""

    @classmethod
    def of(cls, values: np.ndarray, n_samples: int) -> Draws:
        """Summarise the measure of each sample, shape (n_draws,)."""
        std = float(values.std(ddof=1)) if len(values) > 1 else 0.0
        return cls(float(values.mean()), std, values, n_samples)


def draw_samples(
    available: np.ndarray, rng: np.random.Generator | int, n_samples: int, n_draws: int, at_least: int = 1
) -> np.ndarray:
    """Return the indices of samples of the available actions, (n_draws, n_samples or fewer), none twice in a sample.

    Where fewer than `n_samples` are available (a mask of shape (n,)), each sample holds all of them: the measure is
    then exact and its standard deviation 0. The same seed draws the same actions for novelty and for diversity.
    Fewer than `at_least` available actions are a ShapeError.
    """
    n_samples, n_draws = checked(Count, n_samples, "n_samples"), checked(Count, n_draws, "n_draws")
    if n_samples < at_least:
        raise SettingsError(f"`n_samples` should be at least {at_least} for this measure, but is {n_samples}.")
    indices = np.flatnonzero(available)
    if len(indices) < at_least:
        raise ShapeError(
            f"`trajectories` should hold at least {at_least} appropriate actions to draw from, "
            f"but {len(indices)} of {len(available)} are appropriate."
        )
    generator = _generator(rng)
    size = min(n_samples, len(indices))
    return np.array([np.sort(generator.choice(indices, size=size, replace=False)) for _ in range(n_draws)])


def _generator(rng: np.random.Generator | int) -> np.random.Generator:
    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError):
        raise SettingsError(f"`rng` should be a generator of NumPy or a seed, but is {shown(rng)}.") from None


def _allowed(
    trajectories: Trajectories, demos: BasicActions | None, criteria: Criteria, appropriate: np.ndarray | None
) -> np.ndarray:
    """Return which actions count, shape (n,) of bool: the given ones, else the appropriate ones, without demos all."""
    if appropriate is None and demos is not None:
        return is_appropriate(trajectories, demos, criteria)
    n = count_trajectories(trajectories)
    mask = np.ones(n, dtype=bool) if appropriate is None else np.asarray(appropriate)
    if mask.shape != (n,) or mask.dtype != bool:
        raise ShapeError(
            f"`appropriate` should be a mask of shape ({n},), one bool for each trajectory, "
            f"but is {mask.dtype} of shape {mask.shape}."
        )
    return mask


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
    """Return the paper's novelty [rad]: mean distance of `n_samples` random actions to the nearest basic action.

    It is repeated `n_draws` times. Only appropriate actions are drawn, all of them where they are fewer.

    Raises:
        ShapeError: If no action is appropriate, or shapes do not fit.
    """
    check_basic_actions(demos)
    allowed = _allowed(trajectories, demos, criteria, appropriate)
    samples = draw_samples(allowed, rng, n_samples, n_draws)
    drawn, place = np.unique(samples, return_inverse=True)
    nearest = dtw_matrix([trajectories[k] for k in drawn], list(demos.trajectories)).min(axis=1)
    return Draws.of(nearest[place].reshape(samples.shape).mean(axis=1), samples.shape[1])


def mean_pairwise_distance(trajectories: Trajectories) -> float:
    """Return the mean distance over all pairs of at least two different trajectories [rad]."""
    count_trajectories(trajectories, least=2)
    distances = dtw_matrix(trajectories)
    return float(distances[np.triu_indices(len(distances), k=1)].mean())


def reward_scale(demos: BasicActions) -> float:
    """Return the mean distance between the basic actions [rad], the unit in which the environments pay novelty."""
    check_basic_actions(demos)
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
    """Return the paper's diversity [rad]: the mean distance between `n_samples` random actions, two or more.

    It is repeated `n_draws` times. With `demos` only appropriate actions are drawn, without them every action may be;
    all are drawn where they are fewer.

    Raises:
        ShapeError: If fewer than two actions are available, or shapes do not fit.
    """
    allowed = _allowed(trajectories, demos, criteria, appropriate)
    samples = draw_samples(allowed, rng, n_samples, n_draws, at_least=2)
    values = np.array([mean_pairwise_distance([trajectories[k] for k in sample]) for sample in samples])
    return Draws.of(values, samples.shape[1])


@dataclass(frozen=True, eq=False)
class Table:
    """The figures of the paper's Table I for one set of actions: the share of each outcome [%], novelty, diversity."""

    unlearned_pct: float
    learned_pct: float
    appropriate_pct: float
    """Sum of the two."""
    fluctuating_pct: float
    non_moving_pct: float
    novelty: Draws | None
    """Distance to the nearest basic action over random samples [rad]; None without an appropriate action."""
    diversity: Draws | None
    """Distance between actions over random samples [rad]; None with fewer than two appropriate actions."""
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
    """Return the figures of Table I; novelty draws first.

    `scores` are what `score` said of the same trajectories and criteria, if already known.
    """
    scores = score(trajectories, demos, criteria) if scores is None else scores
    generator = _generator(rng)
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


@dataclass(frozen=True, eq=False)
class FarthestPoints:
    """A greedy selection of actions; `indices` are the chosen trajectories in the order of choice, shape (n,).

    `rewards`, shape (n,), are what each choice earns: its smallest distance to the basic actions and to the choices
    before it, divided by the mean distance between the basic actions. They never rise.
    """

    indices: np.ndarray
    rewards: np.ndarray = field(repr=False)

    @property
    def total(self) -> float:
        """Sum of the rewards: the score of the greedy oracle."""
        return float(self.rewards.sum())


LOOKED_AT = 256
"""Candidates that `farthest_points` compares together."""


def farthest_points(
    trajectories: Trajectories,
    demos: BasicActions,
    n_actions: int = 30,
    appropriate: np.ndarray | None = None,
    criteria: Criteria = PAPER_CRITERIA,
) -> FarthestPoints:
    """Choose actions greedily, each the farthest from the basic actions and from those chosen before (the oracle).

    Fewer than `n_actions` are returned where fewer are appropriate. The choice is exact; of equally far ones the first
    is taken. A candidate's distance to what is known only falls, so that one is compared with the actions picked since
    it was looked at last only where what it had then could still be the largest. Greedy is not the
    best possible set, but no order of single choices that looks one step ahead earns more at any step.
    """
    n_actions = checked(Count, n_actions, "n_actions")
    check_basic_actions(demos)
    candidates = np.flatnonzero(_allowed(trajectories, demos, criteria, appropriate))
    is_array = isinstance(trajectories, np.ndarray)
    pool = trajectories[candidates] if is_array else [np.asarray(trajectories[k]) for k in candidates.tolist()]
    scale = reward_scale(demos)
    chosen: list[int] = []
    rewards: list[float] = []
    nearest = dtw_matrix(pool, list(demos.trajectories)).min(axis=1) if len(candidates) else np.empty(0)
    n_seen = np.zeros(len(candidates), np.int64)  # how many of the chosen each candidate was compared with
    while len(chosen) < min(n_actions, len(candidates)):
        while True:
            is_stale = n_seen < len(chosen)
            best = nearest[~is_stale].max(initial=-np.inf)
            (rest,) = (is_stale & (nearest >= best) & (nearest > -np.inf)).nonzero()
            if not len(rest):
                break
            rows = rest[np.argsort(-nearest[rest], kind="stable")[:LOOKED_AT]]
            rows = rows[n_seen[rows] == n_seen[rows[0]]]
            some, since = [pool[row] for row in rows], [pool[k] for k in chosen[n_seen[rows[0]] :]]
            nearest[rows] = np.minimum(nearest[rows], dtw_matrix(some, since).min(axis=1))
            n_seen[rows] = len(chosen)
        pick = int(np.argmax(np.where(n_seen == len(chosen), nearest, -np.inf)))
        chosen.append(pick)
        rewards.append(float(nearest[pick]) / scale)
        nearest[pick] = -np.inf
    return FarthestPoints(candidates[chosen], np.array(rewards))


def vendi_score(similarity: np.ndarray) -> float:
    """Return the effective number of different items, 1 (all alike) to n (Friedman and Dieng 2023, arXiv:2210.02410).

    The exponential of the Shannon entropy of the eigenvalues of K / n; K is `similarity`, shape (n, n), symmetric, 1 on
    the diagonal. One that is no kernel, as one made of warping distances need not be, has a few negative eigenvalues;
    they count as 0, and the others are brought back to the sum 1.

    Raises:
        ShapeError: If it is no such matrix.

    Example:
        The two examples of the authors' own package, which cuts off after four digits:

        >>> points = np.array([0, 0, 10, 10, 20, 20])
        >>> float(np.floor(1e4 * vendi_score(np.exp(-np.abs(points[:, None] - points)))) / 1e4)
        2.9999
        >>> float(np.floor(1e4 * vendi_score(np.array([[1, 0.9, 0], [0.9, 1, 0], [0, 0, 1]]))) / 1e4)
        2.1573
    """
    matrix = as_numbers(similarity, "similarity")
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not len(matrix):
        raise ShapeError(f"`similarity` should have shape (n, n) with n at least 1, but has {matrix.shape}.")
    refuse_where(~np.isfinite(matrix), matrix, "similarity", "finite numbers")
    refuse_where(~np.isclose(matrix, matrix.T), matrix, "similarity", "a symmetric matrix")
    diagonal = np.diag(matrix)
    refuse_where(~np.isclose(diagonal, 1.0), diagonal, "similarity", "ones on its diagonal")
    eigenvalues = np.linalg.eigvalsh(matrix / len(matrix))
    shares = eigenvalues[eigenvalues > 0] / eigenvalues[eigenvalues > 0].sum()
    return float(np.exp(-np.sum(shares * np.log(shares))))


def dtw_similarity(trajectories: Trajectories, length_scale_rad: float = LENGTH_SCALE_RAD) -> np.ndarray:
    """Return how alike trajectories are, exp(-distance / `length_scale_rad`), shape (n, n) in (0, 1]."""
    return np.exp(-dtw_matrix(trajectories) / checked(Positive, length_scale_rad, "length_scale_rad"))
