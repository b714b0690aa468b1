"""Figures of numbers: learning curves (the paper's Fig. 2) and Table I as dots with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from creative_nao.evaluation.drawing import figure
from creative_nao.evaluation.paper.reference import (
    CONDITION_COLOURS,
    CONDITION_LINES,
    CONDITION_MARKERS,
    CONDITION_NAMES,
    CONDITION_TITLES,
    TABLE_I,
)
from creative_nao.evaluation.paper.summary import Figures, values_of
from creative_nao.model import Memory
from creative_nao.pb_space.palette import INK

N_POINTS = 400
"""Points of a drawn learning curve; each is the median over its stretch of epochs."""


def learning_curves(memories: Mapping[str, Sequence[Memory]]) -> Figure:
    """Draw loss against epochs: median and range over the networks of a condition, and one network of each.

    Args:
        memories: Networks of each condition, lowest seed first.
    """
    drawn, (many, one) = figure(9.4, 3.9, 1, 2, sharey=True, sharex=True)
    for condition in CONDITION_NAMES:
        mine = memories[condition]
        style: dict[str, Any] = {"color": CONDITION_COLOURS[condition], "linestyle": CONDITION_LINES[condition]}
        curves = [_thinned(memory) for memory in mine]
        epochs = curves[0][0]
        losses = np.array([loss for _, loss in curves])
        many.fill_between(epochs, losses.min(axis=0), losses.max(axis=0), color=style["color"], alpha=0.16, linewidth=0)
        many.plot(epochs, np.median(losses, axis=0), linewidth=1.8, label=CONDITION_TITLES[condition], **style)
        history = mine[0].loss_history
        one.plot(1 + mine[0].loss_every * np.arange(len(history)), history, color=style["color"], linewidth=0.8)
    n_networks = [len(memories[condition]) for condition in CONDITION_NAMES]
    told = str(n_networks[0]) if len(set(n_networks)) == 1 else " / ".join(map(str, n_networks))
    word = "network" if max(n_networks) == 1 else "networks"
    many.set(yscale="log", xlabel="epoch", ylabel="loss", title=f"Median and range, {told} {word} a condition")
    many.locator_params(axis="x", nbins=5)
    many.xaxis.set_major_formatter("{x:,.0f}")
    one.set(xlabel="epoch", title=f"One network each, seed {memories['half'][0].training.seed}")
    drawn.legend(*many.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return drawn


def table_dots(networks: Sequence[Figures], rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw Table I: every network a dot, the mean over seeds with its 95 % interval, the paper's network a cross."""
    drawn, axes = figure(10.4, 3.7, 1, len(TABLE_I))
    for ax, measure in zip(axes, TABLE_I, strict=True):
        values = values_of(networks, measure.field)
        for place, condition in enumerate(CONDITION_NAMES):
            row = next(one for one in rows if one["memory"] == condition)
            colour = CONDITION_COLOURS[condition]
            mine = values[condition]
            spread = np.linspace(-0.11, 0.11, len(mine)) if len(mine) > 1 else np.zeros(len(mine))
            ax.scatter(place - 0.17 + spread, mine, s=13, color=colour, alpha=0.5, linewidths=0)
            _mean(ax, place + 0.14, row[measure.field], condition)
            ax.plot(place + 0.34, measure.paper[condition], "x", color=INK, markersize=7, markeredgewidth=1.8)
        ax.set_xticks(range(len(CONDITION_NAMES)), CONDITION_NAMES)
        ax.set(title=f"{measure.title} [{measure.unit}]", xlim=(-0.55, len(CONDITION_NAMES) - 0.4))
        largest = max([*measure.paper.values(), *(value for mine in values.values() for value in mine)])
        ax.set_ylim(0.0, 103.0 if measure.field == "appropriateness_pct" else 1.08 * largest)
        ax.grid(axis="x", visible=False)
    drawn.supxlabel("training condition", fontsize=10)
    drawn.legend(handles=_legend(), loc="outside upper center", ncols=3, fontsize=9.5)
    return drawn


def _mean(ax: Axes, place: float, measured: Mapping[str, Any] | None, condition: str) -> None:
    if measured is None:
        return
    colour = CONDITION_COLOURS[condition]
    if measured["low"] is not None:
        ax.vlines(place, measured["low"], measured["high"], color=colour, linewidth=3.2, capstyle="round")
    marker = CONDITION_MARKERS[condition]
    ax.plot(place, measured["mean"], marker, color="white", markeredgecolor=colour, markeredgewidth=1.8, markersize=7)


def _legend() -> list[Any]:
    from matplotlib.lines import Line2D

    colour = CONDITION_COLOURS["open"]
    return [
        Line2D([], [], marker="o", linestyle="", color=colour, alpha=0.5, markersize=4, label="one network"),
        Line2D(
            [], [], marker="o", color=colour, linewidth=3.2, markerfacecolor="white", markeredgewidth=1.8,
            markersize=7, label="mean over seeds, 95 % interval",
        ),
        Line2D(
            [], [], marker="x", linestyle="", color=INK, markeredgewidth=1.8, markersize=7, label="the paper's network"
        ),
    ]  # fmt: skip


def _thinned(memory: Memory) -> tuple[np.ndarray, np.ndarray]:
    """Return epochs and loss of a memory's curve, the median over each stretch."""
    history = memory.loss_history.astype(np.float64)
    n = min(N_POINTS, len(history))
    parts = np.array_split(np.arange(len(history)), n)
    epochs = np.array([1 + memory.loss_every * float(part.mean()) for part in parts])
    return epochs, np.array([np.median(history[part]) for part in parts])
