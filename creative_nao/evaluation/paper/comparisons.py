"""When a difference between conditions counts: intervals over seeds, and three verdicts.

The conditions are compared as independent samples of networks. A network of one condition begins with the same weights
as that of the same seed in another, but training is chaotic, so nothing is gained by pairing them.

Also here:
- What the paper reports: its Table I, its three conditions, and how they are called and drawn here.
- Learning curves as numbers: how fast the loss falls and how unsteadily.
- `results.json` and `networks.csv`: means over seeds with intervals, and every network's own figures.
"""

from __future__ import annotations

import csv
import io
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from creative_nao.evaluation.statistics import LEVEL, N_RESAMPLES, estimate, expanded_tail, resample, student_quantile
from creative_nao.maps.colours import BASIC_ACTIONS
from creative_nao.model import CONDITIONS, Memory

CONDITION_NAMES = tuple(CONDITIONS)
"""`open`, `half`, `closed`: closed-loop ratio 0, 0.5 and 1."""

CONDITION_TITLES = {"open": "open loop, 0.0", "half": "half closed, 0.5", "closed": "closed loop, 1.0"}
CONDITION_COLOURS = dict(zip(CONDITION_NAMES, BASIC_ACTIONS, strict=False))
CONDITION_MARKERS = {"open": "o", "half": "s", "closed": "D"}
CONDITION_LINES: dict[str, Any] = {"open": "-", "half": (0, (5, 1.5)), "closed": (0, (2, 1.2))}
"""Conditions differ in marker and dash too, so that nothing rests on colour alone."""


@dataclass(frozen=True)
class Measure:
    """A row of Table I.

    Attributes:
        field: Name in `results.json`.
        title: Name on pages.
        unit: Unit on pages.
        paper: The paper's value per condition; empty where it gives none.
    """

    field: str
    title: str
    unit: str
    paper: dict[str, float]


def _paper(open_loop: float, half: float, closed: float) -> dict[str, float]:
    return {"open": open_loop, "half": half, "closed": closed}


TABLE_I = (
    Measure("unlearned_pct", "unlearned", "%", _paper(72.21, 75.26, 57.95)),
    Measure("learned_pct", "learned", "%", _paper(11.23, 7.58, 40.02)),
    Measure("appropriateness_pct", "appropriate", "%", _paper(83.44, 82.84, 97.97)),
    Measure("novelty", "novelty", "rad", _paper(26.02, 31.71, 18.53)),
    Measure("diversity", "diversity", "rad", _paper(43.12, 48.03, 35.96)),
)
"""The paper's Table I, row by row."""

FURTHER = (
    Measure("fluctuating_pct", "fluctuating", "%", {}),
    Measure("non_moving_pct", "non-moving", "%", {}),
)
"""What the paper's share of inappropriate actions is made of; it gives no figures."""


CONVERGED_LEVEL = 0.01
"""Share of its first value that the loss has to fall below to count as converged; the paper names no criterion."""

WARM_UP = 0.1
"""Share of the training that is left out of the unsteadiness: there the loss falls steeply in every condition."""


def epochs_to_level(memory: Memory, level: float = CONVERGED_LEVEL) -> int | None:
    """Return the first epoch whose loss is at most `level` times the first one; None if there is none.

    The curve that a memory keeps has at most 5000 points, so the answer is exact to a spacing of them.
    """
    history = memory.loss_history
    below = np.flatnonzero(history <= level * history[0])
    return int(below[0]) * memory.loss_every + 1 if len(below) else None


def unsteadiness(memory: Memory) -> float:
    """Return the mean change of log10(loss) from one kept point of the curve to the next, without the first tenth.

    Curves are compared at the same spacing only, which networks trained for the same number of epochs have.
    """
    history = memory.loss_history[int(WARM_UP * len(memory.loss_history)) :]
    return float(np.abs(np.diff(np.log10(history.astype(np.float64)))).mean()) if len(history) > 1 else 0.0


Figures = Mapping[str, Any]
"""What `measuring.measure_entry` returns."""

WHY_NONE = {"novelty": "no appropriate action to measure", "diversity": "fewer than two appropriate actions to compare"}
NOT_HERE = {
    "reward": "the whole grid is scored as in the paper, nothing is searched",
    "oracle_share": "the whole grid is scored as in the paper, nothing is searched",
}


def values_of(networks: Sequence[Figures], field: str) -> dict[str, np.ndarray]:
    """Return a figure of all networks by condition, one value per seed; networks without it are left out."""
    return {
        condition: np.array(
            [one[field] for one in networks if one["condition"] == condition and one[field] is not None], dtype=float
        )
        for condition in CONDITION_NAMES
    }


