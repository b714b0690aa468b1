"""A run folder and its record `run.json`; `evaluate` fills one from a suite: jobs, results, table, figures, report."""

from __future__ import annotations

import dataclasses
import stat
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from creative_nao import schema, storage
from creative_nao.agents import bundle
from creative_nao.agents.bundle import find_bundle
from creative_nao.arrays import unsealed_sha256
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.evaluation.jobs import plan
from creative_nao.evaluation.pages import markdown_table
from creative_nao.evaluation.protocol import write_episodes
from creative_nao.evaluation.results import Measured, collect, make_results, naming, write_results
from creative_nao.evaluation.runner import Executor, LocalExecutor, Progress
from creative_nao.evaluation.suites import Suite, bundle_of
from creative_nao.model import memory
from creative_nao.model.memory import shipped_memories
from creative_nao.runtime import record, sha256
from creative_nao.schema import Field, JsonObject, LongText, NonNegative, Sha256, Versions

RECORD = "run.json"


@schema.record(closed=False)
class RunRecord:
    """What `run.json` holds: how a run was made. Some fields are written when it is finished."""

    command: LongText
    settings: JsonObject
    versions: Versions
    memories: Annotated[dict[str, Sha256], Field(max_length=schema.MAX_KEYS)] = dataclasses.field(default_factory=dict)
    """SHA-256 of the files that the run reads; bundles and demonstrations too."""
    seconds: NonNegative = 0.0


def open_folder(
    folder: Path,
    settings: Mapping[str, Any],
    *,
    inputs: Mapping[str, str] | None = None,
    resume: bool = False,
    command: str | None = None,
) -> dict[str, Any]:
    """Make a run folder, or open the one to be continued, and return its record.

    Args:
        folder: The run folder.
        settings: Everything that decides the results, as plain values; `settings["suite"]["name"]` names the run.
        inputs: SHA-256 of each file that the run reads.
        resume: Continue what is there.
        command: How to type the run again; the running command unless given.

    Raises:
        SettingsError: If the folder holds something and `resume` is not asked for, or holds another run.
        NotFoundError: If there is nothing to resume.
        FileFormatError: If the record is damaged.
    """
    fresh = record(settings=dict(settings), command=command)
    if inputs is not None:
        fresh["memories"] = dict(inputs)
    filled = folder.exists() and (not folder.is_dir() or any(folder.iterdir()))
    if not resume:
        if filled:
            raise SettingsError(
                f"`--out` {folder} exists and is not empty; add --resume to continue it, or choose another folder"
            )
        write_record(folder, fresh)
        return fresh
    if not (folder / RECORD).is_file():
        way = "choose another folder" if filled else "leave out --resume to start there"
        raise NotFoundError(f"nothing to resume in {folder}: it has no {RECORD}; {way}")
    found = read_record(folder)
    only_plain_files(folder)
    if difference := _difference(found, fresh):
        raise SettingsError(f"{folder} {difference}; choose another folder")
    return found


def _difference(found: dict[str, Any], fresh: dict[str, Any]) -> str | None:
    """Return in which way two records are of different runs, or None."""
    had, wanted = found["settings"], fresh["settings"]
    if (name := had.get("suite", {}).get("name")) != wanted["suite"]["name"]:
        return f"holds suite `{name}`, not `{wanted['suite']['name']}`"
    decisive = wanted["suite"].keys() - {"about"}  # which is prose for the report
    if changed := sorted(key for key in decisive if had["suite"].get(key) != wanted["suite"][key]):
        return f"was started with other settings of suite `{name}` ({', '.join(changed)})"
    for key in wanted:
        if had.get(key) != wanted[key] and key != "suite":
            return f"was started with {key} {had.get(key)}, not {wanted[key]}"
    for name, digest in fresh.get("memories", {}).items():
        if found.get("memories", {}).get(name) != digest:
            return f"was started with another file {name}, which has changed since"
    for package, version in fresh["versions"].items():
        if (before := found["versions"].get(package)) != version:
            return f"was started with {package} {before}, now it is {version}: results of two versions would be mixed"
    return None


def only_plain_files(folder: Path) -> None:
    """Refuse a folder that holds more than files and folders.

    Through a link what writes there could be led to files elsewhere; a pipe or a device would be waited for.

    Raises:
        SettingsError: Naming the first of them.
    """
    for path in sorted(folder.rglob("*")):
        kind = path.lstat().st_mode
        if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
            what = "a link" if stat.S_ISLNK(kind) else "no plain file"
            raise SettingsError(
                f"{path} is {what}: a run that is continued reads and writes plain files of its own folder; remove it"
            )


def read_record(folder: Path) -> dict[str, Any]:
    """Return the record of a run folder as plain values, after checking them.

    Raises:
        NotFoundError: If there is none.
        FileFormatError: If it is damaged; the message names the part.
    """
    path = folder / RECORD
    values = storage.read_json(path, "record of a run", where=f"record {path}")
    schema.parse(RunRecord, values, f"record {path}")
    if not isinstance(values["settings"].get("suite", {}), dict):
        raise FileFormatError(f"record {path}: `settings`: `suite` should be a JSON object")
    return values


def write_record(folder: Path, content: dict[str, Any]) -> Path:
    """Write the record of a run folder in one step."""
    return storage.write_json(folder / RECORD, content)


def input_hashes(suite: Suite) -> dict[str, str]:
    """Return the SHA-256 of each file that a suite brings: memories, bundles and demonstrations.

    Names that only an environment knows are left out, and so are memories that the suite itself trains.
    """
    bundles = dict.fromkeys(map(bundle_of, suite.agents))
    found = {name: _sha256(find_bundle(name)) for name in bundles if name is not None}
    if suite.taught is not None:
        for folder in filter(None, (suite.taught.demonstrations, *(one.demonstrations for one in suite.taught.sets))):
            found |= {str(path): sha256(path) for path in sorted(Path(folder).iterdir()) if not path.is_dir()}
    shipped = set(shipped_memories(None))
    for name in suite.memories:
        path = memory.shipped_file(name) if name in shipped else Path(name)
        if path.is_file():
            found[name] = _sha256(path)
    return found


def _sha256(path: Path) -> str:
    """Return the SHA-256 of a file; of one that ships, as 0.1.0 shipped it: without the digests in its header."""
    if path.parent == memory.PRETRAINED:
        return memory.content_sha256(path)
    return unsealed_sha256(path, kind=bundle.KIND) if path.parent == bundle.PRETRAINED else sha256(path)


def hashes(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of every result in a run folder; the jobs' own files and the record are left out."""
    found = sorted(path for path in folder.rglob("*") if path.is_file() and path.relative_to(folder).parts[0] != "jobs")
    return {str(path.relative_to(folder)): sha256(path) for path in found if path.name != RECORD}


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
    settings = {"suite": dataclasses.asdict(suite), "seed": seed}
    record = open_folder(folder, settings, inputs=input_hashes(suite), resume=resume, command=command)
    executor = LocalExecutor() if executor is None else executor
    start = time.monotonic()
    done = executor.run(jobs, folder, on_progress)
    with naming(f"results in {folder / 'jobs'}"):
        measured = collect(suite, jobs, done)
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
