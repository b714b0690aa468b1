"""The PB map as a picture, in the manner of the paper's Fig. 4."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.maps.colours import (
    INK,
    NEAREST,
    PAPER_WHITE,
    UNUSABLE,
    action_colour,
    action_letter,
    colour_values,
    rgb,
)
from creative_nao.maps.figure_style import write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

    from creative_nao.maps.map import PBMap


HALF_DISTANCE = 10.0
"""DTW distance at which half of the similarity is left [rad]: the paper's threshold of the learned actions."""

MEASURE_COLOURS = "YlGn"
"""Scale of a measure, from pale to dark in grey too; its dark end is not taken for the purple of what fluctuates."""


def map_image(pb_map: PBMap) -> np.ndarray:
    """Return the colours of the map, shape (resolution, resolution, 3) in [0, 1], row 0 at PB 2 = -1.

    Colour is the nearest basic action, strength its similarity 2^(-distance / 10); what cannot be used has its own.
    """
    colours = np.array([rgb(action_colour(place)) for place in range(len(pb_map.names))])
    similarity = 2.0 ** (-pb_map.distance / HALF_DISTANCE)
    weight = (0.15 + 0.85 * similarity)[:, None]
    image = weight * colours[pb_map.nearest] + (1 - weight) * np.array(rgb(PAPER_WHITE))
    return _with_unusable(image, pb_map)


def measure_span(pb_map: PBMap, values: np.ndarray) -> tuple[float, float]:
    """Return the smallest and the largest value among the points that can be used; 0 and 1 if none can."""
    usable = values[pb_map.appropriate]
    return (float(usable.min()), float(usable.max())) if len(usable) else (0.0, 1.0)


