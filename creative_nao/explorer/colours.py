"""What the colours of the map may tell: nearest action, outcome, every measure, and what the body makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.envs.physical_chart import FIGURES, PhysicalMap
from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.pb_space import COLOURINGS, PBMap
from creative_nao.pb_space.palette import INK, UNUSABLE, action_colour, rgb
from creative_nao.pb_space.picture import map_image, measure_image, measure_span

Chart = PBMap | PhysicalMap

NEAREST = "nearest"
OUTCOME = "outcome"
PHYSICAL = "physical"
_OF_BODY = {f"{PHYSICAL}_{name}": name for name in FIGURES if name != "fell"}
NAMES: dict[str, str] = {
    NEAREST: "nearest action",
    OUTCOME: "outcome",
    **{name: name for name in COLOURINGS},
    PHYSICAL: "physical outcome",
    **{key: f"physical: {name.replace('_', ' ')}" for key, name in _OF_BODY.items()},
}
"""Every colouring as the page calls it. Those of the body need a physical map of the memory."""
USABLE = {"learned": "#009E73", "unlearned": "#E97E00"}
"""Colours of the two outcomes that a robot can use."""


@dataclass(frozen=True)
class Swatch:
    """An entry of a legend: a colour, or the colour and pattern of an outcome, and what it means."""

    text: str
    colour: str = ""
    outcome: str = ""


@dataclass(frozen=True)
class Scale:
    """The scale of a measure: what it is, with its unit, and the values at its ends."""

    label: str
    low: float
    high: float


def check(name: str) -> str:
    """Return the name of a colouring.

    Raises:
        NotFoundError: If there is none of this name; the message has the nearest one.
    """
    if name not in NAMES:
        raise NotFoundError(f"no colouring `{name}`{nearest_name(name, NAMES)}; there are {', '.join(NAMES)}")
    return name


def is_of_body(colour: str) -> bool:
    """Tell whether a colouring needs a physical map."""
    return colour == PHYSICAL or colour in _OF_BODY


def is_number(colour: str) -> bool:
    """Tell whether a colouring is a number with a scale."""
    return colour in COLOURINGS or colour in _OF_BODY


def needs_movements(colour: str) -> bool:
    """Tell whether a colouring is worked out from the movements themselves."""
    return colour in COLOURINGS and COLOURINGS[colour].needs_trajectories


def scale_label(colour: str) -> str:
    """Return what a number is, with its unit."""
    return COLOURINGS[colour].label if colour in COLOURINGS else FIGURES[_OF_BODY[colour]]


def figure_of_body(chart: PhysicalMap, colour: str) -> np.ndarray:
    """Return what a colouring of the body tells of every point, shape (n,)."""
    return chart.figures[_OF_BODY[colour]].astype(np.float64)


def spans(charts: list[Chart], values: list[np.ndarray]) -> tuple[float, float]:
    """Return the ends of a scale that serves several maps: over the points of all that can be used."""
    ends = [measure_span(chart, one) for chart, one in zip(charts, values, strict=True)]  # type: ignore[arg-type]
    return min(low for low, _ in ends), max(high for _, high in ends)


def cell_colours(
    chart: Chart, colour: str = NEAREST, values: np.ndarray | None = None, span: tuple[float, float] | None = None
) -> np.ndarray:
    """Return the colour of every cell, shape (resolution, resolution, 3) in [0, 1], row 0 at the lowest PB 2.

    Args:
        chart: A mental map or, for a colouring of the body, a physical one.
        colour: A name of `NAMES`.
        values: The number of each cell where the colouring is one, shape (n,).
        span: Values at the ends of their scale; default: those of the cells that can be used.

    Raises:
        NotFoundError: If there is no such colouring.
    """
    drawable: PBMap = chart  # type: ignore[assignment] - a physical map has everything that is drawn of a mental one
    if is_number(check(colour)):
        assert values is not None
        return measure_image(drawable, values, span)[0]
    if colour == NEAREST:
        return map_image(drawable)
    named = {**{outcome: one for outcome, (one, _) in UNUSABLE.items()}, **USABLE}
    colours = np.array([rgb(named.get(str(outcome), INK)) for outcome in chart.outcome])
    return colours.reshape(chart.resolution, chart.resolution, 3)


def swatches(chart: Chart, colour: str, letters: list[str], words: dict[str, str]) -> list[Swatch]:
    """Return the legend of a colouring: basic actions or outcomes, with their shares of the map.

    Args:
        chart: The map of the whole PB space.
        colour: A name of `NAMES`.
        letters: What to call each basic action.
        words: What to call each outcome.
    """
    found = []
    if colour == NEAREST:
        found += [Swatch(text, action_colour(place)) for place, text in enumerate(letters)]
    elif not is_number(colour):
        found += [Swatch(f"{words[name]} {chart.share_pct(name):.1f} %", one) for name, one in USABLE.items()]
    for name in UNUSABLE:
        share = chart.share_pct(name)
        if share > 0:
            found.append(Swatch(f"{words[name]} {share:.1f} %", outcome=name))
    return found
