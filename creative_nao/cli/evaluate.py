"""`creative-nao evaluate SUITE`, `evaluate verify` and `evaluate leaderboard`: compare agents, check results."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import json
import shlex
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from rich.table import Table

from creative_nao.agents.registry import split_name
from creative_nao.cli.terminal import Display, Terminal, print_result
from creative_nao.errors import NotFoundError, SettingsError, nearest_name, shown
from creative_nao.evaluation.leaderboard import leaderboard, with_record
from creative_nao.evaluation.pages import conditions_table, env_label, terminal_table
from creative_nao.evaluation.run import evaluate
from creative_nao.evaluation.runner import Executor, LocalExecutor, Progress
from creative_nao.evaluation.suites import SUFFIX, SUITE_NAMES, Suite, check_agent, find_suite, suite_from_values
from creative_nao.evaluation.verification import TOLERANCE, Verification, verify
from creative_nao.schema import Count, Seed, checked

INTERRUPTED = 130
DOES_NOT_HOLD = 1
"""Exit code of `verify` for a file whose figures are not repeated."""
FILES = {"report.html": "report", "results.json": "results", "episodes.csv": "every action", "run.json": "record"}


@dataclass(frozen=True, kw_only=True)
class JobOptions:
    """Where jobs run and what may be imported for them."""

    n_workers: int | None = None
    """Most processes at a time, without influence on results; default: the available cores."""
    scheduler: str | None = None
    """Address of a Dask scheduler, such as tcp://node1:8786: jobs run on its workers instead of on this machine."""
    trust: bool = False
    """Import and run the modules that a suite or result file names (package.module:factory): for your own files."""
    json: bool = False
    """Print the results as JSON instead of the table."""


@dataclass(frozen=True)
class EvaluateSettings(JobOptions):
    """Compare agents on a suite; results, figures and a report go to a run folder.

    Further commands: `creative-nao evaluate paper` reproduces the paper, `evaluate verify` plays a result file's
    episodes again, `evaluate leaderboard` compares finished runs; each has a --help of its own.
    """

    suite: tyro.conf.Positional[str] = "quick"
    """`quick`: agents on one memory; `frontier`: what imagining buys; `search`: all agents on memories no training has
    seen; `physical`: what the body changes; `performed`: the best imagining robot in physics; `modulation`: a PB that
    changes while a movement unfolds; `modulated`: who finds most that way; `transfer`: memories of other
    demonstrations; `gestures`: the same agents and figures on sets of recordings, and beside networks memories that
    only mix; `long`, `units4`, `units8`: episodes of 100 movements, memories of 4 and 8 PB units; or a TOML file of
    your own."""
    out: Path | None = None
    """Run folder, which must be new or empty unless --resume is given; default: runs/SUITE-TIMESTAMP."""
    seed: int = 0
    """Seed of the whole evaluation; the same seed gives the same results."""
    resume: bool = False
    """Continue the run folder --out: finished jobs are not done again."""
    agents: str | None = None
    """Only these agents, with commas between: names, shipped bundles, bundle files, or package.module:factory of your
    own; default: those of the suite."""
    memories: str | None = None
    """Only these memories, with commas between: shipped names, parts of the bank, or memory files; default: those of
    the suite."""
    n_seeds: int | None = None
    """Repetitions of everything; default: as the suite says."""
    n_actions: int | None = None
    """Movements performed in an episode; default: as the suite says."""
    n_imagined: str | None = None
    """Movements that each agent looks at, by imagining them, for each one that it performs: numbers with commas
    between; default: as the suite says."""
    demonstrations: tuple[Path, ...] = ()
    """transfer, gestures: folder of recordings, a basic action each, on which the memories are trained; default: those
    of the suite. gestures takes several folders, and deals out those with more than eleven to sets of six or more."""


