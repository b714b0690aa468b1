"""What the paper says, and whether it holds over seeds: `claims.toml` holds its Table I and its 18 conclusions.

One rule serves all claims of a kind. A conclusion about an order ("the half closed condition is most novel") is a set
of differences of means, each of which has to be positive; a conclusion about every network ("the six actions are
learned") is a share of networks, which has to be above one half in every condition.
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.evaluation.paper.bank import CONDITION_NAMES
from creative_nao.evaluation.paper.comparisons import Difference, decide, decide_rates, difference, rate
from creative_nao.evaluation.statistics import seed_sequence
from creative_nao.schema import Text, parse, record
from creative_nao.storage import read_text

CONDITION_TITLES = {"open": "open loop, 0.0", "half": "half closed, 0.5", "closed": "closed loop, 1.0"}

CONVERGED_LEVEL = 0.01
"""Share of its first value that the loss has to fall below to count as converged; the paper names no criterion."""

OWNED_PCT = 0.1
"""Share of the map that a basic action's region needs to count as a region: 40 points of 40,000."""

Figures = Mapping[str, Any]
"""All figures of one network, as `summary.measure_entry` returns them."""


@record
class Measure:
    """A row of Table I.

    Attributes:
        field: Name in `results.json`.
        title: Name on pages.
        unit: Unit on pages.
        paper: The paper's value per condition; empty where it gives none.
    """

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


@record
class PaperContent:
    """The content of `claims.toml`."""

    measure: tuple[Measure, ...]
    claim: tuple[Claim, ...]


SHOWS: dict[str, Callable[[Figures], bool]] = {
    "converges": lambda one: one["epochs_to_level"] is not None,
    "learned": lambda one: one["n_reproduced"] == len(one["reproduction_dtw"]),
    "own-region": lambda one: min(one["region_pct"].values()) >= OWNED_PCT,
    "abrupt": lambda one: one["steep_step_pct"] > 0,
    "combinations": lambda one: one["n_pairs_between"] >= 1,
}
"""Whether a network shows what a claim without pairs says, by the claim's key."""

_PATH = Path(__file__).with_name("claims.toml")
_CONTENT = parse(PaperContent, tomllib.loads(read_text(_PATH, "claims")), "claims.toml")
CLAIMS = _CONTENT.claim
TABLE_I = tuple(one for one in _CONTENT.measure if one.paper)
"""The paper's Table I, row by row."""
FURTHER = tuple(one for one in _CONTENT.measure if not one.paper)
"""What the paper's share of inappropriate actions is made of; it gives no figures."""

DECIDED_BY_TABLE_I = tuple(
    claim
    for claim in CLAIMS
    if claim.key in ("half-novel", "half-diverse", "closed-appropriate", "closed-like-training")
)
"""Of the claims that Table I decides, one for each of its four figures: novelty, diversity, appropriate, learned."""


def judge(networks: Sequence[Figures], *, seed: int) -> list[dict[str, Any]]:
    """Return the verdict on each claim with its evidence, as plain values: the content of `claims.json`.

    Args:
        networks: Figures of every network.
        seed: Decides the bootstrap samples.
    """
    networks = [{**one, "epochs_to_level_or_all": _epochs(one), "n_owned": _n_owned(one)} for one in networks]
    return [_judge(claim, networks, seed) for claim in CLAIMS]


def _epochs(network: Figures) -> float:
    reached = network["epochs_to_level"]
    return float(network["n_epochs"] if reached is None else reached)


def _n_owned(network: Figures) -> int:
    return sum(share >= OWNED_PCT for share in network["region_pct"].values())


def _judge(claim: Claim, networks: Sequence[Figures], seed: int) -> dict[str, Any]:
    values = values_of(networks, claim.field)
    if claim.pairs:
        verdict, compared = compare(values, claim, seed)
        evidence = {"differences": [dataclasses.asdict(one) for one in compared]}
    else:
        shown = {name: [bool(SHOWS[claim.key](one)) for one in networks if one["condition"] == name] for name in values}
        rates = [rate(name, answers) for name, answers in shown.items() if answers]
        verdict = decide_rates(rates if len(rates) == len(CONDITION_NAMES) else [])
        evidence = {"rates": [dataclasses.asdict(one) for one in rates]}
    return {
        "key": claim.key,
        "says": claim.says,
        "paper": claim.paper,
        "measured": claim.measured,
        "unit": claim.unit,
        "verdict": verdict,
        "means": {name: float(mine.mean()) if len(mine) else None for name, mine in values.items()},
        **evidence,
    }


def values_of(networks: Sequence[Figures], field: str) -> dict[str, np.ndarray]:
    """Return a figure of all networks by condition, one value per seed; networks without it are left out."""
    return {
        name: np.array([one[field] for one in networks if one["condition"] == name and one[field] is not None], float)
        for name in CONDITION_NAMES
    }


def compare(values: Mapping[str, np.ndarray], claim: Claim, seed: int) -> tuple[str, list[Difference]]:
    """Return the verdict on an order and the differences that decide it; without values on a side it is undecided."""
    if not all(len(values[condition]) for pair in claim.pairs for condition in pair):
        return decide([]), []
    rng = np.random.default_rng(seed_sequence(seed, claim.key))
    differences = [difference(values, above, below, rng) for above, below in claim.pairs]
    return decide(differences), differences
