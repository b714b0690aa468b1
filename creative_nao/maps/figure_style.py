"""The look of all figures: palette, style, figures without a display, and how they are written.

Colours are told apart with every kind of colour vision, smallest CAM02-UCS difference 17.6. Colour never stands alone:
regions have borders, basic actions letters, inappropriate outcomes hatching.
"""

from __future__ import annotations

import functools
import io
import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from creative_nao.schema import checked_path
from creative_nao.storage import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

P = ParamSpec("P")
T = TypeVar("T")

# matplotlib takes a fifth of a second to import, so only what draws does it.

BLUE, ORANGE, GREEN, BROWN, SKY, YELLOW = "#004FE5", "#E97E00", "#009E73", "#8B2F00", "#66D6FF", "#EDD912"
BASIC_ACTIONS = (BLUE, ORANGE, GREEN, BROWN, SKY, YELLOW)  # in their order; with more than six they begin again
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
PAPER_WHITE = "#F5F5F5"  # what a colour fades to as the similarity to the basic action falls
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


PLAIN: dict[Any, Any] = {"text.parse_math": False, "text.usetex": False}
"""Text is shown as it stands: names come out of files, and one such as ``$\\nosuch{$`` is no mathematics."""
STYLE: dict[Any, Any] = {
    **PLAIN,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib: the same picture everywhere
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E6E8EB",
    "grid.linewidth": 0.8,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.hashsalt": "creative_nao",  # the same figure, the same file
}
"""Of matplotlib's settings; `styled` makes them hold."""
DPI = 150
# Colours of a PNG, which is a quarter of the size of one with all. They are chosen by octree: cutting at medians saves
# less and merges a rare colour, such as that of non-moving points, with a frequent one.
N_COLOURS = 256


def styled() -> AbstractContextManager[None]:
    """Return a context in which figures are drawn in `STYLE`."""
    import matplotlib

    return matplotlib.rc_context(STYLE)


def plain_text(draw: Callable[P, T]) -> Callable[P, T]:
    """Have a function that draws show text as it stands, as `PLAIN` says."""

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> T:
        import matplotlib

        with matplotlib.rc_context(PLAIN):
            return draw(*args, **kwargs)

    return drawn


def figure(
    width: float, height: float, n_rows: int = 1, n_columns: int = 1, **kwargs: Any
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure of `width` x `height` inches, free of any display, and its axes row by row."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(width, height), layout="constrained")
    axes = drawn.subplots(n_rows, n_columns, squeeze=False, **kwargs)
    return drawn, list(axes.ravel())


def save(drawn: Figure, path: Path) -> Path:
    """Write a figure as `path`.png and `path`.svg, each in one step, and return the PNG's path."""
    png, svg = path.with_suffix(".png"), path.with_suffix(".svg")
    pixels = io.BytesIO()
    drawn.savefig(pixels, format="png", dpi=DPI)
    save_small(pixels, png)
    with replacing(svg) as temporary:
        drawn.savefig(temporary, format="svg", metadata={"Date": None})
    return png


def save_small(picture: Path | io.BytesIO, png: Path) -> None:
    """Write a picture in `N_COLOURS` as a PNG, in one step; it may be that very file."""
    from PIL import Image

    with Image.open(picture) as whole:
        few = whole.convert("RGB").quantize(N_COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    with replacing(png) as temporary:
        few.save(temporary, format="PNG", optimize=True)


def write_figure(drawn: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure in one step, as PNG, SVG or PDF by the ending of the path."""
    target = checked_path(path)
    with replacing(target) as temporary:
        drawn.savefig(temporary, dpi=DPI, format=target.suffix.lstrip(".") or "png")
