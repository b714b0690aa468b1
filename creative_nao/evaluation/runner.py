"""Jobs on one machine: a process each, some at a time; a killed one is tried again, a finished one never.

Also here:
- Where the jobs of an evaluation run: one interface, a machine or a cluster behind it, the same results.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from creative_nao import storage
from creative_nao.errors import CreativeNaoError, SettingsError
from creative_nao.evaluation.job_handlers import PARENT
from creative_nao.evaluation.jobs import Job, read_result, write_spec
from creative_nao.runtime import usable_cores

POLL_S = 0.1
STOP_S = 5.0
"""How long a worker may take to end when it is asked to."""

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)
"""Workers share the cores by their number; threads within them would only fight, and change rounding."""


class JobError(CreativeNaoError, RuntimeError):
    """A job failed at every attempt."""


@dataclass(frozen=True)
class Progress:
    """How far the jobs are."""

    n_done: int
    n_total: int
    share: float
    """Share of the expected work that is done."""
    running: tuple[str, ...]
    """Titles of the jobs at work."""
    seconds_left: float


@dataclass
class _Worker:
    job: Job
    process: subprocess.Popen[bytes]
    started: float = field(default_factory=time.monotonic)


def run_jobs(
    jobs: Sequence[Job],
    folder: Path,
    *,
    n_workers: int,
    n_attempts: int = 3,
    on_progress: Callable[[Progress], None] = lambda _: None,
) -> dict[str, dict[str, Any]]:
    """Do all jobs and return their results by name; those with a result in `folder` are not done again.

    Args:
        jobs: Each after those it needs.
        folder: Run folder; specs, results and logs go to its subfolder `jobs`.
        n_workers: Most processes at a time; has no influence on results.
        n_attempts: How often a job is started before it counts as failed.
        on_progress: Called several times a second.

    Raises:
        SettingsError: If `n_workers` is below 1.
        JobError: If jobs failed; the others are finished first.
        KeyboardInterrupt: After Ctrl-C, when the workers have been stopped; finished results stay.
    """
    if n_workers < 1:
        raise SettingsError(f"`n_workers` should be at least 1, but is {n_workers}")
    return _Run(tuple(jobs), folder.absolute(), n_workers, n_attempts, on_progress).work()


class _Run:
    """The state of one call of `run_jobs`."""

    def __init__(
        self,
        jobs: tuple[Job, ...],
        folder: Path,
        n_workers: int,
        n_attempts: int,
        on_progress: Callable[[Progress], None],
    ):
        self.jobs, self.folder, self.n_workers, self.n_attempts = jobs, folder, n_workers, n_attempts
        self.on_progress = on_progress
        self.results: dict[str, dict[str, Any]] = {}
        self.failures: dict[str, str] = {}
        self.attempts = dict.fromkeys((job.name for job in jobs), 0)
        self.workers: list[_Worker] = []

    def work(self) -> dict[str, dict[str, Any]]:
        for job in self.jobs:
            if (result := read_result(job, self.folder)) is not None:
                self.results[job.name] = result
        self.started, self.share_at_start = time.monotonic(), self._seconds_done()
        try:
            while True:
                self._collect()
                self._start()
                self.on_progress(self._progress())
                if not self.workers:
                    break
                time.sleep(POLL_S)
        finally:
            self._stop_all()
        if self.failures:
            name, reason = next(iter(self.failures.items()))
            more = f" and {len(self.failures) - 1} more" if len(self.failures) > 1 else ""
            log = self.folder / "jobs" / f"{name}.log"
            raise JobError(f"job `{name}`{more} failed: {reason} (log: {log}); mend the cause and add --resume")
        return self.results

    def _waiting(self) -> list[Job]:
        """Return the jobs that can start now, longest first."""
        busy = {worker.job.name for worker in self.workers} | set(self.results) | set(self.failures)
        ready = [job for job in self.jobs if job.name not in busy and set(job.needs) <= set(self.results)]
        return sorted(ready, key=lambda job: -job.seconds)

    def _start(self) -> None:
        for job in self._waiting()[: self.n_workers - len(self.workers)]:
            self.attempts[job.name] += 1
            spec = write_spec(job, self.folder)
            with open(job.log_path(self.folder), "ab") as log:
                process = subprocess.Popen(  # noqa: S603 - our own module, our own file
                    [sys.executable, "-m", "creative_nao.evaluation.job_handlers", str(spec), str(self.folder)],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    env={**os.environ, **ONE_THREAD, PARENT: str(os.getpid())},
                    # Ctrl-C reaches the runner alone; it stops the workers itself.
                    start_new_session=True,
                )
            self.workers.append(_Worker(job, process))

    def _collect(self) -> None:
        for worker in [worker for worker in self.workers if worker.process.poll() is not None]:
            self.workers.remove(worker)
            job, code = worker.job, worker.process.returncode
            self._forget_progress(job)
            result = read_result(job, self.folder) if code == 0 else None
            if result is not None:
                self.results[job.name] = result
            elif code == 2 or self.attempts[job.name] >= self.n_attempts:
                self._fail(job, code)

    def _fail(self, job: Job, code: int) -> None:
        try:
            lines = job.log_path(self.folder).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        except OSError:
            lines = []
        said = lines[-1] if lines else "it could say nothing, perhaps because its log cannot be written"
        ended = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
        tries = f"{self.attempts[job.name]} attempts, " if self.attempts[job.name] > 1 else ""
        self.failures[job.name] = said if code == 2 else f"{tries}{ended}, {said}"

    def _stop_all(self) -> None:
        for worker in self.workers:
            worker.process.terminate()
        deadline = time.monotonic() + STOP_S
        for worker in self.workers:
            with contextlib.suppress(subprocess.TimeoutExpired):
                worker.process.wait(max(0.0, deadline - time.monotonic()))
            if worker.process.poll() is None:
                worker.process.kill()
                worker.process.wait()
        for worker in self.workers:
            self._forget_progress(worker.job)
        self.workers.clear()
        for part in ("jobs", *{Path(path).parent for job in self.jobs for path in job.writes}):
            storage.sweep(self.folder / part)  # what a killed worker was about to write

    def _forget_progress(self, job: Job) -> None:
        with contextlib.suppress(OSError):  # a folder that has vanished or turned read-only is told by who writes there
            job.progress_path(self.folder).unlink(missing_ok=True)

    def _share_of(self, worker: _Worker) -> float:
        """Return how much of a running job is done: what it reports, else what its expected duration suggests."""
        try:
            return float(worker.job.progress_path(self.folder).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return min(0.9, (time.monotonic() - worker.started) / worker.job.seconds)

    def _seconds_done(self) -> float:
        done = sum(job.seconds for job in self.jobs if job.name in self.results)
        return done + sum(worker.job.seconds * self._share_of(worker) for worker in self.workers)

    def _progress(self) -> Progress:
        total = sum(job.seconds for job in self.jobs)
        done = self._seconds_done()
        elapsed = time.monotonic() - self.started
        # Expectation first, measured speed more and more: ten seconds of it weigh as much as the expectation.
        speed = (done - self.share_at_start + 10.0 * self.n_workers) / (elapsed + 10.0)
        return Progress(
            n_done=len(self.results),
            n_total=len(self.jobs),
            share=done / total,
            running=tuple(worker.job.title for worker in self.workers),
            seconds_left=(total - done) / speed,
        )


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
