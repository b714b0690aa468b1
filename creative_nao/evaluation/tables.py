"""The results as a table: for the terminal, as Markdown, and as cells of the report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from rich.markup import escape
from rich.table import Table

from creative_nao.evaluation.pages import DASH, interval, render

Results = Mapping[str, Any]


class Column(NamedTuple):
    """A column of measures; what it means is told in `report.html.jinja`."""

    title: str
    field: str
    digits: int


MEASURED_COLUMNS = (
    Column("appropriate [%]", "appropriateness_pct", 1),
    Column("novelty [rad]", "novelty", 1),
    Column("diversity [rad]", "diversity", 1),
    Column("reward", "reward", 2),
    Column("of oracle [%]", "oracle_share", 1),
)
TITLES = (*(column.title.replace(" [", "\n[") for column in MEASURED_COLUMNS), "actions\ngenerated", "seconds")
SUMMARY_TITLES = (
    "reward\n(mean)",
    "reward\n(IQM)",
    "of oracle\n[%]",
    "over\nbaseline",
    "beats\nbaseline [%]",
    "ahead on",
    "actions in\ntraining",
)
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
    scale = 100.0 if column.field == "oracle_share" else 1.0
    mean, _, below = interval(row[column.field], column.digits, scale=scale).partition(" ")
    return mean, below


def cells(row: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the cells of a row after agent and environment: a figure each, and what stands below it."""
    trained, seconds = row["n_actions_training"], row["seconds_training"]
    return [
        *(figure(row, column) for column in MEASURED_COLUMNS),
        (str(row["n_actions"]), f"+ {trained:,} training" if trained else ""),
        (f"{row['seconds']:.1f}", f"+ {seconds:.0f} training" if seconds else ""),
    ]


def summary_cells(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the cells of an entry of the summary after agent and environment, as `cells`."""
    versus = entry["versus"]
    texts = [
        interval(entry["reward"], 2),
        interval(entry["reward_iqm"], 2),
        interval(entry["oracle_share"], 1, scale=100.0),
        interval(versus and versus["difference"], 2, sign="+"),
        interval(versus and versus["probability_of_improvement"], 0, scale=100.0),
    ]
    return [
        *((mean, below) for mean, _, below in (text.partition(" ") for text in texts)),
        (f"{versus['n_memories_ahead']} of {entry['n_memories']}" if versus else DASH, ""),
        (f"{entry['n_actions_training']:,}", ""),
    ]


def terminal_table(results: Results) -> Table:
    """Return the table for a terminal: row by row for one memory, over all of them for several."""
    rows = results["rows"]
    memories = list(dict.fromkeys(row["memory"] for row in rows))
    several = len(memories) > 1
    titles = SUMMARY_TITLES if several else TITLES
    subject = f"{len(memories)} memories" if several else f"memory {memories[0]}"
    table = Table(
        title=f"Suite {results['suite']}: {subject}, {rows[0]['n_seeds']} seeds, {rows[0]['n_actions']} actions each",
        caption="Over memories and seeds, 95 % stratified bootstrap intervals below; IQM: mean of the middle half. "
        "What each memory gave stands in results.json."
        if several
        else "Mean over seeds with its 95 % interval below; an action is one generated trajectory.",
    )
    table.add_column("agent", style="bold")
    table.add_column("environment")
    for title in titles:
        table.add_column(escape(title), justify="right")
    entries = results["summary"] if several else rows
    for place, entry in enumerate(entries):
        last = place + 1 == len(entries) or entries[place + 1]["env"] != entry["env"]
        texts = ["\n".join(filter(None, cell)) for cell in (summary_cells if several else cells)(entry)]
        table.add_row(escape(entry["agent"]), env_label(entry["env"]), *map(escape, texts), end_section=last)
    return table


def markdown_table(results: Results) -> str:
    """Return the table as Markdown, a line per row."""
    rows = [(row["agent"], env_label(row["env"]), row["memory"], cells(row)) for row in results["rows"]]
    several = len({row["memory"] for row in results["rows"]}) > 1
    return render("table.md.jinja", titles=[column.title for column in MEASURED_COLUMNS], several=several, rows=rows)
