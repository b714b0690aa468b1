"""A suite cut into jobs: plain data that a process of its own (`job_handlers.py`) turns into a result file."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from creative_nao import storage
from creative_nao.agents.registry import split_name
from creative_nao.errors import CreativeNaoError
from creative_nao.evaluation.oracle_sets import OracleSet, shipped_oracle_set
from creative_nao.evaluation.suites import Suite, check_agent, slug, trained_here
from creative_nao.model.controls import CONTROLS
from creative_nao.schema import Field, JsonObject, NonNegative, PlainName, load_json, record, save_json

PARENT = "CREATIVE_NAO_RUNNER"
"""Environment variable with the process number of the runner, without which a job's process ends."""
IMAGINING_S = 0.0005
"""Expected seconds to imagine a movement."""
STARTING_S = 4.0
"""Expected seconds until a job's process has loaded physics and network."""

Kind = Literal["teach", "teach-set", "train", "play", "chart"]


@record
class Job:
    """One piece of work.

    Attributes:
        name: Unique in its run folder; also the name of its files.
        kind: What is done: a memory is trained (`teach`), or one of each condition on a set (`teach-set`), an agent is
            trained (`train`), an agent plays episodes (`play`), or a memory's map is scored (`chart`).
        title: What is shown while it runs.
        spec: Everything that decides the result; plain JSON.
        needs: Names of jobs whose files it reads.
        reads: Those files, and `writes` the ones it makes beside its result, as paths in the run folder.
        writes: See `reads`.
        seconds: Expected duration; decides the order and the time left, never a result.
    """

    name: PlainName
    kind: Kind
    title: Annotated[str, Field(max_length=10_000)]
    spec: JsonObject
    needs: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()
    seconds: NonNegative = STARTING_S

    def file(self, folder: Path, suffix: str) -> Path:
        """Return a file of the job: `.json` (what to do), `.result.json`, `.progress` (share that is done), `.log`."""
        return folder / "jobs" / f"{self.name}{suffix}"

    def described(self) -> dict[str, Any]:
        """Return kind and spec as JSON would hold them: a finished job counts only for the same spec."""
        return json.loads(json.dumps({"kind": self.kind, "spec": self.spec}, allow_nan=False))


def read_result(job: Job, folder: Path) -> dict[str, Any] | None:
    """Return the result of a finished job; None when it has none, a damaged one, or one of another spec."""
    path = job.file(folder, ".result.json")
    try:
        found = storage.read_json(path, "result of a job")
    except CreativeNaoError:
        return None
    if not isinstance(found, dict) or found.get("job") != job.described() or not isinstance(found.get("result"), dict):
        return None
    return found["result"]


def write_result(job: Job, folder: Path, result: dict[str, Any]) -> None:
    """Write a job's result in one step."""
    storage.write_json(job.file(folder, ".result.json"), {"job": job.described(), "result": result}, None)


def write_spec(job: Job, folder: Path) -> Path:
    """Write what the job's process reads and return the path."""
    return save_json(job.file(folder, ".json"), job, None)


def read_spec(path: Path) -> Job:
    """Return the job that `write_spec` wrote.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is torn or foreign; the message names the field.
    """
    return load_json(Job, path, "job")


def plan(suite: Suite, *, base_seed: int) -> tuple[Job, ...]:
    """Cut `suite` into jobs: memories and agents are trained, maps scored, agents judged in groups.

    Args:
        suite: What to evaluate.
        base_seed: Seed of the whole evaluation.

    Returns:
        The jobs; each stands after those it needs.

    Raises:
        CreativeNaoError: If an agent cannot take part, as `check_agent` tells.
    """
    taught = _train_memories(suite)
    learning = [agent for agent in suite.agents if trained_here(check_agent(agent))]
    jobs: list[Job] = [*_each_once(taught.values())]
    charted = suite.memories if suite.charted == "all" else suite.shown
    for group in _groups(suite.memories, suite.memories_per_job):
        own = _each_once(taught[memory] for memory in group if memory in taught)
        trained = {
            (agent, memory, seed): _train_agent(suite, agent, memory, seed, base_seed, taught.get(memory))
            for memory in group
            for agent in learning
            for seed in range(suite.n_seeds)
        }
        mapped = [m for m in group if m in charted and (m in suite.shown or oracle_of(suite, m) is None)]
        jobs += [*trained.values(), *(_score_map(suite, memory, taught.get(memory)) for memory in mapped)]
        for agent in suite.agents:
            for seeds in _groups(range(suite.n_seeds), suite.seeds_per_job):
                keys = [(agent, memory, seed) for memory in group for seed in seeds]
                needed = [trained[key] for key in keys if key in trained]
                jobs.append(_play(suite, agent, group, seeds, needed, own, base_seed))
    return tuple(jobs)


def _each_once(jobs: Iterable[Job]) -> tuple[Job, ...]:
    return tuple({job.name: job for job in jobs}.values())


def oracle_of(suite: Suite, memory: str) -> OracleSet | None:
    """Return what the oracle chooses on a memory where that ships; else its map has to be scored first."""
    if suite.taught_seed(memory) is not None:
        return None
    return shipped_oracle_set(memory, suite.n_actions, suite.resolution)


def _groups(values: Sequence[Any], size: int) -> list[Sequence[Any]]:
    return [values[first : first + size] for first in range(0, len(values), size)]


