"""`report.html`: a whole run on one page that needs nothing else, for someone new to the subject.

This file works out the figures; the sentences are in `templates/report.html.jinja`, `findings.html.jinja` (what the
results say) and `limits.html.jinja` (what they do not).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from creative_nao import storage
from creative_nao.agents.registry import UNTRAINED
from creative_nao.evaluation.figures import draw_figures, shown_memories
from creative_nao.evaluation.jobs import slug
from creative_nao.evaluation.pages import data_uri, render
from creative_nao.evaluation.plots import agent_colour
from creative_nao.evaluation.protocol import ActionRecord, Episode
from creative_nao.evaluation.results import Measured, Row, verdict
from creative_nao.evaluation.suites import Suite, actions_before, in_bundle, trained_here
from creative_nao.evaluation.tables import MEASURED_COLUMNS, SUMMARY_TITLES, cells, env_label, summary_cells
from creative_nao.maps import PBMap

VERDICTS = {"ahead": "ahead are", "open": "not to be told apart are", "behind": "behind are"}
INTRODUCED = ("supervised", "random", "ppo", "oracle")
"""Agents that the report introduces in words of its own."""


def write_report(
    folder: Path, suite: Suite, results: dict[str, Any], measured: Measured, record: Mapping[str, Any]
) -> Path:
    """Draw the figures of a run folder, write `report.html` beside them and return its path.

    Args:
        folder: Run folder; its maps are read.
        suite: What was evaluated.
        results: The content of `results.json`.
        measured: All episodes, trainings and oracles.
        record: The content of `run.json`.
    """
    maps = {memory: PBMap.load(folder / "maps" / f"{slug(memory)}.npz") for memory in shown_memories(suite)}
    page = render(
        "report.html.jinja",
        **findings(suite, results, measured),
        record=record,
        n_basic=len(next(iter(maps.values())).names),
        columns=MEASURED_COLUMNS,
        rows=[{**_line(row, cells(row)), "memory": row["memory"]} for row in results["rows"]],
        summary_titles=[title.replace("\n", " ") for title in SUMMARY_TITLES],
        summary=[_line(entry, summary_cells(entry)) for entry in results["summary"]],
        others=[_introduction(agent) for agent in suite.agents if agent not in INTRODUCED],
        trained=[agent for agent in suite.agents if trained_here(agent)],
        notes=notes(results),
        pictures=draw_figures(folder, suite, results, measured, maps),
        data_uri=data_uri,
        ppo_settings=", ".join(f"{name} {value}" for name, value in dataclasses.asdict(suite.ppo).items()),
        env_label=env_label,
    )
    return storage.write_text(folder / "report.html", page)


def _line(row: Row, figures: Sequence[tuple[str, str]]) -> dict[str, Any]:
    agent = row["agent"]
    return {"agent": agent, "env": env_label(row["env"]), "colour": agent_colour(agent), "cells": figures}


def _introduction(agent: str) -> dict[str, Any]:
    """Return what the report tells of an agent: its training if it comes out of a bundle, else its docstring."""
    about = (UNTRAINED[agent].__doc__ or "").strip().partition("\n")[0] if agent in UNTRAINED else None
    return {"name": agent, "n_trained": actions_before(agent) if in_bundle(agent) else None, "about": about}


def findings(suite: Suite, results: Mapping[str, Any], measured: Measured) -> dict[str, Any]:
    """Return the values of `findings.html.jinja`: a dictionary of figures for each sentence, with its `kind`."""
    found: list[dict[str, Any]] = []
    if several := len(suite.memories) > 1:
        for env in suite.envs:
            found += _over_memories(env, [entry for entry in results["summary"] if entry["env"] == env])
    for memory in suite.memories:
        if not several:
            for env in suite.envs:
                rows = [row for row in results["rows"] if (row["env"], row["memory"]) == (env, memory)]
                found.append({"env": env_label(env), "memory": memory, **_ranking(rows)})
        found += _physics(suite, measured, memory)
        if not several:
            found.append({"kind": "map", "memory": memory, **_map(measured, memory)})
    if several:
        earned = [sum(oracle.rewards) for oracle in measured.oracles.values()]
        found.append({"kind": "oracles", "least": min(earned), "most": max(earned)})
    return {"findings": found, "suite": suite, "several_memories": several, "baseline": results["baseline"]}


def _over_memories(env: str, entries: Sequence[Row]) -> list[dict[str, Any]]:
    entries = sorted(entries, key=lambda entry: -entry["reward"]["mean"])
    found: list[dict[str, Any]] = [{"kind": "overall", "env": env_label(env), "rows": entries}]
    if compared := [entry for entry in entries if entry["versus"] is not None]:
        named = {word: [e["agent"] for e in compared if verdict(e) == word] for word in VERDICTS}
        parts = [(words, named[word]) for word, words in VERDICTS.items() if named[word]]
        found.append({"kind": "compared", "parts": parts})
    return found


def _ranking(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the agents by reward, those whose interval reaches the best one's, and who is more diverse."""
    ranked = sorted(rows, key=lambda row: -row["reward"]["mean"])
    best, low = ranked[0], ranked[0]["reward"]["low"]
    known = [row for row in ranked if row["diversity"] is not None]
    most = max(known, key=lambda row: row["diversity"]["mean"], default=best)
    return {
        "kind": "ranking",
        "rows": ranked,
        "best": best,
        "level": [row["agent"] for row in ranked[1:] if low is not None and row["reward"]["high"] >= low],
        "diverse": known if most is not best else [],
    }


