"""`report.html`: the whole evaluation on one page that needs nothing else, for someone who is new to the subject."""

from __future__ import annotations

import base64
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
from matplotlib.figure import Figure

from creative_nao import atomic
from creative_nao.evaluation import map_plot, plots
from creative_nao.evaluation.drawing import save
from creative_nao.evaluation.findings import findings, limits, notes
from creative_nao.evaluation.jobs import slug
from creative_nao.evaluation.palette import agent_colour
from creative_nao.evaluation.results import Measured
from creative_nao.evaluation.suites import Suite
from creative_nao.evaluation.tables import MEASURED_COLUMNS, actions, env_label, figure, seconds
from creative_nao.pb_space import PBMap

TYPES = {".png": "image/png", ".svg": "image/svg+xml"}


@dataclass(frozen=True)
class Picture:
    """A figure of the report."""

    title: str
    caption: str
    path: Path
    """The file that is put into the page."""

    @property
    def data(self) -> str:
        """The image as a data URI."""
        coded = base64.b64encode(self.path.read_bytes()).decode("ascii")
        return f"data:{TYPES[self.path.suffix]};base64,{coded}"


def write_report(
    folder: Path, suite: Suite, results: Mapping[str, Any], measured: Measured, record: Mapping[str, Any]
) -> Path:
    """Draw the figures of a run folder, write `report.html` beside them and return its path.

    Args:
        folder: Run folder; its charts are read.
        suite: What was evaluated.
        results: The content of `results.json`.
        measured: All episodes, trainings and oracles.
        record: The content of `run.json`.
    """
    charts = {memory: PBMap.load(folder / "maps" / f"{slug(memory)}.npz") for memory in suite.memories}
    pictures = [
        picture
        for memory in suite.memories
        for picture in _draw(folder, suite, results, measured, memory, charts[memory])
    ]
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("creative_nao.evaluation"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("report.html.jinja").render(
        title=f"Who finds the most new, usable actions with {suite.n_actions} tries?",
        suite=suite,
        record=record,
        n_basic=len(charts[suite.memories[0]].names),
        several_memories=len(suite.memories) > 1,
        columns=MEASURED_COLUMNS,
        rows=[_row(row) for row in results["rows"]],
        findings=findings(suite, results, measured),
        limits=limits(suite),
        notes=notes(results),
        pictures=pictures,
        ppo_settings=", ".join(f"{name} {value}" for name, value in dataclasses.asdict(suite.ppo).items()),
        env_label=env_label,
    )
    return atomic.write_text(folder / "report.html", page)


def _row(row: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "agent": row["agent"],
        "env": env_label(row["env"]),
        "memory": row["memory"],
        "colour": agent_colour(row["agent"]),
        "figures": [figure(row, column) for column in MEASURED_COLUMNS],
        "actions": actions(row),
        "seconds": seconds(row),
    }


def _draw(
    folder: Path, suite: Suite, results: Mapping[str, Any], measured: Measured, memory: str, charted: PBMap
) -> list[Picture]:
    """Draw every figure of one memory."""
    suffix = f"-{slug(memory)}" if len(suite.memories) > 1 else ""
    where = f" (memory {memory})" if suffix else ""

    def keep(drawn: Figure, name: str, title: str, caption: str, kind: str = ".svg") -> Picture:
        path = save(drawn, folder / "figures" / f"{name}{suffix}.png")
        return Picture(title + where, caption, path.with_suffix(kind))

    mental = suite.oracle_envs[0] if suite.oracle_envs else suite.envs[0]
    found = [
        keep(
            plots.rewards(suite, results, measured, memory),
            "reward",
            "Reward of each agent",
            "The large marker is the mean over seeds, the bar its 95 % interval, each small dot one seed. The dotted line is "
            "the oracle, the most that a search could hope for; in physics there is none, because all actions of the map "
            "would have to be performed.",
        ),
        keep(
            plots.cumulative(suite, measured, memory),
            "cumulative",
            "Reward gathered, action by action",
            "The line is the mean over seeds, the band reaches from the worst to the best seed. Curves flatten as it gets "
            "harder to find something that was not found before.",
        ),
        keep(
            plots.outcomes(suite, measured, memory),
            "outcomes",
            "What became of the generated actions",
            "Learned: a taught action again. Unlearned: usable and new. All others cannot be used, and the name says why: "
            "fluctuating ones are too fast, non moving ones stand still; the rest is what the robot's body objected to.",
        ),
        keep(
            map_plot.choices(suite, measured, charted, memory, mental),
            "choices",
            "Where each agent looked",
            "The memory's map in the mental environment: each point is an action, its colour the taught action most like "
            "it, paler where it is less like it; hatched regions give nothing usable. Letters mark where the taught actions lie. "
            "Large points are the choices of the first seed (a cross where the action could not be used), small ones those "
            "of the other seeds. The oracle shows where the new actions are.",
            ".png",  # a picture of 40,000 cells is no drawing
        ),
    ]
    if any(training.memory == memory for training in measured.trainings):
        found.append(
            keep(
                plots.training(suite, measured, memory),
                "training",
                "How the trained agent learned",
                "Reward of its training episodes, while it still tries things out, against the actions generated so far: "
                "thin lines are seeds, the thick one is their mean. Dashed lines are what the other agents reach.",
            )
        )
    return found
