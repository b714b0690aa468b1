"""`creative-nao evaluate verify` and `evaluate leaderboard`: what can be done with results that are there."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console
from rich.table import Table

from creative_nao.cli.evaluate import JobOptions, executor_for, job_display
from creative_nao.cli.terminal import print_result
from creative_nao.errors import SettingsError
from creative_nao.evaluation.leaderboard import leaderboard, with_record
from creative_nao.evaluation.pages import env_label
from creative_nao.evaluation.verification import TOLERANCE, Verification, verify

DOES_NOT_HOLD = 1
"""Exit code of `verify` for a file whose figures are not repeated."""


@dataclass(frozen=True)
class LeaderboardSettings:
    """Compare finished runs: write the leaderboard to stdout, as Markdown."""

    runs: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Finished run folders."""

    def run(self) -> int:
        """Write the leaderboard to stdout and return the exit code."""
        if not self.runs:
            raise SettingsError("leaderboard: name run folders, as in `creative-nao evaluate leaderboard runs/mine`")
        sys.stdout.write(leaderboard({str(folder / "results.json"): with_record(folder) for folder in self.runs}))
        return 0


@dataclass(frozen=True)
class VerifySettings(JobOptions):
    """Play episodes of a result file again and say whether its figures hold; the exit code is 1 if they do not."""

    file: tyro.conf.Positional[Path]
    """Result file, or the run folder that holds it."""
    sample: int = 6
    """Episodes to play again, spread over the file; 0: all."""
    row: int | None = None
    """Only this row of the file, counted from 1; default: all."""

    def run(self) -> int:
        """Play the episodes again; return 0 if the file holds, 1 if not."""
        path = self.file / "results.json" if self.file.is_dir() else self.file
        with job_display() as show:
            verification = verify(
                path, trusted=self.trust, n_sample=self.sample, row=self.row, executor=executor_for(self),
                on_progress=show,
            )  # fmt: skip
        figures = {
            "holds": verification.holds,
            "exact": verification.exact,
            **dataclasses.asdict(verification),
        }
        if not self.json:
            (Console() if sys.stdout.isatty() else Console(width=140)).print(_table(verification, path))
        print_result(figures, _lines(verification, path), as_json=self.json)
        return 0 if verification.holds else DOES_NOT_HOLD


def run(settings: VerifySettings | LeaderboardSettings) -> int:
    """Run the command chosen."""
    return settings.run()


def _table(verification: Verification, path: Path) -> Table:
    table = Table("agent", "environment", "memory", title=f"Played again from {path}")
    for title in ("seed", "published", "found", "holds"):
        table.add_column(title, justify="right")
    for check in verification.checks:
        figures = (f"{check.published:.6f}", f"{check.found:.6f}", "yes" if check.holds else "NO")
        table.add_row(check.agent, env_label(check.env), check.memory, str(check.seed), *figures)
    return table


def _lines(verification: Verification, path: Path) -> Iterator[str]:
    yield from (*verification.differences, *verification.contradictions)
    n_bad = sum(not check.holds for check in verification.checks) + len(verification.contradictions)
    exact = "to the bit" if verification.exact else f"within {TOLERANCE:.0%}, for not everything is as it was"
    verdict = f"holds {exact}" if verification.holds else f"does NOT hold: {n_bad} of its figures are not repeated"
    yield f"{len(verification.checks)} episodes played again: {path} {verdict}"
