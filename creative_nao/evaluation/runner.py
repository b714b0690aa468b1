"""Run jobs, each in a process of its own, on this machine (`LocalExecutor`) or a Dask cluster (`DaskExecutor`).

Both use one queue and give the same results. `in_threads` is for work within a process.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from creative_nao import __version__, storage
from creative_nao.arrays import MAX_FILE_BYTES
from creative_nao.errors import CreativeNaoError, NotFoundError, SettingsError, load_extra
from creative_nao.evaluation.jobs import PARENT, Job, read_result, write_result, write_spec
from creative_nao.runtime import python_command, python_environment, usable_cores
from creative_nao.schema import parse

Item = TypeVar("Item")
Result = TypeVar("Result")

POLL_S = 0.1
END_BYTES = 8_000
"""Of a log, in which its last line is looked for."""
STOP_S = 5.0
"""How long a job's process may take to end when it is asked to."""
CONNECT_S = 10.0
"""How long a Dask scheduler may take to answer."""
N_RETRIES = 2
"""How often Dask tries a job again whose process died; a worker that is lost counts separately, by its own limit."""
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


OnProgress = Callable[[Progress], None]
"""Called several times a second."""
Results = dict[str, dict[str, Any]]
"""Of jobs, by name."""


class _Queue:
    """Starts each job when those it needs are done, longest first, and keeps results and failures.

    A subclass says how many run at a time (`n_slots`), how a job is started (`submit` returns a future), how its result
    arrives (`result` raises JobError when it failed), how much of it is done (`share`), and how all is ended (`stop`).
    """

    ahead = False
    """Whether more jobs are submitted than can run at a time."""

    def __init__(self, jobs: Sequence[Job], folder: Path, on_progress: OnProgress):
        self.jobs, self.folder, self.on_progress = tuple(jobs), folder, on_progress
        self.results: Results = {}
        self.failures: dict[str, str] = {}
        self.futures: dict[str, Any] = {}
        self.started: dict[str, float] = {}

    n_slots: Callable[[], int]
    submit: Callable[[Job], Any]
    result: Callable[[Job, Any], dict[str, Any]]
    stop: Callable[[], None]

    def share(self, job: Job) -> float:
        return 0.0

    def run(self) -> Results:
        found = {job.name: read_result(job, self.folder) for job in self.jobs}
        self.results |= {name: result for name, result in found.items() if result is not None}
        self.begin, self.done_at_begin = time.monotonic(), self._seconds_done()
        try:
            while True:
                for job in [job for job in self._running() if self.futures[job.name].done()]:
                    try:
                        self.results[job.name] = self.result(job, self.futures.pop(job.name))
                    except JobError as error:
                        self.failures[job.name] = str(error)
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
            raise JobError(f"job `{name}`{more} failed: {reason}; mend the cause and add --resume")
        return self.results

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
    pipe = contextlib.nullcontext(subprocess.PIPE)
    with pipe if log is None else storage.open_plain(log, "ab", follow=False) as output:
        return subprocess.Popen(  # noqa: S603 - our own module, our own file
            python_command("creative_nao.evaluation.job_handlers", spec, folder),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            env=python_environment(**ONE_THREAD, **{PARENT: str(os.getpid())}),
            # Ctrl-C reaches the runner alone; it stops its jobs itself.
            start_new_session=True,
        )


@dataclass(frozen=True)
class LocalExecutor:
    """This machine: an operating-system process per job.

    Args:
        n_workers: Most processes at a time, every core unless given; has no influence on results.
        n_attempts: How often a job is started before it counts as failed.
    """

    n_workers: int = dataclasses.field(default_factory=usable_cores)
    n_attempts: int = 3

    def run(self, jobs: Sequence[Job], folder: Path, on_progress: OnProgress = lambda _: None) -> Results:
        """Run all jobs and return their results by name.

        Each runs in a process of its own, a killed one again, one with a result in the folder never.

        Args:
            jobs: Each after those it needs.
            folder: Run folder; specs, results and logs go to its subfolder `jobs`.

        Raises:
            SettingsError: If `n_workers` is below 1.
            JobError: If jobs failed; the others are finished first.
            KeyboardInterrupt: After Ctrl-C, when the processes have been stopped; finished results stay.
        """
        if self.n_workers < 1:
            raise SettingsError(f"`n_workers` should be at least 1, but is {self.n_workers}")
        return _LocalQueue(jobs, folder.absolute(), on_progress, self).run()


