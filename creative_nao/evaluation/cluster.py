"""Jobs on a cluster: Dask distributed schedules them, this side keeps what is finished.

Also here:
- What a worker of a cluster does: one job in a process of its own, in an empty folder, its files handed back.
"""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from creative_nao import __version__, storage
from creative_nao.errors import MissingDependencyError, NotFoundError, SettingsError
from creative_nao.evaluation.job_handlers import PARENT
from creative_nao.evaluation.jobs import Job, job_from_plain, read_result, write_result, write_spec
from creative_nao.evaluation.runner import ONE_THREAD, JobError, Progress

if TYPE_CHECKING:
    from distributed import Client, Future


MISTAKE = 2
"""Exit code of a job that will fail the same way again."""


def do_job(values: dict[str, Any], files: dict[str, bytes]) -> dict[str, Any]:
    """Do a job and return `result` with `files`, or `mistake` with what the job said.

    Args:
        values: The job, as `dataclasses.asdict` tells it.
        files: Content of every file that the job reads, by its path in the run folder.

    Raises:
        RuntimeError: If the job's process died; the scheduler then tries again.
    """
    job = job_from_plain(values)
    with tempfile.TemporaryDirectory(prefix="creative-nao-") as name:
        folder = Path(name)
        for path, content in files.items():
            storage.write_bytes(folder / path, content)
        spec = write_spec(job, folder)
        done = subprocess.run(  # noqa: S603 - our own module, our own file
            [sys.executable, "-m", "creative_nao.evaluation.job_handlers", str(spec), str(folder)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, **ONE_THREAD, PARENT: str(os.getpid())},
        )
        said = next(reversed(done.stderr.strip().splitlines()), "it said nothing")
        if done.returncode == MISTAKE:
            return {"mistake": said}
        result = read_result(job, folder)
        if done.returncode != 0 or result is None:
            raise RuntimeError(f"exit code {done.returncode}, {said}")
        return {"result": result, "files": {path: (folder / path).read_bytes() for path in job.writes}}


POLL_S = 0.2
CONNECT_S = 10.0
N_RETRIES = 2
"""How often a job whose process died is tried again; a worker that is lost counts separately, by Dask's own limit."""


@dataclass(frozen=True)
class DaskExecutor:
    """The workers of a Dask scheduler.

    Args:
        address: Address of the scheduler, such as `tcp://node1:8786`, or `tls://` where it asks for certificates.
    """

    address: str

    @property
    def n_workers(self) -> int:
        """Not known before the scheduler is asked: workers come and go while jobs run."""
        return 0

    def run(
        self, jobs: Sequence[Job], folder: Path, on_progress: Callable[[Progress], None]
    ) -> dict[str, dict[str, Any]]:
        """Do all jobs and return their results by name.

        Raises:
            MissingDependencyError: If `distributed` is not installed.
            NotFoundError: If no scheduler answers at the address.
            SettingsError: If a worker has another version of this package.
            JobError: If a job failed at every attempt; the others are finished first.
        """
        try:
            from distributed import Client
        except ImportError:
            raise MissingDependencyError(
                "`--scheduler` needs the package `distributed`; install it with `pip install 'creative-nao[cluster]'`"
            ) from None
        try:
            client = Client(self.address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise NotFoundError(
                f"no Dask scheduler at `{self.address}` ({type(error).__name__}); start one with `dask scheduler` and "
                "give the address that it prints, such as tcp://node1:8786"
            ) from None
        with client:
            _check_workers(client)
            return _Run(client, tuple(jobs), folder, on_progress).work()


class _Run:
    """The state of one call of `DaskExecutor.run`."""

    def __init__(
        self, client: Client, jobs: tuple[Job, ...], folder: Path, on_progress: Callable[[Progress], None]
    ) -> None:
        self.client, self.jobs, self.folder, self.on_progress = client, jobs, folder, on_progress
        self.results: dict[str, dict[str, Any]] = {}
        self.failures: dict[str, str] = {}
        self.futures: dict[str, Future] = {}
        self.started = time.monotonic()

    def work(self) -> dict[str, dict[str, Any]]:
        for job in self.jobs:
            if (result := read_result(job, self.folder)) is not None:
                self.results[job.name] = result
        self.n_before = sum(job.seconds for job in self.jobs if job.name in self.results)
        try:
            while True:
                self._collect()
                self._submit()
                self.on_progress(self._progress())
                if not self.futures:
                    break
                time.sleep(POLL_S)
        finally:
            self.client.cancel(list(self.futures.values()))
        if self.failures:
            name, reason = next(iter(self.failures.items()))
            more = f" and {len(self.failures) - 1} more" if len(self.failures) > 1 else ""
            raise JobError(f"job `{name}`{more} failed: {reason}; mend the cause and add --resume")
        return self.results

    def _submit(self) -> None:
        known = set(self.results) | set(self.failures) | set(self.futures)
        for job in sorted(self.jobs, key=lambda job: -job.seconds):
            if job.name in known or not set(job.needs) <= set(self.results):
                continue
            files = {path: (self.folder / path).read_bytes() for path in job.reads}
            # `pure` would let the scheduler answer from another run's result of the same name.
            self.futures[job.name] = self.client.submit(
                do_job, dataclasses.asdict(job), files, pure=False, retries=N_RETRIES, priority=int(job.seconds)
            )

    def _collect(self) -> None:
        jobs = {job.name: job for job in self.jobs}
        for name, future in [(name, future) for name, future in self.futures.items() if future.done()]:
            del self.futures[name]
            if future.status != "finished":
                self.failures[name] = str(future.exception())
                continue
            found = future.result()
            if "mistake" in found:
                self.failures[name] = found["mistake"]
                continue
            for path, content in found["files"].items():
                storage.write_bytes(self.folder / path, content)
            # The result last: a job that has one is never done again, so its files must be there.
            write_result(jobs[name], self.folder, found["result"])
            self.results[name] = found["result"]

    def _progress(self) -> Progress:
        total = sum(job.seconds for job in self.jobs)
        done = sum(job.seconds for job in self.jobs if job.name in self.results)
        n_threads = sum(worker["nthreads"] for worker in self.client.scheduler_info(n_workers=-1)["workers"].values())
        elapsed = time.monotonic() - self.started
        speed = (done - self.n_before + 10.0 * max(1, n_threads)) / (elapsed + 10.0)
        titles = tuple(job.title for job in self.jobs if job.name in self.futures)
        return Progress(
            n_done=len(self.results),
            n_total=len(self.jobs),
            share=done / total,
            running=titles[: max(1, n_threads)],
            seconds_left=(total - done) / speed,
        )


def _check_workers(client: Client) -> None:
    """Results of two versions must not be mixed: every worker should have this one."""
    found: Any = client.run(package_version)  # a coroutine only for asynchronous clients
    for address, version in found.items():
        if version != __version__:
            raise SettingsError(
                f"worker {address} should have creative-nao {__version__}, as here, but has {version}; "
                "install the same version on all machines"
            )


def package_version() -> str:
    """Return the version of this package, as a worker has it."""
    return __version__
