"""Figures of movements as joint curves (the paper's Fig. 3): the basic actions and examples of generated ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from creative_nao.demonstrations import Demonstrations
from creative_nao.evaluation.drawing import figure
from creative_nao.measures import farthest_points
from creative_nao.model import Memory
from creative_nao.pb_space import PBMap
from creative_nao.pb_space.palette import BASIC_ACTIONS, INK

RIGHT: Any = "-"
LEFT: Any = (0, (3, 1.5))


@dataclass(frozen=True, eq=False)
class Example:
    """A movement worth showing.

    Attributes:
        title: What it is.
        trajectory: Joint angles [rad], shape (n_steps, n_joints).
    """

    title: str
    trajectory: np.ndarray


def basic_actions(demos: Demonstrations) -> Figure:
    """Draw every basic action."""
    taught = zip(demos.names, demos.trajectories, strict=True)
    return _panels(demos, [Example(name.replace("_", " "), trajectory) for name, trajectory in taught], 3)


def examples(
    memories: Sequence[Memory],
    charts: Sequence[PBMap],
    combinations: Sequence[dict | None],
    rng: np.random.Generator,
) -> tuple[Figure, str]:
    """Draw movements that cannot be used and movements that are new.

    The rule: a fluctuating one and a non-moving one, each drawn at random from the first map that has any; the two
    most novel ones of the first map, by greedy search over the whole of it; the clearest combination of the first
    memory that has one.

    Args:
        memories: The memories, the one to be shown first.
        charts: Their maps.
        combinations: Entry `clearest_combination` of each memory's figures.
        rng: Draws the first two.

    Returns:
        The figure, and what is missing from it, in words.
    """
    memory, demos = memories[0], memories[0].demonstrations
    shown, missing = [], []
    for outcome in ("fluctuating", "non_moving"):
        word = outcome.replace("_", "-")
        for owner, charted in zip(memories, charts, strict=True):
            points = np.flatnonzero(charted.outcome == outcome)
            if len(points):
                pb = charted.pb[rng.choice(points)]
                shown.append(Example(f"{word}: {owner.name} at {_place(pb)}", owner.generate(pb[None])[0]))
                break
        else:
            missing.append(f"no map has a {word} movement")
    generated = memory.generate(charts[0].pb)
    best = farthest_points(generated, demos, 2, charts[0].appropriate)
    for place, index in enumerate(best.indices):
        rank = ("most novel", "then most novel")[place]
        shown.append(Example(f"{rank}: {memory.name} at {_place(charts[0].pb[index])}", generated[index]))
    for owner, combination in zip(memories, combinations, strict=True):
        if combination is None:
            continue
        first, second = (combination[key].replace("_", " ") for key in ("first", "second"))
        joined = f"{first}, then {second}" if combination["kind"] == "in time" else f"right arm {first}, left {second}"
        trajectory = owner.generate(np.array([combination["pb"]]))[0]
        shown.append(Example(f"{owner.name}: {joined}", trajectory))
        break
    else:
        missing.append("no map has a combination of two basic actions among the points that were looked at")
    return _panels(demos, shown, 2), "; ".join(missing)


def draw_movement(ax: Axes, trajectory: np.ndarray, demos: Demonstrations, title: str = "") -> None:
    """Draw one movement: right arm solid, left arm dashed, a colour for each pair of joints."""
    seconds = demos.dt_s * np.arange(len(trajectory))
    pairs = list(dict.fromkeys(joint[1:] for joint in demos.joints))
    for joint, angles in zip(demos.joints, trajectory.T, strict=True):
        colour = BASIC_ACTIONS[pairs.index(joint[1:]) % len(BASIC_ACTIONS)]
        ax.plot(seconds, angles, color=colour, linestyle=RIGHT if joint.startswith("R") else LEFT, linewidth=1.3)
    ax.set_title(title, fontsize=9.5)
    ax.set_xlim(0.0, seconds[-1])


def joint_legend(demos: Demonstrations) -> list[Line2D]:
    """Return legend entries of the joints and of the two arms."""
    pairs = list(dict.fromkeys(joint[1:] for joint in demos.joints))
    handles = [Line2D([], [], color=BASIC_ACTIONS[k % len(BASIC_ACTIONS)], label=pair) for k, pair in enumerate(pairs)]
    arms = (("right arm", RIGHT), ("left arm", LEFT))
    return [*handles, *(Line2D([], [], color=INK, linestyle=style, label=word) for word, style in arms)]


def _panels(demos: Demonstrations, shown: Sequence[Example], n_columns: int) -> Figure:
    n_rows = -(-len(shown) // n_columns)
    drawn, axes = figure(9.4, 2.1 * n_rows + 0.9, n_rows, n_columns, sharex=True, sharey=True)
    for ax, example in zip(axes, shown, strict=False):
        draw_movement(ax, example.trajectory, demos, example.title)
    for ax in axes[len(shown) :]:
        ax.remove()
    for ax in axes[max(0, len(shown) - n_columns) : len(shown)]:
        ax.tick_params(labelbottom=True)
    drawn.supxlabel("time [s]", fontsize=10)
    drawn.supylabel("joint angle [rad]", fontsize=10)
    drawn.legend(handles=joint_legend(demos), loc="outside upper center", ncols=6, fontsize=9)
    return drawn


def _place(pb: np.ndarray) -> str:
    return f"({pb[0]:+.2f}, {pb[1]:+.2f})"
