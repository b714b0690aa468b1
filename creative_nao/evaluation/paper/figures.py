"""All figures of the reproduction, the paper's Fig. 2 to 5 and Table I, with what their captions need to know."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogFormatter, NullFormatter

from creative_nao.demonstrations import Demonstrations
from creative_nao.evaluation.paper.bank import CONDITION_NAMES, Entry
from creative_nao.evaluation.paper.claims import CONDITION_TITLES, TABLE_I, Figures, values_of
from creative_nao.evaluation.paper.summary import map_path
from creative_nao.maps import PBMap
from creative_nao.maps.figure_style import BASIC_ACTIONS, INK, action_letter, figure, save, styled
from creative_nao.maps.picture import draw_on, legend_handles, map_image
from creative_nao.measures import farthest_points, score
from creative_nao.model import Memory

COLOURS = dict(zip(CONDITION_NAMES, BASIC_ACTIONS, strict=False))
MARKERS = {"open": "o", "half": "s", "closed": "D"}
LINES: dict[str, Any] = {"open": "-", "half": (0, (5, 1.5)), "closed": (0, (2, 1.2))}
"""Conditions differ in marker and dash too, so that nothing rests on colour alone."""

ARMS: dict[str, Any] = {"right": "-", "left": (0, (3, 1.5))}  # lines of the two arms
N_POINTS = 400  # points of a drawn learning curve; each is the median over its stretch of epochs

WALK = ("right_straight", "left_jab")
"""The walk goes along the straight line between the learned PB values of these two, the pair of the paper's Fig. 5."""

MAPS_PER_ROW = 8


class Network(NamedTuple):
    """A network with its map and its figures."""

    entry: Entry
    memory: Memory
    memory_map: PBMap
    figures: Figures


Networks = Mapping[str, Sequence[Network]]
"""Of each condition, lowest seed first."""


