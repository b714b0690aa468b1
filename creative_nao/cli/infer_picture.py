"""The picture of `creative-nao infer`: each joint's recorded and regenerated curve, and where the answer lies."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from creative_nao.pb_space.palette import INK, action_colour, action_letter
from creative_nao.pb_space.picture import write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from creative_nao.model import Memory, Recognition

RECORDED, REGENERATED = action_colour(1), action_colour(0)
GRID = "#E6E8EB"


def draw_recognition(
    memory: Memory, recorded: np.ndarray, found: Recognition, path: Path | None = None, title: str = ""
) -> Figure:
    """Draw recorded and regenerated curves of every joint beside the PB space with the answer in it.

    Args:
        memory: Which recognised.
        recorded: Joint angles [rad], shape (n_steps, n_joints).
        found: What it recognised.
        path: Picture to write in one step, its kind by its ending; None writes nothing.
        title: Above everything.

    Returns:
        The matplotlib figure.
    """
    from matplotlib.figure import Figure

    n_joints = len(memory.joints)
    n_columns = min(4, n_joints)
    n_rows = -(-n_joints // n_columns)
    figure = Figure(figsize=(3.0 * n_columns + 3.4, max(3.4, 2.3 * n_rows) + 0.7), layout="constrained")
    halves = figure.add_gridspec(1, 2, width_ratios=(3.0 * n_columns, 3.4))
    curves, place = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
    panels = curves.subplots(n_rows, n_columns, sharex=True, squeeze=False).ravel()
    time_s = np.arange(len(recorded)) * memory.dt_s
    low = min(recorded.min(), found.trajectory.min())
    high = max(recorded.max(), found.trajectory.max())
    for joint, axes in enumerate(panels):
        if joint >= n_joints:
            axes.set_axis_off()
            continue
        axes.plot(time_s, recorded[:, joint], color=RECORDED, linewidth=3.2, alpha=0.8, label="recorded")
        axes.plot(time_s, found.trajectory[:, joint], color=REGENERATED, linewidth=1.4, label="regenerated")
        axes.set_title(memory.joints[joint], fontsize=10, loc="left", color=INK)
        axes.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
        _plain(axes)
    for axes in panels[-n_columns:]:
        axes.set_xlabel("time [s]")
    for axes in panels[::n_columns]:
        axes.set_ylabel("angle [rad]")
    _draw_place(place.subplots(), memory, found)
    handles, labels = panels[0].get_legend_handles_labels()
    curves.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    figure.suptitle(title, fontsize=11, color=INK)
    if path is not None:
        write_figure(figure, path)
    return figure


def _draw_place(axes: Axes, memory: Memory, found: Recognition) -> None:
    """Draw the first two PB units: the basic actions' letters, where else the search ended, and the answer."""
    from matplotlib import patheffects

    two = memory.network.n_pb > 1
    vertical = 1 if two else 0
    halo = [patheffects.withStroke(linewidth=3, foreground="white")]
    near = found.restarts.error <= 1.5 * found.error + 1.0
    axes.scatter(
        found.restarts.pb[near, 0], found.restarts.pb[near, vertical], s=14, color=INK, alpha=0.35, linewidth=0,
        label="other ends, little worse",
    )  # fmt: skip
    for action, pb in enumerate(memory.pb):
        axes.text(
            pb[0], pb[vertical], action_letter(action), color=INK, ha="center", va="center", fontsize=12,
            weight="bold", path_effects=halo, zorder=2,
        )  # fmt: skip
    axes.scatter(
        found.pb[0], found.pb[vertical], marker="*", s=230, color=REGENERATED, edgecolor="white", linewidth=1.2,
        zorder=3, label="answer",
    )  # fmt: skip
    names = "\n".join(f"{action_letter(k)}  {n.replace('_', ' ')}" for k, n in enumerate(memory.demonstrations.names))
    axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal", xlabel="PB 1", ylabel="PB 2" if two else "PB 1")
    axes.set_title("PB space", fontsize=10, loc="left", color=INK)
    axes.legend(
        loc="upper left", bbox_to_anchor=(0.0, -0.22), frameon=False, fontsize=9, title=names, title_fontsize=9,
        alignment="left",
    )  # fmt: skip
    _plain(axes)


def _plain(axes: Axes) -> None:
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
