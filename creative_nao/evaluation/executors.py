"""Where the jobs of an evaluation run: one interface, a machine or a cluster behind it, the same results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from creative_nao.cores import usable_cores
from creative_nao.evaluation.jobs import Job
from creative_nao.evaluation.runner import Progress, run_jobs


class Executor(Protocol):
    """Does jobs: each in a process of its own, a killed one again, one with a result in the folder never."""

    @property
    def n_workers(self) -> int:
        """Most jobs at a time, as far as is known beforehand."""
        ...

    def run(
        self, jobs: Sequence[Job], folder: Path, on_progress: Callable[[Progress], None]
    ) -> dict[str, dict[str, Any]]:
        """Do all jobs and return their results by name.

        Args:
            jobs: Each after those it needs.
            folder: Run folder, where results and files are written.
            on_progress: Called several times a second.

        Raises:
            JobError: If a job failed at every attempt; the others are finished first.
            KeyboardInterrupt: After Ctrl-C; finished results stay.
        """
        ...


@dataclass(frozen=True)
class LocalExecutor:
    """This machine: an operating-system process per job."""

    n_workers: int

    @classmethod
    def on_all_cores(cls) -> LocalExecutor:
        """Return one that uses every core this process may use."""
        return cls(usable_cores())

    def run(
        self, jobs: Sequence[Job], folder: Path, on_progress: Callable[[Progress], None]
    ) -> dict[str, dict[str, Any]]:
        """Do all jobs and return their results by name."""
        return run_jobs(jobs, folder, n_workers=self.n_workers, on_progress=on_progress)
