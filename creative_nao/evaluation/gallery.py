"""Every figure of an evaluation, drawn, written as PNG and SVG, and told in a caption."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from creative_nao.evaluation import film, map_plot, plots, summary_plots
from creative_nao.evaluation.drawing import STYLE, save
from creative_nao.evaluation.jobs import slug
from creative_nao.evaluation.results import Measured
from creative_nao.evaluation.suites import Suite
from creative_nao.pb_space import PBMap

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
    drawn = {"standing": summary_plots.standing(results)}
    if any(entry["versus"] is not None for entry in summary):
        drawn["improvement"] = summary_plots.improvement(results)
    if any(entry["profile"] is not None and entry["agent"] != "oracle" for entry in summary):
        drawn["profiles"] = summary_plots.profiles(results)
    if set(suite.oracle_envs) & set(suite.envs):
        drawn["regret"] = summary_plots.regret(suite, measured)
    return drawn


def _draw(suite: Suite, results: dict[str, Any], measured: Measured, memory: str, charted: PBMap) -> dict[str, Figure]:
    mental = suite.oracle_envs[0] if suite.oracle_envs else suite.envs[0]
    drawn = {
        "reward": plots.rewards(suite, results, measured, memory),
        "cumulative": plots.cumulative(suite, measured, memory),
        "outcomes": plots.outcomes(suite, measured, memory),
        "choices": map_plot.choices(suite, measured, charted, memory, mental),
    }
    if any(training.memory == memory for training in measured.trainings):
        drawn["training"] = plots.training(suite, measured, memory)
    return drawn


def _draw_film(
    folder: Path, suite: Suite, results: dict[str, Any], measured: Measured, memory: str
) -> dict[str, Figure]:
    """Draw what the best agent found on the first memory, where it moves a NAO and this machine can draw it."""
    env = suite.envs[0]
    found = film.memory_of(memory, folder) if memory == suite.memories[0] else None
    if found is None or "Modulation" in env:  # no single PB vector makes a modulated movement again
        return {}
    rows = [row for row in results["rows"] if (row["env"], row["memory"]) == (env, memory)]
    best = max(rows, key=lambda row: row["reward"]["mean"])["agent"]
    episode = next(e for e in measured.episodes if (e.env, e.memory, e.agent) == (env, memory, best))
    drawn = film.film(found, episode)
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
