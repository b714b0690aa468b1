"""What a worker of a cluster does: one job in a process of its own, in an empty folder, its files handed back.

The worker needs this package and nothing else: no file system is shared. What comes in is a job as plain data and the
bytes of the files it reads; what goes out is plain data and bytes again.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from creative_nao import atomic
from creative_nao.evaluation.job import PARENT
from creative_nao.evaluation.jobs import job_from_plain, read_result, write_spec
from creative_nao.evaluation.runner import ONE_THREAD

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
            atomic.write_bytes(folder / path, content)
        spec = write_spec(job, folder)
        done = subprocess.run(  # noqa: S603 - our own module, our own file
            [sys.executable, "-m", "creative_nao.evaluation.job", str(spec), str(folder)],
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
