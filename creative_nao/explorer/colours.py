"""What the colours of a map tell, their legend and patterns, and finer maps of a window computed on demand."""

from __future__ import annotations

import dataclasses
import html
import io
import threading
from base64 import b64encode
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from PIL import Image

from creative_nao.envs.physical_map import FIGURES, PhysicalMap
from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.explorer.memory_service import BODY_WORDS, OUTCOME_WORDS, spoken
from creative_nao.explorer.view import View
from creative_nao.maps import COLOURINGS, PBMap, colour_values
from creative_nao.maps.figure_style import INK, PAPER_WHITE, UNUSABLE, action_colour, action_letter, rgb
from creative_nao.maps.picture import MEASURE_COLOURS, map_image, measure_image, measure_span
from creative_nao.measures import OUTCOMES, score, unexpectedness
from creative_nao.model import Memory


class Computation:
    """One computation in a thread, watched from the page.

    Attributes:
        share: How much of it is done, 0 to 1.
    """

    def __init__(self) -> None:
        self.share = 0.0
        self.cancelled = False

    def cancel(self) -> None:
        """Let it end at its next step; what it then returns is None."""
        self.cancelled = True

    def rows(self, n: int, block: int, begin: float = 0.0, end: float = 1.0) -> Iterator[slice]:
        """Give the rows of n things block by block, until they are done or the work is called off.

        Args:
            n: How many there are.
            block: How many at a time.
            begin: The share of the work done before the first of them.
            end: The share done after the last.
        """
        for start in range(0, n, block):
            if self.cancelled:
                return
            yield slice(start, min(start + block, n))
            self.share = begin + (end - begin) * min(start + block, n) / n


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


PERIOD_PX = 8
STRENGTH = 0.35
"""How far the lines of a pattern are drawn towards white."""
_MIDDLE = PERIOD_PX // 2


def _dots(up: np.ndarray, across: np.ndarray, radius_squared: float) -> np.ndarray:
    return (up % PERIOD_PX - _MIDDLE) ** 2 + (across % PERIOD_PX - _MIDDLE) ** 2 <= radius_squared


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
    rows, columns = np.mgrid[: pixels.shape[0], : pixels.shape[1]]
    lines = where & PATTERNS[outcome](rows, columns)
    pixels[lines] = (1 - STRENGTH) * pixels[lines] + STRENGTH


def sample(outcome: str, width: int, height: int) -> np.ndarray:
    """Return a small picture of an outcome's colour and pattern, (height, width, 3) in [0, 1]."""
    pixels = np.tile(np.array(rgb(UNUSABLE[outcome][0])), (height, width, 1))
    hatch(pixels, np.ones((height, width), bool), outcome)
    return pixels


SWATCH_W, SWATCH_H = 22, 14
_STOPS = 9


def legend_html(chart: Chart, colour: str, scale: Scale | None = None) -> str:
    """Return the legend of a colouring; names that come from a memory's file are escaped.

    Args:
        chart: The map of the whole PB space, mental or physical.
        colour: A name of `colours.NAMES`.
        scale: The scale of a colouring that is a number.
    """
    letters = [f"{action_letter(place)} {spoken(name)}" for place, name in enumerate(chart.names)]
    parts = []
    if is_number(colour) and scale is not None:
        parts.append(
            f'<div class="cn-scale"><span>{scale.low:.3g}</span>'
            f'<span class="cn-ramp" style="background:linear-gradient(to right, {", ".join(_ramp())})"></span>'
            f"<span>{scale.high:.3g}</span><span>{html.escape(scale.label)}</span></div>"
        )
    faded = colour == NEAREST
    parts += [_entry(one, faded) for one in swatches(chart, colour, letters, {**OUTCOME_WORDS, **BODY_WORDS})]
    told = "strong: like the basic action, faint: new" if faded else ", ".join(letters)
    parts.append(f"<span>{html.escape(told)}</span><span>lines: where a basic action comes back</span>")
    return f'<div class="cn-swatches">{"".join(parts)}</div>'


def _entry(swatch: Swatch, faded: bool) -> str:
    look = swatch.colour or f"url({_sample_address(swatch.outcome)})"
    if faded and swatch.colour:
        look = f"linear-gradient(to right, {look}, {PAPER_WHITE})"
    return f'<span><i style="background:{look}"></i>{html.escape(swatch.text)}</span>'


@cache
def _sample_address(outcome: str) -> str:
    stream = io.BytesIO()
    pixels = np.round(255 * sample(outcome, SWATCH_W, SWATCH_H)).astype(np.uint8)
    Image.fromarray(pixels).save(stream, format="PNG")
    return f"data:image/png;base64,{b64encode(stream.getvalue()).decode()}"