def _memory(suite: Suite, name: str) -> dict[str, Any]:
    """Return where a job finds a memory: by its name, or in a file of the run folder."""
    if suite.taught_seed(name) is None:
        return {"name": name, "file": None}
    group, _, kind = name.rpartition("/")[0].rpartition("/")
    if kind not in CONTROLS:
        return {"name": name, "file": f"memories/{slug(name)}.safetensors"}
    assert suite.taught is not None
    made_of = _memory(suite, f"{group}/{suite.taught.last_network(kind)}/{suite.taught_seed(name)}")
    return {"name": name, "file": made_of["file"], "control": kind, "seed": suite.taught_seed(name)}


def _job(
    kind: Kind, name: str, title: str, spec: dict[str, Any], work_s: float, *needed: Job | None, writes: str = ""
) -> Job:
    """Return a job that takes `work_s` seconds once it has started, after those whose files it reads."""
    before = [job for job in needed if job is not None]
    return Job(
        name=f"{kind}-{name}",
        kind=kind,
        title=title,
        spec=spec,
        needs=tuple(job.name for job in before),
        reads=tuple(file for job in before for file in job.writes),
        writes=(writes,) if writes else (),
        seconds=STARTING_S + work_s,
    )


def _train_memories(suite: Suite) -> dict[str, Job]:
    """Return the job that trains each memory, by the memory's name."""
    if suite.taught is None or not suite.taught.conditions:
        return {name: _train_memory(suite, name) for name in suite.memories if suite.taught_seed(name) is not None}
    found = {}
    for one in suite.taught.sets:
        for seed in suite.taught.seeds:
            names = {kind: f"{one.name}/{kind}/{seed}" for kind in suite.taught.conditions}
            memories = {kind: _memory(suite, name) for kind, name in names.items()}
            files = tuple(memory["file"] for memory in memories.values() if "control" not in memory)
            spec = {
                "set": dataclasses.asdict(one),
                "seed": seed,
                "n_epochs": suite.taught.n_epochs,
                "resolution": suite.resolution,
                "memories": memories,
            }
            title, work_s = f"train memories of {one.name}, seed {seed}", len(files) * suite.taught.n_epochs / 1500.0
            job = _job("teach-set", f"{slug(one.name)}-{seed}", title, spec, work_s)
            found |= dict.fromkeys(names.values(), dataclasses.replace(job, writes=files))
    return found


def _train_memory(suite: Suite, memory: str) -> Job:
    assert suite.taught is not None
    file = _memory(suite, memory)["file"]
    single = ("demonstrations", "teaching_seed", "closed_loop_ratio", "n_epochs")
    spec = {key: getattr(suite.taught, key) for key in single}
    spec |= {"seed": suite.taught_seed(memory), "memory": memory, "file": file}
    return _job("teach", slug(memory), f"train memory {memory}", spec, suite.taught.n_epochs / 1500.0, writes=file)


def _train_agent(suite: Suite, agent: str, memory: str, seed: int, base_seed: int, training: Job | None) -> Job:
    name = f"{agent}-{slug(memory)}-{seed}"
    spec = {
        "agent": agent,
        "env": suite.training_env,
        "memory": _memory(suite, memory),
        "seed": seed,
        "base_seed": base_seed,
        "settings": dataclasses.asdict(suite.ppo),
        "bundle": f"agents/{name}.safetensors",
    }
    title, work_s = f"train {agent}, seed {seed}", suite.ppo.n_generated / 3500.0
    return _job("train", name, title, spec, work_s, training, writes=spec["bundle"])


def _score_map(suite: Suite, memory: str, training: Job | None) -> Job:
    spec = {
        "env": suite.training_env,
        "memory": _memory(suite, memory),
        "resolution": suite.resolution,
        "n_actions": suite.n_actions,
        "chart": f"maps/{slug(memory)}.npz",
        "oracle": "found" if oracle_of(suite, memory) is None else "shipped",
    }
    title, work_s = f"score the map of {memory}", suite.resolution**2 / 20_000.0
    if spec["oracle"] == "found":
        title, work_s = f"{title} and search it with the oracle", suite.resolution**2 / 4000.0
    return _job("chart", slug(memory), title, spec, work_s, training, writes=spec["chart"])


def _play(
    suite: Suite, agent: str, memories: Sequence[str], seeds: Sequence[int], trained: Sequence[Job],
    taught: Sequence[Job], base_seed: int,
) -> Job:  # fmt: skip
    """Return the job in which an agent plays; `trained` makes its bundles, `taught` the memories."""
    cost = dict(suite.seconds_per_action)
    reach = f"{slug(memories[0])}-to-{slug(memories[-1])}" if len(memories) > 1 else slug(memories[0])
    whom = f"evaluate {agent}" if len(memories) == 1 else f"evaluate {agent} on {len(memories)} memories"
    which = f"seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"seed {seeds[0]}"
    spec = {
        "agent": agent,
        "envs": list(suite.envs),
        "memories": [_memory(suite, memory) for memory in memories],
        "seeds": list(seeds),
        "base_seed": base_seed,
        "n_actions": suite.n_actions,
        # Memory by memory, seed by seed; empty for an agent that is not trained here.
        "bundles": [job.spec["bundle"] for job in trained],
        # What made bundles and memories decides the result too.
        "made_by": [job.described() for job in (*trained, *taught)],
    }
    n_looked_at = split_name(agent)[1] or 1
    per_action = sum(cost.get(env, 0.01) for env in suite.envs) + IMAGINING_S * n_looked_at * len(suite.envs)
    work_s = len(seeds) * len(memories) * suite.n_actions * per_action
    name = f"{slug(agent)}-{reach}-{seeds[0]}-{seeds[-1]}"
    return _job("play", name, f"{whom}, {which}", spec, work_s, *trained, *taught)
