"""The memory's map with the points that each agent chose on it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from creative_nao.evaluation.drawing import figure
from creative_nao.evaluation.palette import INK, agent_label
from creative_nao.evaluation.results import Measured
from creative_nao.evaluation.suites import Suite
from creative_nao.pb_space import PBMap
from creative_nao.pb_space.picture import draw_on, legend_handles

FEW = 3
"""Most agents that are drawn on large maps, two in a row; more stand three in a row."""


def choices(suite: Suite, measured: Measured, charted: PBMap, memory: str, env: str) -> Figure:
    """Draw the map once per agent with the PB vectors it chose: the first seed's large, the other seeds' small."""
    n_columns = 2 if len(suite.agents) <= FEW else 3
    n_rows = -(-(len(suite.agents) + 1) // n_columns)
    drawn, axes = figure(8.6, 8.3 / n_columns * n_rows + 0.8, n_rows, n_columns)
    for ax in axes[len(suite.agents) + 1 :]:
        ax.remove()
    for ax, agent in zip(axes, suite.agents, strict=False):
        _ground(ax, charted, agent_label(agent))
        first, *others = [e for e in measured.episodes if (e.memory, e.env, e.agent) == (memory, env, agent)]
        for episode in others:
            points = np.array([[a.pb_1, a.pb_2] for a in episode.actions])
            ax.plot(*points.T, "o", color=INK, markersize=3.2, markeredgecolor="white", markeredgewidth=0.5)
        for usable, marker, size in ((True, "o", 44), (False, "X", 40)):
            points = np.array([[a.pb_1, a.pb_2] for a in first.actions if a.appropriate == usable]).reshape(-1, 2)
            _large(ax, points, marker, size)
    ax = axes[len(suite.agents)]
    _ground(ax, charted, "oracle (knows the map)")
    _large(ax, np.array(measured.oracles[memory].pb).reshape(-1, 2), "o", 44)
    drawn.legend(handles=legend_handles(charted), loc="outside lower center", ncols=3, fontsize=9)
    return drawn


def _ground(ax: Axes, charted: PBMap, title: str) -> None:
    draw_on(ax, charted)
    ax.grid(visible=False)
    ax.set(title=title, xticks=[-1, 0, 1], yticks=[-1, 0, 1])


def _large(ax: Axes, points: np.ndarray, marker: str, size: float) -> None:
    style = {"facecolor": "white", "edgecolor": "black", "linewidth": 1.4, "zorder": 3, "clip_on": False}
    ax.scatter(*points.T, s=size, marker=marker, **style)
