"""`creative-nao evaluate paper`: reproduce the paper, claim by claim."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from creative_nao.cli.evaluate import check_options, run_suite
from creative_nao.cli.terminal import Display
from creative_nao.evaluation.paper.bank import CONDITION_NAMES, Report, paper_settings
from creative_nao.evaluation.paper.claims import CONDITION_TITLES, FURTHER, TABLE_I
from creative_nao.evaluation.paper.page import mean_cell, number
from creative_nao.evaluation.paper.run import Reproduction, reproduce
from creative_nao.schema import Count, checked

SUITE = "paper"
FILES = {"report.html": "report", "reproduction.md": "page", "results.json": "results"}
COLOURS = {"holds": "green", "does not hold": "red", "undecided": "dim"}


@dataclass(frozen=True)
class PaperOptions:
    """Reproduce the paper: its Table I, figures and conclusions over many networks, with intervals and verdicts."""

    out: Path | None = None
    """Run folder, which must be new or empty unless --resume is given; default: runs/paper-TIMESTAMP."""
    seed: int = 0
    """Seed of the random draws; the same seed gives the same results."""
    n_workers: int | None = None
    """Networks at a time, without influence on results; default: the available cores."""
    resume: bool = False
    """Continue the run folder --out: what is done is not done again."""
    json: bool = False
    """Print results.json instead of the tables."""
    quick: bool = False
    """Train a few networks for a short time, to see in minutes what it looks like."""
    retrain: bool = False
    """Train ten networks a condition in the run folder instead of taking the shipped ones."""


def run(asked: PaperOptions) -> int:
    """Reproduce the paper and return the exit code: 0, or 130 after Ctrl-C."""
    check_options(asked)
    checked(Count | None, asked.n_workers, "--n-workers")
    settings = paper_settings(quick=asked.quick, retrain=asked.retrain, seed=asked.seed)
    flags = [f"--{settings.source}"] if settings.source != "shipped" else []
    command = " ".join([f"creative-nao evaluate {SUITE}", *flags, f"--seed {settings.seed}"])

    def work(folder: Path) -> tuple[dict[str, Any], list[Table]]:
        done = reproduce(
            settings, folder, n_workers=asked.n_workers, resume=asked.resume, command=command, watch=_watch
        )
        return {**done.results, "claims": done.claims}, [table_i(done), verdicts(done)]

    return run_suite(asked, SUITE, command, work, FILES, width=140)


def table_i(done: Reproduction) -> Table:
    """Return Table I for a terminal: the paper's network beside the mean over ours."""
    rows = {row["memory"]: row for row in done.results["rows"]}
    counts = " / ".join(str(rows[name]["n_seeds"]) for name in CONDITION_NAMES)
    table = Table(title=f"Table I: the paper's network, and ours ({counts} networks, mean and 95 % interval)")
    table.add_column("")
    for name in CONDITION_NAMES:
        table.add_column(f"{CONDITION_TITLES[name]}\npaper", justify="right")
        table.add_column("\nhere", justify="right")
    for measure in (*TABLE_I, *FURTHER):
        cells = [f"{measure.title} [{measure.unit}]"]
        for name in CONDITION_NAMES:
            cells += number(measure.paper.get(name), 2), mean_cell(rows[name][measure.field])
        table.add_row(*map(escape, cells))
    return table


def verdicts(done: Reproduction) -> Table:
    """Return the verdict on each claim for a terminal."""
    table = Table("claim", "verdict", title="What the paper says, and whether it holds over seeds")
    for claim in done.claims:
        table.add_row(claim["says"], claim["verdict"], style=COLOURS[claim["verdict"]])
    return table


@contextlib.contextmanager
def _watch(totals: dict[str, int]) -> Iterator[Report]:
    with Display(totals) as display:
        yield display.show