@dataclass(frozen=True)
class LeaderboardSettings:
    """Compare finished runs: write the leaderboard to stdout, as Markdown."""

    runs: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Finished run folders."""

    def run(self) -> int:
        """Write the leaderboard to stdout and return the exit code."""
        if not self.runs:
            raise SettingsError("leaderboard: name run folders, as in `creative-nao evaluate leaderboard runs/mine`")
        sys.stdout.write(leaderboard({str(folder / "results.json"): with_record(folder) for folder in self.runs}))
        return 0


@dataclass(frozen=True)
class VerifySettings(JobOptions):
    """Play episodes of a result file again and say whether its figures hold; the exit code is 1 if they do not."""

    file: tyro.conf.Positional[Path]
    """Result file, or the run folder that holds it."""
    sample: int = 6
    """Episodes to play again, spread over the file; 0: all."""
    row: int | None = None
    """Only this row of the file, counted from 1; default: all."""

    def run(self) -> int:
        """Play the episodes again; return 0 if the file holds, 1 if not."""
        path = self.file / "results.json" if self.file.is_dir() else self.file
        with job_display() as show:
            verification = verify(
                path, trusted=self.trust, n_sample=self.sample, row=self.row, executor=executor_for(self),
                on_progress=show,
            )  # fmt: skip
        figures = {"holds": verification.holds, "exact": verification.exact, **dataclasses.asdict(verification)}
        if not self.json:
            (Terminal() if sys.stdout.isatty() else Terminal(width=140)).print(_table(verification, path))
        print_result(figures, _lines(verification, path), as_json=self.json)
        return 0 if verification.holds else DOES_NOT_HOLD


def run(settings: EvaluateSettings | VerifySettings | LeaderboardSettings) -> int:
    """Run the command chosen and return the exit code: 0, 1 where a file does not hold, or 130 after Ctrl-C."""
    if not isinstance(settings, EvaluateSettings):
        return settings.run()
    if settings.suite not in SUITE_NAMES and not settings.suite.endswith(SUFFIX):
        raise NotFoundError(
            f"no suite `{settings.suite}`{nearest_name(settings.suite, SUITE_NAMES)}; there are: "
            f"{', '.join(SUITE_NAMES)}, or a file of your own ending in {SUFFIX}"
        )
    executor = executor_for(settings)
    check_options(settings)
    suite, command = _chosen(settings), _command(settings)

    def work(folder: Path) -> tuple[dict[str, Any], list[Table]]:
        with job_display() as show:
            done = evaluate(
                suite,
                folder,
                seed=settings.seed,
                executor=executor,
                resume=settings.resume,
                command=command,
                on_progress=show,
            )
        tables = [terminal_table(done.results)]
        return done.results, [*tables, conditions_table(done.results)] if "conditions" in done.results else tables

    return run_suite(settings, suite.name, command, work, FILES)


def check_options(asked: Any) -> None:
    """Refuse what no suite can be run with, before hours of work; the settings are those of any suite."""
    if asked.resume and asked.out is None:
        raise SettingsError("--resume continues a run folder: name it with --out")
    checked(Seed, asked.seed, "--seed")


def run_suite(
    asked: Any, name: str, command: str, work: Callable[[Path], Any], files: dict[str, str], width: int = 160
) -> int:
    """Let `work` fill a run folder and print its figures or tables; return the exit code: 0, or 130 after Ctrl-C."""
    folder = asked.out or Path("runs") / f"{name}-{datetime.datetime.now():%Y%m%d-%H%M%S}"
    console = Terminal(stderr=True)  # so that --json leaves stdout to the figures
    try:
        figures, tables = work(folder)
    except KeyboardInterrupt:
        scheduler = getattr(asked, "scheduler", None)
        again = f"{command} --out {folder}{'' if scheduler is None else f' --scheduler {scheduler}'} --resume"
        console.print(f"stopped; what is done is kept, continue with: {again}", soft_wrap=True, highlight=False)
        return INTERRUPTED
    if asked.json:
        sys.stdout.write(json.dumps(figures, indent=2, allow_nan=False) + "\n")
    else:
        console = Terminal() if sys.stdout.isatty() else Terminal(width=width)
        for table in tables:
            console.print(table)
    for file, what in files.items():
        console.print(f"{what:>12}: {folder / file}", soft_wrap=True, highlight=False)
    return 0


def executor_for(options: JobOptions) -> Executor:
    """Return where the jobs run."""
    checked(Count | None, options.n_workers, "--n-workers")
    if options.scheduler is not None:
        if options.n_workers is not None:
            raise SettingsError(
                "`--n-workers` counts processes of this machine; with --scheduler the cluster's workers decide"
            )
        from creative_nao.evaluation.runner import DaskExecutor

        return DaskExecutor(options.scheduler)
    return LocalExecutor() if options.n_workers is None else LocalExecutor(options.n_workers)


@contextlib.contextmanager
def job_display() -> Iterator[Callable[[Progress], None]]:
    """While inside, show how many jobs are done, which are at work and how long the rest will take."""
    with Display({"jobs": 0}) as display:
        yield lambda progress: display.show(
            "jobs",
            progress.n_done,
            f"now: {', '.join(progress.running)}" if progress.running else "",
            total=progress.n_total,
            seconds_left=progress.seconds_left,
        )


def _chosen(settings: EvaluateSettings) -> Suite:
    """Return the suite with what the flags change of it."""
    suite = find_suite(settings.suite, trusted=settings.trust)
    changes: dict[str, Any] = {}
    if settings.agents is not None:
        changes["agents"] = tuple(map(check_agent, _listed(settings.agents)))
    if settings.n_imagined is not None:
        changes["n_imagined"] = tuple(_whole(word) for word in _listed(settings.n_imagined))
        if settings.agents is None:  # those of the suite, each once
            changes["agents"] = tuple(dict.fromkeys(split_name(agent)[0] for agent in suite.agents))
    if settings.memories is not None:
        if suite.taught is not None:
            raise SettingsError(f"--memories: suite `{suite.name}` trains its memories; they are chosen by [taught]")
        changes["memories"] = _listed(settings.memories)
    for name in ("n_seeds", "n_actions"):
        if (value := getattr(settings, name)) is not None:
            changes[name] = checked(Count, value, f"--{name.replace('_', '-')}")
    if changes:
        values = dataclasses.asdict(suite) | changes
        suite = suite_from_values(values, where=f"suite `{suite.name}`", check_names=True)
    if not settings.demonstrations:
        return suite
    if suite.taught is None:
        raise SettingsError(
            f"--demonstrations belongs to suites that train memories, as `transfer`; `{suite.name}` has no [taught]"
        )
    others = tuple(name for name in suite.memories if name not in suite.taught.names)
    taught = suite.taught.on(settings.demonstrations)
    return dataclasses.replace(suite, taught=taught, memories=(*others, *taught.names))


def _listed(text: str) -> tuple[str, ...]:
    """Return the words of a list with commas."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _whole(word: str) -> int:
    if not (word.isascii() and word.isdecimal()):
        raise SettingsError(f"--n-imagined should be whole numbers, as 1,8,64, but has {shown(word)}")
    return int(word)


