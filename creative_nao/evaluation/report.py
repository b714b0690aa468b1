"""`report.html`: the whole evaluation on one page that needs nothing else, for someone who is new to the subject.

Also here:
- What the results say in sentences, and what they do not: written from the figures, never ahead of them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2

from creative_nao import storage
from creative_nao.agents.registry import UNTRAINED
from creative_nao.evaluation.gallery import draw_pictures, shown_memories
from creative_nao.evaluation.jobs import slug
from creative_nao.evaluation.plots import agent_colour
from creative_nao.evaluation.protocol import ActionRecord, Episode
from creative_nao.evaluation.resolve_agents import described, trained_here
from creative_nao.evaluation.result_page import verdict
from creative_nao.evaluation.results import Measured
from creative_nao.evaluation.suites import Suite
from creative_nao.evaluation.tables import MEASURED_COLUMNS, SUMMARY_TITLES, cells, env_label, summary_cells
from creative_nao.maps import PBMap

FEW_SEEDS = 10


def findings(suite: Suite, results: Mapping[str, Any], measured: Measured) -> list[str]:
    """Return the answer in one sentence per environment and memory, what physics changes, and what the map holds."""
    if len(suite.memories) > 1:
        return _over_memories(suite, results, measured)
    lines = []
    for memory in suite.memories:
        for env in suite.envs:
            rows = [row for row in results["rows"] if (row["env"], row["memory"]) == (env, memory)]
            lines.append(_ranking(rows, f"In the {env_label(env)} environment{_of(suite, memory)}"))
        lines += _physics(suite, measured, memory)
        oracle = measured.oracles[memory]
        usable = oracle.shares_pct.get("learned", 0.0) + oracle.shares_pct.get("unlearned", 0.0)
        lines.append(
            f"The whole map{_of(suite, memory)}: {usable:.0f} % of it gives a usable action, "
            f"{oracle.shares_pct.get('learned', 0.0):.0f} % a taught one. "
            f"The oracle earns {sum(oracle.rewards):.1f} with {len(oracle.rewards)} actions."
        )
    return lines


def _over_memories(suite: Suite, results: Mapping[str, Any], measured: Measured) -> list[str]:
    lines = []
    for env in suite.envs:
        entries = sorted(
            (entry for entry in results["summary"] if entry["env"] == env), key=lambda entry: -entry["reward"]["mean"]
        )
        told = ", ".join(f"{e['agent']} {e['reward']['mean']:.1f}{_interval(e['reward'])}" for e in entries)
        lines.append(
            f"In the {env_label(env)} environment, over {len(suite.memories)} memories, the reward is: {told}."
        )
        compared = [entry for entry in entries if entry["versus"] is not None]
        if compared:
            words = {word: [e["agent"] for e in compared if verdict(e) == word] for word in VERDICTS}
            parts = [f"{text}: {', '.join(words[word])}" for word, text in VERDICTS.items() if words[word]]
            kind = "allowing for other memories of the same kind"
            lines.append(f"Compared with {results['baseline']}, {kind}, {'; '.join(parts)}.")
    for memory in suite.memories:
        lines += _physics(suite, measured, memory)
    best = [sum(oracle.rewards) for oracle in measured.oracles.values()]
    lines.append(
        f"The oracle earns {min(best):.1f} to {max(best):.1f} with {suite.n_actions} actions, depending on the memory."
    )
    return lines


VERDICTS = {"ahead": "ahead are", "open": "not to be told apart are", "behind": "behind are"}


def limits(suite: Suite) -> list[str]:
    """Return what the results do not show."""
    lines = []
    if trained := [agent for agent in suite.agents if trained_here(agent)]:
        names = " and ".join(trained)
        lines.append(
            f"{names} is judged on the very memory it was trained on. It may have learned that map by heart; "
            "whether it could search a memory it has never seen is another question, which this suite does not ask."
        )
        lines.append(
            f"The budgets are unequal: before its episode of {suite.n_actions} actions, {names} generated "
            f"{suite.ppo.n_generated:,} actions in training, the others none."
        )
        lines.append(
            f"The training settings of {names} were chosen on the memory half/0 too, in runs with other seeds."
        )
        if any(env != suite.training_env for env in suite.envs):
            lines.append(
                f"{names} was trained in the {env_label(suite.training_env)} environment only; in the other it meets "
                "physics for the first time."
            )
    if suite.n_seeds < FEW_SEEDS:
        lines.append(
            f"{suite.n_seeds} seeds are few. The intervals are widened for that, but they speak of other seeds, not of "
            "other memories."
        )
    if {"supervised", "random"} <= set(suite.agents):
        lines.append(
            "supervised and random both draw evenly from the whole map, one on a fine grid, one between its points: "
            "what separates them is chance, and shows how far such figures can be trusted."
        )
    if len(suite.memories) == 1:
        lines.append(
            f"One memory, {suite.memories[0]}: another network trained on the same actions has another map, "
            "and figures of its own."
        )
    lines.append(
        "The oracle is greedy: it takes the best next action every time, and some other set of actions may earn more "
        f"in all. It chooses from {suite.resolution} x {suite.resolution} points, "
        "agents from all between them too."
    )
    lines.append(
        "New and usable is not the same as good boxing: nobody has judged whether the actions would hit or please."
    )
    return lines


def notes(results: Mapping[str, Any]) -> list[str]:
    """Return the reasons of missing or partial figures, once each."""
    found: dict[str, list[str]] = {}
    for row in results["rows"]:
        for key, reason in row.items():
            if key.endswith("_reason"):
                where = f"{row['agent']}, {env_label(row['env'])}"
                found.setdefault(f"{key.removesuffix('_reason').replace('_', ' ')}: {reason}", []).append(where)
    total = len(results["rows"])
    return [f"{text} ({'all rows' if len(rows) == total else '; '.join(rows)})." for text, rows in found.items()]


def _ranking(rows: list[Mapping[str, Any]], start: str) -> str:
    ranked = sorted(rows, key=lambda row: -row["reward"]["mean"])
    told = ", ".join(f"{row['agent']} {row['reward']['mean']:.1f}{_interval(row['reward'])}" for row in ranked)
    text = f"{start}, the reward is: {told}."
    if len(ranked) < 2:
        return text
    best, story = ranked[0], _other_story(ranked)
    if best["reward"]["low"] is None:
        return f"{text} One seed cannot tell them apart.{story}"
    level = [row["agent"] for row in ranked[1:] if row["reward"]["high"] >= best["reward"]["low"]]
    if not level:
        return f"{text} {best['agent']} is ahead of all others: its interval overlaps with none of theirs.{story}"
    names = " and ".join(level)
    return f"{text} The interval of {best['agent']} overlaps with that of {names}: these seeds leave it open.{story}"


def _other_story(ranked: list[Mapping[str, Any]]) -> str:
    """Return a sentence when the best in reward is not the best in diversity."""
    known = [row for row in ranked if row["diversity"] is not None]
    most = max(known, key=lambda row: row["diversity"]["mean"], default=None)
    if most is None or most is ranked[0]:
        return ""
    told = ", ".join(f"{row['agent']} {row['diversity']['mean']:.1f}" for row in known)
    return f" {ranked[0]['agent']} is not the most diverse, though: diversity is {told}."


def _physics(suite: Suite, measured: Measured, memory: str) -> list[str]:
    """Compare, action by action, what the same PB vectors gave in the mind and in the robot's body."""
    lines = []
    for env in suite.envs:
        if not suite.oracle_envs or env in suite.oracle_envs:
            continue
        imagined, performed = (
            # Agents that look at no results choose the same in both.
            [e for e in measured.episodes if (e.memory, e.env) == (memory, which) and _is_blind(e.agent)]
            for which in (suite.oracle_envs[0], env)
        )
        pairs = zip(_actions(imagined), _actions(performed), strict=True)
        usable = [body.appropriate for mind, body in pairs if mind.appropriate]
        if not usable:
            continue
        change = 100.0 * (sum(e.reward for e in performed) / sum(e.reward for e in imagined) - 1.0)
        lines.append(
            f"What physics changes{_of(suite, memory)}: of {len(usable)} actions that are usable in the mind, the "
            f"robot's body refused {usable.count(False)}; performed, the same choices earn {change:+.1f} %."
        )
    return lines


def _is_blind(agent: str) -> bool:
    """Return whether an agent chooses without looking at results, so that it plays the same points everywhere."""
    return agent in UNTRAINED and not UNTRAINED[agent]().learns_within_episode


def _actions(episodes: list[Episode]) -> list[ActionRecord]:
    return [action for episode in episodes for action in episode.actions]


def _interval(figure: Mapping[str, Any]) -> str:
    return "" if figure["low"] is None else f" [{figure['low']:.1f}, {figure['high']:.1f}]"


def _of(suite: Suite, memory: str) -> str:
    return f" of memory {memory}" if len(suite.memories) > 1 else ""


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
    return storage.write_text(folder / "report.html", page)


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
