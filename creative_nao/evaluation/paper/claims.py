"""What the paper says, and whether it holds over seeds: `claims.toml` holds its Table I and its 18 conclusions.

One rule serves all claims of a kind. A conclusion about an order ("the half closed condition is most novel") is a set
of differences of means, each of which has to be positive; a conclusion about every network ("the six actions are
learned") is a share of networks, which has to be above one half in every condition. The conditions are compared as
independent samples of networks. A network of one condition begins with the same weights as that of the same seed in
another, but training is chaotic, so nothing is gained by pairing them.
"""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.evaluation.paper.bank import CONDITION_NAMES
from creative_nao.evaluation.statistics import (
    LEVEL,
    N_RESAMPLES,
    bootstrap_interval,
    probability_of_improvement,
    resample,
    seed_sequence,
    student_quantile,
    wilson_interval,
)
from creative_nao.schema import Text, parse, record
from creative_nao.storage import read_text

HOLDS, FAILS, UNDECIDED = "holds", "does not hold", "undecided"
CONDITION_TITLES = {"open": "open loop, 0.0", "half": "half closed, 0.5", "closed": "closed loop, 1.0"}

CONVERGED_LEVEL = 0.01
"""Share of its first value that the loss has to fall below to count as converged; the paper names no criterion."""

OWNED_PCT = 0.1  # share of the map that a basic action's region needs to count as a region: 40 points of 40,000

Figures = Mapping[str, Any]
"""All figures of one network, as `summary.measure_entry` returns them."""


@record
class Measure:
    """A row of Table I: its name in `results.json`, title and unit on pages, the paper's value per condition if any."""

    field: Text
    title: Text
    unit: Text
    paper: dict[str, float] = dataclasses.field(default_factory=dict)


@record
class Claim:
    """A conclusion of the paper: about an order of conditions, or without `pairs` about most networks of each.

    Attributes:
        key: Short name.
        says: What the paper says, in our words.
        paper: What the paper bases it on.
        field: Figure of a network that decides an order; without pairs, the one whose means stand beside the verdict.
        measured: What that figure is; without pairs, what a network has to show.
        unit: Unit of that figure, or what it counts.
        pairs: Pairs of conditions whose first should have the larger mean.
    """

    key: Text
    says: Text
    paper: Text
    field: Text
    measured: Text
    unit: Text
    pairs: tuple[tuple[str, str], ...] = ()


SHOWS: dict[str, Callable[[Figures], bool]] = {
    "converges": lambda one: one["epochs_to_level"] is not None,
    "learned": lambda one: one["n_reproduced"] == len(one["reproduction_dtw"]),
    "own-region": lambda one: min(one["region_pct"].values()) >= OWNED_PCT,
    "abrupt": lambda one: one["steep_step_pct"] > 0,
    "combinations": lambda one: one["n_pairs_between"] >= 1,
}
"""Whether a network shows what a claim without pairs says, by the claim's key."""

_CONTENT = tomllib.loads(read_text(Path(__file__).with_name("claims.toml"), "claims"))
CLAIMS = tuple(parse(Claim, one, "claims.toml") for one in _CONTENT["claim"])
_MEASURES = tuple(parse(Measure, one, "claims.toml") for one in _CONTENT["measure"])
TABLE_I = tuple(one for one in _MEASURES if one.paper)  # the paper's Table I, row by row
FURTHER = tuple(one for one in _MEASURES if not one.paper)
"""What the paper's share of inappropriate actions is made of; it gives no figures."""

_BY_KEY = {claim.key: claim for claim in CLAIMS}
DECIDED_BY_TABLE_I = tuple(
    _BY_KEY[key] for key in ("half-novel", "half-diverse", "closed-appropriate", "closed-like-training")
)
"""Of the claims that Table I decides, one for each of its four figures: novelty, diversity, appropriate, learned."""


def judge(networks: Sequence[Figures], *, seed: int) -> list[dict[str, Any]]:
    """Return the verdict on each claim with its evidence: the content of `claims.json`.

    `networks` has the figures of every network; `seed` decides the bootstrap samples.
    """
    return [_judge(claim, [_with_derived(one) for one in networks], seed) for claim in CLAIMS]


def _with_derived(one: Figures) -> Figures:
    epochs = one["n_epochs"] if one["epochs_to_level"] is None else one["epochs_to_level"]
    n_owned = sum(share >= OWNED_PCT for share in one["region_pct"].values())
    return {**one, "epochs_to_level_or_all": float(epochs), "n_owned": n_owned}