def make_results(networks: Sequence[Figures], *, resolution: int, seed: int) -> dict[str, Any]:
    """Return the content of `results.json`: one row per condition.

    Args:
        networks: Figures of every network.
        resolution: Points along each axis of the maps.
        seed: Decides the bootstrap samples.
    """
    rows = []
    for condition in CONDITION_NAMES:
        mine = [one for one in networks if one["condition"] == condition]
        row: dict[str, Any] = {
            "agent": "supervised",
            "env": "grid",
            "memory": condition,
            "closed_loop_ratio": CONDITIONS[condition],
            "n_seeds": len(mine),
            "n_actions": resolution**2,
            "spread": {},
        }
        for measure in (*TABLE_I, *FURTHER):
            values = values_of(mine, measure.field)[condition]
            row[measure.field] = mean_with_interval(values, [seed, condition, measure.field])
            if row[measure.field] is None:
                row[f"{measure.field}_reason"] = WHY_NONE.get(measure.field, "no network of this condition")
                continue
            row["spread"][measure.field] = {"smallest": float(values.min()), "largest": float(values.max())}
            if len(values) < 2:
                row[f"{measure.field}_reason"] = "no interval from a single seed"
        for field, reason in NOT_HERE.items():
            row[field], row[f"{field}_reason"] = None, reason
        rows.append(row)
    return {"suite": "paper", "rows": rows}


def mean_with_interval(values: np.ndarray, stream: Sequence[int | str]) -> dict[str, float | None] | None:
    """Return mean, low and high over seeds; None without values. `stream` names the random draws."""
    if not len(values):
        return None
    rng = np.random.default_rng([part if isinstance(part, int) else zlib.crc32(part.encode()) for part in stream])
    found = estimate(values, rng=rng)
    return {"mean": found.value, "low": found.low, "high": found.high}


def networks_csv(networks: Sequence[Figures]) -> str:
    """Return every figure of every network as CSV, a row each; figures per basic action get a column each."""
    rows = [_flat(one) for one in networks]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(key for row in rows for key in row)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _flat(figures: Figures) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for key, value in figures.items():
        if isinstance(value, dict) and all(isinstance(one, int | float) for one in value.values()):
            row |= {f"{key}/{name}": one for name, one in value.items()}
        elif not isinstance(value, dict | list):
            row[key] = value
    return row


HOLDS, FAILS, UNDECIDED = "holds", "does not hold", "undecided"
Z = 1.959963984540054
"""Two-sided 95 % point of the normal curve."""


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

    @property
    def positive(self) -> bool:
        """Whether the whole interval is above zero."""
        return self.low is not None and self.low > 0

    @property
    def negative(self) -> bool:
        """Whether the whole interval is below zero."""
        return self.high is not None and self.high < 0


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
    one, other = np.asarray(values[above], dtype=np.float64), np.asarray(values[below], dtype=np.float64)
    mean = float(one.mean() - other.mean())
    pairs = one[:, None] - other[None, :]
    superiority = float(np.mean(pairs > 0) + 0.5 * np.mean(pairs == 0))
    n_least = min(len(one), len(other))
    if n_least < 2:
        return Difference(above, below, mean, None, None, superiority)
    drawn = [resample(side[:, None], N_RESAMPLES, rng).mean(axis=(1, 2)) for side in (one, other)]
    tail = expanded_tail(n_least, LEVEL)
    low, high = np.quantile(drawn[0] - drawn[1], [tail, 1.0 - tail])
    margin = _welch_margin(one, other)
    return Difference(
        above, below, mean, min(float(low), mean - margin), max(float(high), mean + margin), superiority
    )  # fmt: skip


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
    if any(one.negative for one in differences):
        return FAILS
    return HOLDS if differences and all(one.positive for one in differences) else UNDECIDED


@dataclass(frozen=True)
class Rate:
    """In how many networks of a condition something is the case, with Wilson's 95 % interval of the share."""

    condition: str
    n_yes: int
    n: int
    low: float
    high: float


def rate(condition: str, answers: Sequence[bool]) -> Rate:
    """Count the networks of a condition (Wilson 1927: an interval that is honest for few and for extreme counts).

    Example:
        >>> found = rate("half", [True] * 10)
        >>> found.n_yes, round(found.low, 3), found.high
        (10, 0.722, 1.0)
    """
    n, share = len(answers), float(np.mean(answers))
    centre = (share + Z**2 / (2 * n)) / (1 + Z**2 / n)
    half = Z / (1 + Z**2 / n) * math.sqrt(share * (1 - share) / n + Z**2 / (4 * n**2))
    low, high = max(0.0, centre - half), min(1.0, centre + half)
    # At the ends the formula is exact but for rounding.
    return Rate(condition, sum(answers), n, 0.0 if share == 0 else low, 1.0 if share == 1 else high)


def decide_rates(rates: Sequence[Rate]) -> str:
    """Return the verdict on "in every condition, most networks do": the whole interval above, or below, one half."""
    if any(one.high < 0.5 for one in rates):
        return FAILS
    return HOLDS if rates and all(one.low > 0.5 for one in rates) else UNDECIDED
