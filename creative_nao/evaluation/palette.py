"""Colours of the figures: those of the PB map, told apart with every kind of colour vision."""

from __future__ import annotations

from creative_nao.pb_space.palette import BASIC_ACTIONS, FLUCTUATING, INK, NON_MOVING

FAINT = "#8A9199"

AGENTS = {"supervised": "#004FE5", "random": "#E97E00", "ppo": "#009E73"}
MARKERS = {"supervised": "o", "random": "s", "ppo": "D"}
"""Agents differ in shape too, so that nothing rests on colour alone."""

OUTCOMES = {
    "learned": "#009E73",
    "unlearned": "#66D6FF",
    "fluctuating": FLUCTUATING,
    "non_moving": NON_MOVING,
    "joint_limit": "#8B2F00",
    "torque_saturated": "#E97E00",
    "tracking_error": "#EDD912",
    "self_collision": "#004FE5",
    "fell": INK,
}
"""Outcomes that a robot can use first, then the reasons why not."""


def agent_colour(agent: str) -> str:
    """Return the colour of an agent; the same for the same name."""
    rest = [colour for colour in BASIC_ACTIONS if colour not in AGENTS.values()]
    return AGENTS.get(agent) or rest[sum(agent.encode()) % len(rest)]
