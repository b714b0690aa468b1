"""Every figure of a run: drawn for all or for single memories, and written as PNG and SVG.

The charts are in `plots.py`; here are the map with the points that each agent chose and a film strip of finds.
Captions are in `templates/report.html.jinja`.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from creative_nao.errors import MissingDependencyError, NotFoundError
from creative_nao.evaluation import plots
from creative_nao.evaluation.jobs import slug
from creative_nao.evaluation.plots import agent_label
from creative_nao.evaluation.protocol import Episode
from creative_nao.evaluation.results import Measured
from creative_nao.evaluation.suites import Suite
from creative_nao.joints import JOINTS
from creative_nao.maps import PBMap
from creative_nao.maps.figure_style import INK, figure, save, styled
from creative_nao.maps.picture import draw_on, legend_handles
from creative_nao.model import Memory, load_memory

if TYPE_CHECKING:
    from creative_nao.robot.scene import Scene

MAX_SHOWN = 3
"""Most memories that are drawn one by one; the figures over all memories and the result file hold the others."""
FEW = 3
"""Most agents whose maps are drawn large, two in a row; more stand three in a row."""
N_ROWS = 4
"""Finds that are shown: those that earned most."""
TICKS = (0, 3, 5, 7, 9, 11, 13, 16)
"""Ticks that are drawn, the first punch or what stands in its place: a movement repeats itself after it."""
SIZE_PX = (170, 190)
CAMERA = "close"


@dataclass(frozen=True)
class Picture:
    """A figure that has been written."""

    name: str
    """What it shows; the report knows title and caption."""
    memory: str | None
    """The memory, or None for a figure over all of them."""
    path: Path
    """The file that is put into the page."""


def shown_memories(suite: Suite) -> tuple[str, ...]:
    """Return the memories that are drawn one by one: all of a few, else some spread over the suite's list."""
    n_shown = min(MAX_SHOWN, len(suite.memories))
    return tuple(suite.memories[place * len(suite.memories) // n_shown] for place in range(n_shown))


def draw_figures(
    folder: Path, suite: Suite, results: dict[str, Any], measured: Measured, maps: dict[str, PBMap]
) -> list[Picture]:
    """Draw every figure of every memory into the subfolder `figures` of a run folder.

    Args:
        folder: Run folder.
        suite: What was evaluated.
        results: The content of `results.json`.
        measured: All episodes, trainings and oracles.
        maps: The map of each memory.
    """
    with styled():
        overall = _draw_overall(suite, results, measured) if len(suite.memories) > 1 else {}
        return [_keep(folder, suite, None, name, drawn) for name, drawn in overall.items()] + [
            _keep(folder, suite, memory, name, drawn)
            for memory in shown_memories(suite)
            for drawings in (
                _draw(suite, results, measured, memory, maps[memory]),
                _draw_film(folder, suite, results, measured, memory),
            )
            for name, drawn in drawings.items()
        ]


def _draw_overall(suite: Suite, results: dict[str, Any], measured: Measured) -> dict[str, Figure]:
    summary = results["summary"]
    drawn = {"standing": plots.standing(results)}
    if any(entry["versus"] is not None for entry in summary):
        drawn["improvement"] = plots.improvement(results)
    if any(entry["profile"] is not None and entry["agent"] != "oracle" for entry in summary):
        drawn["profiles"] = plots.profiles(results)
    if set(suite.oracle_envs) & set(suite.envs):
        drawn["regret"] = plots.regret(suite, measured)
    return drawn


def _draw(suite: Suite, results: dict[str, Any], measured: Measured, memory: str, scored: PBMap) -> dict[str, Figure]:
    mental = suite.oracle_envs[0] if suite.oracle_envs else suite.envs[0]
    drawn = {
        "reward": plots.rewards(suite, results, measured, memory),
        "cumulative": plots.cumulative(suite, measured, memory),
        "outcomes": plots.outcomes(suite, measured, memory),
        "choices": choices(suite, measured, scored, memory, mental),
    }
    if any(training.memory == memory for training in measured.trainings):
        drawn["training"] = plots.training(suite, measured, memory)
    return drawn


def _draw_film(
    folder: Path, suite: Suite, results: dict[str, Any], measured: Measured, memory: str
) -> dict[str, Figure]:
    """Draw what the best agent found on the first memory, where it moves a NAO and this machine can draw it."""
    env = suite.envs[0]
    found = memory_of(memory, folder) if memory == suite.memories[0] else None
    if found is None or "Modulation" in env:  # no single PB vector makes a modulated movement again
        return {}
    rows = [row for row in results["rows"] if (row["env"], row["memory"]) == (env, memory)]
    best = max(rows, key=lambda row: row["reward"]["mean"])["agent"]
    drawn = film(found, measured.of(memory, env, best)[0])
    return {} if drawn is None else {"film": drawn}


def _keep(folder: Path, suite: Suite, memory: str | None, name: str, drawn: Figure) -> Picture:
    """Write a figure of one memory, or with None of all."""
    file = f"{name}-{slug(memory)}.png" if memory is not None and len(suite.memories) > 1 else f"{name}.png"
    png = save(drawn, folder / "figures" / file)
    # A map of 40,000 points and photographs are no drawings: their SVG would be many times as large.
    return Picture(name, memory, png if name in ("choices", "film") else png.with_suffix(".svg"))


def memory_of(name: str, folder: Path) -> Memory | None:
    """Return a memory of a suite, from the run folder if it was trained there; None if it is no NAO's."""
    own = folder / "memories" / f"{name.replace('/', '-')}.safetensors"
    try:
        memory = load_memory(own if own.is_file() else name)
    except NotFoundError:
        return None
    return memory if tuple(memory.demonstrations.joints) == tuple(JOINTS) else None


def film(memory: Memory, episode: Episode) -> Figure | None:
    """Draw the finds of an episode that earned most.

    Args:
        memory: The memory that was searched; its joints are those of NAO.
        episode: What was found.

    Returns:
        The figure; None where this machine cannot draw the robot, or nothing was found.
    """
    best = sorted((action for action in episode.actions if action.appropriate), key=lambda action: -action.reward)
    if not best:
        return None
    best = best[:N_ROWS]
    moves = memory.generate(np.array([[action.pb_1, action.pb_2] for action in best]))
    try:
        strips = [_strip(move, float(memory.demonstrations.dt_s)) for move in moves]
    except MissingDependencyError:
        return None
    drawn, axes = figure(8.6, 1.42 * len(best) + 0.3, len(best), 1)
    for ax, strip, action in zip(axes, strips, best, strict=True):
        ax.imshow(strip, interpolation="lanczos")
        ax.set_title(
            f"action {action.step} of {agent_label(episode.agent)}: reward {action.reward:.2f}, most like "
            f"{action.nearest.replace('_', ' ')}, {action.distance:.0f} rad from it",
            fontsize=9.0,
            fontweight="normal",
        )
        ax.set_axis_off()
    return drawn


def _strip(move: np.ndarray, dt_s: float) -> np.ndarray:
    """Return the drawn ticks of a movement side by side, uint8 of shape (height, width, 3)."""
    from creative_nao.robot.film import imagined_frames, pictures  # loads MuJoCo

    frames = imagined_frames(_scene(), move, dt_s, frame_dt_s=dt_s)
    chosen = frames[[min(tick, len(frames) - 1) for tick in TICKS]]
    width, height = SIZE_PX
    images = pictures(_scene(), chosen, camera=CAMERA, width=width, height=height)
    gap = np.full((height, 4, 3), 255, dtype=np.uint8)
    pieces = [piece for image in images for piece in (image, gap)]
    return np.concatenate(pieces[:-1], axis=1)


@functools.cache
def _scene() -> Scene:
    from creative_nao.robot.scene import Scene

    return Scene(with_bag=False)  # it would hide an arm


def choices(suite: Suite, measured: Measured, scored: PBMap, memory: str, env: str) -> Figure:
    """Draw the map once per agent with the PB vectors it chose: the first seed's large, the other seeds' small."""
    n_columns = 2 if len(suite.agents) <= FEW else 3
    n_rows = -(-(len(suite.agents) + 1) // n_columns)
    drawn, axes = figure(8.6, 8.3 / n_columns * n_rows + 0.8, n_rows, n_columns)
    for ax in axes[len(suite.agents) + 1 :]:
        ax.remove()
    for ax, agent in zip(axes, suite.agents, strict=False):
        _ground(ax, scored, agent_label(agent))
        first, *others = measured.of(memory, env, agent)
        for episode in others:
            points = np.array([[a.pb_1, a.pb_2] for a in episode.actions])
            ax.plot(*points.T, "o", color=INK, markersize=3.2, markeredgecolor="white", markeredgewidth=0.5)
        for usable, marker, size in ((True, "o", 44), (False, "X", 40)):
            points = np.array([[a.pb_1, a.pb_2] for a in first.actions if a.appropriate == usable]).reshape(-1, 2)
            _large(ax, points, marker, size)
    ax = axes[len(suite.agents)]
    _ground(ax, scored, "oracle (knows the map)")
    _large(ax, np.array(measured.oracles[memory].pb).reshape(-1, 2), "o", 44)
    drawn.legend(handles=legend_handles(scored), loc="outside lower center", ncols=3, fontsize=9)
    return drawn


def _ground(ax: Axes, scored: PBMap, title: str) -> None:
    draw_on(ax, scored)
    ax.grid(visible=False)
    ax.set(title=title, xticks=[-1, 0, 1], yticks=[-1, 0, 1])


def _large(ax: Axes, points: np.ndarray, marker: str, size: float) -> None:
    style = {"facecolor": "white", "edgecolor": "black", "linewidth": 1.4, "zorder": 3, "clip_on": False}
    ax.scatter(*points.T, s=size, marker=marker, **style)
