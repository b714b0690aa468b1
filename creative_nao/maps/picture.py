"""The picture of a map: in the manner of the paper's Fig. 4, or coloured by a measure."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import NotFoundError, SettingsError, ShapeError, nearest_name, printable
from creative_nao.maps.figure_style import (
    INK,
    PAPER_WHITE,
    UNUSABLE,
    action_colour,
    action_letter,
    plain_text,
    rgb,
    write_figure,
)
from creative_nao.maps.grid import GridMap, neighbour_pairs
from creative_nao.measures import dtw_pairs, excursions, largest_speeds, unexpectedness
from creative_nao.measures.dtw import as_numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

NEAREST = "nearest"  # the colouring of the paper's Fig. 4, no number: nearest basic action, strong where it is similar


class Colouring(NamedTuple):
    """A measure of every point of a map: its name with its unit, and the function that gives it, shape (n,).

    Some need the trajectories, which a map read from a file does not hold.
    """

    label: str
    needs_trajectories: bool
    values: Callable[[GridMap], np.ndarray]


def _neighbour_distances(pb_map: GridMap) -> np.ndarray:
    """Return the mean distance of each movement to its neighbours': four, at an edge three, in a corner two."""
    n_cells = pb_map.resolution**2
    first, second = neighbour_pairs(pb_map.resolution)
    distances = dtw_pairs(_trajectories(pb_map), first, second)
    total = np.bincount(first, distances, n_cells) + np.bincount(second, distances, n_cells)
    return total / (np.bincount(first, minlength=n_cells) + np.bincount(second, minlength=n_cells))


def _unexpectedness(pb_map: GridMap) -> np.ndarray:
    """Against the map's own usable points: what an even draw from them would be expected to find."""
    usable = pb_map.distance[pb_map.appropriate]
    return unexpectedness(pb_map.distance, usable if len(usable) else pb_map.distance)


def _speeds(pb_map: GridMap) -> np.ndarray:
    if pb_map.dt_s is None:
        raise SettingsError("a map coloured by speed needs its tick, `dt_s`, which this one does not hold.")
    return largest_speeds(_trajectories(pb_map), pb_map.dt_s).max(axis=1)


def _trajectories(pb_map: GridMap) -> np.ndarray:
    assert pb_map.trajectories is not None  # `colour_values` refuses a map without
    return pb_map.trajectories


COLOURINGS: dict[str, Colouring] = {
    "novelty": Colouring("novelty: DTW distance to the nearest basic action [rad]", False, lambda grid: grid.distance),
    "unexpectedness": Colouring("unexpectedness among the usable movements of the map [bit]", False, _unexpectedness),
    "speed": Colouring("largest speed of a joint [rad/s]", True, _speeds),
    "excursion": Colouring("way of the most moving joint [rad]", True, lambda grid: excursions(_trajectories(grid))),
    "ruggedness": Colouring("mean DTW distance to the neighbouring movements [rad]", True, _neighbour_distances),
}
"""Every colouring that is a number, by name."""


def check_colour(name: str) -> str:
    """Return the name of a colouring; one that does not exist is a NotFoundError with the nearest name."""
    known = (NEAREST, *COLOURINGS)
    if name not in known:
        raise NotFoundError(f"no colouring `{name}`{nearest_name(name, known)}; there are {', '.join(known)}.")
    return name


def colour_values(pb_map: GridMap, colour: str | ArrayLike) -> tuple[np.ndarray, str]:
    """Return the number that colours each point, shape (n,), and what it is.

    `colour` is a name of `COLOURINGS`, or numbers of one's own, shape (n,), in the order of the map's points.

    Raises:
        NotFoundError: If there is no colouring of this name.
        SettingsError: If it needs the movements and the map, read from a file, has none.
        ShapeError: If numbers of one's own do not fit the map or are not finite.
    """
    if isinstance(colour, str):
        if check_colour(colour) == NEAREST:
            raise SettingsError(f"`{NEAREST}` is no number; those that are: {', '.join(COLOURINGS)}.")
        colouring = COLOURINGS[colour]
        if colouring.needs_trajectories and pb_map.trajectories is None:
            raise SettingsError(
                f"colouring by {colour} needs the movements, which this map does not hold; "
                "make it again with `pb_map(memory)`."
            )
        return colouring.values(pb_map), colouring.label
    values = as_numbers(colour, "colour")
    if values.shape != (len(pb_map.pb),) or not np.isfinite(values).all():
        raise ShapeError(
            f"`colour` should be a name or {len(pb_map.pb)} finite numbers, one for each point of the map, but has "
            f"shape {values.shape}{'' if np.isfinite(values).all() else ' and values that are not finite'}."
        )
    return values, ""


