"""`creative-nao evaluate SUITE`: compare agents, or reproduce the paper; ends with a table and a report.

Also here:
- `creative-nao evaluate leaderboard` and `verify`: what can be done with results that are there.
"""

from __future__ import annotations

import dataclasses
import datetime
import json
import shlex
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar
from rich.table import Table

from creative_nao.demonstrations import load_demonstrations
from creative_nao.errors import NotFoundError, SettingsError, nearest_name
from creative_nao.evaluation.publishing import leaderboard, publish, with_record
from creative_nao.evaluation.run import Evaluation, evaluate
from creative_nao.evaluation.runner import Executor, LocalExecutor, Progress
from creative_nao.evaluation.suites import SUFFIX, SUITE_NAMES, Suite, check_agent, find_suite
from creative_nao.evaluation.tables import env_label, terminal_table
from creative_nao.evaluation.verification import TOLERANCE, Verification, verify

DOES_NOT_HOLD = 1


def run_leaderboard(runs: tuple[Path, ...], docs: Path | None) -> int:
    """Write the pages into `docs`, or without it the leaderboard to stdout; return the exit code."""
    if not runs and docs is None:
        raise SettingsError("leaderboard: name the run folders, as in `creative-nao evaluate leaderboard runs/mine`")
    if docs is None:
        found = {str(folder / "results.json"): with_record(folder) for folder in runs}
        sys.stdout.write(leaderboard(found))
        return 0
    for path in publish(runs, docs):
        Console(stderr=True).print(f"written: {path}", soft_wrap=True, highlight=False)
    return 0


def run_verify(
    files: tuple[Path, ...],
    *,
    trusted: bool,
    n_sample: int,
    row: int | None,
    as_json: bool,
    executor: Executor,
    on_progress: Callable[[Progress], None],
) -> int:
    """Play episodes of a result file again; return 0 if it holds, 1 if not."""
    if len(files) != 1:
        raise SettingsError("verify: name one result file, as in `creative-nao evaluate verify runs/mine/results.json`")
    path = files[0] / "results.json" if files[0].is_dir() else files[0]
    found = verify(path, trusted=trusted, n_sample=n_sample, row=row, executor=executor, on_progress=on_progress)
    if as_json:
        sys.stdout.write(json.dumps(_plain(found), indent=2, allow_nan=False) + "\n")
    else:
        _print(found, path)
    return 0 if found.holds else DOES_NOT_HOLD


def _plain(found: Verification) -> dict[str, object]:
    return {
        "holds": found.holds,
        "exact": found.exact,
        "checks": [vars(check) for check in found.checks],
        "differences": list(found.differences),
        "contradictions": list(found.contradictions),
    }


def _print(found: Verification, path: Path) -> None:
    console = Console() if sys.stdout.isatty() else Console(width=140)
    table = Table(title=f"Played again from {path}")
    for title in ("agent", "environment", "memory"):
        table.add_column(title)
    for title in ("seed", "published", "found", "holds"):
        table.add_column(title, justify="right")
    for check in found.checks:
        figures = (f"{check.published:.6f}", f"{check.found:.6f}", "yes" if check.holds else "NO")
        table.add_row(check.agent, env_label(check.env), check.memory, str(check.seed), *figures)
    console.print(table)
    for line in (*found.differences, *found.contradictions):
        console.print(line, soft_wrap=True, highlight=False)
    n_bad = sum(not check.holds for check in found.checks) + len(found.contradictions)
    how = "to the bit" if found.exact else f"within {TOLERANCE:.0%}, for not everything is as it was"
    said = f"holds {how}" if found.holds else f"does NOT hold: {n_bad} of its figures are not repeated"
    console.print(f"{len(found.checks)} episodes played again: {path} {said}", soft_wrap=True, highlight=False)


PAPER, PAPER_FLAGS = "paper", ("quick", "retrain")
LEADERBOARD, VERIFY = "leaderboard", "verify"

PLAIN_EVERY_S = 15.0
"""Between two lines of progress where no terminal can show a bar."""


