"""`creative-nao evaluate leaderboard` and `verify`: what can be done with results that are there."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from creative_nao.errors import SettingsError
from creative_nao.evaluation.executors import Executor
from creative_nao.evaluation.leaderboard import leaderboard
from creative_nao.evaluation.publishing import publish, with_record
from creative_nao.evaluation.runner import Progress
from creative_nao.evaluation.tables import env_label
from creative_nao.evaluation.verification import TOLERANCE, Verification, verify

DOES_NOT_HOLD = 1


def run_leaderboard(runs: tuple[Path, ...], docs: Path | None) -> int:
    """Write the pages into `docs`, or without it the leaderboard to stdout; return the exit code."""
    if not runs and docs is None:
        raise SettingsError("leaderboard: name the run folders, as in `creative-nao evaluate leaderboard runs/mine`")
    if docs is None:
        found = {str(folder / "results.json"): with_record(folder) for folder in runs}
        sys.stdout.write(leaderboard(found))
        return 0
    for path in publish(runs, docs):
        Console(stderr=True).print(f"written: {path}", soft_wrap=True, highlight=False)
    return 0


def run_verify(
    files: tuple[Path, ...],
    *,
    trusted: bool,
    n_sample: int,
    row: int | None,
    as_json: bool,
    executor: Executor,
    on_progress: Callable[[Progress], None],
) -> int:
    """Play episodes of a result file again; return 0 if it holds, 1 if not."""
    if len(files) != 1:
        raise SettingsError("verify: name one result file, as in `creative-nao evaluate verify runs/mine/results.json`")
    path = files[0] / "results.json" if files[0].is_dir() else files[0]
    found = verify(path, trusted=trusted, n_sample=n_sample, row=row, executor=executor, on_progress=on_progress)
    if as_json:
        sys.stdout.write(json.dumps(_plain(found), indent=2, allow_nan=False) + "\n")
    else:
        _print(found, path)
    return 0 if found.holds else DOES_NOT_HOLD


def _plain(found: Verification) -> dict[str, object]:
    return {
        "holds": found.holds,
        "exact": found.exact,
        "checks": [vars(check) for check in found.checks],
        "differences": list(found.differences),
        "contradictions": list(found.contradictions),
    }


def _print(found: Verification, path: Path) -> None:
    console = Console() if sys.stdout.isatty() else Console(width=140)
    table = Table(title=f"Played again from {path}")
    for title in ("agent", "environment", "memory"):
        table.add_column(title)
    for title in ("seed", "published", "found", "holds"):
        table.add_column(title, justify="right")
    for check in found.checks:
        figures = (f"{check.published:.6f}", f"{check.found:.6f}", "yes" if check.holds else "NO")
        table.add_row(check.agent, env_label(check.env), check.memory, str(check.seed), *figures)
    console.print(table)
    for line in (*found.differences, *found.contradictions):
        console.print(line, soft_wrap=True, highlight=False)
    n_bad = sum(not check.holds for check in found.checks) + len(found.contradictions)
    how = "to the bit" if found.exact else f"within {TOLERANCE:.0%}, for not everything is as it was"
    said = f"holds {how}" if found.holds else f"does NOT hold: {n_bad} of its figures are not repeated"
    console.print(f"{len(found.checks)} episodes played again: {path} {said}", soft_wrap=True, highlight=False)
