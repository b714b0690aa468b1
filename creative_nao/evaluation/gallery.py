"""Every figure of an evaluation, drawn, written as PNG and SVG, and told in a caption.

Also here:
- The best finds of an episode as film strips: the robot as the memory imagines it, a row a movement.
- The memory's map with the points that each agent chose on it.
"""

from __future__ import annotations

import base64
import functools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from creative_nao.errors import MissingDependencyError, NotFoundError
from creative_nao.evaluation import plots
from creative_nao.evaluation.jobs import slug
from creative_nao.evaluation.plots import INK, STYLE, agent_label, figure, save
from creative_nao.evaluation.protocol import Episode
from creative_nao.evaluation.results import Measured
from creative_nao.evaluation.suites import Suite
from creative_nao.joints import JOINTS
from creative_nao.maps import PBMap
from creative_nao.maps.picture import draw_on, legend_handles
from creative_nao.model import Memory, load_memory

if TYPE_CHECKING:
    from creative_nao.robot.scene import Scene


N_ROWS = 4
"""Finds that are shown: those that earned most."""
TICKS = (0, 3, 5, 7, 9, 11, 13, 16)
"""Ticks that are drawn, the first punch or what stands in its place: a movement repeats itself after it."""
SIZE_PX = (170, 190)
CAMERA = "close"


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


TYPES = {".png": "image/png", ".svg": "image/svg+xml"}

MAX_SHOWN = 3
"""Most memories that are drawn one by one; the figures over all memories and the result file hold the others."""

CAPTIONS = {
    "standing": (
        "Who earns most, over all memories",
        "The marker is the mean over all memories and seeds, the bar its 95 % interval, the upright line the mean "
        "of the middle half of the episodes. The dashed line is the baseline: an agent whose bar lies right "
        "of it earns more.",
    ),
    "improvement": (
        "How surely better than the baseline",
        "Take an episode of the agent and one of the baseline on the same memory: so often does the agent's earn more. "
        "At 50 % the two are equals.",
    ),
    "profiles": (
        "How evenly",
        "Share of all episodes, over all memories, that reach more than a given share of the oracle's reward. A curve "
        "further to the right is better; one that falls steeply belongs to an agent that does about equally well "
        "everywhere. Bands are 95 % intervals.",
    ),
    "regret": (
        "What is left to find, action by action",
        "How far the reward gathered stays behind that of the oracle with as many actions, on average over all "
        "memories and seeds. Lower is better; the oracle itself would lie at zero.",
    ),
    "film": (
        "What was found",
        "The movements that earned most in the first episode of the agent with the highest mean, a row each, as the "
        "memory imagines them: from the guard at the left through the first two and a half seconds. Above each stands "
        "the taught action most like it, and how far the two are apart.",
    ),
    "reward": (
        "Reward of each agent",
        "The large marker is the mean over seeds, the bar its 95 % interval, each small dot one seed. The dotted line "
        "is the oracle, which knows the whole map beforehand; in physics there is none, because the robot would have "
        "to perform every action of the map.",
    ),
    "cumulative": (
        "Reward gathered, action by action",
        "The line is the mean over seeds, the band reaches from the worst to the best seed. Curves flatten as it gets "
        "harder to find something that was not found before.",
    ),
    "outcomes": (
        "What became of the generated actions",
        "Learned: a taught action again. Unlearned: usable and new. All others cannot be used, and the name says why: "
        "fluctuating ones are too fast, non-moving ones stand still, the rest is what the robot's body objected to.",
    ),
    "choices": (
        "Where each agent looked",
        "The memory's map: each point is an action, its colour the taught action most like it, fainter where newer; "
        "hatched regions give nothing usable. Letters mark where the taught actions lie; thin lines enclose what is "
        "one of them performed again. Large points are the choices of the first seed, crosses those that could not "
        "be used, small points the other seeds. The oracle's choices show where the most new actions are.",
    ),
    "training": (
        "How the trained agent learned",
        "Reward of its training episodes, while it still tries things out, against the actions generated so far: thin "
        "lines are seeds, the thick one is their mean. Dashed lines are the other agents, dotted is the oracle.",
    ),
}


@dataclass(frozen=True)
class Picture:
    """A figure that has been written."""

    title: str
    caption: str
    path: Path
    """The file that is put into the page."""

    @property
    def data(self) -> str:
        """The image as a data URI."""
        coded = base64.b64encode(self.path.read_bytes()).decode("ascii")
        return f"data:{TYPES[self.path.suffix]};base64,{coded}"


def shown_memories(suite: Suite) -> tuple[str, ...]:
    """Return the memories that are drawn one by one: all of a few, else some spread over the suite's list."""
    n_shown = min(MAX_SHOWN, len(suite.memories))
    return tuple(suite.memories[place * len(suite.memories) // n_shown] for place in range(n_shown))


def draw_pictures(
    folder: Path, suite: Suite, results: dict[str, Any], measured: Measured, charts: dict[str, PBMap]
) -> list[Picture]:
    """Draw every figure of every memory into the subfolder `figures` of a run folder.

    Args:
        folder: Run folder.
        suite: What was evaluated.
        results: The content of `results.json`.
        measured: All episodes, trainings and oracles.
        charts: The map of each memory.
    """
    with matplotlib.rc_context(STYLE):
        overall = _draw_overall(suite, results, measured) if len(suite.memories) > 1 else {}
        return [_keep(folder, suite, None, name, drawn) for name, drawn in overall.items()] + [
            _keep(folder, suite, memory, name, drawn)
            for memory in shown_memories(suite)
            for drawings in (
                _draw(suite, results, measured, memory, charts[memory]),
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


def _draw(suite: Suite, results: dict[str, Any], measured: Measured, memory: str, charted: PBMap) -> dict[str, Figure]:
    mental = suite.oracle_envs[0] if suite.oracle_envs else suite.envs[0]
    drawn = {
        "reward": plots.rewards(suite, results, measured, memory),
        "cumulative": plots.cumulative(suite, measured, memory),
        "outcomes": plots.outcomes(suite, measured, memory),
        "choices": choices(suite, measured, charted, memory, mental),
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
    episode = next(e for e in measured.episodes if (e.env, e.memory, e.agent) == (env, memory, best))
    drawn = film(found, episode)
    return {} if drawn is None else {"film": drawn}


def _keep(folder: Path, suite: Suite, memory: str | None, name: str, drawn: Figure) -> Picture:
    """Write a figure of one memory, or with None of all."""
    title, caption = CAPTIONS[name]
    several = len(suite.memories) > 1
    png = save(
        drawn, folder / "figures" / (f"{name}-{slug(memory)}.png" if several and memory is not None else f"{name}.png")
    )
    # A map of 40,000 points and photographs are no drawings: their SVG would be many times as large.
    path = png if name in ("choices", "film") else png.with_suffix(".svg")
    return Picture(f"{title} (memory {memory})" if several and memory is not None else title, caption, path)
