"""Colours of the figures: those of the PB map, told apart with every kind of colour vision."""

from __future__ import annotations

from creative_nao.pb_space.palette import (
    BASIC_ACTIONS,
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

AGENTS = {"supervised": BLUE, "random": ORANGE, "ppo": GREEN}
MARKERS = {"supervised": "o", "random": "s", "ppo": "D"}
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


def agent_colour(agent: str) -> str:
    """Return the colour of an agent; the same for the same name."""
    rest = [colour for colour in BASIC_ACTIONS if colour not in AGENTS.values()]
    return AGENTS.get(agent) or rest[sum(agent.encode()) % len(rest)]
