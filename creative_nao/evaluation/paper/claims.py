"""What the paper says, and whether it holds over seeds: its Table I and its 18 conclusions, with what decides each.

One rule serves all claims of a kind. A conclusion about an order ("the half closed condition is most novel") is a set
of differences of means, each of which has to be positive; a conclusion about every network ("the six actions are
learned") is a share of networks, which has to be above one half in every condition.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from creative_nao.evaluation.paper.bank import CONDITION_NAMES
from creative_nao.evaluation.paper.comparisons import Difference, decide, decide_rates, difference, rate
from creative_nao.evaluation.statistics import seed_sequence

OPEN, HALF, CLOSED = CONDITION_NAMES
CONDITION_TITLES = {"open": "open loop, 0.0", "half": "half closed, 0.5", "closed": "closed loop, 1.0"}

CONVERGED_LEVEL = 0.01
"""Share of its first value that the loss has to fall below to count as converged; the paper names no criterion."""

OWNED_PCT = 0.1
"""Share of the map that a basic action's region needs to count as a region: 40 points of 40,000."""

Figures = Mapping[str, Any]
"""All figures of one network, as `summary.measure_entry` returns them."""


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


TABLE_I = (
    Measure("unlearned_pct", "unlearned", "%", {OPEN: 72.21, HALF: 75.26, CLOSED: 57.95}),
    Measure("learned_pct", "learned", "%", {OPEN: 11.23, HALF: 7.58, CLOSED: 40.02}),
    Measure("appropriateness_pct", "appropriate", "%", {OPEN: 83.44, HALF: 82.84, CLOSED: 97.97}),
    Measure("novelty", "novelty", "rad", {OPEN: 26.02, HALF: 31.71, CLOSED: 18.53}),
    Measure("diversity", "diversity", "rad", {OPEN: 43.12, HALF: 48.03, CLOSED: 35.96}),
)
"""The paper's Table I, row by row."""

FURTHER = (Measure("fluctuating_pct", "fluctuating", "%", {}), Measure("non_moving_pct", "non-moving", "%", {}))
"""What the paper's share of inappropriate actions is made of; it gives no figures."""


@dataclass(frozen=True)
class Claim:
    """A conclusion of the paper: about the order of conditions (`pairs`), or most networks of each (`shows`).

    Attributes:
        key: Short name.
        says: What the paper says, in our words.
        paper: What the paper bases it on.
        field: Figure of a network that decides an order; of `shows`, the one whose means stand beside the verdict.
        measured: What that figure is, or what a network has to show.
        unit: Unit of that figure, or what it counts.
        pairs: Pairs of conditions whose first should have the larger mean.
        shows: Whether a network shows it.
    """

    key: str
    says: str
    paper: str
    field: str
    measured: str
    unit: str
    pairs: tuple[tuple[str, str], ...] = ()
    shows: Callable[[Figures], bool] | None = None


def _most(condition: str) -> tuple[tuple[str, str], ...]:
    return tuple((condition, other) for other in CONDITION_NAMES if other != condition)


def _least(condition: str) -> tuple[tuple[str, str], ...]:
    return tuple((other, condition) for other in CONDITION_NAMES if other != condition)


FALLING = ((OPEN, HALF), (HALF, CLOSED))
RISING = ((CLOSED, HALF), (HALF, OPEN))
TABLE, CURVES, MAPS = "Table I", "Fig. 2, by eye", "Fig. 4, by eye"

