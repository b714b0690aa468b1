"""Figures of a (runs x tasks) array and how far to trust them: pure functions, no files, no plots.

A run is one seed, a task one memory (or any other setting that is repeated for each seed). Intervals are 95 %
stratified bootstrap intervals: runs are drawn anew within each task, as often as there are. With few runs the plain
percentile interval is too narrow, so the percentiles are moved outwards by what Student's t is wider than the normal
curve: Hesterberg's expanded percentile interval (The American Statistician 69, 2015, 371-386). It still never leaves
the range of the runs.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.special import betaincinv, ndtr

from creative_nao.errors import ShapeError

N_RESAMPLES = 10_000
"""Bootstrap samples of an interval."""
LEVEL = 0.95
"""Share of cases in which an interval should hold the truth."""
N_RESAMPLES_OVER_TASKS = 2_000
"""Bootstrap samples of what costs more than a mean: comparisons by pairs, profiles, tasks drawn anew."""

Estimate = dict[str, Any]
"""A figure as `results.json` holds it: `mean`, `low` and `high`, these None when a single run leaves them unknown."""


def seed_sequence(*parts: int | str) -> np.random.SeedSequence:
    """Return the seeds of one purpose of an evaluation; text counts by its CRC-32, so that a name is a seed.

    Example:
        >>> rng = np.random.default_rng(seed_sequence(0, "ppo", "reward"))
    """
    return np.random.SeedSequence([zlib.crc32(part.encode()) if isinstance(part, str) else part for part in parts])


def mean(values: np.ndarray) -> np.ndarray:
    """Return the mean over runs and tasks of an array (..., runs, tasks)."""
    return np.asarray(values, dtype=np.float64).mean(axis=(-2, -1))


def iqm(values: np.ndarray) -> np.ndarray:
    """Return the interquartile mean of an array (..., runs, tasks): the mean of its middle half.

    A quarter of the values, rounded down, is left out at either end.

    Example:
        >>> float(iqm(np.array([[0.0], [1.0], [3.0], [100.0]])))
        2.0
    """
    values = np.asarray(values, dtype=np.float64)
    flat = np.sort(values.reshape(*values.shape[:-2], -1), axis=-1)
    cut = flat.shape[-1] // 4
    return flat[..., cut : flat.shape[-1] - cut].mean(axis=-1)


def estimate(
    values: np.ndarray,
    *,
    rng: np.random.Generator,
    statistic: Callable[[np.ndarray], np.ndarray] = mean,
    n_resamples: int = N_RESAMPLES,
) -> Estimate:
    """Return a figure and its stratified bootstrap interval.

    Args:
        values: Shape (runs, tasks), or (runs,) for one task; finite.
        rng: Draws the bootstrap samples; the same generator state gives the same interval.
        statistic: What to estimate, as `mean` or `iqm`: takes an array (..., runs, tasks), gives an array (...).
        n_resamples: Bootstrap samples.

    Raises:
        ShapeError: If `values` is empty, has other axes, or holds values that are not finite.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim == 1:
        values = values[:, None]
    if values.ndim != 2 or values.size == 0:
        raise ShapeError(f"`values` should have shape (runs, tasks), each at least 1, but has {values.shape}")
    if not np.isfinite(values).all():
        raise ShapeError(f"`values` should be finite, but holds {values[~np.isfinite(values)][0]}")
    return _estimate(float(statistic(values)), len(values), lambda: statistic(resample(values, n_resamples, rng)))


def compare(ours: np.ndarray, theirs: np.ndarray, *, rng: np.random.Generator) -> Estimate:
    """Return the probability of improvement of one agent over another, with its stratified bootstrap interval.

    Args:
        ours: Shape (runs, tasks), finite.
        theirs: Shape (other runs, tasks), finite.
        rng: Draws the bootstrap samples of both, independently.

    Raises:
        ShapeError: If the tasks differ in number.
    """
    if ours.ndim != 2 or theirs.ndim != 2 or ours.shape[1] != theirs.shape[1]:
        raise ShapeError(
            f"`ours` and `theirs` should have shape (runs, tasks) with equal tasks, but have {ours.shape} and "
            f"{theirs.shape}"
        )

    def samples() -> np.ndarray:
        return probability_of_improvement(*(resample(runs, N_RESAMPLES_OVER_TASKS, rng) for runs in (ours, theirs)))

    return _estimate(float(probability_of_improvement(ours, theirs)), min(len(ours), len(theirs)), samples)


