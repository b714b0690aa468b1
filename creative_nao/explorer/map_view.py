"""The map as a picture to touch: its pixels, and the marks upon it."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image

from creative_nao.explorer.colours import NEAREST, Chart, cell_colours
from creative_nao.explorer.hatching import PATTERNS, hatch
from creative_nao.explorer.view import View
from creative_nao.pb_space.palette import INK, action_letter, rgb


class Mark(NamedTuple):
    """A letter on the map: where in the PB space, and what it says."""

    pb: tuple[float, float]
    letter: str


def map_picture(
    chart: Chart,
    colour: str = NEAREST,
    view: View | None = None,
    values: np.ndarray | None = None,
    span: tuple[float, float] | None = None,
) -> Image.Image:
    """Draw what a view shows of a map, `SIZE` pixels along each side, PB 2 upwards.

    Regions of learned movements have dark borders and what cannot be used is hatched, so that nothing is told by
    colour alone.

    Args:
        chart: The map; cells beyond its edge repeat the last.
        colour: What its colours tell, a name of `colours.NAMES`.
        view: Which square of the PB space; default: all that the map covers.
        values: The number of each cell, where the colouring is one.
        span: Values at the ends of its scale.

    Raises:
        NotFoundError: If there is no such colouring.
    """
    n = chart.resolution
    rows, columns = (View.of(chart) if view is None else view).cells(chart)
    seen = np.ix_(rows, columns)
    pixels = cell_colours(chart, colour, values, span)[seen]
    outcome = chart.outcome.reshape(n, n)[seen]
    for name in PATTERNS:
        where = outcome == name
        if where.any():
            hatch(pixels, where, name)
    pixels[borders(chart, rows, columns)] = rgb(INK)
    return Image.fromarray(np.round(255 * pixels).astype(np.uint8))


def borders(chart: Chart, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Tell which pixels border a region of learned movements, by the rows and the columns of cells under them."""
    n = chart.resolution
    region = np.where(chart.outcome == "learned", chart.nearest, -1).reshape(n, n)[np.ix_(rows, columns)]
    found = np.zeros(region.shape, bool)
    found[1:] |= region[1:] != region[:-1]
    found[:, 1:] |= region[:, 1:] != region[:, :-1]
    return found


def map_address(
    chart: Chart,
    colour: str = NEAREST,
    view: View | None = None,
    values: np.ndarray | None = None,
    span: tuple[float, float] | None = None,
) -> str:
    """Return the picture of `map_picture` as a data address, so that showing it needs no room on a disk."""
    stream = io.BytesIO()
    map_picture(chart, colour, view, values, span).quantize(256).save(stream, format="PNG")
    return f"data:image/png;base64,{b64encode(stream.getvalue()).decode()}"


def overlay(
    view: View,
    learned_pb: np.ndarray,
    points: np.ndarray,
    marks: Sequence[Mark] = (),
    crowd: np.ndarray | None = None,
) -> str:
    """Return the marks as SVG: letters of the basic actions, others' points, and where we are.

    Args:
        view: What the map below shows; marks outside are left out.
        learned_pb: Where the basic actions lie, shape (n_actions, 2).
        points: Where the movement shown comes from, shape (n, 2); more than one are a path.
        marks: More letters, for instance of favourites.
        crowd: Points of others, such as an agent's choices, shape (n, 2).
    """
    parts = []
    for pb in () if crowd is None else crowd:
        if view.shows(pb):
            x, y = view.to_pixel(pb)
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="white" stroke="black" stroke-width="1.5"/>')
    letters = [Mark((float(p[0]), float(p[1])), action_letter(place)) for place, p in enumerate(learned_pb)]
    for mark in (*letters, *marks):
        if view.shows(mark.pb):
            x, y = view.to_pixel(mark.pb)
            parts.append(
                f'<text x="{x:.1f}" y="{y:.1f}" dy="0.35em" text-anchor="middle" font-size="26" font-weight="bold" '
                f'fill="white" stroke="black" stroke-width="5" paint-order="stroke">{mark.letter}</text>'
            )
    places = [view.to_pixel(pb) for pb in points]
    if len(places) > 1:
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        for colour, width in (("white", 6), ("black", 2.5)):
            parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="{width}"/>')
    if len(points) and view.shows(points[-1]):
        x, y = places[-1]
        for colour, width in (("white", 6), ("black", 2.5)):
            parts.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="11" fill="none" stroke="{colour}" stroke-width="{width}"/>'
            )
    return "".join(parts)
