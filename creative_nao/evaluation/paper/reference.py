"""What the paper reports: its Table I, its three conditions, and how they are called and drawn here.

J. Hwang, J. Tani, "A Dynamic Neural Network Approach to Generating Robot's Novel Actions: A Simulation Experiment",
UR 2018, arXiv:1805.05537. One network per condition; no spread is given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from creative_nao.model.shipped import CONDITIONS
from creative_nao.pb_space.palette import BASIC_ACTIONS

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