def measure_image(
    pb_map: PBMap, values: np.ndarray, span: tuple[float, float] | None = None
) -> tuple[np.ndarray, ScalarMappable]:
    """Return the colours of a map that tell a number a point, in the manner of `map_image`, and their scale.

    The scale goes from `span[0]` to `span[1]`, by default over the points that can be used (`measure_span`); the others
    keep the colours of their outcomes.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    low, high = measure_span(pb_map, values) if span is None else span
    scale = ScalarMappable(Normalize(low, high), MEASURE_COLOURS)
    return _with_unusable(np.array(scale.to_rgba(values))[:, :3], pb_map), scale


def _with_unusable(image: np.ndarray, pb_map: PBMap) -> np.ndarray:
    for outcome, (colour, _) in UNUSABLE.items():
        image[pb_map.outcome == outcome] = rgb(colour)
    return image.reshape(pb_map.resolution, pb_map.resolution, 3)


def draw_on(axes: Axes, pb_map: PBMap, image: np.ndarray | None = None) -> None:
    """Draw the map with borders, hatching and the letters of the basic actions on matplotlib axes.

    The colours are those of `image`, by default of `map_image`.
    """
    from matplotlib import patheffects

    n = pb_map.resolution
    half_cell = 1.0 / (n - 1)
    axes.imshow(
        map_image(pb_map) if image is None else image, origin="lower", interpolation="nearest",
        extent=(-1 - half_cell, 1 + half_cell, -1 - half_cell, 1 + half_cell),
    )  # fmt: skip
    axis = np.linspace(-1, 1, n)
    for outcome, (_, hatch) in UNUSABLE.items():
        mask = (pb_map.outcome == outcome).reshape(n, n).astype(float)
        if mask.any():
            filled = axes.contourf(axis, axis, mask, levels=[0.5, 1.5], colors="none", hatches=[hatch])
            filled.set_edgecolor("#FFFFFF50")
            filled.set_linewidth(0.0)
    learned = pb_map.outcome == "learned"
    for place in range(len(pb_map.names)):
        mask = (learned & (pb_map.nearest == place)).reshape(n, n).astype(float)
        if mask.any():
            axes.contour(axis, axis, mask, levels=[0.5], colors=INK, linewidths=0.6)
    for place, (first, second) in enumerate(pb_map.learned_pb):
        axes.text(
            first, second, action_letter(place), color="white", ha="center", va="center", fontsize=13, weight="bold",
            path_effects=[patheffects.withStroke(linewidth=3, foreground="black")],
        )  # fmt: skip
    axes.set(xlim=(-1 - half_cell, 1 + half_cell), ylim=(-1 - half_cell, 1 + half_cell), aspect="equal")
    axes.set(xlabel="PB 1", ylabel="PB 2", xticks=[-1, -0.5, 0, 0.5, 1], yticks=[-1, -0.5, 0, 0.5, 1])


def legend_handles(pb_map: PBMap, coloured: bool = True) -> list[Any]:
    """Return legend entries: each basic action with the share of the map that it fills, and the unusable kinds.

    Where the colours tell something else than the basic action, `coloured` is False.
    """
    from matplotlib.patches import Patch

    shares = pb_map.learned_region_pct()
    handles = [
        Patch(
            facecolor=action_colour(place) if coloured else "none",
            edgecolor=INK if coloured else "none",
            label=f"{action_letter(place)}  {name.replace('_', ' ')}  ({shares[place]:.1f} % learned)",
        )
        for place, name in enumerate(pb_map.names)
    ]
    for outcome, (colour, hatch) in UNUSABLE.items():
        if outcome not in ("fluctuating", "non_moving") and not (pb_map.outcome == outcome).any():
            continue  # the two kinds of the paper are always told, those of the body where they happen
        hatch = hatch[:-1] if len(hatch) > 2 else hatch
        label = f"{outcome.replace('_', '-')}  ({pb_map.share_pct(outcome):.1f} %)"
        handles.append(Patch(facecolor=colour, edgecolor="white", hatch=hatch, label=label))
    return handles


def draw_map(
    pb_map: PBMap,
    path: str | os.PathLike[str] | None = None,
    *,
    title: str | None = None,
    points: np.ndarray | None = None,
    colour: str | ArrayLike = NEAREST,
    colour_label: str | None = None,
) -> Figure:
    """Draw one map with its legend.

    Args:
        pb_map: The map.
        path: PNG or SVG to write in one step, by its ending; None writes nothing.
        title: Title; default: the name of the memory.
        points: PB points to mark, for example an agent's choices, shape (n, 2).
        colour: What the colours tell: `nearest`, a measure of `colouring.COLOURINGS`, or a number of one's own for each
            point of the map, shape (n,).
        colour_label: Text beside the scale; default: the measure and its unit.

    Returns:
        The matplotlib figure.

    Raises:
        CreativeNaoError: If the map cannot be coloured so, as `colouring.colour_values` tells.
    """
    from matplotlib.figure import Figure

    by_action = isinstance(colour, str) and colour == NEAREST
    figure = Figure(figsize=(9.4 if by_action else 10.6, 6.2), layout="compressed" if by_action else "constrained")
    axes = figure.subplots()
    if by_action:
        draw_on(axes, pb_map)
        heading = "strong colour: like the basic action\nfaint colour: new"
    else:
        values, label = colour_values(pb_map, colour)
        image, scale = measure_image(pb_map, values)
        draw_on(axes, pb_map, image)
        figure.colorbar(scale, ax=axes, label=label if colour_label is None else colour_label, shrink=0.82, pad=0.02)
        heading = "letters: the basic actions\nlines: where they come back"
    if points is not None:
        axes.scatter(points[:, 0], points[:, 1], s=28, color="white", edgecolor="black", linewidth=1.2, zorder=3)
    name = pb_map.record.get("settings", {}).get("memory", "")
    appropriate = 100.0 * float(pb_map.appropriate.mean())
    axes.set_title(title if title is not None else f"Memory {name}: {appropriate:.1f} % of the map is appropriate")
    figure.legend(
        handles=legend_handles(pb_map, by_action), loc="outside right upper", frameon=False, fontsize=9,
        title=heading, alignment="left",
    )  # fmt: skip
    if path is not None:
        write_figure(figure, path)
    return figure