@dataclass(frozen=True)
class EvaluateSettings:
    """Compare agents on a suite, or reproduce the paper; results, figures and a report go to a run folder."""

    suite: tyro.conf.Positional[str] = "quick"
    """`quick`: agents on one memory; `search`: all agents on memories no training has seen; `physical`: what the body
    changes; `performed`: the same for the best agent on all of these memories; `modulation`: a PB that changes while a
    movement unfolds; `transfer`: memories of other demonstrations; a TOML file of your own; `paper`: the paper's Table
    I, figures and conclusions over many networks; `leaderboard`: compare finished runs; `verify`: play a result file's
    episodes again."""
    files: tyro.conf.Positional[tuple[Path, ...]] = ()
    """leaderboard: finished run folders; verify: a result file or run folder."""
    out: Path | None = None
    """Run folder, which must be new or empty unless --resume is given; default: runs/SUITE-TIMESTAMP."""
    seed: int = 0
    """Seed of the whole evaluation; the same seed gives the same results."""
    n_workers: int | None = None
    """Most processes at a time, without influence on results; default: the available cores."""
    resume: bool = False
    """Continue the run folder --out: finished jobs are not done again."""
    json: bool = False
    """Print results.json instead of the table."""
    agents: str | None = None
    """Only these agents, with commas between: names, shipped bundles, bundle files, or package.module:factory of your
    own; default: those of the suite."""
    demonstrations: Path | None = None
    """transfer: folder of CSV recordings, a basic action each, on which the memories are trained; default: those of the
    suite."""
    scheduler: str | None = None
    """Address of a Dask scheduler, such as tcp://node1:8786: jobs run on its workers instead of on this machine."""
    sample: int = 6
    """verify: episodes to play again, spread over the file; 0: all."""
    trust: bool = False
    """Import and run the modules that a suite or result file names (package.module:factory): for your own files."""
    row: int | None = None
    """verify: only this row of the file, counted from 1; default: all."""
    quick: bool = False
    """paper: train a few networks for a short time, to see in minutes what it looks like."""
    retrain: bool = False
    """paper: train ten networks a condition in the run folder instead of taking the shipped ones."""
    docs: Path | None = None
    """Bring result files and the pages that stand on them into this documentation folder."""


def run(settings: EvaluateSettings) -> int:
    """Evaluate and return the exit code: 0, or 130 after Ctrl-C.

    Raises:
        CreativeNaoError: If the user made a mistake, or a job failed at every attempt.
    """
    _check(settings)
    if settings.suite == PAPER:
        return _paper(settings)
    if settings.suite == LEADERBOARD:
        return run_leaderboard(settings.files, settings.docs)
    # Progress goes to stderr, so that --json leaves stdout to the figures.
    console = Console(stderr=True)
    executor = _executor(settings)
    if settings.suite == VERIFY:
        with _Display(console) as display:
            return run_verify(
                settings.files, trusted=settings.trust, n_sample=settings.sample, row=settings.row,
                as_json=settings.json, executor=executor, on_progress=display.show,
            )  # fmt: skip
    suite = _chosen(settings)
    if settings.docs is not None and not settings.docs.is_dir():
        raise SettingsError(f"--docs should name the folder of the documentation, but {settings.docs} is none")
    stamp = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    folder = settings.out or Path("runs") / f"{suite.name}-{stamp}"
    words = _words(settings)
    try:
        with _Display(console) as display:
            evaluation = evaluate(
                suite,
                folder,
                seed=settings.seed,
                executor=executor,
                resume=settings.resume,
                command=words,
                on_progress=display.show,
            )
    except KeyboardInterrupt:
        where = "" if settings.scheduler is None else f" --scheduler {settings.scheduler}"
        again = f"{words} --out {folder}{where} --resume"
        console.print(f"stopped; finished jobs are kept, continue with: {again}", soft_wrap=True, highlight=False)
        return 130
    _show(evaluation, as_json=settings.json, console=console)
    if settings.docs is not None:
        return run_leaderboard((folder,), settings.docs)
    return 0


def _check(settings: EvaluateSettings) -> None:
    """Refuse what cannot be done, before anything starts."""
    known = (*SUITE_NAMES, PAPER, LEADERBOARD, VERIFY)
    if settings.suite not in known and not settings.suite.endswith(SUFFIX):
        raise NotFoundError(
            f"no suite `{settings.suite}`{nearest_name(settings.suite, known)}; there are: {', '.join(known)}, "
            f"or a file of your own ending in {SUFFIX}"
        )
    if settings.resume and settings.out is None:
        raise SettingsError("--resume continues a run folder: name it with --out")
    if settings.n_workers is not None and settings.n_workers < 1:
        raise SettingsError(f"`--n-workers` should be at least 1, but is {settings.n_workers}")
    if settings.n_workers is not None and settings.scheduler is not None:
        raise SettingsError(
            "`--n-workers` counts processes of this machine; with --scheduler the cluster's workers decide"
        )
    if settings.seed < 0:
        raise SettingsError(f"`--seed` should be at least 0, but is {settings.seed}")
    if settings.files and settings.suite not in (LEADERBOARD, VERIFY):
        raise SettingsError(f"`{settings.files[0]}`: files belong to leaderboard and verify, not to `{settings.suite}`")
    if settings.suite != PAPER and (given := [name for name in PAPER_FLAGS if getattr(settings, name)]):
        raise SettingsError(f"--{given[0]} belongs to `creative-nao evaluate {PAPER}`, not to `{settings.suite}`")
    own = [name for name in ("agents", "demonstrations", "scheduler") if getattr(settings, name) is not None]
    if settings.suite == PAPER and own:
        raise SettingsError(f"--{own[0]} belongs to suites of agents, not to `{PAPER}`")


