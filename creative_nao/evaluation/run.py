"""An evaluation from a suite to its run folder: jobs, results, table, figures, report.

Also here:
- A run folder: what makes it new, what makes it possible to continue it, and the record `run.json` that it carries.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao import storage
from creative_nao.agents.bundle import find_bundle
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.evaluation.jobs import plan
from creative_nao.evaluation.protocol import write_episodes
from creative_nao.evaluation.resolve_agents import in_bundle
from creative_nao.evaluation.results import Measured, collect, make_results, naming, write_results
from creative_nao.evaluation.runner import Executor, LocalExecutor, Progress
from creative_nao.evaluation.suites import Suite
from creative_nao.evaluation.tables import markdown_table
from creative_nao.fields import Fields
from creative_nao.model.memory import PRETRAINED, shipped_memories
from creative_nao.runtime import record, sha256
from creative_nao.storage import as_json, read_text

RECORD = "run.json"


def open_folder(
    folder: Path, suite: Suite, *, base_seed: int, resume: bool, command: str | None = None
) -> dict[str, Any]:
    """Make a run folder, or open the one to be continued, and return its record.

    Args:
        folder: The run folder.
        suite: What is evaluated there.
        base_seed: Seed of the whole evaluation.
        resume: Continue what is there.
        command: How to type the run again; the running command unless given.

    Raises:
        SettingsError: If the folder holds something and `resume` is not asked for, or holds another run.
        NotFoundError: If there is nothing to resume.
        FileFormatError: If the record is damaged.
    """
    settings = json.loads(json.dumps({"suite": dataclasses.asdict(suite), "seed": base_seed}))
    # "memories" is the name in the records published so far; bundles and demonstrations came to it later.
    fresh = {**record(settings=settings, command=command), "memories": input_hashes(suite)}
    path = folder / RECORD
    if not resume:
        if _holds_something(folder):
            raise SettingsError(
                f"`--out` {folder} exists and is not empty; add --resume to continue it, or choose another folder"
            )
        write_record(folder, fresh)
        return fresh
    if not path.is_file():
        way = "choose another folder" if _holds_something(folder) else "leave out --resume to start there"
        raise NotFoundError(f"nothing to resume in {folder}: it has no {RECORD}; {way}")
    found = read_record(folder)
    refuse_links(folder)
    _same_run(folder, found, fresh)
    return found


def _holds_something(folder: Path) -> bool:
    return folder.exists() and (not folder.is_dir() or any(folder.iterdir()))


def refuse_links(folder: Path) -> None:
    """Refuse a folder with links in it: what writes there could be led to files elsewhere.

    Raises:
        SettingsError: Naming the first link.
    """
    if links := sorted(path for path in folder.rglob("*") if path.is_symlink()):
        raise SettingsError(f"{links[0]} is a link: a run that is continued writes into its own folder only; remove it")


def read_record(folder: Path) -> dict[str, Any]:
    """Return the record of a run folder.

    Raises:
        NotFoundError: If there is none.
        FileFormatError: If it is damaged; the message names the part.
    """
    path = folder / RECORD
    values = as_json(read_text(path, "record of a run"), f"record {path}")
    found = Fields(values, f"record {path}")
    found.text("command", longest=20_000)
    settings, versions = found.object("settings"), found.object("versions")
    for name in versions.values:
        versions.text(name)
    if "suite" in settings:
        settings.object("suite")
    if "memories" in found:
        found.object("memories")
    if "seconds" in found:
        found.number("seconds", least=0.0)
    return values


def write_record(folder: Path, content: dict[str, Any]) -> Path:
    """Write the record of a run folder in one step."""
    return storage.write_text(folder / RECORD, json.dumps(content, indent=2, allow_nan=False) + "\n")


def input_hashes(suite: Suite) -> dict[str, str]:
    """Return the SHA-256 of each file that a suite brings: memories, bundles and demonstrations.

    Names that only an environment knows are left out, and so are memories that the suite itself trains.
    """
    found = {name: sha256(find_bundle(name)) for name in suite.agents if in_bundle(name)}
    if suite.taught is not None and suite.taught.demonstrations is not None:
        folder = Path(suite.taught.demonstrations)
        found |= {str(path): sha256(path) for path in sorted(folder.glob("*.csv"))}
    for name in suite.memories:
        path = PRETRAINED / f"{name.replace('/', '-')}.safetensors" if name in shipped_memories() else Path(name)
        if path.is_file():
            found[name] = sha256(path)
    return found


def hashes(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every result in a run folder; the jobs' own files and the record are left out."""
    found = sorted(path for path in folder.rglob("*") if path.is_file() and path.relative_to(folder).parts[0] != "jobs")
    return {str(path.relative_to(folder)): sha256(path) for path in found if path.name != RECORD}


def _same_run(folder: Path, found: dict[str, Any], fresh: dict[str, Any]) -> None:
    had, wanted = found["settings"], fresh["settings"]
    if had.get("suite", {}).get("name") != wanted["suite"]["name"]:
        raise SettingsError(
            f"{folder} holds suite `{had.get('suite', {}).get('name')}`, not `{wanted['suite']['name']}`; "
            "choose another folder"
        )
    if had.get("seed") != wanted["seed"]:
        raise SettingsError(f"{folder} was started with --seed {had.get('seed')}, not {wanted['seed']}")
    if had != wanted:
        changed = sorted(key for key in wanted["suite"] if had["suite"].get(key) != wanted["suite"][key])
        raise SettingsError(
            f"{folder} was started with other settings of suite `{wanted['suite']['name']}` ({', '.join(changed)}); "
            "choose another folder"
        )
    for name, digest in fresh["memories"].items():
        if found.get("memories", {}).get(name) != digest:
            raise SettingsError(
                f"{folder} was started with another file {name}, which has changed since; choose another folder"
            )
    for package, version in fresh["versions"].items():
        if found["versions"].get(package) != version:
            raise SettingsError(
                f"{folder} was started with {package} {found['versions'].get(package)}, now it is {version}: "
                "results of two versions would be mixed; choose another folder"
            )


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
        SettingsError: If the folder holds another run, or a count is below 1.
        NotFoundError: If there is nothing to resume, or a name of the suite is unknown.
        JobError: If a job failed at every attempt.
        KeyboardInterrupt: After Ctrl-C; finished jobs stay and can be resumed.
    """
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
    storage.write_text(folder / "table.md", markdown_table(results))
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