def _command(settings: EvaluateSettings) -> str:
    """Return how to type the run again."""
    words = ["creative-nao", "evaluate", settings.suite, "--seed", str(settings.seed)]
    for name in ("agents", "memories", "n_seeds", "n_actions", "n_imagined"):
        if (value := getattr(settings, name)) is not None:
            words += [f"--{name.replace('_', '-')}", str(value)]
    if settings.demonstrations:
        words += ["--demonstrations", *map(str, settings.demonstrations)]
    return shlex.join(words)


def _table(verification: Verification, path: Path) -> Table:
    table = Table("agent", "environment", "memory", title=f"Played again from {path}")
    for title in ("seed", "published", "found", "holds"):
        table.add_column(title, justify="right")
    for check in verification.checks:
        figures = (f"{check.published:.6f}", f"{check.found:.6f}", "yes" if check.holds else "NO")
        table.add_row(check.agent, env_label(check.env), check.memory, str(check.seed), *figures)
    return table


def _lines(verification: Verification, path: Path) -> Iterator[str]:
    yield from (*verification.differences, *verification.contradictions)
    n_bad = sum(not check.holds for check in verification.checks) + len(verification.contradictions)
    exact = "to the bit" if verification.exact else f"within {TOLERANCE:.0%}, for not everything is as it was"
    verdict = f"holds {exact}" if verification.holds else f"does NOT hold: {n_bad} of its figures are not repeated"
    yield f"{len(verification.checks)} episodes played again: {path} {verdict}"
