"""Markdown pieces of the generated pages: paragraphs, tables, figures with intervals.

Also here:
- The results as one table: for the terminal and as Markdown.
- `docs/leaderboard.md`: everyone's figures side by side, written from result files alone.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.markup import escape
from rich.table import Table

WIDTH = 120
DASH = "\N{EN DASH}"


def paragraph(*sentences: str) -> str:
    """Return sentences as one wrapped paragraph."""
    return textwrap.fill(" ".join(sentences), WIDTH, break_long_words=False, break_on_hyphens=False)


def bullet(*sentences: str) -> str:
    """Return sentences as one wrapped item of a list."""
    return textwrap.fill(
        " ".join(sentences),
        WIDTH,
        initial_indent="- ",
        subsequent_indent="  ",
        break_long_words=False,
        break_on_hyphens=False,
    )


def table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose first column is text and whose others are figures."""
    lines = ["| " + " | ".join(titles) + " |", "| --- |" + " ---: |" * (len(titles) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def interval(found: Mapping[str, Any] | None, digits: int, *, scale: float = 1.0, sign: str = "") -> str:
    """Return a figure with its interval as text; a dash where there is none.

    Example:
        >>> interval({"mean": 0.5, "low": 0.25, "high": 0.75}, 1, scale=100.0)
        '50.0 [25.0, 75.0]'
    """
    if found is None:
        return DASH
    mean = f"{scale * found['mean']:{sign}.{digits}f}"
    return mean if found["low"] is None else f"{mean} {span(found, digits, scale=scale, sign=sign)}"


def span(found: Mapping[str, Any], digits: int, *, scale: float = 1.0, sign: str = "") -> str:
    """Return an interval alone as text."""
    if found["low"] is None:
        return "unknown"
    return f"[{scale * found['low']:{sign}.{digits}f}, {scale * found['high']:{sign}.{digits}f}]"


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


Results = Mapping[str, Any]
COLUMNS = (
    "agent",
    "reward (IQM)",
    "reward (mean)",
    "of oracle [%]",
    "beats the baseline [%]",
    "ahead on",
    "actions in training",
)
PACKAGES = ("numpy", "torch", "numba", "mujoco")

PREFACE = (
    "# Leaderboard",
    paragraph(
        "Who finds the most new, usable actions for the least trying? Everybody has the same budget of generated",
        "actions in an episode. Figures are over all memories and seeds of a suite; in brackets stands the 95 %",
        "stratified bootstrap interval (seeds drawn anew within each memory, widened for few seeds).",
    ),
    paragraph(
        "Sorted by the interquartile mean (IQM: the mean of the middle half), which a few lucky episodes do not move.",
        "*Of oracle*: share of what a greedy search earns that knows the whole map beforehand. *Beats the baseline*:",
        "how probable it is that an episode of the agent earns more than one of the baseline on the same memory; 50 is",
        "no difference. *Ahead on*: memories on which its mean is higher.",
    ),
    paragraph(
        "This page is written by `creative-nao evaluate leaderboard` from the files named below;",
        "`creative-nao evaluate verify FILE` plays a sample of their episodes again and says whether they hold.",
    ),
)
ENTERING = (
    "## Enter your own",
    "Name your agent's bundle file and run the suite; everything else stays as it is:",
    "```sh\n"
    "creative-nao evaluate search --agents supervised,my_agent.safetensors --out runs/mine\n"
    "creative-nao evaluate verify runs/mine/results.json\n"
    "creative-nao evaluate leaderboard runs/mine\n"
    "```",
    paragraph(
        "A suite is a TOML file, so a comparison of your own is one too: `creative-nao evaluate my_suite.toml`. The",
        "shipped ones are in `creative_nao/evaluation/suites/`. Agents must not be trained or tuned on the bank's test",
        "memories.",
    ),
)


def leaderboard(published: Mapping[str, Results]) -> str:
    """Return the page as Markdown.

    Args:
        published: Content of each result file, by its path as seen from the page.
    """
    suites = [block for path, results in published.items() for block in _suite(path, results)]
    return "\n\n".join([*PREFACE, *suites, *ENTERING]) + "\n"


def _suite(path: str, results: Results) -> list[str]:
    record = results["record"]
    suite = record["settings"]["suite"]
    blocks = [f"## Suite `{results['suite']}`"]
    if suite.get("about"):
        blocks.append(paragraph(suite["about"]))
    for env in dict.fromkeys(entry["env"] for entry in results["summary"]):
        entries = [entry for entry in results["summary"] if entry["env"] == env]
        entries.sort(key=lambda entry: -entry["reward_iqm"]["mean"])
        memories = f"{entries[0]['n_memories']} {'memory' if entries[0]['n_memories'] == 1 else 'memories'}"
        blocks += [
            f"### {env_label(env).capitalize()}: {memories}, {entries[0]['n_seeds']} seeds, "
            f"{suite['n_actions']} actions an episode",
            table(COLUMNS, [_line(entry, results["baseline"]) for entry in entries]),
        ]
    versions = record["versions"]
    made_with = ", ".join(f"{name} {versions[name]}" for name in PACKAGES if name in versions)
    blocks.append(
        paragraph(
            f"From [{path}]({path}), made by `{record['command']}`",
            f"with creative-nao {versions['creative-nao']} ({made_with}).",
        )
    )
    return blocks


def _line(entry: Mapping[str, Any], baseline: str | None) -> list[str]:
    versus = entry["versus"]
    return [
        entry["agent"] + (" (baseline)" if entry["agent"] == baseline else ""),
        interval(entry["reward_iqm"], 2),
        interval(entry["reward"], 2),
        interval(entry["oracle_share"], 1, scale=100.0),
        interval(versus and versus["probability_of_improvement"], 0, scale=100.0),
        f"{versus['n_memories_ahead']} of {entry['n_memories']}" if versus else DASH,
        f"{entry['n_actions_training']:,}",
    ]
