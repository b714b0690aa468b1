"""Run jobs: the queue that orders them, one operating-system process for each on this machine, and a thread pool.

`LocalExecutor` runs jobs here, `cluster.DaskExecutor` on a cluster; both use `JobQueue` and give the same results.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from creative_nao import storage
from creative_nao.errors import CreativeNaoError, SettingsError
from creative_nao.evaluation.jobs import PARENT, Job, read_result, write_spec
from creative_nao.runtime import usable_cores

Item = TypeVar("Item")
Result = TypeVar("Result")

POLL_S = 0.1
STOP_S = 5.0
"""How long a job's process may take to end when it is asked to."""
USER_ERROR = 2
"""Exit code of a job that will fail the same way again."""

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)
"""Processes share the cores by their number; threads within them would only compete, and change rounding."""


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


def in_threads(
    items: Sequence[Item],
    work: Callable[[Item], Result],
    n_workers: int,
    on_done: Callable[[int, Item], None] = lambda *_: None,
) -> list[Result]:
    """Return the result of each item, in order: for compiled work that releases Python's lock.

    Args:
        items: What to work on.
        work: The work; it must not depend on the other items.
        n_workers: Items at a time.
        on_done: Called with how many are done and the last of them.
    """
    with ThreadPoolExecutor(n_workers) as pool:
        futures = [pool.submit(work, item) for item in items]
        try:
            results = []
            for place, (item, future) in enumerate(zip(items, futures, strict=True)):
                results.append(future.result())
                on_done(place + 1, item)
            return results
        except BaseException:
            for future in futures:
                future.cancel()
            raise


class Executor(Protocol):
    """Where jobs run: `LocalExecutor` on this machine, `cluster.DaskExecutor` on a cluster, with the same results."""

    @property
    def n_workers(self) -> int:
        """Most jobs at a time, as far as is known beforehand."""
        ...

    def run(
        self, jobs: Sequence[Job], folder: Path, on_progress: Callable[[Progress], None] = ...
    ) -> dict[str, dict[str, Any]]:
        """Run all jobs and return their results by name; see `LocalExecutor.run`."""
        ...


class JobQueue:
    """Starts each job when those it needs are done, longest first, and keeps results and failures.

    A subclass says how a job is started and how its result arrives.
    """

    ahead = False
    """Whether more jobs are submitted than can run at a time."""

    def __init__(self, jobs: Sequence[Job], folder: Path, on_progress: Callable[[Progress], None]):
        self.jobs, self.folder, self.on_progress = tuple(jobs), folder, on_progress
        self.results: dict[str, dict[str, Any]] = {}
        self.failures: dict[str, str] = {}
        self.futures: dict[str, Any] = {}
        self.started: dict[str, float] = {}

    def n_slots(self) -> int:
        """Return how many jobs can run at a time."""
        raise NotImplementedError

    def submit(self, job: Job) -> Any:
        """Start a job and return its future, which has `done`."""
        raise NotImplementedError

    def result(self, job: Job, future: Any) -> dict[str, Any]:
        """Return what a finished job found, with its files in the run folder; raise JobError if it failed."""
        raise NotImplementedError

    def share(self, job: Job) -> float:
        """Return how much of a running job is done."""
        return 0.0

    def stop(self) -> None:
        """End what still runs."""
        raise NotImplementedError

    def log_of(self, name: str) -> str:
        """Return where a job's output can be read, as a part of an error message."""
        return ""

    def run(self) -> dict[str, dict[str, Any]]:
        """Run all jobs and return their results by name."""
        for job in self.jobs:
            if (result := read_result(job, self.folder)) is not None:
                self.results[job.name] = result
        self.begin, self.done_at_begin = time.monotonic(), self._seconds_done()
        try:
            while True:
                self._collect()
                for job in self._ready():
                    self.started[job.name] = time.monotonic()
                    self.futures[job.name] = self.submit(job)
                self.on_progress(self._progress())
                if not self.futures:
                    break
                time.sleep(POLL_S)
        finally:
            self.stop()
        if self.failures:
            name, reason = next(iter(self.failures.items()))
            more = f" and {len(self.failures) - 1} more" if len(self.failures) > 1 else ""
            raise JobError(f"job `{name}`{more} failed: {reason}{self.log_of(name)}; mend the cause and add --resume")
        return self.results

    def _collect(self) -> None:
        for job in self._running():
            if self.futures[job.name].done():
                future = self.futures.pop(job.name)
                try:
                    self.results[job.name] = self.result(job, future)
                except JobError as error:
                    self.failures[job.name] = str(error)

    def _ready(self) -> list[Job]:
        known = set(self.results) | set(self.failures) | set(self.futures)
        ready = [job for job in self.jobs if job.name not in known and set(job.needs) <= set(self.results)]
        ready.sort(key=lambda job: -job.seconds)
        return ready if self.ahead else ready[: max(0, self.n_slots() - len(self.futures))]

    def _running(self) -> list[Job]:
        return [job for job in self.jobs if job.name in self.futures]

    def _seconds_done(self) -> float:
        done = sum(job.seconds for job in self.jobs if job.name in self.results)
        return done + sum(job.seconds * self.share(job) for job in self._running())

    def _progress(self) -> Progress:
        total = sum(job.seconds for job in self.jobs)
        done, elapsed, n_slots = self._seconds_done(), time.monotonic() - self.begin, max(1, self.n_slots())
        # Expectation first, measured speed more and more: ten seconds of it weigh as much as the expectation.
        speed = (done - self.done_at_begin + 10.0 * n_slots) / (elapsed + 10.0)
        return Progress(
            n_done=len(self.results),
            n_total=len(self.jobs),
            share=done / total if total else 1.0,
            running=tuple(job.title for job in self._running()[:n_slots]),
            seconds_left=(total - done) / speed,
        )