def _map(measured: Measured, memory: str) -> dict[str, Any]:
    oracle = measured.oracles[memory]
    learned = oracle.shares_pct.get("learned", 0.0)
    return {
        "usable_pct": learned + oracle.shares_pct.get("unlearned", 0.0),
        "learned_pct": learned,
        "oracle": sum(oracle.rewards),
        "n_chosen": len(oracle.rewards),
    }


def _physics(suite: Suite, measured: Measured, memory: str) -> list[dict[str, Any]]:
    """Compare, action by action, what the same PB vectors gave as the memory imagines them and in physics."""
    found = []
    for env in suite.envs if suite.oracle_envs else ():
        if env in suite.oracle_envs:
            continue
        imagined, performed = (
            # Agents that look at no results choose the same in both.
            [e for e in measured.episodes if (e.memory, e.env) == (memory, which) and _is_blind(e.agent)]
            for which in (suite.oracle_envs[0], env)
        )
        pairs = zip(_actions(imagined), _actions(performed), strict=True)
        if usable := [after.appropriate for before, after in pairs if before.appropriate]:
            change = 100.0 * (sum(e.reward for e in performed) / sum(e.reward for e in imagined) - 1.0)
            counts = {"n_usable": len(usable), "n_refused": usable.count(False)}
            found.append({"kind": "physics", "memory": memory, "change_pct": change, **counts})
    return found


def _is_blind(agent: str) -> bool:
    """Return whether an agent chooses without looking at results, so that it plays the same points everywhere."""
    return agent in UNTRAINED and not UNTRAINED[agent]().learns_within_episode


def _actions(episodes: Sequence[Episode]) -> list[ActionRecord]:
    return [action for episode in episodes for action in episode.actions]


def notes(results: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """Return the reasons of missing or partial figures, each once, with the rows they concern; none for all rows."""
    found: dict[str, list[str]] = {}
    for row in results["rows"]:
        for key, reason in row.items():
            if key.endswith("_reason"):
                text = f"{key.removesuffix('_reason').replace('_', ' ')}: {reason}"
                found.setdefault(text, []).append(f"{row['agent']}, {env_label(row['env'])}")
    return [(text, [] if len(rows) == len(results["rows"]) else rows) for text, rows in found.items()]