CLAIMS = (
    Claim(
        "converges", "Learning converges in all conditions.", CURVES, "best_loss",
        f"the loss falls below {100 * CONVERGED_LEVEL:g} % of its first value", "lowest loss",
        shows=lambda one: one["epochs_to_level"] is not None,
    ),
    Claim(
        "learned", "The network learns the six basic actions, in all conditions.", "stated without a figure",
        "n_reproduced", "all six come back in closed loop within DTW 10", "actions that come back",
        shows=lambda one: one["n_reproduced"] == len(one["reproduction_dtw"]),
    ),
    Claim(
        "open-fastest", "Open-loop training converges faster than the others.", CURVES, "epochs_to_level_or_all",
        f"epochs until the loss falls below {100 * CONVERGED_LEVEL:g} % of its first value; "
        "all epochs where it never does", "epochs", _least(OPEN),
    ),
    Claim(
        "closed-unsteady", "The closed-loop learning curve fluctuates more.", CURVES, "unsteadiness",
        "mean change of log10(loss) from one kept point of the curve to the next", "", _most(CLOSED),
    ),
    Claim(
        "half-novel", "Half closed training makes the most novel actions.", TABLE, "novelty", "novelty", "rad",
        _most(HALF),
    ),
    Claim(
        "half-diverse", "Half closed training makes the most diverse actions.", TABLE, "diversity", "diversity", "rad",
        _most(HALF),
    ),
    Claim(
        "closed-least-novel", "Closed-loop training makes the least novel actions.", TABLE, "novelty", "novelty", "rad",
        _least(CLOSED),
    ),
    Claim(
        "closed-least-diverse", "Closed-loop training makes the least diverse actions.", TABLE, "diversity",
        "diversity", "rad", _least(CLOSED),
    ),
    Claim(
        "closed-appropriate", "Closed-loop training makes the most appropriate actions.", TABLE, "appropriateness_pct",
        "share of appropriate actions", "%", _most(CLOSED),
    ),
    Claim(
        "closed-like-training", "Closed-loop training makes the actions most like the taught ones.", TABLE,
        "learned_pct", "share of learned actions", "%", _most(CLOSED),
    ),
    Claim(
        "half-fewest-learned", "Half closed training gives the fewest taught actions back.", TABLE, "learned_pct",
        "share of learned actions", "%", _least(HALF),
    ),
    Claim(
        "simpler-regions", "The map becomes simpler as the ratio grows: fewer regions.", MAPS, "n_regions",
        "connected regions of usable actions with the same nearest basic action", "", FALLING,
    ),
    Claim(
        "simpler-borders", "The map becomes simpler as the ratio grows: shorter borders.", MAPS, "border_length",
        "length of all borders between colours of the map", "PB units", FALLING,
    ),
    Claim(
        "simpler-smooth", "The map becomes simpler as the ratio grows: less rugged.", MAPS, "ruggedness",
        "mean DTW distance from one grid point to the next", "rad", FALLING,
    ),
    Claim(
        "more-even", "The regions of the six actions become more even in size as the ratio grows.", MAPS, "evenness",
        "evenness of the learned regions' sizes, 1 if all are equal", "", RISING,
    ),
    Claim(
        "own-region", "Each basic action has a region of its own on the map.", MAPS, "n_owned",
        f"each of the six is learned on at least {OWNED_PCT} % of the map", "actions with a region",
        shows=lambda one: min(one["region_pct"].values()) >= OWNED_PCT,
    ),
    Claim(
        "abrupt", "The map is rugged: a small change of the PB can change the action abruptly.", "Fig. 5 and video",
        "steep_step_pct",
        "a step from one usable grid point to the next changes the action by more than the smallest distance between "
        "two basic actions", "% of the steps", shows=lambda one: one["steep_step_pct"] > 0,
    ),
    Claim(
        "combinations", "Between two basic actions lie combinations of them.", "Fig. 3c and 5b, one example each",
        "n_pairs_between",
        "on the straight line between the learned PB values of at least one pair lies a combination of these two",
        "of the pairs of actions", shows=lambda one: one["n_pairs_between"] >= 1,
    ),
)  # fmt: skip

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
    if claim.shows is None:
        verdict, compared = compare(values, claim, seed)
        evidence = {"differences": [dataclasses.asdict(one) for one in compared]}
    else:
        shown = {name: [bool(claim.shows(one)) for one in networks if one["condition"] == name] for name in values}
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
