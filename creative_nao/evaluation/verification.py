"""Play episodes of a result file again and say whether its figures hold."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao.errors import FileFormatError, NotFoundError, SettingsError
from creative_nao.evaluation.jobs import Job, plan
from creative_nao.evaluation.results import collect, naming, read_results, summarise
from creative_nao.evaluation.run import RECORD, RunRecord, input_hashes, read_record
from creative_nao.evaluation.runner import Executor, LocalExecutor, Progress
from creative_nao.evaluation.suites import Suite, refuse_modules, suite_from_values
from creative_nao.runtime import versions
from creative_nao.schema import JsonObject, Seed, parse, record

TOLERANCE = 0.01
"""Largest relative difference of an episode's reward where versions or the processor differ: 1 %."""
SUMMARY_TOLERANCE = 1e-9
"""Largest relative difference of a mean worked out again from the same numbers."""


@record(closed=False)
class RunSettings:
    """The settings in the record of a suite's run."""

    suite: JsonObject
    seed: Seed


@dataclass(frozen=True)
class Check:
    """An episode that was played again."""

    agent: str
    env: str
    memory: str
    seed: int
    published: float
    found: float
    holds: bool


@dataclass(frozen=True)
class Verification:
    """What playing again has shown."""

    checks: tuple[Check, ...]
    differences: tuple[str, ...]
    """What is not as it was when the file was made: versions, changed memories."""
    contradictions: tuple[str, ...]
    """Where the file contradicts itself: means that do not follow from its own episodes."""

    @property
    def exact(self) -> bool:
        """Whether the same bits were asked for: only on the same versions and memories."""
        return not self.differences

    @property
    def holds(self) -> bool:
        """Whether every episode and every mean holds."""
        return not self.contradictions and all(check.holds for check in self.checks)


def verify(
    path: Path,
    *,
    trusted: bool = False,
    n_sample: int = 6,
    row: int | None = None,
    executor: Executor | None = None,
    on_progress: Callable[[Progress], None] = lambda _: None,
) -> Verification:
    """Play episodes of a result file again.

    Args:
        path: `results.json` of a run folder, or a published file that holds its record itself.
        trusted: Whether agents and environments that the file names with a module are imported.
        n_sample: Episodes to play, spread evenly over all of the file or the row; 0 plays them all.
        row: Only this row, counted from 1.
        executor: Where the episodes are played.
        on_progress: Called several times a second.

    Raises:
        NotFoundError: If the file does not exist, or what it needs is not there any more.
        FileFormatError: If it is no result file, or has no record.
        SettingsError: If there is no such row.
    """
    results = read_results(path)
    made = results.get("record") or (read_record(path.parent) if (path.parent / RECORD).is_file() else None)
    if made is None:
        raise FileFormatError(f"results {path}: no `record`, and no run.json beside it that tells how it was made")
    if n_sample < 0:
        raise SettingsError(f"`--sample` should be at least 0, but is {n_sample}")
    rows = results["rows"]
    if row is not None and not 1 <= row <= len(rows):
        raise SettingsError(f"`--row` should be between 1 and {len(rows)}, the rows of {path}, but is {row}")
    made = parse(RunRecord, made, f"results {path}: record")
    settings = parse(RunSettings, made.settings, f"results {path}: record: `settings`")
    suite = suite_from_values(settings.suite, where=f"results {path}, `settings`")
    if not trusted:
        refuse_modules(suite, f"results {path}")
    with naming(f"results {path}"):
        chosen = _sample(rows if row is None else [rows[row - 1]], n_sample)
        differences = _differences(suite, made)
        jobs = _jobs(suite, settings.seed, {(r["agent"], r["memory"], seed) for r, seed in chosen})
        broken = tuple(contradictions(results, suite.baseline, settings.seed))
    with tempfile.TemporaryDirectory(prefix="creative-nao-") as folder:
        done = (executor or LocalExecutor()).run(jobs, Path(folder), on_progress)
    episodes = collect(suite, jobs, done).episodes
    played = {(found.agent, found.env, found.memory, found.seed): found.reward for found in episodes}
    checks = []
    for entry, seed in chosen:
        key = (entry["agent"], entry["env"], entry["memory"], seed)
        if key not in played:
            raise FileFormatError(f"results {path}: row of {_name(entry)}, {entry['memory']}, is none of its suite's")
        published, found = entry["reward_per_seed"][str(seed)], played[key]
        holds = found == published if not differences else math.isclose(found, published, rel_tol=TOLERANCE)
        checks.append(Check(*key, published, found, holds))
    return Verification(tuple(checks), tuple(differences), broken)


def contradictions(results: Mapping[str, Any], baseline: str, base_seed: int) -> list[str]:
    """Return where a result file's means do not follow from the rewards of its own episodes."""
    found = []
    for row in results["rows"]:
        if not math.isclose(np.mean([*row["reward_per_seed"].values()]), row["reward"]["mean"], rel_tol=1e-9):
            found.append(f"{_name(row)}, {row['memory']}: the mean reward is not that of its episodes")
    again = summarise(results["rows"], baseline=baseline, base_seed=base_seed)
    for entry, published in zip(again, results["summary"], strict=True):
        found += [
            f"{_name(entry)}: `{field}` of the summary does not follow from the rows"
            for field in entry
            if field in published and not _close(entry[field], published[field])  # older files have fewer
        ]
    return found


def _close(one: Any, other: Any) -> bool:
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_close(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_close, one, other))
    if isinstance(one, float) and isinstance(other, int | float):
        return math.isclose(one, other, rel_tol=SUMMARY_TOLERANCE, abs_tol=1e-12)
    return one == other


def _name(entry: Mapping[str, Any]) -> str:
    return f"{entry['agent']} in {entry['env']}"


def _sample(rows: Sequence[Mapping[str, Any]], n_sample: int) -> list[tuple[Mapping[str, Any], int]]:
    """Return pairs of row and seed: of all there are, evenly spread, the same for the same file."""
    for row in rows:
        if "reward_per_seed" not in row:
            raise FileFormatError(
                f"results: row of {_name(row)} has no `reward_per_seed`: it was made by an old version"
            )
    pairs = [(row, int(seed)) for row in rows for seed in row["reward_per_seed"]]
    if n_sample == 0 or n_sample >= len(pairs):
        return pairs
    return [pairs[place] for place in np.linspace(0, len(pairs) - 1, n_sample).round().astype(int)]


def _jobs(suite: Suite, base_seed: int, wanted: set[tuple[str, str, int]]) -> list[Job]:
    """Return the jobs that play an agent on a memory with a seed, and those they need; no other."""
    single = dataclasses.replace(suite, seeds_per_job=1, memories_per_job=1)
    jobs = plan(single, base_seed=base_seed)
    names = set()
    for job in reversed(jobs):  # each stands after those it needs
        spec = job.spec
        is_wanted = job.kind == "play" and (spec["agent"], spec["memories"][0]["name"], spec["seeds"][0]) in wanted
        if is_wanted or job.name in names:
            names |= {job.name, *job.needs}
    return [job for job in jobs if job.name in names]


def _differences(suite: Suite, made: RunRecord) -> list[str]:
    try:
        files = input_hashes(suite)
    except OSError as error:
        raise NotFoundError(f"{error.filename}: {error.strerror}") from None
    changed = [f"{name} is another file than then" for name, was in made.memories.items() if files.get(name) != was]
    now = versions()
    return changed + [
        f"{package} was {version}, now {now.get(package, 'missing')}"
        for package, version in made.versions.items()
        if now.get(package) != version
    ]
