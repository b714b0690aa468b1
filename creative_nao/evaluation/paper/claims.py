"""The paper's conclusions, claim by claim: what decides each, and whether it holds over seeds.

One rule serves all claims of a kind. A conclusion about an order ("the half closed condition is most novel") is a set
of differences of means, each of which has to be positive; a conclusion about every network ("the six actions are
learned") is a share of networks, which has to be above one half in every condition.
"""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from creative_nao.evaluation.paper.comparisons import (
    CONDITION_NAMES,
    CONVERGED_LEVEL,
    Difference,
    Figures,
    decide,
    decide_rates,
    difference,
    rate,
    values_of,
)

OPEN, HALF, CLOSED = CONDITION_NAMES
OWNED_PCT = 0.1
"""Share of the map that a basic action's region needs to count as a region: 40 points of 40,000."""


@dataclass(frozen=True)
class Order:
    """A claim about the order of conditions.

    Attributes:
        key: Short name.
        says: What the paper says, in our words.
        field: Figure of a network that decides it.
        measured: What that figure is.
        unit: Its unit.
        pairs: Pairs of conditions whose first should have the larger mean.
        paper: What the paper bases it on.
    """

    key: str
    says: str
    field: str
    measured: str
    unit: str
    pairs: tuple[tuple[str, str], ...]
    paper: str


@dataclass(frozen=True)
class Everywhere:
    """A claim about most networks of every condition.

    Attributes:
        key: Short name.
        says: What the paper says, in our words.
        measured: What a network has to show.
        shows: Whether it does.
        paper: What the paper bases it on.
        field: Figure of a network that tells how much; its means stand beside the verdict.
        unit: What that figure is.
    """

    key: str
    says: str
    measured: str
    shows: Callable[[Figures], bool]
    paper: str
    field: str
    unit: str


def _most(condition: str) -> tuple[tuple[str, str], ...]:
    return tuple((condition, other) for other in CONDITION_NAMES if other != condition)


def _least(condition: str) -> tuple[tuple[str, str], ...]:
    return tuple((other, condition) for other in CONDITION_NAMES if other != condition)


FALLING = ((OPEN, HALF), (HALF, CLOSED))
RISING = ((CLOSED, HALF), (HALF, OPEN))

TABLE, CURVES, MAPS = "Table I", "Fig. 2, by eye", "Fig. 4, by eye"

CLAIMS: tuple[Order | Everywhere, ...] = (
    Everywhere(
        "converges",
        "Learning converges in all conditions.",
        f"the loss falls below {100 * CONVERGED_LEVEL:g} % of its first value",
        lambda one: one["epochs_to_level"] is not None,
        CURVES,
        "best_loss",
        "lowest loss",
    ),
    Everywhere(
        "learned",
        "The network learns the six basic actions, in all conditions.",
        "all six come back in closed loop within DTW 10",
        lambda one: one["n_reproduced"] == len(one["reproduction_dtw"]),
        "stated without a figure",
        "n_reproduced",
        "actions that come back",
    ),
    Order(
        "open-fastest",
        "Open-loop training converges faster than the others.",
        "epochs_to_level_or_all",
        f"epochs until the loss falls below {100 * CONVERGED_LEVEL:g} % of its first value; "
        "all epochs where it never does",
        "epochs",
        _least(OPEN),
        CURVES,
    ),
    Order(
        "closed-unsteady",
        "The closed-loop learning curve fluctuates more.",
        "unsteadiness",
        "mean change of log10(loss) from one kept point of the curve to the next",
        "",
        _most(CLOSED),
        CURVES,
    ),
    Order(
        "half-novel", "Half closed training makes the most novel actions.", "novelty", "novelty", "rad", _most(HALF),
        TABLE,
    ),
    Order(
        "half-diverse", "Half closed training makes the most diverse actions.", "diversity", "diversity", "rad",
        _most(HALF), TABLE,
    ),
    Order(
        "closed-least-novel", "Closed-loop training makes the least novel actions.", "novelty", "novelty", "rad",
        _least(CLOSED), TABLE,
    ),
    Order(
        "closed-least-diverse", "Closed-loop training makes the least diverse actions.", "diversity", "diversity",
        "rad", _least(CLOSED), TABLE,
    ),
    Order(
        "closed-appropriate", "Closed-loop training makes the most appropriate actions.", "appropriateness_pct",
        "share of appropriate actions", "%", _most(CLOSED), TABLE,
    ),
    Order(
        "closed-like-training", "Closed-loop training makes the actions most like the taught ones.", "learned_pct",
        "share of learned actions", "%", _most(CLOSED), TABLE,
    ),
    Order(
        "half-fewest-learned", "Half closed training gives the fewest taught actions back.", "learned_pct",
        "share of learned actions", "%", _least(HALF), TABLE,
    ),
    Order(
        "simpler-regions", "The map becomes simpler as the ratio grows: fewer regions.", "n_regions",
        "connected regions of usable actions with the same nearest basic action", "", FALLING, MAPS,
    ),
    Order(
        "simpler-borders", "The map becomes simpler as the ratio grows: shorter borders.", "border_length",
        "length of all borders between colours of the map", "PB units", FALLING, MAPS,
    ),
    Order(
        "simpler-smooth", "The map becomes simpler as the ratio grows: less rugged.", "ruggedness",
        "mean DTW distance from one grid point to the next", "rad", FALLING, MAPS,
    ),
    Order(
        "more-even", "The regions of the six actions become more even in size as the ratio grows.", "evenness",
        "evenness of the learned regions' sizes, 1 if all are equal", "", RISING, MAPS,
    ),
    Everywhere(
        "own-region",
        "Each basic action has a region of its own on the map.",
        f"each of the six is learned on at least {OWNED_PCT} % of the map",
        lambda one: min(one["region_pct"].values()) >= OWNED_PCT,
        MAPS,
        "n_owned",
        "actions with a region",
    ),
    Everywhere(
        "abrupt",
        "The map is rugged: a small change of the PB can change the action abruptly.",
        "a step from one usable grid point to the next changes the action by more than the smallest distance between "
        "two basic actions",
        lambda one: one["steep_step_pct"] > 0,
        "Fig. 5 and video",
        "steep_step_pct",
        "% of the steps",
    ),
    Everywhere(
        "combinations",
        "Between two basic actions lie combinations of them.",
        "on the straight line between the learned PB values of at least one pair lies a combination of these two",
        lambda one: one["n_pairs_between"] >= 1,
        "Fig. 3c and 5b, one example each",
        "n_pairs_between",
        "of the pairs of actions",
    ),
)  # fmt: skip


