"""An evaluation from a suite to its run folder: jobs, results, table, figures, report."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao import atomic
from creative_nao.evaluation.executors import Executor, LocalExecutor
from creative_nao.evaluation.folder import hashes, open_folder, write_record
from creative_nao.evaluation.jobs import plan
from creative_nao.evaluation.protocol import write_episodes
from creative_nao.evaluation.result_checks import naming
from creative_nao.evaluation.results import Measured, collect, make_results, write_results
from creative_nao.evaluation.runner import Progress
from creative_nao.evaluation.suites import Suite
from creative_nao.evaluation.tables import markdown_table


@dataclass(frozen=True)
class Evaluation:
    """A finished evaluation."""

    folder: Path
    results: dict[str, Any]
    """The content of `results.json`."""
    measured: Measured
    record: dict[str, Any]
    """The content of `run.json`."""


def evaluate(
    suite: Suite,
    folder: Path,
    *,
    seed: int = 0,
    executor: Executor | None = None,
    resume: bool = False,
    command: str | None = None,
    on_progress: Callable[[Progress], None] = lambda _: None,
) -> Evaluation:
    """Evaluate `suite` and write everything into a run folder.

    Args:
        suite: What to evaluate.
        folder: Run folder: new or empty, or with `resume` one to be continued.
        seed: Seed of the whole evaluation: same seed, same results, whatever the number of workers.
        executor: Where the jobs run; this machine, on all its cores, unless given.
        resume: Continue the folder: finished jobs are not done again.
        command: How to type the run again, for the record and the report.
        on_progress: Called several times a second while jobs run.

    Raises:
        MissingDependencyError: If dm-control is missing; the report shows movements on the robot.
        SettingsError: If the folder holds another run, or a count is below 1.
        NotFoundError: If there is nothing to resume, or a name of the suite is unknown.
        JobError: If a job failed at every attempt.
        KeyboardInterrupt: After Ctrl-C; finished jobs stay and can be resumed.
    """
    importlib.import_module("creative_nao.robot.modelling")  # what is missing is told now, not after the last job
    jobs = plan(suite, base_seed=seed)
    record = open_folder(folder, suite, base_seed=seed, resume=resume, command=command)
    executor = LocalExecutor.on_all_cores() if executor is None else executor
    start = time.monotonic()
    done = executor.run(jobs, folder, on_progress)
    with naming(f"results in {folder / 'jobs'}"):
        measured = collect(suite, [{"kind": job.kind, "spec": job.spec, "result": done[job.name]} for job in jobs])
        results = make_results(suite, measured, base_seed=seed)
    write_results(folder / "results.json", results)
    write_episodes(folder / "episodes.csv", measured.episodes)
    atomic.write_text(folder / "table.md", markdown_table(results))
    record = {
        **record,
        "seeds": list(range(suite.n_seeds)),
        "n_workers": executor.n_workers,
        "seconds": round(time.monotonic() - start + record.get("seconds", 0.0), 1),
    }
    # Drawing is loaded here: the jobs' processes import this package too and draw nothing.
    from creative_nao.evaluation.report import write_report

    write_report(folder, suite, results, measured, record)
    record["hashes"] = hashes(folder)
    write_record(folder, record)
    return Evaluation(folder, results, measured, record)