def _chosen(settings: EvaluateSettings) -> Suite:
    """Return the suite with what the flags change of it."""
    suite = find_suite(settings.suite, trusted=settings.trust)
    if settings.agents is not None:
        names = tuple(name.strip() for name in settings.agents.split(",") if name.strip())
        suite = dataclasses.replace(suite, agents=tuple(map(check_agent, names)))
    if settings.demonstrations is None:
        return suite
    if suite.taught is None:
        raise SettingsError(
            f"--demonstrations belongs to suites that train memories, as `transfer`; `{suite.name}` has no [taught]"
        )
    load_demonstrations(settings.demonstrations)  # its mistakes are told now
    return dataclasses.replace(
        suite, taught=dataclasses.replace(suite.taught, demonstrations=str(settings.demonstrations))
    )


def _words(settings: EvaluateSettings) -> str:
    """Return how to type the run again."""
    words = ["creative-nao", "evaluate", settings.suite, "--seed", str(settings.seed)]
    for name in ("agents", "demonstrations"):
        if (value := getattr(settings, name)) is not None:
            words += [f"--{name}", str(value)]
    return shlex.join(words)


def _executor(settings: EvaluateSettings) -> Executor:
    if settings.scheduler is not None:
        from creative_nao.evaluation.cluster import DaskExecutor

        return DaskExecutor(settings.scheduler)
    return LocalExecutor.on_all_cores() if settings.n_workers is None else LocalExecutor(settings.n_workers)


def _paper(settings: EvaluateSettings) -> int:
    from creative_nao.cli.evaluate_paper import PaperRequest, run_paper

    values = {field.name: getattr(settings, field.name) for field in dataclasses.fields(PaperRequest)}
    return run_paper(PaperRequest(**values))


def _show(evaluation: Evaluation, *, as_json: bool, console: Console) -> None:
    if as_json:
        sys.stdout.write(json.dumps(evaluation.results, indent=2, allow_nan=False) + "\n")
    else:
        out = Console() if sys.stdout.isatty() else Console(width=160)
        out.print(terminal_table(evaluation.results))
        console = out
    for name, what in (
        ("report.html", "report"),
        ("results.json", "results"),
        ("episodes.csv", "every action"),
        ("run.json", "record"),
    ):
        console.print(f"{what:>12}: {evaluation.folder / name}", soft_wrap=True, highlight=False)


class _Display:
    """A bar on a terminal, a line now and then elsewhere.

    Unlike `progress.Display` it does not know the pieces of work beforehand, and shows which are at work.
    """

    def __init__(self, console: Console):
        self.console, self.last, self.n_done = console, 0.0, -1
        self.bar = Bar(
            TextColumn("jobs"),
            MofNCompleteColumn(),
            BarColumn(bar_width=30),
            TextColumn("{task.fields[left]}"),
            TextColumn("{task.fields[work]}", style="dim"),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )

    def __enter__(self) -> _Display:
        self.bar.start()
        self.task = self.bar.add_task("jobs", total=None, left="", work="")
        return self

    def __exit__(self, *exception: object) -> None:
        self.bar.stop()

    def show(self, progress: Progress) -> None:
        """Show how far the jobs are."""
        left = f"{_duration(progress.seconds_left)} left"
        work = ", ".join(progress.running)
        if self.console.is_terminal:
            # Jobs are counted; how far the running ones are shows in the time left.
            self.bar.update(self.task, total=progress.n_total, completed=progress.n_done, left=left, work=work)
        elif progress.running and (progress.n_done != self.n_done or time.monotonic() - self.last >= PLAIN_EVERY_S):
            self.last, self.n_done = time.monotonic(), progress.n_done
            line = f"{progress.n_done} of {progress.n_total} jobs done, about {left}, now: {work}"
            self.console.print(line, soft_wrap=True, highlight=False)


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