@cache
def _ramp() -> tuple[str, ...]:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return tuple(to_hex(one) for one in colormaps[MEASURE_COLOURS](np.linspace(0, 1, _STOPS)))


BLOCK = 512
"""Movements made at a time: few enough that a click in between is answered at once."""
MAKING = 0.5
"""Share of the work after which all movements are made; what is left is comparing them."""


def measured(memory: Memory, chart: PBMap, colour: str, whole: PBMap, work: Computation) -> np.ndarray | None:
    """Return the number of each cell, shape (n,), as `pb_space.colour_values` defines it; None if called off.

    Args:
        memory: Makes the movements again where the map does not hold them.
        chart: The cells.
        colour: A name of `pb_space.COLOURINGS`.
        whole: The map of the whole PB space: what an unexpected movement is compared with.
        work: The work, to be watched and called off.
    """
    if colour == "unexpectedness":
        usable = whole.distance[whole.appropriate]
        return unexpectedness(chart.distance, usable if len(usable) else whole.distance)
    if needs_movements(colour) and chart.trajectories is None:
        made = np.empty((len(chart.pb), memory.n_steps, len(memory.joints)))
        for rows in work.rows(len(made), BLOCK, end=MAKING):
            made[rows] = memory.generate(chart.pb[rows])
        chart = dataclasses.replace(chart, trajectories=made, dt_s=memory.dt_s)
    if work.cancelled:
        return None
    values = colour_values(chart, colour)[0]
    work.share = 1.0
    return values


class Measurements:
    """The numbers of the whole map that were asked for so far, worked out once for all tabs.

    Args:
        memory: The memory of the map.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._known: dict[tuple[str, int], np.ndarray] = {}
        self._lock = threading.Lock()

    def known(self, chart: PBMap, colour: str) -> np.ndarray | None:
        """Return the numbers if they were worked out before."""
        return self._known.get((colour, chart.resolution))

    def values(self, chart: PBMap, colour: str, work: Computation) -> np.ndarray | None:
        """Return the numbers of the whole map, shape (n,); None if called off."""
        with self._lock:
            found = self.known(chart, colour)
            if found is None and not work.cancelled:
                found = measured(self._memory, chart, colour, chart, work)
                if found is not None:
                    self._known[colour, chart.resolution] = found
            return found


LEVELS = (50, 200)
"""Cells along each side of the window, one after the other: the first is there at once, the last as fine as the map."""


@dataclass(frozen=True, eq=False)
class FinerMap:
    """The cells of a window.

    Attributes:
        view: What they cover.
        chart: They, scored, without their movements.
        values: The number of each cell by the colouring that it belongs to.
    """

    view: View
    chart: PBMap
    values: dict[str, np.ndarray]


def finer_map(memory: Memory, whole: PBMap, view: View, n: int, colour: str, work: Computation) -> FinerMap | None:
    """Generate and score `n` x `n` cells of a window; None if called off.

    Args:
        memory: The memory.
        whole: Its map of the whole PB space.
        view: The window, within [-1, 1].
        n: Cells along each side.
        colour: What the colours tell: its number is worked out from the same movements.
        work: The work, to be watched and called off.
    """
    pb = view.grid(n)
    kept = np.empty((n * n, memory.n_steps, len(memory.joints))) if needs_movements(colour) else None
    outcome = np.empty(n * n, dtype=f"<U{max(map(len, OUTCOMES))}")
    nearest, distance = np.empty(n * n, dtype=np.int64), np.empty(n * n)
    for rows in work.rows(n * n, BLOCK, end=0.8):
        made = memory.generate(pb[rows])
        scores = score(made, memory.demonstrations)
        outcome[rows], nearest[rows], distance[rows] = scores.outcome, scores.nearest, scores.novelty
        if kept is not None:
            kept[rows] = made
    if work.cancelled:
        return None
    settings = {"memory": memory.name, "resolution": n, "view": [view.left, view.bottom, view.width]}

    def chart(trajectories: np.ndarray | None) -> PBMap:
        return PBMap(
            n, pb, outcome, nearest, distance, whole.learned_pb, whole.names, {"settings": settings},
            trajectories, memory.dt_s,
        )  # fmt: skip

    values = {}
    if is_number(colour) and not is_of_body(colour):
        number = measured(memory, chart(kept), colour, whole, work)
        if number is None:
            return None
        values[colour] = number
    work.share = 1.0
    return FinerMap(view, chart(None), values)
