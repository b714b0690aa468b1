"""The results as one table: for the terminal and as Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rich.markup import escape
from rich.table import Table


@dataclass(frozen=True)
class Column:
    """A column of the table and what it means, in words for someone new to the subject."""

    title: str
    field: str
    digits: int
    meaning: str


MEASURED_COLUMNS = (
    Column(
        "appropriate [%]",
        "appropriateness_pct",
        1,
        "Share of the generated actions that can be used: they move, but not faster than half as fast again as the "
        "taught ones, and in physics the robot performs them without harm. Higher is better.",
    ),
    Column(
        "novelty [rad]",
        "novelty",
        1,
        "How far the usable actions are from the taught ones: the mean distance of each to its nearest taught action. "
        "Distances are dynamic time warping distances, summed over the action; up to 10 counts as a taught action "
        "performed again.",
    ),
    Column(
        "diversity [rad]",
        "diversity",
        1,
        "How far the usable actions are from one another: the mean distance between all pairs.",
    ),
    Column(
        "reward",
        "reward",
        2,
        "What a search is rewarded for: each usable action earns its distance to the nearest action known so far, "
        "taught or found; finding a thing twice earns nothing. 1 is the mean distance between two taught actions.",
    ),
    Column(
        "of oracle [%]",
        "oracle_share",
        1,
        "The reward as a share of what a greedy search earns that knows every action on the whole map beforehand.",
    ),
)

NONE = "\N{EN DASH}"

SHORT_ENV = {"CreativeNao/Boxing-v0": "physical", "CreativeNao/BoxingMental-v0": "mental"}


def env_label(env: str) -> str:
    """Return an environment's name in words: `physical`, `mental`, or the name itself."""
    return SHORT_ENV.get(env, env.rpartition("/")[2])


def figure(row: Mapping[str, Any], column: Column) -> tuple[str, str]:
    """Return mean and interval of a row's field as text; a dash where there is none."""
    found = row[column.field]
    if found is None:
        return NONE, ""
    scale = 100.0 if column.field == "oracle_share" else 1.0
    mean = f"{scale * found['mean']:.{column.digits}f}"
    if found["low"] is None:
        return mean, ""
    return mean, f"[{scale * found['low']:.{column.digits}f}, {scale * found['high']:.{column.digits}f}]"


def actions(row: Mapping[str, Any]) -> tuple[str, str]:
    """Return the actions generated: in the episode, and before it in training."""
    trained = row["n_actions_training"]
    return str(row["n_actions"]), f"+ {trained:,} training" if trained else ""


def seconds(row: Mapping[str, Any]) -> tuple[str, str]:
    """Return the seconds of an episode, and of the training before it."""
    trained = row["seconds_training"]
    return f"{row['seconds']:.1f}", f"+ {trained:.0f} training" if trained else ""


def cells(row: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the cells of a row after agent and environment: a figure each, and what stands below it."""
    return [*(figure(row, column) for column in MEASURED_COLUMNS), actions(row), seconds(row)]


def terminal_table(results: Mapping[str, Any]) -> Table:
    """Return the table for a terminal."""
    rows = results["rows"]
    table = Table(
        title=f"Suite {results['suite']}: {_subject(results)}",
        caption="Mean over seeds with its 95 % interval below; an action is one generated trajectory.",
    )
    table.add_column("agent", style="bold")
    table.add_column("environment")
    for column in MEASURED_COLUMNS:
        table.add_column(escape(column.title.replace(" [", "\n[")), justify="right")
    table.add_column("actions\ngenerated", justify="right")
    table.add_column("seconds", justify="right")
    for place, row in enumerate(rows):
        last = place + 1 == len(rows) or rows[place + 1]["env"] != row["env"]
        texts = ["\n".join(filter(None, cell)) for cell in cells(row)]
        table.add_row(row["agent"], env_label(row["env"]), *texts, end_section=last)
    return table


def markdown_table(results: Mapping[str, Any]) -> str:
    """Return the table as Markdown."""
    titles = ["agent", "environment", *(column.title for column in MEASURED_COLUMNS), "actions generated", "seconds"]
    lines = ["| " + " | ".join(titles) + " |", "| --- | --- |" + " ---: |" * (len(titles) - 2)]
    for row in results["rows"]:
        texts = [" ".join(filter(None, cell)) for cell in cells(row)]
        lines.append("| " + " | ".join([row["agent"], env_label(row["env"]), *texts]) + " |")
    return "\n".join(lines) + "\n"


def _subject(results: Mapping[str, Any]) -> str:
    rows = results["rows"]
    memories = ", ".join(dict.fromkeys(row["memory"] for row in rows))
    return f"memory {memories}, {rows[0]['n_seeds']} seeds, {rows[0]['n_actions']} actions each"
