"""The results as one table: for the terminal and as Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rich.markup import escape
from rich.table import Table

from creative_nao.evaluation.markdown import interval


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

SHORT_ENV = {
    "CreativeNao/Boxing-v0": "physical",
    "CreativeNao/BoxingMental-v0": "mental",
    "CreativeNao/BoxingModulation-v0": "modulation",
}


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
    """Return the table for a terminal: row by row for one memory, over all of them for several."""
    rows = results["rows"]
    if len({row["memory"] for row in rows}) > 1:
        return summary_table(results)
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


def summary_table(results: Mapping[str, Any]) -> Table:
    """Return the table over all memories for a terminal."""
    entries, rows = results["summary"], results["rows"]
    memories = len({row["memory"] for row in rows})
    table = Table(
        title=f"Suite {results['suite']}: {memories} memories, {rows[0]['n_seeds']} seeds, "
        f"{rows[0]['n_actions']} actions each",
        caption="Over memories and seeds, 95 % stratified bootstrap intervals below; IQM: mean of the middle half. "
        "What each memory gave stands in results.json.",
    )
    table.add_column("agent", style="bold")
    table.add_column("environment")
    for title in SUMMARY_TITLES:
        table.add_column(escape(title), justify="right")
    for place, entry in enumerate(entries):
        last = place + 1 == len(entries) or entries[place + 1]["env"] != entry["env"]
        texts = [text.replace(" [", "\n[", 1) for text in summary_cells(entry)]
        table.add_row(entry["agent"], env_label(entry["env"]), *map(escape, texts), end_section=last)
    return table


SUMMARY_TITLES = (
    "reward\n(mean)",
    "reward\n(IQM)",
    "of oracle\n[%]",
    "over\nbaseline",
    "beats\nbaseline [%]",
    "ahead on",
    "actions in\ntraining",
)


def summary_cells(entry: Mapping[str, Any]) -> list[str]:
    """Return the cells of an entry of the summary after agent and environment."""
    versus = entry["versus"]
    return [
        interval(entry["reward"], 2),
        interval(entry["reward_iqm"], 2),
        interval(entry["oracle_share"], 1, scale=100.0),
        interval(versus and versus["difference"], 2, sign="+"),
        interval(versus and versus["probability_of_improvement"], 0, scale=100.0),
        f"{versus['n_memories_ahead']} of {entry['n_memories']}" if versus else NONE,
        f"{entry['n_actions_training']:,}",
    ]


def markdown_table(results: Mapping[str, Any]) -> str:
    """Return the table as Markdown."""
    titles = ["agent", "environment", *(column.title for column in MEASURED_COLUMNS), "actions generated", "seconds"]
    several = len({row["memory"] for row in results["rows"]}) > 1
    if several:
        titles.insert(2, "memory")
    n_words = 3 if several else 2
    lines = ["| " + " | ".join(titles) + " |", "|" + " --- |" * n_words + " ---: |" * (len(titles) - n_words)]
    for row in results["rows"]:
        texts = [" ".join(filter(None, cell)) for cell in cells(row)]
        where = [row["memory"]] if several else []
        lines.append("| " + " | ".join([row["agent"], env_label(row["env"]), *where, *texts]) + " |")
    return "\n".join(lines) + "\n"


def _subject(results: Mapping[str, Any]) -> str:
    rows = results["rows"]
    memories = ", ".join(dict.fromkeys(row["memory"] for row in rows))
    return f"memory {memories}, {rows[0]['n_seeds']} seeds, {rows[0]['n_actions']} actions each"