def probability_of_improvement(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Return how probable it is that a run of ours beats a run of theirs on the same task, averaged over tasks.

    An equal pair counts half: per task this is Mann and Whitney's U divided by the number of pairs. Takes (..., runs,
    tasks) and (..., other runs, tasks), gives (...).

    Example:
        >>> float(probability_of_improvement(np.array([[1.0], [3.0]]), np.array([[1.0], [2.0]])))
        0.625
    """
    ours, theirs = ours[..., :, None, :], theirs[..., None, :, :]
    return ((ours > theirs) + 0.5 * (ours == theirs)).mean(axis=(-3, -2, -1))


def estimate_over_tasks(values: np.ndarray, *, rng: np.random.Generator) -> Estimate:
    """Return a mean with an interval that speaks of other tasks too: tasks are drawn anew, then runs within each.

    The stratified interval keeps the tasks; where an answer is meant for tasks of the same kind that nobody has tried,
    their choice is chance as well.

    Args:
        values: Shape (runs, tasks), finite.
        rng: Draws the bootstrap samples.
    """
    n_runs, n_tasks = values.shape

    def samples() -> np.ndarray:
        tasks = rng.integers(n_tasks, size=(N_RESAMPLES_OVER_TASKS, 1, n_tasks))
        return mean(values[rng.integers(n_runs, size=(N_RESAMPLES_OVER_TASKS, n_runs, n_tasks)), tasks])

    return _estimate(float(mean(values)), n_tasks, samples)


def worth(ours: np.ndarray, curve: Sequence[tuple[int, np.ndarray]], *, rng: np.random.Generator) -> Estimate:
    """Return how many imagined candidates a movement an agent is worth: where the random curve reaches its mean.

    Between two points of the curve the reward is linear in the logarithm of the candidates. Beyond its ends the figure
    is the end: read as "at most" or "at least". Runs of the agent and of the curve are resampled together.

    Args:
        ours: Rewards of the agent, shape (runs, tasks).
        curve: Candidates and rewards (runs, tasks) of uniform candidates on the same tasks; candidates rise.
        rng: Draws the bootstrap samples.
    """
    steps = np.log([k for k, _ in curve])

    def reached(level: np.ndarray, means: np.ndarray) -> np.ndarray:  # (n,), (n, points) -> (n,)
        rising = np.maximum.accumulate(means, axis=1)
        return np.array([np.exp(np.interp(one, row, steps)) for one, row in zip(level, rising, strict=True)])

    def samples() -> np.ndarray:
        drawn = [mean(resample(rewards, N_RESAMPLES_OVER_TASKS, rng)) for rewards in (ours, *(r for _, r in curve))]
        return reached(drawn[0], np.stack(drawn[1:], axis=1))

    middle = reached(np.array([mean(ours)]), np.array([[float(mean(rewards)) for _, rewards in curve]]))
    return _estimate(float(middle[0]), min(len(ours), *(len(rewards) for _, rewards in curve)), samples)


def performance_profile(values: np.ndarray, thresholds: np.ndarray) -> np.ndarray:
    """Return the share of runs, over all tasks, that lie above each threshold.

    Takes (..., runs, tasks) and n thresholds, gives (..., n), falling from 1 to 0.

    Example:
        >>> performance_profile(np.array([[0.2, 0.6], [0.4, 0.8]]), np.array([0.0, 0.5, 1.0])).tolist()
        [1.0, 0.5, 0.0]
    """
    return (values[..., None] > np.asarray(thresholds)).mean(axis=(-3, -2))


def profile_band(
    values: np.ndarray, thresholds: np.ndarray, *, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pointwise 95 % stratified bootstrap band of a performance profile, two arrays of shape (n,)."""
    samples = performance_profile(resample(values, N_RESAMPLES_OVER_TASKS, rng), thresholds)
    return bootstrap_interval(samples, len(values))


def bootstrap_interval(samples: np.ndarray, n_runs: int) -> tuple[Any, Any]:
    """Return both ends of the expanded percentile interval of bootstrap samples, numbers or arrays of shape (...).

    Args:
        samples: Shape (n_resamples, ...): the statistic of each bootstrap sample.
        n_runs: How many runs each sample was drawn from; of one run, the interval is the range of the samples.
    """
    tail = expanded_tail(n_runs) if n_runs > 1 else 0.0
    low, high = np.quantile(samples, [tail, 1.0 - tail], axis=0)
    return low, high


def _estimate(value: float, n_runs: int, samples: Callable[[], np.ndarray]) -> Estimate:
    if n_runs == 1:
        return {"mean": value, "low": None, "high": None}
    low, high = map(float, bootstrap_interval(samples(), n_runs))
    # Of equal runs the mean is rounded differently from sample to sample; an interval holds its own figure.
    return {"mean": value, "low": min(low, value), "high": max(high, value)}


def resample(values: np.ndarray, n_resamples: int, rng: np.random.Generator) -> np.ndarray:
    """Draw runs of `values` (runs, tasks) with replacement within each task: shape (n_resamples, runs, tasks)."""
    n_runs, n_tasks = values.shape
    drawn = rng.integers(n_runs, size=(n_resamples, n_runs, n_tasks))
    return values[drawn, np.arange(n_tasks)]


def expanded_tail(n_runs: int) -> float:
    """Return the share of bootstrap samples to leave out at either end, so that n_runs runs are enough for `LEVEL`."""
    return float(ndtr(-math.sqrt(n_runs / (n_runs - 1)) * student_quantile(0.5 + LEVEL / 2.0, n_runs - 1)))


def student_quantile(probability: float, degrees: float) -> float:
    """Return the quantile of Student's t distribution.

    Example:
        >>> round(student_quantile(0.975, 4), 3)
        2.776
    """
    # By the incomplete beta function, which every supported SciPy inverts to the last digits; 1.15's stdtrit to ten.
    x = betaincinv(degrees / 2.0, 0.5, 2.0 * min(probability, 1.0 - probability))
    return float(math.copysign(math.sqrt(degrees * (1.0 / x - 1.0)), probability - 0.5))


def wilson_interval(n_yes: int, n: int) -> tuple[float, float]:
    """Return Wilson's interval of a share (1927): honest for few cases and for shares near 0 and 1.

    Example:
        >>> low, high = wilson_interval(10, 10)
        >>> round(low, 3), high
        (0.722, 1.0)
    """
    from scipy.stats import binomtest  # half a second to load, and seldom wanted

    found = binomtest(n_yes, n).proportion_ci(LEVEL, method="wilson")
    return float(found.low), float(found.high)