def judge(networks: Sequence[Figures], *, seed: int, claims: Sequence[Order | Everywhere] = CLAIMS) -> list[dict]:
    """Return the verdict on each claim with its evidence, as plain values.

    Args:
        networks: Figures of every network.
        seed: Decides the bootstrap samples.
        claims: Which claims.
    """
    networks = [{**one, "epochs_to_level_or_all": _epochs(one), "n_owned": _owned(one)} for one in networks]
    return [
        _judge_order(claim, networks, seed) if isinstance(claim, Order) else _judge_everywhere(claim, networks)
        for claim in claims
    ]


def compare(values: Mapping[str, np.ndarray], claim: Order, seed: int) -> tuple[str, list[Difference]]:
    """Return the verdict on an order and the differences that decide it; without values on a side it is undecided."""
    if not all(len(values[condition]) for pair in claim.pairs for condition in pair):
        return decide([]), []
    rng = np.random.default_rng([seed, zlib.crc32(claim.key.encode())])
    found = [difference(values, above, below, rng) for above, below in claim.pairs]
    return decide(found), found


def _judge_order(claim: Order, networks: Sequence[Figures], seed: int) -> dict[str, Any]:
    values = values_of(networks, claim.field)
    verdict, found = compare(values, claim, seed)
    return {
        "key": claim.key,
        "says": claim.says,
        "paper": claim.paper,
        "measured": claim.measured,
        "unit": claim.unit,
        "verdict": verdict,
        "means": _means(values),
        "differences": [dataclasses.asdict(one) for one in found],
    }


def _judge_everywhere(claim: Everywhere, networks: Sequence[Figures]) -> dict[str, Any]:
    rates = []
    for condition in CONDITION_NAMES:
        answers = [bool(claim.shows(one)) for one in networks if one["condition"] == condition]
        if answers:
            rates.append(rate(condition, answers))
    verdict = decide_rates(rates) if len(rates) == len(CONDITION_NAMES) else decide_rates([])
    return {
        "key": claim.key,
        "says": claim.says,
        "paper": claim.paper,
        "measured": claim.measured,
        "unit": claim.unit,
        "verdict": verdict,
        "means": _means(values_of(networks, claim.field)),
        "rates": [dataclasses.asdict(one) for one in rates],
    }


def _means(values: Mapping[str, np.ndarray]) -> dict[str, float | None]:
    return {name: float(mine.mean()) if len(mine) else None for name, mine in values.items()}


def _owned(network: Figures) -> int:
    return sum(share >= OWNED_PCT for share in network["region_pct"].values())


def _epochs(network: Figures) -> float:
    reached = network["epochs_to_level"]
    return float(network["n_epochs"] if reached is None else reached)