class _LocalQueue(_Queue):
    """A thread waits for each job's process and starts it again when it was killed."""

    def __init__(self, jobs: Sequence[Job], folder: Path, on_progress: OnProgress, executor: LocalExecutor):
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
                process = self.processes[job.name] = start_process(job, self.folder, job.file(self.folder, ".log"))
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
        log, last = job.file(self.folder, ".log"), "it could say nothing, perhaps because its log cannot be written"
        with contextlib.suppress(OSError):
            last = next(reversed(storage.read_end(log, END_BYTES).strip().splitlines()), last)
        return f"{last} (log: {log})"

    def share(self, job: Job) -> float:
        # What the job reports, else what its expected duration suggests.
        try:
            return min(1.0, max(0.0, float(storage.read_end(job.file(self.folder, ".progress"), 32))))
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
            job.file(self.folder, ".progress").unlink(missing_ok=True)


def do_job(values: dict[str, Any], files: dict[str, bytes]) -> dict[str, Any]:
    """Do a job on a worker and return `result` with `files`, or `mistake` with what the job said.

    Args:
        values: The job, as `dataclasses.asdict` gives it.
        files: Content of every file that the job reads, by its path in the run folder.

    Raises:
        RuntimeError: If the job's process died; the scheduler then tries again.
    """
    job = parse(Job, values, "job")
    with tempfile.TemporaryDirectory(prefix="creative-nao-") as name:
        folder = Path(name)
        for path, content in files.items():
            storage.write_bytes(folder / path, content)
        process = start_process(job, folder)
        _, errors = process.communicate()
        last = next(reversed(errors.decode("utf-8", "replace").strip().splitlines()), "it said nothing")
        if process.returncode == USER_ERROR:
            return {"mistake": last}
        result = read_result(job, folder)
        if process.returncode != 0 or result is None:
            raise RuntimeError(f"exit code {process.returncode}, {last}")
        return {"result": result, "files": _files(folder, job.writes)}


def _files(folder: Path, paths: Sequence[str]) -> dict[str, bytes]:
    return {path: storage.read_bytes(folder / path, "file of a job", MAX_FILE_BYTES) for path in paths}


@dataclass(frozen=True)
class DaskExecutor:
    """The workers of a Dask scheduler.

    Args:
        address: Address of the scheduler, such as `tcp://node1:8786`, or `tls://` where it asks for certificates.
    """

    address: str

    n_workers: ClassVar[int] = 0
    """Not known before the scheduler is asked: workers come and go while jobs run."""

    def run(self, jobs: Sequence[Job], folder: Path, on_progress: OnProgress = lambda _: None) -> Results:
        """Run all jobs and return their results by name.

        Raises:
            MissingDependencyError: If `distributed` is not installed.
            NotFoundError: If no scheduler answers at the address.
            SettingsError: If a worker has another version of this package.
            JobError: If a job failed at every attempt; the others are finished first.
        """
        distributed: Any = load_extra("distributed", "cluster", "`--scheduler`")
        try:
            client = distributed.Client(self.address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise NotFoundError(
                f"no Dask scheduler at `{self.address}` ({type(error).__name__}); start one with `dask scheduler` and "
                "give the address that it prints, such as tcp://node1:8786"
            ) from None
        with client:
            versions: Any = client.run(package_version)
            for worker, version in versions.items():  # results of two must not be mixed
                if version != __version__:
                    raise SettingsError(
                        f"worker {worker} should have creative-nao {__version__}, as here, but has {version}; "
                        "install the same version on all machines"
                    )
            return _DaskQueue(jobs, folder, on_progress, client).run()


class _DaskQueue(_Queue):
    """Submits every job whose needs are done: the scheduler knows how many run at a time."""

    ahead = True

    def __init__(self, jobs: Sequence[Job], folder: Path, on_progress: OnProgress, client: Any):
        super().__init__(jobs, folder, on_progress)
        self.client = client

    def n_slots(self) -> int:
        return sum(worker["nthreads"] for worker in self.client.scheduler_info(n_workers=-1)["workers"].values())

    def submit(self, job: Job) -> Any:
        files = _files(self.folder, job.reads)
        # `pure` would let the scheduler answer from another run's result of the same name.
        return self.client.submit(
            do_job, dataclasses.asdict(job), files, pure=False, retries=N_RETRIES, priority=int(job.seconds)
        )

    def result(self, job: Job, future: Any) -> dict[str, Any]:
        if future.status != "finished":
            raise JobError(str(future.exception()))
        done = future.result()
        if "mistake" in done:
            raise JobError(done["mistake"])
        for path, content in done["files"].items():
            storage.write_bytes(self.folder / path, content)
        # The result last: a job that has one is never done again, so its files must be there.
        write_result(job, self.folder, done["result"])
        return done["result"]

    def stop(self) -> None:
        self.client.cancel(list(self.futures.values()))


def package_version() -> str:
    """Return the version of this package, as a worker has it."""
    return __version__


Executor = LocalExecutor | DaskExecutor
"""Where jobs run; the results are the same everywhere."""
