"""The palette of all figures: told apart with every kind of colour vision, smallest CAM02-UCS difference 17.6.

Colour never stands alone: regions have borders, basic actions letters, inappropriate outcomes hatching.
"""

from __future__ import annotations

BLUE, ORANGE, GREEN, BROWN, SKY, YELLOW = "#004FE5", "#E97E00", "#009E73", "#8B2F00", "#66D6FF", "#EDD912"
BASIC_ACTIONS = (BLUE, ORANGE, GREEN, BROWN, SKY, YELLOW)
"""Of the basic actions, in their order; with more than six they begin again."""
FLUCTUATING = "#4B0082"
NON_MOVING = "#CD94B5"
UNUSABLE: dict[str, tuple[str, str]] = {
    "fluctuating": (FLUCTUATING, "\\\\\\\\"),
    "non_moving": (NON_MOVING, "////"),
    "joint_limit": ("#6E6E6E", "||||"),
    "fell": ("#000000", "xxxx"),
    "self_collision": ("#C2003A", "oo"),
    "torque_saturated": ("#3C4A4F", "...."),
    "tracking_error": ("#9A9A9A", "----"),
}
"""Colour and hatching of what cannot be used: the two kinds of the paper, then what only a body adds."""
PAPER_WHITE = "#F5F5F5"
"""What a colour fades to as the similarity to the basic action falls."""
INK = "#22262B"
FAINT = "#8A9199"
OUTCOME_COLOURS = {
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
"""Of outcomes in bars, where no hatching is: those that a robot can use first, then the reasons why not."""


def action_colour(place: int) -> str:
    """Return the colour of the basic action at `place`."""
    return BASIC_ACTIONS[place % len(BASIC_ACTIONS)]


def action_letter(place: int) -> str:
    """Return the letter that marks the basic action at `place`: A, B, C, ..."""
    return chr(ord("A") + place % 26)


def rgb(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue in [0, 1] of a ``#rrggbb`` colour."""
    return (int(colour[1:3], 16) / 255, int(colour[3:5], 16) / 255, int(colour[5:7], 16) / 255)
