"""The colourings of a map, the patterns of its outcomes, and its picture."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Callable
from typing import Any

import numpy as np
from PIL import Image

from creative_nao.envs.physical_map import FIGURES, PhysicalMap
from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.explorer.view import View
from creative_nao.maps import COLOURINGS, PBMap
from creative_nao.maps.figure_style import INK, UNUSABLE, rgb
from creative_nao.maps.picture import NEAREST, map_image, measure_image, measure_span

OUTCOME = "outcome"
PHYSICAL = "physical"
_PHYSICAL_FIGURES = {f"{PHYSICAL}_{name}": name for name in FIGURES if name != "fell"}
NAMES: dict[str, str] = {
    NEAREST: "nearest action",
    OUTCOME: "outcome",
    **{name: name for name in COLOURINGS},
    PHYSICAL: "physical outcome",
    **{key: f"physical: {name.replace('_', ' ')}" for key, name in _PHYSICAL_FIGURES.items()},
}
"""Every colouring as the page calls it. The physical ones need a physical map of the memory."""
USABLE = {"learned": "#009E73", "unlearned": "#E97E00"}
"""Colours of the two outcomes that a robot can use."""


def is_physical(colour: str) -> bool:
    """Tell whether a colouring needs a physical map."""
    return colour == PHYSICAL or colour in _PHYSICAL_FIGURES


def is_number(colour: str) -> bool:
    """Tell whether a colouring is a number with a scale."""
    return colour in COLOURINGS or colour in _PHYSICAL_FIGURES


def needs_movements(colour: str) -> bool:
    """Tell whether a colouring is worked out from the movements themselves."""
    return colour in COLOURINGS and COLOURINGS[colour].needs_trajectories


def scale_label(colour: str) -> str:
    """Return what a number is, with its unit."""
    return COLOURINGS[colour].label if colour in COLOURINGS else FIGURES[_PHYSICAL_FIGURES[colour]]


def physical_figure(pb_map: PhysicalMap, colour: str) -> np.ndarray:
    """Return the number of every point in a physical colouring, shape (n,)."""
    return pb_map.figures[_PHYSICAL_FIGURES[colour]].astype(np.float64)


def shared_span(maps: list[tuple[PBMap, np.ndarray]]) -> tuple[float, float]:
    """Return the ends of one scale for the numbers of several maps: over the points of all that can be used."""
    ends = [measure_span(pb_map, values) for pb_map, values in maps]
    return min(low for low, _ in ends), max(high for _, high in ends)


def cell_colours(
    pb_map: PBMap, colour: str = NEAREST, values: np.ndarray | None = None, span: tuple[float, float] | None = None
) -> np.ndarray:
    """Return the colour of every cell, shape (resolution, resolution, 3) in [0, 1], row 0 at the lowest PB 2.

    A physical colouring needs a physical map, a number its `values`, shape (n,); `span` are those at the ends of their
    scale, by default of the cells that can be used. NotFoundError if there is no such colouring.
    """
    if colour not in NAMES:
        raise NotFoundError(f"no colouring `{colour}`{nearest_name(colour, NAMES)}; there are {', '.join(NAMES)}")
    if is_number(colour):
        assert values is not None
        return measure_image(pb_map, values, span)[0]
    if colour == NEAREST:
        return map_image(pb_map)
    named = {outcome: pair[0] for outcome, pair in UNUSABLE.items()} | USABLE
    colours = np.array([rgb(named.get(str(outcome), INK)) for outcome in pb_map.outcome])
    return colours.reshape(pb_map.resolution, pb_map.resolution, 3)


PERIOD_PX = 8
STRENGTH = 0.35  # how far the lines of a pattern are drawn towards white


def _dots(up: np.ndarray, across: np.ndarray, radius_squared: float) -> np.ndarray:
    middle = PERIOD_PX // 2
    return (up % PERIOD_PX - middle) ** 2 + (across % PERIOD_PX - middle) ** 2 <= radius_squared


PATTERNS: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "fluctuating": lambda up, across: (up + across) % PERIOD_PX == 0,
    "non_moving": lambda up, across: (up - across) % PERIOD_PX == 0,
    "joint_limit": lambda up, across: across % PERIOD_PX == 0,
    "tracking_error": lambda up, across: up % PERIOD_PX == 0,
    "fell": lambda up, across: ((up + across) % PERIOD_PX == 0) | ((up - across) % PERIOD_PX == 0),
    "self_collision": lambda up, across: _dots(up, across, 5.0),
    "torque_saturated": lambda up, across: _dots(up, across, 1.0),
}
"""By outcome: whether a pixel belongs to the pattern, from its row and its column."""


def hatch(pixels: np.ndarray, where: np.ndarray, outcome: str) -> None:
    """Draw the pattern of an outcome into a picture, (height, width, 3) in [0, 1], where `where` is true."""
    lines = where & PATTERNS[outcome](*np.mgrid[: pixels.shape[0], : pixels.shape[1]])
    pixels[lines] = (1 - STRENGTH) * pixels[lines] + STRENGTH


def sample(outcome: str, width: int, height: int) -> np.ndarray:
    """Return a small picture of an outcome's colour and pattern, (height, width, 3) in [0, 1]."""
    pixels = np.tile(np.array(rgb(UNUSABLE[outcome][0])), (height, width, 1))
    hatch(pixels, np.ones((height, width), bool), outcome)
    return pixels


def map_picture(
    pb_map: PBMap,
    colour: str = NEAREST,
    view: View | None = None,
    values: np.ndarray | None = None,
    span: tuple[float, float] | None = None,
) -> Image.Image:
    """Draw what a view shows of a map, `SIZE` pixels along each side, PB 2 upwards.

    Regions of learned movements have dark borders and what cannot be used is hatched, so that nothing is shown by
    colour alone. The view is by default all that the map covers; cells beyond its edge repeat the last. Colours,
    values, their span and errors are those of `cell_colours`.
    """
    rows, columns = (View.of(pb_map) if view is None else view).cells(pb_map)
    seen = np.ix_(rows, columns)
    pixels = cell_colours(pb_map, colour, values, span)[seen]
    outcome = pb_map.outcome.reshape(pb_map.resolution, -1)[seen]
    for name in PATTERNS:
        if (where := outcome == name).any():
            hatch(pixels, where, name)
    pixels[borders(pb_map, rows, columns)] = rgb(INK)
    return as_picture(pixels)


def borders(pb_map: PBMap, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Tell which pixels border a region of learned movements, by the rows and the columns of cells under them."""
    region = np.where(pb_map.outcome == "learned", pb_map.nearest, -1).reshape(pb_map.resolution, -1)
    region = region[np.ix_(rows, columns)]
    border = np.zeros(region.shape, bool)
    border[1:] |= region[1:] != region[:-1]
    border[:, 1:] |= region[:, 1:] != region[:, :-1]
    return border


def as_picture(pixels: np.ndarray) -> Image.Image:
    """Return colours in [0, 1], shape (height, width, 3), as a picture."""
    return Image.fromarray(np.round(255 * pixels).astype(np.uint8))


def data_address(kind: str, content: bytes) -> str:
    """Return a file of a MIME type as a data address, so that showing it needs no room on a disk."""
    return f"data:{kind};base64,{b64encode(content).decode()}"


def png_address(picture: Image.Image, **options: Any) -> str:
    """Return a picture as a data address; `options` are Pillow's for PNG."""
    stream = io.BytesIO()
    picture.save(stream, format="PNG", **options)
    return data_address("image/png", stream.getvalue())
