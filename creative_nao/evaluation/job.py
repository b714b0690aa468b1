"""A job's own process: `python -m creative_nao.evaluation.job SPEC.json FOLDER` does one job and writes its result.

A process of its own keeps the result independent of what ran before; one that is killed takes nothing else with it.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from pathlib import Path

from creative_nao import atomic
from creative_nao.errors import CreativeNaoError
from creative_nao.evaluation.jobs import Job, read_spec, write_result

REPORT_EVERY_S = 0.5
PARENT = "CREATIVE_NAO_RUNNER"
"""Environment variable with the process number of the runner."""


def main(arguments: list[str]) -> int:
    """Do the job described in the file `arguments[0]` for the run folder `arguments[1]`; return the exit code."""
    _leave_with_the_runner()
    job, folder = read_spec(Path(arguments[0])), Path(arguments[1])
    from creative_nao.evaluation.work import WORK

    try:
        write_result(job, folder, WORK[job.kind](job.spec, folder, _Reporter(job, folder)))
    except CreativeNaoError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    except OSError as error:
        if error.errno not in atomic.DISK_FAULTS:
            raise
        sys.stderr.write(f"{error.filename}: {error.strerror}\n")
        return 2
    return 0


class _Reporter:
    """Writes the share that is done, not oftener than it is read."""

    def __init__(self, job: Job, folder: Path):
        self.path, self.last = job.progress_path(folder), 0.0

    def __call__(self, share: float) -> None:
        if time.monotonic() - self.last >= REPORT_EVERY_S:
            self.last = time.monotonic()
            atomic.write_text(self.path, f"{share:.4f}")


def _leave_with_the_runner() -> None:
    """End this process when its runner is gone: nobody would collect the result, and the core is wanted elsewhere."""
    runner = os.environ.get(PARENT)
    if runner is None:
        return

    def watch() -> None:
        while os.getppid() == int(runner):
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
