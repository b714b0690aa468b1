"""Colours of the figures: those of the PB map, told apart with every kind of colour vision."""

from __future__ import annotations

from pathlib import Path

from creative_nao.pb_space.palette import (
    BLUE,
    BROWN,
    FLUCTUATING,
    GREEN,
    INK,
    NON_MOVING,
    ORANGE,
    SKY,
    YELLOW,
)

FAINT = "#8A9199"

AGENTS = {
    "supervised": BLUE,
    "random": ORANGE,
    "ppo": GREEN,
    "oracle": INK,
    "sobol": "#882255",
    "replay": "#8A9199",
    "cma_es": "#CC6677",
    "cma_me": "#AA4499",
    "map_elites": "#B8860B",
    "novelty_search": "#44AA99",
    "bayesian": "#332288",
    "sac": "#117733",
    "td3": "#999933",
    "tqc": "#6699CC",
    "crossq": "#661100",
    "recurrent_ppo": "#88CCEE",
}
OTHERS = ("#CC6677", "#44AA99", "#332288", "#999933", "#AA4499", "#661100")
SHAPES = ("o", "s", "D", "^", "v", "P", "X", "<", ">", "p", "h", "*")
"""Agents differ in shape too, so that nothing rests on colour alone."""

OUTCOMES = {
    "learned": GREEN,
    "unlearned": SKY,
    "fluctuating": FLUCTUATING,
    "non_moving": NON_MOVING,
    "joint_limit": BROWN,
    "torque_saturated": ORANGE,
    "tracking_error": YELLOW,
    "self_collision": BLUE,
    "fell": INK,
}
"""Outcomes that a robot can use first, then the reasons why not."""


def agent_label(agent: str) -> str:
    """Return how figures call an agent: a shipped bundle by its algorithm, a file by its stem."""
    return Path(agent).stem if agent.endswith(".safetensors") else agent.split("/")[0]


def agent_colour(agent: str) -> str:
    """Return the colour of an agent; the same for the same name."""
    label = agent_label(agent)
    return AGENTS.get(label) or OTHERS[sum(label.encode()) % len(OTHERS)]


def agent_marker(agent: str) -> str:
    """Return the shape of an agent; the same for the same name."""
    label = agent_label(agent)
    place = list(AGENTS).index(label) if label in AGENTS else sum(label.encode())
    return SHAPES[place % len(SHAPES)]