HALF_DISTANCE = 10.0  # at which half of the similarity is left [rad]: the paper's threshold of the learned actions
MEASURE_COLOURS = "YlGn"  # from pale to dark in grey too; its dark end is not taken for the purple of what fluctuates


def map_image(pb_map: GridMap) -> np.ndarray:
    """Return the colours of the map, shape (resolution, resolution, 3) in [0, 1], row 0 at PB 2 = -1.

    Colour is the nearest basic action, strength its similarity 2^(-distance / 10); what cannot be used has its own.
    """
    colours = np.array([rgb(action_colour(place)) for place in range(len(pb_map.names))])
    similarity = 2.0 ** (-pb_map.distance / HALF_DISTANCE)
    weight = (0.15 + 0.85 * similarity)[:, None]
    image = weight * colours[pb_map.nearest] + (1 - weight) * np.array(rgb(PAPER_WHITE))
    return _with_unusable(image, pb_map)


def measure_span(pb_map: GridMap, values: np.ndarray) -> tuple[float, float]:
    """Return the smallest and the largest value among the points that can be used; 0 and 1 if none can."""
    usable = values[pb_map.appropriate]
    return (float(usable.min()), float(usable.max())) if len(usable) else (0.0, 1.0)


def measure_image(
    pb_map: GridMap, values: np.ndarray, span: tuple[float, float] | None = None
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


def _with_unusable(image: np.ndarray, pb_map: GridMap) -> np.ndarray:
    for outcome, (colour, _) in UNUSABLE.items():
        image[pb_map.outcome == outcome] = rgb(colour)
    return image.reshape(pb_map.resolution, pb_map.resolution, 3)


def draw_on(axes: Axes, pb_map: GridMap, image: np.ndarray | None = None) -> None:
    """Draw the map with borders, hatching and letters of the basic actions; its colours are `image` or `map_image`."""
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
    axes.grid(visible=False)


def legend_handles(pb_map: GridMap, coloured: bool = True, shares: bool = True) -> list[Any]:
    """Return legend entries: each basic action, `coloured` or not, and the unusable kinds, with `shares` of the map."""
    from matplotlib.patches import Patch

    learned_pct = pb_map.learned_region_pct()
    handles = [
        Patch(
            facecolor=action_colour(place) if coloured else "none",
            edgecolor=INK if coloured else "none",
            label=f"{action_letter(place)}  {name.replace('_', ' ')}"
            + (f"  ({learned_pct[place]:.1f} % learned)" if shares else ""),
        )
        for place, name in enumerate(pb_map.names)
    ]
    for outcome, (colour, hatch) in UNUSABLE.items():
        if outcome not in ("fluctuating", "non_moving") and not (pb_map.outcome == outcome).any():
            continue  # the two kinds of the paper are always told, those of the body where they happen
        hatch = hatch[:-1] if len(hatch) > 2 else hatch
        label = outcome.replace("_", "-") + (f"  ({pb_map.share_pct(outcome):.1f} %)" if shares else "")
        handles.append(Patch(facecolor=colour, edgecolor="white", hatch=hatch, label=label))
    return handles


@plain_text
def draw_map(
    pb_map: GridMap,
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
        title: Title; default: the memory and how much of the map is appropriate.
        points: PB points to mark, for example an agent's choices, shape (n, 2).
        colour: What the colours tell: `nearest`, a measure of `COLOURINGS`, or a number of one's own for each
            point of the map, shape (n,).
        colour_label: Text beside the scale; default: the measure and its unit.

    Raises:
        CreativeNaoError: If the map cannot be coloured so, as `colour_values` tells.
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
        marks = as_numbers(points, "points").reshape(-1, 2)
        axes.scatter(marks[:, 0], marks[:, 1], s=28, color="white", edgecolor="black", linewidth=1.2, zorder=3)
    appropriate = 100.0 * float(pb_map.appropriate.mean())
    default = f"Memory {printable(pb_map.memory_name)}: {appropriate:.1f} % of the map is appropriate"
    axes.set_title(default if title is None else title)
    figure.legend(
        handles=legend_handles(pb_map, by_action), loc="outside right upper", frameon=False, fontsize=9,
        title=heading, alignment="left",
    )  # fmt: skip
    if path is not None:
        write_figure(figure, path)
    return figure
