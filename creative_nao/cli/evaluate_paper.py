"""`creative-nao evaluate paper`: reproduce the paper, claim by claim."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from creative_nao.cli.evaluate import new_folder
from creative_nao.cli.terminal import Display
from creative_nao.errors import SettingsError
from creative_nao.evaluation.paper.bank import CONDITION_NAMES, Report, paper_settings
from creative_nao.evaluation.paper.claims import CONDITION_TITLES, FURTHER, TABLE_I
from creative_nao.evaluation.paper.page import mean_cell, number
from creative_nao.evaluation.paper.run import Reproduction, reproduce
from creative_nao.schema import Count, Seed, checked

SUITE = "paper"
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
    """Reproduce the paper and return the exit code: 0, or 130 after Ctrl-C.

    Raises:
        CreativeNaoError: If the user made a mistake, or no network of a condition could be trained.
    """
    checked(Count | None, asked.n_workers, "--n-workers")
    checked(Seed, asked.seed, "--seed")
    settings = paper_settings(quick=asked.quick, retrain=asked.retrain, seed=asked.seed)
    if asked.resume and asked.out is None:
        raise SettingsError("--resume continues a run folder: name it with --out")
    folder = asked.out or new_folder(SUITE)
    flags = [f"--{settings.source}"] if settings.source != "shipped" else []
    command = " ".join([f"creative-nao evaluate {SUITE}", *flags, f"--seed {settings.seed}"])
    # Progress goes to stderr, so that --json leaves stdout to the figures.
    console = Console(stderr=True)
    try:
        done = reproduce(
            settings, folder, n_workers=asked.n_workers, resume=asked.resume, command=command, watch=_watch
        )
    except KeyboardInterrupt:
        again = f"{command} --out {folder} --resume"
        console.print(f"stopped; what is done is kept, continue with: {again}", soft_wrap=True, highlight=False)
        return 130
    if asked.json:
        sys.stdout.write(json.dumps({**done.results, "claims": done.claims}, indent=2, allow_nan=False) + "\n")
    else:
        console = Console() if sys.stdout.isatty() else Console(width=140)
        console.print(table_i(done))
        console.print(verdicts(done))
    for name, what in (("report.html", "report"), ("reproduction.md", "page"), ("results.json", "results")):
        console.print(f"{what:>12}: {done.folder / name}", soft_wrap=True, highlight=False)
    return 0


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
        cells = [
            text
            for name in CONDITION_NAMES
            for text in (number(measure.paper.get(name), 2), escape(mean_cell(rows[name][measure.field])))
        ]
        table.add_row(escape(f"{measure.title} [{measure.unit}]"), *cells)
    return table


def verdicts(done: Reproduction) -> Table:
    """Return the verdict on each claim for a terminal."""
    table = Table(title="What the paper says, and whether it holds over seeds")
    table.add_column("claim")
    table.add_column("verdict")
    for claim in done.claims:
        table.add_row(claim["says"], claim["verdict"], style=COLOURS[claim["verdict"]])
    return table


@contextlib.contextmanager
def _watch(totals: dict[str, int]) -> Iterator[Report]:
    with Display(totals) as display:
        yield display.show
