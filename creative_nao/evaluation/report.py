"""`report.html`: the whole evaluation on one page that needs nothing else, for someone who is new to the subject."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2

from creative_nao import atomic
from creative_nao.evaluation.entrants import described
from creative_nao.evaluation.findings import findings, limits, notes
from creative_nao.evaluation.gallery import draw_pictures, shown_memories
from creative_nao.evaluation.jobs import slug
from creative_nao.evaluation.palette import agent_colour
from creative_nao.evaluation.results import Measured
from creative_nao.evaluation.suites import Suite
from creative_nao.evaluation.tables import MEASURED_COLUMNS, SUMMARY_TITLES, cells, env_label, summary_cells
from creative_nao.pb_space import PBMap


def write_report(
    folder: Path, suite: Suite, results: dict[str, Any], measured: Measured, record: Mapping[str, Any]
) -> Path:
    """Draw the figures of a run folder, write `report.html` beside them and return its path.

    Args:
        folder: Run folder; its charts are read.
        suite: What was evaluated.
        results: The content of `results.json`.
        measured: All episodes, trainings and oracles.
        record: The content of `run.json`.
    """
    charts = {memory: PBMap.load(folder / "maps" / f"{slug(memory)}.npz") for memory in shown_memories(suite)}
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("creative_nao.evaluation"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("report.html.jinja").render(
        title=f"Who finds the most new, usable actions with {suite.n_actions} tries?",
        suite=suite,
        record=record,
        n_basic=len(next(iter(charts.values())).names),
        several_memories=len(suite.memories) > 1,
        columns=MEASURED_COLUMNS,
        rows=[_row(row) for row in results["rows"]],
        summary_titles=[title.replace("\n", " ") for title in SUMMARY_TITLES],
        summary=[_summary(entry) for entry in results["summary"]],
        others=[(agent, told) for agent in suite.agents if (told := described(agent))],
        findings=findings(suite, results, measured),
        limits=limits(suite),
        notes=notes(results),
        pictures=draw_pictures(folder, suite, results, measured, charts),
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
        "cells": cells(row),
    }


def _summary(entry: Mapping[str, Any]) -> dict[str, Any]:
    texts = [text.partition(" [") for text in summary_cells(entry)]
    return {
        "agent": entry["agent"],
        "env": env_label(entry["env"]),
        "colour": agent_colour(entry["agent"]),
        "cells": [(figure, f"[{below}" if below else "") for figure, _, below in texts],
    }
