"""Figures of maps: the three conditions side by side (Fig. 4), every network's map, and a walk through one (Fig. 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from creative_nao.evaluation.drawing import figure
from creative_nao.evaluation.paper.movements import draw_movement, joint_legend
from creative_nao.evaluation.paper.reference import CONDITION_NAMES, CONDITION_TITLES
from creative_nao.measures import score
from creative_nao.model import Memory
from creative_nao.pb_space import PBMap
from creative_nao.pb_space.palette import INK, action_letter
from creative_nao.pb_space.picture import draw_on, legend_handles, map_image

WALK = ("right_straight", "left_jab")
"""The walk goes along the straight line between the learned PB values of these two, the pair of the paper's Fig. 5."""

N_STOPS = 6
"""Evenly spaced points of the walk, both ends among them."""

MAPS_PER_ROW = 8


def three_maps(charts: Mapping[str, PBMap]) -> Figure:
    """Draw one map of each condition side by side."""
    drawn, axes = figure(11.0, 4.5, 1, len(CONDITION_NAMES))
    for ax, condition in zip(axes, CONDITION_NAMES, strict=True):
        charted = charts[condition]
        draw_on(ax, charted)
        ax.grid(visible=False)
        learned, usable = charted.share_pct("learned"), 100.0 * float(charted.appropriate.mean())
        ax.set_title(f"{CONDITION_TITLES[condition]}\n{usable:.0f} % usable, {learned:.0f} % learned", fontsize=10)
        ax.set(xticks=[-1, 0, 1], yticks=[-1, 0, 1])
    drawn.legend(handles=_plain_legend(charts["half"]), loc="outside lower center", ncols=4, fontsize=9)
    return drawn


def all_maps(charts: Mapping[str, Sequence[tuple[int, PBMap]]]) -> Figure:
    """Draw every network's map, small: condition by condition, seed by seed."""
    rows = [
        (condition, charts[condition][start : start + MAPS_PER_ROW])
        for condition in CONDITION_NAMES
        for start in range(0, len(charts[condition]), MAPS_PER_ROW)
    ]
    n_columns = max(3, max(len(row) for _, row in rows))
    drawn, axes = figure(10.8, 10.2 / n_columns * len(rows) * 1.12 + 0.6, len(rows), n_columns)
    for place, ax in enumerate(axes):
        condition, row = rows[place // n_columns]
        column = place % n_columns
        ax.axis("off")
        if column < len(row):
            seed, charted = row[column]
            ax.imshow(map_image(charted), origin="lower", interpolation="nearest", extent=(-1, 1, -1, 1))
            ax.plot(*charted.learned_pb.T, "o", color="white", markeredgecolor=INK, markersize=2.6, markeredgewidth=0.7)
            ax.set_title(f"{condition} {seed}", fontsize=8, loc="center")
            ax.grid(visible=False)
    drawn.legend(handles=_plain_legend(charts["half"][0][1]), loc="outside lower center", ncols=4, fontsize=9)
    return drawn


def walk_points(memory: Memory) -> tuple[np.ndarray, tuple[str, str]]:
    """Return the PB values of the walk, shape (6, 2), and the two basic actions between which it goes."""
    names = memory.demonstrations.names
    first, last = WALK if set(WALK) <= set(names) else (names[0], names[-1])
    begin, end = (memory.pb[names.index(name)] for name in (first, last))
    share = np.linspace(0.0, 1.0, N_STOPS)[:, None]
    return (1.0 - share) * begin + share * end, (first, last)


def walk(memory: Memory, charted: PBMap) -> Figure:
    """Draw a map with six points on a straight line and the movements that they generate."""
    points, _ = walk_points(memory)
    generated = memory.generate(points)
    scores = score(generated, memory.demonstrations)
    drawn = Figure(figsize=(10.8, 6.6), layout="constrained")
    left, right = np.asarray(drawn.subfigures(1, 2, width_ratios=(1.0, 1.25))).ravel()
    ax = left.subplots()
    draw_on(ax, charted)
    ax.grid(visible=False)
    ax.plot(*points.T, "-", color="white", linewidth=2.6)
    ax.plot(*points.T, "-", color=INK, linewidth=1.2)
    for place, point in enumerate(points):
        ax.plot(*point, "o", color="white", markeredgecolor=INK, markersize=13, markeredgewidth=1.3, zorder=3)
        ax.annotate(
            str(place + 1), point, ha="center", va="center", fontsize=8.5, weight="bold", zorder=4, color=INK
        )  # fmt: skip
    ax.set_title(f"Memory {memory.name}", fontsize=10)
    panels = right.subplots(3, 2, sharex=True, sharey=True)
    for place, panel in enumerate(panels.ravel()):
        nearest = memory.demonstrations.names[scores.nearest[place]]
        letter = action_letter(int(scores.nearest[place]))
        told = f"{scores.outcome[place].replace('_', '-')}, nearest {letter} {nearest.replace('_', ' ')}"
        draw_movement(panel, generated[place], memory.demonstrations)
        panel.set_title(f"{place + 1}: {told}\nPB ({points[place, 0]:+.2f}, {points[place, 1]:+.2f}), "
                        f"DTW {scores.novelty[place]:.1f}", fontsize=8.5)  # fmt: skip
    for panel in panels[-1]:
        panel.set_xlabel("time [s]")
    right.supylabel("joint angle [rad]", fontsize=10)
    left.legend(handles=_plain_legend(charted), loc="outside lower center", ncols=2, fontsize=8.5)
    right.legend(handles=joint_legend(memory.demonstrations), loc="outside lower center", ncols=3, fontsize=8.5)
    return drawn


def _plain_legend(charted: PBMap) -> list:
    """Return the legend of a map without the shares, which belong to one map alone."""
    handles = legend_handles(charted)
    for handle in handles:
        handle.set_label(handle.get_label().split("  (")[0])
    return handles