def learning_curves(networks: Networks) -> Figure:
    """Draw loss against epochs: median and range over the networks of a condition, and one network of each."""
    drawn, (many, one) = figure(9.4, 3.9, 1, 2, sharey=True, sharex=True)
    for condition in CONDITION_NAMES:
        mine = [one.memory for one in networks[condition]]
        style: dict[str, Any] = {"color": COLOURS[condition], "linestyle": LINES[condition]}
        curves = [_thinned(memory) for memory in mine]
        epochs = curves[0][0]
        losses = np.array([loss for _, loss in curves])
        many.fill_between(epochs, losses.min(axis=0), losses.max(axis=0), color=style["color"], alpha=0.16, linewidth=0)
        many.plot(epochs, np.median(losses, axis=0), linewidth=1.8, label=CONDITION_TITLES[condition], **style)
        history = mine[0].loss_history
        one.plot(1 + mine[0].loss_every * np.arange(len(history)), history, color=style["color"], linewidth=0.8)
    n_networks = [len(networks[condition]) for condition in CONDITION_NAMES]
    counts = str(n_networks[0]) if len(set(n_networks)) == 1 else " / ".join(map(str, n_networks))
    word = "network" if max(n_networks) == 1 else "networks"
    many.set_yscale("log")
    many.yaxis.set_major_formatter(LogFormatter())
    many.yaxis.set_minor_formatter(NullFormatter())
    many.set(xlabel="epoch", ylabel="loss", title=f"Median and range, {counts} {word} a condition")
    many.locator_params(axis="x", nbins=5)
    many.xaxis.set_major_formatter("{x:,.0f}")
    one.set(xlabel="epoch", title=f"One network each, seed {networks['half'][0].memory.training.seed}")
    drawn.legend(*many.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return drawn


def table_dots(networks: Networks, rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw Table I: every network a dot, the mean over seeds with its 95 % interval, the paper's network a cross."""
    drawn, axes = figure(10.4, 3.7, 1, len(TABLE_I))
    for ax, measure in zip(axes, TABLE_I, strict=True):
        values = values_of([one.figures for mine in networks.values() for one in mine], measure.field)
        for place, condition in enumerate(CONDITION_NAMES):
            colour, mine = COLOURS[condition], values[condition]
            spread = np.linspace(-0.11, 0.11, len(mine)) if len(mine) > 1 else np.zeros(len(mine))
            ax.scatter(place - 0.17 + spread, mine, s=13, color=colour, alpha=0.5, linewidths=0)
            if (mean := next(row for row in rows if row["memory"] == condition)[measure.field]) is not None:
                if mean["low"] is not None:
                    ax.vlines(place + 0.14, mean["low"], mean["high"], color=colour, linewidth=3.2, capstyle="round")
                ax.plot(
                    place + 0.14, mean["mean"], MARKERS[condition], color="white", markeredgecolor=colour,
                    markeredgewidth=1.8, markersize=7,
                )  # fmt: skip
            ax.plot(place + 0.34, measure.paper[condition], "x", color=INK, markersize=7, markeredgewidth=1.8)
        ax.set_xticks(range(len(CONDITION_NAMES)), CONDITION_NAMES)
        ax.set(title=f"{measure.title} [{measure.unit}]", xlim=(-0.55, len(CONDITION_NAMES) - 0.4))
        largest = max([*measure.paper.values(), *(value for mine in values.values() for value in mine)])
        ax.set_ylim(0.0, 103.0 if measure.field == "appropriateness_pct" else 1.08 * largest)
        ax.grid(axis="x", visible=False)
    drawn.supxlabel("training condition", fontsize=10)
    like: dict[str, Any] = {"markeredgewidth": 1.8, "markersize": 7}
    handles = [
        Line2D([], [], marker="o", linestyle="", color=COLOURS["open"], alpha=0.5, markersize=4, label="one network"),
        Line2D([], [], marker="o", color=COLOURS["open"], linewidth=3.2, markerfacecolor="white",
               label="mean over seeds, 95 % interval", **like),
        Line2D([], [], marker="x", linestyle="", color=INK, label="the paper's network", **like),
    ]  # fmt: skip
    drawn.legend(handles=handles, loc="outside upper center", ncols=3, fontsize=9.5)
    return drawn


def _thinned(memory: Memory) -> tuple[np.ndarray, np.ndarray]:
    """Return epochs and loss of a memory's curve, the median over each stretch."""
    history = memory.loss_history.astype(np.float64)
    parts = np.array_split(np.arange(len(history)), min(N_POINTS, len(history)))
    epochs = np.array([1 + memory.loss_every * float(part.mean()) for part in parts])
    return epochs, np.array([np.median(history[part]) for part in parts])


def examples(networks: Sequence[Network], rng: np.random.Generator) -> tuple[Figure, str]:
    """Draw movements that cannot be used and movements that are new; return also what is missing, in words.

    The rule: a fluctuating one and a non-moving one, each drawn at random from the first map that has any; the two
    most novel ones of the first map, by greedy search over the whole of it; the clearest combination of the first
    memory that has one. Of the networks, the one to be shown comes first.
    """
    shown, missing = [], []
    for outcome in ("fluctuating", "non_moving"):
        word = outcome.replace("_", "-")
        for _, memory, memory_map, _ in networks:
            points = np.flatnonzero(memory_map.outcome == outcome)
            if len(points):
                pb = memory_map.pb[rng.choice(points)]
                shown.append((f"{word}: {memory.name} at {_place(pb)}", memory.generate(pb[None])[0]))
                break
        else:
            missing.append(f"no map has a {word} movement")
    _, memory, memory_map, _ = networks[0]
    demos = memory.demonstrations
    generated = memory.generate(memory_map.pb)
    best = farthest_points(generated, demos, 2, memory_map.appropriate)
    for place, index in enumerate(best.indices):
        rank = ("most novel", "then most novel")[place]
        shown.append((f"{rank}: {memory.name} at {_place(memory_map.pb[index])}", generated[index]))
    for _, memory, _, figures in networks:
        if (combination := figures["clearest_combination"]) is None:
            continue
        first, second = (combination[key].replace("_", " ") for key in ("first", "second"))
        joined = f"{first}, then {second}" if combination["kind"] == "in time" else f"right arm {first}, left {second}"
        shown.append((f"{memory.name}: {joined}", memory.generate(np.array([combination["pb"]]))[0]))
        break
    else:
        missing.append("no map has a combination of two basic actions among the points that were looked at")
    return _panels(demos, shown, 2), "; ".join(missing)


def _draw_movement(ax: Axes, trajectory: np.ndarray, demos: Demonstrations) -> None:
    """Draw one movement: right arm solid, left arm dashed, a colour for each pair of joints."""
    seconds = demos.dt_s * np.arange(len(trajectory))
    colours = _pair_colours(demos)
    for joint, angles in zip(demos.joints, trajectory.T, strict=True):
        line = ARMS["right" if joint.startswith("R") else "left"]
        ax.plot(seconds, angles, color=colours[joint[1:]], linestyle=line, linewidth=1.3)
    ax.set_xlim(0.0, seconds[-1])


def _pair_colours(demos: Demonstrations) -> dict[str, str]:
    pairs = dict.fromkeys(joint[1:] for joint in demos.joints)
    return dict(zip(pairs, itertools.cycle(BASIC_ACTIONS), strict=False))


def _joint_legend(demos: Demonstrations) -> list[Line2D]:
    """Return legend entries of the joints and of the two arms."""
    handles = [Line2D([], [], color=colour, label=pair) for pair, colour in _pair_colours(demos).items()]
    return [*handles, *(Line2D([], [], color=INK, linestyle=line, label=f"{arm} arm") for arm, line in ARMS.items())]


def _panels(demos: Demonstrations, shown: Sequence[tuple[str, np.ndarray]], n_columns: int) -> Figure:
    """Draw movements with their titles; trajectories [rad] of shape (n_steps, n_joints)."""
    n_rows = -(-len(shown) // n_columns)
    drawn, axes = figure(9.4, 2.1 * n_rows + 0.9, n_rows, n_columns, sharex=True, sharey=True)
    for ax, (title, trajectory) in zip(axes, shown, strict=False):
        _draw_movement(ax, trajectory, demos)
        ax.set_title(title, fontsize=9.5)
    for ax in axes[len(shown) :]:
        ax.remove()
    for ax in axes[max(0, len(shown) - n_columns) : len(shown)]:
        ax.tick_params(labelbottom=True)
    drawn.supxlabel("time [s]", fontsize=10)
    drawn.supylabel("joint angle [rad]", fontsize=10)
    drawn.legend(handles=_joint_legend(demos), loc="outside upper center", ncols=6, fontsize=9)
    return drawn


def _place(pb: np.ndarray) -> str:
    return f"({pb[0]:+.2f}, {pb[1]:+.2f})"


def three_maps(networks: Networks) -> Figure:
    """Draw one map of each condition side by side."""
    drawn, axes = figure(11.0, 4.5, 1, len(CONDITION_NAMES))
    for ax, condition in zip(axes, CONDITION_NAMES, strict=True):
        memory_map = networks[condition][0].memory_map
        draw_on(ax, memory_map)
        ax.grid(visible=False)
        learned, usable = memory_map.share_pct("learned"), 100.0 * float(memory_map.appropriate.mean())
        ax.set_title(f"{CONDITION_TITLES[condition]}\n{usable:.0f} % usable, {learned:.0f} % learned", fontsize=10)
        ax.set(xticks=[-1, 0, 1], yticks=[-1, 0, 1])
    drawn.legend(handles=_plain_legend(networks["half"][0].memory_map), loc="outside lower center", ncols=4, fontsize=9)
    return drawn


def all_maps(networks: Networks) -> Figure:
    """Draw every network's map, small: condition by condition, seed by seed."""
    rows = [
        networks[condition][start : start + MAPS_PER_ROW]
        for condition in CONDITION_NAMES
        for start in range(0, len(networks[condition]), MAPS_PER_ROW)
    ]
    n_columns = max(3, max(map(len, rows)))
    drawn, axes = figure(10.8, 10.2 / n_columns * len(rows) * 1.12 + 0.6, len(rows), n_columns)
    for place, ax in enumerate(axes):
        row, column = rows[place // n_columns], place % n_columns
        ax.axis("off")
        if column < len(row):
            entry, _, memory_map, _ = row[column]
            ax.imshow(map_image(memory_map), origin="lower", interpolation="nearest", extent=(-1, 1, -1, 1))
            ax.plot(
                *memory_map.learned_pb.T, "o", color="white", markeredgecolor=INK, markersize=2.6, markeredgewidth=0.7
            )
            ax.set_title(f"{entry.condition} {entry.seed}", fontsize=8, loc="center")
            ax.grid(visible=False)
    drawn.legend(handles=_plain_legend(networks["half"][0].memory_map), loc="outside lower center", ncols=4, fontsize=9)
    return drawn


def walk_points(memory: Memory) -> tuple[np.ndarray, tuple[str, str]]:
    """Return the PB values of the walk, shape (6, 2), and the two basic actions between which it goes."""
    names = memory.demonstrations.names
    first, last = WALK if set(WALK) <= set(names) else (names[0], names[-1])
    begin, end = (memory.pb[names.index(name)] for name in (first, last))
    share = np.linspace(0.0, 1.0, 6)[:, None]
    return (1.0 - share) * begin + share * end, (first, last)


def walk(memory: Memory, memory_map: PBMap) -> Figure:
    """Draw a map with six points on a straight line and the movements that they generate."""
    points, _ = walk_points(memory)
    generated = memory.generate(points)
    scores = score(generated, memory.demonstrations)
    drawn = Figure(figsize=(10.8, 6.6), layout="constrained")
    left, right = np.asarray(drawn.subfigures(1, 2, width_ratios=(1.0, 1.25))).ravel()
    ax = left.subplots()
    draw_on(ax, memory_map)
    ax.grid(visible=False)
    ax.plot(*points.T, "-", color="white", linewidth=2.6)
    ax.plot(*points.T, "-", color=INK, linewidth=1.2)
    for place, point in enumerate(points):
        ax.plot(*point, "o", color="white", markeredgecolor=INK, markersize=13, markeredgewidth=1.3, zorder=3)
        middle = {"ha": "center", "va": "center"}
        ax.annotate(str(place + 1), point, fontsize=8.5, weight="bold", zorder=4, color=INK, **middle)
    ax.set_title(f"Memory {memory.name}", fontsize=10)
    panels = right.subplots(3, 2, sharex=True, sharey=True)
    for place, panel in enumerate(panels.ravel()):
        nearest = memory.demonstrations.names[scores.nearest[place]]
        letter = action_letter(int(scores.nearest[place]))
        what = f"{scores.outcome[place].replace('_', '-')}, nearest {letter} {nearest.replace('_', ' ')}"
        _draw_movement(panel, generated[place], memory.demonstrations)
        where = f"PB {_place(points[place])}, DTW {scores.novelty[place]:.1f}"
        panel.set_title(f"{place + 1}: {what}\n{where}", fontsize=8.5)
    for panel in panels[-1]:
        panel.set_xlabel("time [s]")
    right.supylabel("joint angle [rad]", fontsize=10)
    left.legend(handles=_plain_legend(memory_map), loc="outside lower center", ncols=2, fontsize=8.5)
    right.legend(handles=_joint_legend(memory.demonstrations), loc="outside lower center", ncols=3, fontsize=8.5)
    return drawn


def _plain_legend(memory_map: PBMap) -> list:
    """Return the legend of a map without the shares, which belong to one map alone."""
    handles = legend_handles(memory_map)
    for handle in handles:
        handle.set_label(handle.get_label().split("  (")[0])
    return handles


def draw_pictures(
    folder: Path, bank: Sequence[Entry], networks: Sequence[Figures], rows: Sequence[Mapping[str, Any]], *, seed: int
) -> dict[str, Any]:
    """Draw every figure into the subfolder `images` of a run folder with maps; `seed` draws the examples.

    `networks` has the figures of the networks of `bank`, in the same order; `rows` are those of `results.json`.
    Returned is what the captions say: the seed that is shown, the walk, what is missing from the examples.
    """
    every = [
        Network(entry, entry.load(), PBMap.load(map_path(folder, entry)), figures)
        for entry, figures in zip(bank, networks, strict=True)
    ]
    per = {name: [one for one in every if one.entry.condition == name] for name in CONDITION_NAMES}
    entry, half, memory_map, _ = per["half"][0]
    # Half closed first, as in the paper's Fig. 3 and 5, then the others.
    half_first = sorted(every, key=lambda one: one.entry.condition != "half")
    taught = [
        (name.replace("_", " "), trajectory)
        for name, trajectory in zip(half.demonstrations.names, half.demonstrations.trajectories, strict=True)
    ]
    with styled():
        example_figure, missing = examples(half_first, np.random.default_rng(seed))
        for name, drawn in (
            ("learning", learning_curves(per)),
            ("table", table_dots(per, rows)),
            ("actions", _panels(half.demonstrations, taught, 3)),
            ("examples", example_figure),
            ("maps", three_maps(per)),
            ("all_maps", all_maps(per)),
            ("walk", walk(half, memory_map)),
        ):
            save(drawn, folder / "images" / f"paper_{name}.png")
    points, between = walk_points(half)
    return {
        "shown_seed": entry.seed,
        "n_epochs": sorted({one.memory.training.n_epochs for one in every}),
        "examples_missing": missing,
        "walk": {"memory": half.name, "between": list(between), "pb": points.tolist()},
    }
