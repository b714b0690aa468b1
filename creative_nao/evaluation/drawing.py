"""What all figures share: the look, and writing them as PNG and SVG without a display."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from creative_nao import atomic
from creative_nao.evaluation.palette import FAINT, INK

STYLE: dict[Any, Any] = {
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
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.8,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.hashsalt": "creative_nao",  # the same figure, the same file
}
DPI = 150
N_COLOURS = 256
"""Colours of a PNG, which is a quarter of the size of one with all. They are chosen by octree: cutting at medians saves
less and merges a rare colour, such as that of non-moving points, with a frequent one."""


def figure(
    width: float, height: float, n_rows: int = 1, n_columns: int = 1, **kwargs: object
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure of `width` x `height` inches, free of any display, and its axes row by row."""
    drawn = Figure(figsize=(width, height), layout="constrained")
    axes = drawn.subplots(n_rows, n_columns, squeeze=False, **kwargs)  # pyright: ignore[reportCallIssue, reportArgumentType]
    return drawn, list(axes.ravel())


def save(drawn: Figure, path: Path) -> Path:
    """Write a figure as `path`.png and `path`.svg, each in one step, and return the PNG's path."""
    png, svg = path.with_suffix(".png"), path.with_suffix(".svg")
    pixels = io.BytesIO()
    drawn.savefig(pixels, format="png", dpi=DPI)
    save_small(pixels, png)
    with atomic.replacing(svg) as temporary:
        drawn.savefig(temporary, format="svg", metadata={"Date": None})
    return png


def save_small(picture: Path | io.BytesIO, png: Path) -> None:
    """Write a picture in `N_COLOURS` as a PNG, in one step; it may be that very file."""
    from PIL import Image

    with Image.open(picture) as whole:
        few = whole.convert("RGB").quantize(N_COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    with atomic.replacing(png) as temporary:
        few.save(temporary, format="PNG", optimize=True)
