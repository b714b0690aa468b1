"""Jobs on a cluster: Dask distributed schedules them, each runs in a process of its own on a worker.

A worker does a job in an empty folder and hands its files back; this side keeps what is finished.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao import __version__, storage
from creative_nao.errors import MissingDependencyError, NotFoundError, SettingsError
from creative_nao.evaluation.jobs import Job, read_result, write_result
from creative_nao.evaluation.runner import USER_ERROR, JobError, JobQueue, Progress, start_process
from creative_nao.schema import parse

CONNECT_S = 10.0
N_RETRIES = 2
"""How often a job whose process died is tried again; a worker that is lost counts separately, by Dask's own limit."""


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
        return {"result": result, "files": {path: (folder / path).read_bytes() for path in job.writes}}


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
        self, jobs: Sequence[Job], folder: Path, on_progress: Callable[[Progress], None] = lambda _: None
    ) -> dict[str, dict[str, Any]]:
        """Run all jobs and return their results by name.

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
            return _DaskQueue(client, jobs, folder, on_progress).run()


class _DaskQueue(JobQueue):
    """Submits every job whose needs are done: the scheduler knows how many run at a time."""

    ahead = True

    def __init__(self, client: Any, jobs: Sequence[Job], folder: Path, on_progress: Callable[[Progress], None]):
        super().__init__(jobs, folder, on_progress)
        self.client = client

    def n_slots(self) -> int:
        return sum(worker["nthreads"] for worker in self.client.scheduler_info(n_workers=-1)["workers"].values())

    def submit(self, job: Job) -> Any:
        files = {path: (self.folder / path).read_bytes() for path in job.reads}
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


def _check_workers(client: Any) -> None:
    """Results of two versions must not be mixed: every worker should have this one."""
    for address, version in client.run(package_version).items():
        if version != __version__:
            raise SettingsError(
                f"worker {address} should have creative-nao {__version__}, as here, but has {version}; "
                "install the same version on all machines"
            )


def package_version() -> str:
    """Return the version of this package, as a worker has it."""
    return __version__