def start_process(job: Job, folder: Path, log: Path | None = None) -> subprocess.Popen[bytes]:
    """Write a job's spec and start the process that does it; it ends with this one.

    Args:
        job: The job.
        folder: Run folder.
        log: File to which its output is added; else its output can be read from the process.
    """
    spec = write_spec(job, folder)
    with contextlib.nullcontext(subprocess.PIPE) if log is None else open(log, "ab") as output:
        return subprocess.Popen(  # noqa: S603 - our own module, our own file
            [sys.executable, "-m", "creative_nao.evaluation.job_handlers", str(spec), str(folder)],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            env={**os.environ, **ONE_THREAD, PARENT: str(os.getpid())},
            # Ctrl-C reaches the runner alone; it stops its jobs itself.
            start_new_session=True,
        )


@dataclass(frozen=True)
class LocalExecutor:
    """This machine: an operating-system process per job.

    Args:
        n_workers: Most processes at a time; has no influence on results.
        n_attempts: How often a job is started before it counts as failed.
    """

    n_workers: int
    n_attempts: int = 3

    @classmethod
    def on_all_cores(cls) -> LocalExecutor:
        """Return one that uses every core this process may use."""
        return cls(usable_cores())

    def run(
        self, jobs: Sequence[Job], folder: Path, on_progress: Callable[[Progress], None] = lambda _: None
    ) -> dict[str, dict[str, Any]]:
        """Run all jobs and return their results by name.

        Each runs in a process of its own, a killed one again, one with a result in the folder never.

        Args:
            jobs: Each after those it needs.
            folder: Run folder; specs, results and logs go to its subfolder `jobs`.
            on_progress: Called several times a second.

        Raises:
            SettingsError: If `n_workers` is below 1.
            JobError: If jobs failed; the others are finished first.
            KeyboardInterrupt: After Ctrl-C, when the processes have been stopped; finished results stay.
        """
        if self.n_workers < 1:
            raise SettingsError(f"`n_workers` should be at least 1, but is {self.n_workers}")
        return _LocalQueue(jobs, folder.absolute(), on_progress, self).run()


class _LocalQueue(JobQueue):
    """A thread waits for each job's process and starts it again when it was killed."""

    def __init__(
        self, jobs: Sequence[Job], folder: Path, on_progress: Callable[[Progress], None], executor: LocalExecutor
    ):
        super().__init__(jobs, folder, on_progress)
        self.executor, self.pool = executor, ThreadPoolExecutor(executor.n_workers)
        self.lock, self.stopping = threading.Lock(), False
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def n_slots(self) -> int:
        return self.executor.n_workers

    def submit(self, job: Job) -> Any:
        return self.pool.submit(self._attempt, job)

    def result(self, job: Job, future: Any) -> dict[str, Any]:
        return future.result()

    def _attempt(self, job: Job) -> dict[str, Any]:
        code = n_tried = 0
        while n_tried < self.executor.n_attempts:
            with self.lock:
                if self.stopping:
                    break
                process = self.processes[job.name] = start_process(job, self.folder, job.log_path(self.folder))
            code, n_tried = process.wait(), n_tried + 1
            self._forget_progress(job)
            if code == 0 and (result := read_result(job, self.folder)) is not None:
                return result
            if code == USER_ERROR:
                raise JobError(self._last_line(job))
        ended = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
        tries = f"{n_tried} attempts, " if n_tried > 1 else ""
        raise JobError(f"{tries}{ended}, {self._last_line(job)}")

    def _last_line(self, job: Job) -> str:
        with contextlib.suppress(OSError):
            text = job.log_path(self.folder).read_text(encoding="utf-8", errors="replace").strip()
            if text:
                return text.splitlines()[-1]
        return "it could say nothing, perhaps because its log cannot be written"

    def log_of(self, name: str) -> str:
        return f" (log: {self.folder / 'jobs' / f'{name}.log'})"

    def share(self, job: Job) -> float:
        """Return what the job reports, else what its expected duration suggests."""
        try:
            return float(job.progress_path(self.folder).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return min(0.9, (time.monotonic() - self.started[job.name]) / job.seconds)

    def stop(self) -> None:
        with self.lock:
            self.stopping = True
        running = [process for process in self.processes.values() if process.poll() is None]
        for process in running:
            process.terminate()
        deadline = time.monotonic() + STOP_S
        for process in running:
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
        self.pool.shutdown()
        for job in self._running():
            self._forget_progress(job)
        for part in ("jobs", *{Path(path).parent for job in self.jobs for path in job.writes}):
            storage.sweep(self.folder / part)  # what a killed process was about to write

    def _forget_progress(self, job: Job) -> None:
        with contextlib.suppress(OSError):  # a folder that has vanished or turned read-only is told by who writes there
            job.progress_path(self.folder).unlink(missing_ok=True)
