"""When a difference between conditions counts: intervals over seeds, and three verdicts.

The conditions are compared as independent samples of networks. A network of one condition begins with the same weights
as that of the same seed in another, but training is chaotic, so nothing is gained by pairing them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from creative_nao.evaluation.statistics import (
    LEVEL,
    N_RESAMPLES,
    bootstrap_interval,
    probability_of_improvement,
    resample,
    student_quantile,
    wilson_interval,
)

HOLDS, FAILS, UNDECIDED = "holds", "does not hold", "undecided"


@dataclass(frozen=True)
class Difference:
    """By how much the mean of one condition is above that of another.

    Attributes:
        above: Condition that should be above.
        below: Condition that should be below.
        mean: Difference of their means.
        low: Lower end of its 95 % interval; None with a single network on either side.
        high: Upper end.
        superiority: Probability that a network of `above` has the larger value than one of `below`; ties count half.
    """

    above: str
    below: str
    mean: float
    low: float | None
    high: float | None
    superiority: float


def difference(values: Mapping[str, np.ndarray], above: str, below: str, rng: np.random.Generator) -> Difference:
    """Compare the seeds of two conditions by the difference of their means.

    The interval is the wider, end by end, of two: the bootstrap, both sides drawn anew and its percentiles moved
    outwards as in `evaluation.statistics`; and Welch's t interval. The bootstrap alone never leaves the range of the
    seeds: of three a side, it would call one of twenty pure chances certain.

    Args:
        values: Values of each condition, one per seed, shape (n,), at least one.
        above: Condition from whose mean is subtracted.
        below: Condition whose mean is subtracted.
        rng: Draws the samples.
    """
    one, other = (np.asarray(values[name], dtype=np.float64)[:, None] for name in (above, below))
    mean = float(one.mean() - other.mean())
    superiority = float(probability_of_improvement(one, other))
    n_least = min(len(one), len(other))
    if n_least < 2:
        return Difference(above, below, mean, None, None, superiority)
    drawn = [resample(side, N_RESAMPLES, rng).mean(axis=(1, 2)) for side in (one, other)]
    low, high = bootstrap_interval(drawn[0] - drawn[1], n_least)
    margin = _welch_margin(one, other)
    return Difference(above, below, mean, min(low, mean - margin), max(high, mean + margin), superiority)


def _welch_margin(one: np.ndarray, other: np.ndarray) -> float:
    """Return half the width of Welch's 95 % interval of a difference of means, with its degrees rounded down."""
    parts = [float(side.var(ddof=1)) / len(side) for side in (one, other)]
    total = sum(parts)
    if total == 0.0:
        return 0.0
    degrees = total**2 / sum(part**2 / (len(side) - 1) for part, side in zip(parts, (one, other), strict=True))
    return student_quantile(0.5 + LEVEL / 2.0, max(1, math.floor(degrees))) * math.sqrt(total)


def decide(differences: Sequence[Difference]) -> str:
    """Return the verdict on "each of these differences is positive".

    It holds when every interval is above zero, it does not hold when one is below zero, and is undecided otherwise.
    Several must agree for it to hold, so that chance alone makes it hold in no more than about 2.5 % of cases.
    """
    if any(one.high is not None and one.high < 0 for one in differences):
        return FAILS
    holds = differences and all(one.low is not None and one.low > 0 for one in differences)
    return HOLDS if holds else UNDECIDED


@dataclass(frozen=True)
class Rate:
    """In how many networks of a condition something is the case, with Wilson's 95 % interval of the share."""

    condition: str
    n_yes: int
    n: int
    low: float
    high: float


def rate(condition: str, answers: Sequence[bool]) -> Rate:
    """Count the networks of a condition that show something.

    Example:
        >>> counted = rate("half", [True] * 10)
        >>> counted.n_yes, round(counted.low, 3), counted.high
        (10, 0.722, 1.0)
    """
    return Rate(condition, sum(answers), len(answers), *wilson_interval(sum(answers), len(answers)))


def decide_rates(rates: Sequence[Rate]) -> str:
    """Return the verdict on "in every condition, most networks do": the whole interval above, or below, one half."""
    if any(one.high < 0.5 for one in rates):
        return FAILS
    return HOLDS if rates and all(one.low > 0.5 for one in rates) else UNDECIDED
