"""Colours of the PB map: told apart with every kind of colour vision, smallest CAM02-UCS difference 17.6.

Colour never stands alone: regions have borders, basic actions letters, inappropriate outcomes hatching.

Also here:
- What the colours of a PB map may tell beside the nearest basic action: one number a point, with its unit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import NotFoundError, SettingsError, ShapeError, nearest_name
from creative_nao.maps.map import neighbour_pairs
from creative_nao.measures import dtw_pairs, excursions, largest_speeds, unexpectedness

if TYPE_CHECKING:
    from creative_nao.maps.map import PBMap


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


NEAREST = "nearest"
"""The colouring of the paper's Fig. 4, which is no number: nearest basic action, strong where it is similar."""


@dataclass(frozen=True)
class Colouring:
    """A measure that every point of a map has.

    Attributes:
        label: What it is, with its unit, beside the scale.
        needs_trajectories: Whether it is worked out from the movements, which a map read from a file does not hold.
        values: Gives it for every point of a map, shape (n,).
    """

    label: str
    needs_trajectories: bool
    values: Callable[[PBMap], np.ndarray]


def neighbour_distances(pb_map: PBMap) -> np.ndarray:
    """Return the mean DTW distance of each point's movement to those of its neighbours in the grid [rad], shape (n,).

    A point has four neighbours, at an edge three, in a corner two.
    """
    n_cells = pb_map.resolution**2
    first, second = neighbour_pairs(pb_map.resolution)
    distances = dtw_pairs(_trajectories(pb_map), first, second)
    total = np.bincount(first, distances, n_cells) + np.bincount(second, distances, n_cells)
    return total / (np.bincount(first, minlength=n_cells) + np.bincount(second, minlength=n_cells))


def _unexpectedness(pb_map: PBMap) -> np.ndarray:
    """Against the map's own usable points: what an even draw from them would be expected to find."""
    usable = pb_map.distance[pb_map.appropriate]
    return unexpectedness(pb_map.distance, usable if len(usable) else pb_map.distance)


def _speeds(pb_map: PBMap) -> np.ndarray:
    if pb_map.dt_s is None:
        raise SettingsError("a map coloured by speed needs its tick, `dt_s`, which this one does not hold.")
    return largest_speeds(_trajectories(pb_map), pb_map.dt_s).max(axis=1)


def _trajectories(pb_map: PBMap) -> np.ndarray:
    found = pb_map.trajectories
    assert found is not None  # `colour_values` refuses a map without
    return found


COLOURINGS: dict[str, Colouring] = {
    "novelty": Colouring("novelty: DTW distance to the nearest basic action [rad]", False, lambda one: one.distance),
    "unexpectedness": Colouring("unexpectedness among the usable movements of the map [bit]", False, _unexpectedness),
    "speed": Colouring("largest speed of a joint [rad/s]", True, _speeds),
    "excursion": Colouring("way of the most moving joint [rad]", True, lambda one: excursions(_trajectories(one))),
    "ruggedness": Colouring("mean DTW distance to the neighbouring movements [rad]", True, neighbour_distances),
}
"""Every colouring that is a number, by name."""


def check_colour(name: str) -> str:
    """Return the name of a colouring.

    Raises:
        NotFoundError: If there is none of this name; the message has the nearest one.
    """
    known = (NEAREST, *COLOURINGS)
    if name not in known:
        raise NotFoundError(f"no colouring `{name}`{nearest_name(name, known)}; there are {', '.join(known)}.")
    return name


def colour_values(pb_map: PBMap, colour: str | ArrayLike) -> tuple[np.ndarray, str]:
    """Return the number that colours each point, shape (n,), and what it is.

    Args:
        pb_map: The map.
        colour: A name of `COLOURINGS`, or numbers of one's own, shape (n,), in the order of the map's points.

    Raises:
        NotFoundError: If there is no colouring of this name.
        SettingsError: If it needs the movements and the map, read from a file, has none.
        ShapeError: If numbers of one's own do not fit the map or are not finite.
    """
    if isinstance(colour, str):
        if check_colour(colour) == NEAREST:
            raise SettingsError(f"`{NEAREST}` is no number; those that are: {', '.join(COLOURINGS)}.")
        one = COLOURINGS[colour]
        if one.needs_trajectories and getattr(pb_map, "trajectories", None) is None:
            raise SettingsError(
                f"colouring by {colour} needs the movements, which this map does not hold; "
                "make it again with `pb_map(memory)`."
            )
        return one.values(pb_map), one.label
    values = np.asarray(colour)
    if values.shape != (len(pb_map.pb),) or values.dtype.kind not in "fiub" or not np.isfinite(values).all():
        raise ShapeError(
            f"`colour` should be a name or {len(pb_map.pb)} finite numbers, one for each point of the map, but has "
            f"shape {values.shape} and type {values.dtype}."
        )
    return values.astype(np.float64), ""