def _judge(claim: Claim, networks: Sequence[Figures], seed: int) -> dict[str, Any]:
    values = values_of(networks, claim.field)
    if claim.pairs:
        verdict, differences = compare(values, claim, seed)
        evidence = {"differences": differences}
    else:
        shown = {name: [SHOWS[claim.key](one) for one in networks if one["condition"] == name] for name in values}
        rates = [rate(name, answers) for name, answers in shown.items() if answers]
        verdict = decide_rates(rates if len(rates) == len(CONDITION_NAMES) else [])
        evidence = {"rates": rates}
    means = {name: float(mine.mean()) if len(mine) else None for name, mine in values.items()}
    about = {name: getattr(claim, name) for name in ("key", "says", "paper", "measured", "unit")}
    return {**about, "verdict": verdict, "means": means, **evidence}


def values_of(networks: Sequence[Figures], field: str) -> dict[str, np.ndarray]:
    """Return a figure of all networks by condition, one value per seed; networks without it are left out."""
    return {
        name: np.array([one[field] for one in networks if one["condition"] == name and one[field] is not None], float)
        for name in CONDITION_NAMES
    }


def compare(values: Mapping[str, np.ndarray], claim: Claim, seed: int) -> tuple[str, list[dict[str, Any]]]:
    """Return the verdict on an order and the differences that decide it; without values on a side it is undecided."""
    if not all(len(values[condition]) for pair in claim.pairs for condition in pair):
        return decide([]), []
    rng = np.random.default_rng(seed_sequence(seed, claim.key))
    differences = [difference(values, above, below, rng) for above, below in claim.pairs]
    return decide(differences), differences


def difference(values: Mapping[str, np.ndarray], above: str, below: str, rng: np.random.Generator) -> dict[str, Any]:
    """Return by how much the mean of one condition is above that of another.

    The interval is the wider, end by end, of two: the bootstrap, both sides drawn anew and its percentiles moved
    outwards as in `evaluation.statistics`; and Welch's t interval. The bootstrap alone never leaves the range of the
    seeds: of three a side, it would call one of twenty pure chances certain.

    `values` has those of each condition, one per seed, shape (n,), at least one; `rng` draws the samples.

    Returns:
        `above`, `below`; `mean`: the difference; `low`, `high`: the ends of its 95 % interval, None with a single
        network on either side; `superiority`: the probability that a network of `above` has the larger value than one
        of `below`, ties counting half.
    """
    one, other = (np.asarray(values[name], dtype=np.float64)[:, None] for name in (above, below))
    mean, low, high = float(one.mean() - other.mean()), None, None
    n_least = min(len(one), len(other))
    if n_least > 1:
        drawn = [resample(side, N_RESAMPLES, rng).mean(axis=(1, 2)) for side in (one, other)]
        low, high = bootstrap_interval(drawn[0] - drawn[1], n_least)
        margin = _welch_margin(one, other)
        low, high = min(low, mean - margin), max(high, mean + margin)
    superiority = float(probability_of_improvement(one, other))
    return {"above": above, "below": below, "mean": mean, "low": low, "high": high, "superiority": superiority}


def _welch_margin(one: np.ndarray, other: np.ndarray) -> float:
    """Return half the width of Welch's 95 % interval of a difference of means, with its degrees rounded down."""
    parts = [float(side.var(ddof=1)) / len(side) for side in (one, other)]
    total = sum(parts)
    if total == 0.0:
        return 0.0
    degrees = total**2 / sum(part**2 / (len(side) - 1) for part, side in zip(parts, (one, other), strict=True))
    return student_quantile(0.5 + LEVEL / 2.0, max(1, math.floor(degrees))) * math.sqrt(total)


def decide(differences: Sequence[Mapping[str, Any]]) -> str:
    """Return the verdict on "each of these differences is positive".

    It holds when every interval is above zero, it does not hold when one is below zero, and is undecided otherwise.
    Several must agree for it to hold, so that chance alone makes it hold in no more than about 2.5 % of cases.
    """
    if any(one["high"] is not None and one["high"] < 0 for one in differences):
        return FAILS
    return HOLDS if differences and all((one["low"] or 0) > 0 for one in differences) else UNDECIDED


def rate(condition: str, answers: Sequence[bool]) -> dict[str, Any]:
    """Return in how many networks of a condition something is the case, with Wilson's 95 % interval of the share."""
    low, high = wilson_interval(sum(answers), len(answers))
    return {"condition": condition, "n_yes": sum(answers), "n": len(answers), "low": low, "high": high}


def decide_rates(rates: Sequence[Mapping[str, Any]]) -> str:
    """Return the verdict on "in every condition, most networks do": the whole interval above, or below, one half."""
    if any(one["high"] < 0.5 for one in rates):
        return FAILS
    return HOLDS if rates and all(one["low"] > 0.5 for one in rates) else UNDECIDED
