"""The map as a picture to touch: its pixels, the marks upon it, and which PB point lies under the pointer."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image

from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.pb_space import PBMap
from creative_nao.pb_space.palette import INK, UNUSABLE, action_letter, rgb
from creative_nao.pb_space.picture import map_image

SIZE = 600
"""Pixels along each side, whatever the resolution of the map."""
COLOURINGS = ("nearest action", "novelty", "outcome")
_NOVELTY = ("#FFF6D5", "#F2B134", "#C8452D", "#4A0D3A")
_OUTCOMES = {"learned": "#009E73", "unlearned": "#E97E00"}
_HATCH_PX = 8


class Mark(NamedTuple):
    """A letter on the map: where in the PB space, and what it says."""

    pb: tuple[float, float]
    letter: str


def map_picture(chart: PBMap, colouring: str = "nearest action") -> Image.Image:
    """Draw the map, `SIZE` pixels along each side, PB 2 upwards.

    Regions of learned movements have dark borders and what cannot be used is hatched, so that nothing is told by
    colour alone.

    Raises:
        NotFoundError: If there is no such colouring.
    """
    n = chart.resolution
    cells = _cells(chart, colouring).reshape(n, n, 3)
    row = np.arange(SIZE) * n // SIZE
    pixels = cells[::-1][row][:, row]
    up, across = np.mgrid[:SIZE, :SIZE]
    for outcome, slope in (("fluctuating", 1), ("non_moving", -1)):
        seen = (chart.outcome == outcome).reshape(n, n)[::-1][row][:, row]
        stripes = (up + slope * across) % _HATCH_PX == 0
        pixels[seen & stripes] = 0.65 * pixels[seen & stripes] + 0.35
    region = np.where(chart.outcome == "learned", chart.nearest, -1).reshape(n, n)[::-1][row][:, row]
    border = np.zeros((SIZE, SIZE), bool)
    border[1:] |= region[1:] != region[:-1]
    border[:, 1:] |= region[:, 1:] != region[:, :-1]
    pixels[border] = rgb(INK)
    return Image.fromarray(np.round(255 * pixels).astype(np.uint8))


def map_address(chart: PBMap, colouring: str = "nearest action") -> str:
    """Return the picture of `map_picture` as a data address, so that showing it needs no room on a disk."""
    stream = io.BytesIO()
    map_picture(chart, colouring).quantize(256).save(stream, format="PNG")
    return f"data:image/png;base64,{b64encode(stream.getvalue()).decode()}"


def _cells(chart: PBMap, colouring: str) -> np.ndarray:
    if colouring == "nearest action":
        return map_image(chart).reshape(-1, 3)
    if colouring == "novelty":
        share = np.clip(chart.distance / max(float(np.percentile(chart.distance, 98)), 1e-9), 0, 1)
        stops = np.array([rgb(colour) for colour in _NOVELTY])
        places = np.linspace(0, 1, len(stops))
        colours = np.stack([np.interp(share, places, stops[:, channel]) for channel in range(3)], axis=1)
    elif colouring == "outcome":
        colours = np.array([rgb(_OUTCOMES.get(str(one), INK)) for one in chart.outcome])
    else:
        hint = nearest_name(colouring, COLOURINGS)
        raise NotFoundError(f"no colouring `{colouring}`{hint}; there are {', '.join(COLOURINGS)}")
    for outcome, (colour, _) in UNUSABLE.items():
        colours[chart.outcome == outcome] = rgb(colour)
    return colours


def to_pb(x: float, y: float, resolution: int) -> tuple[float, float]:
    """Return the PB point under a pixel of the picture; cells are squares round the grid's points."""

    def one(pixel: float) -> float:
        value = -1 + 2 * (pixel * resolution / SIZE - 0.5) / (resolution - 1)
        return round(min(1.0, max(-1.0, value)), 3)

    return one(x), one(SIZE - y)


def to_pixel(pb: Sequence[float], resolution: int) -> tuple[float, float]:
    """Return the pixel of a PB point: the reverse of `to_pb`."""

    def one(value: float) -> float:
        return ((value + 1) / 2 * (resolution - 1) + 0.5) * SIZE / resolution

    return one(pb[0]), SIZE - one(pb[1])


def overlay(chart: PBMap, points: np.ndarray, marks: Sequence[Mark] = (), crowd: np.ndarray | None = None) -> str:
    """Return the marks as SVG: letters of the basic actions, others' points, and where we are.

    Args:
        chart: The map below.
        points: Where the movement shown comes from, shape (n, 2); more than one are a path.
        marks: More letters, for instance of favourites.
        crowd: Points of others, such as an agent's choices, shape (n, 2).
    """
    n = chart.resolution
    parts = []
    for pb in () if crowd is None else crowd:
        x, y = to_pixel(pb, n)
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="white" stroke="black" stroke-width="1.5"/>')
    letters = [Mark((float(p[0]), float(p[1])), action_letter(place)) for place, p in enumerate(chart.learned_pb)]
    for mark in (*letters, *marks):
        x, y = to_pixel(mark.pb, n)
        parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" dy="0.35em" text-anchor="middle" font-size="26" font-weight="bold" '
            f'fill="white" stroke="black" stroke-width="5" paint-order="stroke">{mark.letter}</text>'
        )
    places = [to_pixel(pb, n) for pb in points]
    if len(places) > 1:
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        for colour, width in (("white", 6), ("black", 2.5)):
            parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="{width}"/>')
    if places:
        x, y = places[-1]
        for colour, width in (("white", 6), ("black", 2.5)):
            parts.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="11" fill="none" stroke="{colour}" stroke-width="{width}"/>'
            )
    return "".join(parts)
