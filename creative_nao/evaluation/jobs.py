"""A suite cut into jobs: plain data that a process of its own turns into a result file."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from creative_nao import atomic
from creative_nao.agents.registry import TRAINED, check_name
from creative_nao.evaluation.suites import Suite

STARTING_S = 4.0
"""Expected seconds until a job's process has loaded physics and network."""


@dataclass(frozen=True)
class Job:
    """One piece of work.

    Attributes:
        name: Unique in its run folder; also the name of its files.
        kind: `train`, `play` or `chart`.
        title: What is shown while it runs.
        spec: Everything that decides the result; plain JSON.
        needs: Names of jobs whose files it reads.
        seconds: Expected duration; decides the order and the time left, never a result.
    """

    name: str
    kind: str
    title: str
    spec: dict[str, Any]
    needs: tuple[str, ...] = ()
    seconds: float = STARTING_S

    def spec_path(self, folder: Path) -> Path:
        """Return where the job's process reads what to do."""
        return folder / "jobs" / f"{self.name}.json"

    def result_path(self, folder: Path) -> Path:
        """Return where the job's process writes its result."""
        return folder / "jobs" / f"{self.name}.result.json"

    def progress_path(self, folder: Path) -> Path:
        """Return where the job's process says how far it is."""
        return folder / "jobs" / f"{self.name}.progress"

    def log_path(self, folder: Path) -> Path:
        """Return what the job's process printed."""
        return folder / "jobs" / f"{self.name}.log"

    def described(self) -> dict[str, Any]:
        """Return kind and spec as JSON would hold them: a finished job counts only for the same spec."""
        return json.loads(json.dumps({"kind": self.kind, "spec": self.spec}, allow_nan=False))


def plan(suite: Suite, *, base_seed: int) -> tuple[Job, ...]:
    """Cut `suite` into jobs: one training per seed, judging in groups of seeds, one chart per memory.

    Args:
        suite: What to evaluate.
        base_seed: Seed of the whole evaluation.

    Returns:
        The jobs; each stands after those it needs.
    """
    jobs: list[Job] = []
    for memory in suite.memories:
        trained = {
            (agent, seed): _training(suite, agent, memory, seed, base_seed)
            for agent in suite.agents
            if check_name(agent) in TRAINED
            for seed in range(suite.n_seeds)
        }
        jobs += [*trained.values(), _chart(suite, memory)]
        for agent in suite.agents:
            for first in range(0, suite.n_seeds, suite.seeds_per_job):
                seeds = range(first, min(first + suite.seeds_per_job, suite.n_seeds))
                needed = [trained[agent, seed] for seed in seeds if (agent, seed) in trained]
                jobs.append(_judging(suite, agent, memory, seeds, needed, base_seed))
    return tuple(jobs)


def read_result(job: Job, folder: Path) -> dict[str, Any] | None:
    """Return the result of a finished job; None when it has none, a damaged one, or one of another spec."""
    try:
        found = json.loads(job.result_path(folder).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(found, dict) or found.get("job") != job.described():
        return None
    return found.get("result")


def write_result(job: Job, folder: Path, result: dict[str, Any]) -> None:
    """Write a job's result in one step."""
    text = json.dumps({"job": job.described(), "result": result}, allow_nan=False)
    atomic.write_text(job.result_path(folder), text)


def write_spec(job: Job, folder: Path) -> Path:
    """Write what the job's process reads and return the path."""
    return atomic.write_text(job.spec_path(folder), json.dumps(dataclasses.asdict(job), allow_nan=False))


def read_spec(path: Path) -> Job:
    """Return the job that `write_spec` wrote."""
    values = json.loads(path.read_text(encoding="utf-8"))
    return Job(**{**values, "needs": tuple(values["needs"])})


def slug(name: str) -> str:
    """Return a name as it may stand in a file name."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in name)


def _training(suite: Suite, agent: str, memory: str, seed: int, base_seed: int) -> Job:
    return Job(
        name=f"train-{agent}-{slug(memory)}-{seed}",
        kind="train",
        title=f"train {agent}, seed {seed}",
        spec={
            "agent": agent,
            "env": suite.training_env,
            "memory": memory,
            "seed": seed,
            "base_seed": base_seed,
            "settings": dataclasses.asdict(suite.ppo),
            "bundle": f"agents/{agent}-{slug(memory)}-{seed}.safetensors",
        },
        seconds=STARTING_S + suite.ppo.n_generated / 3500.0,
    )


def _chart(suite: Suite, memory: str) -> Job:
    return Job(
        name=f"chart-{slug(memory)}",
        kind="chart",
        title=f"chart {memory} and search it with the oracle",
        spec={
            "env": suite.training_env,
            "memory": memory,
            "resolution": suite.resolution,
            "n_actions": suite.n_actions,
            "chart": f"maps/{slug(memory)}.npz",
        },
        seconds=STARTING_S + suite.resolution**2 / 5000.0,
    )


def _judging(suite: Suite, agent: str, memory: str, seeds: range, needed: list[Job], base_seed: int) -> Job:
    per_action = dict(suite.seconds_per_action)
    return Job(
        name=f"play-{agent}-{slug(memory)}-{seeds[0]}-{seeds[-1]}",
        kind="play",
        title=f"judge {agent}, seeds {seeds[0]} to {seeds[-1]}"
        if len(seeds) > 1
        else f"judge {agent}, seed {seeds[0]}",
        spec={
            "agent": agent,
            "envs": list(suite.envs),
            "memory": memory,
            "seeds": list(seeds),
            "base_seed": base_seed,
            "n_actions": suite.n_actions,
            "bundles": [job.spec["bundle"] for job in needed],
            # What made the bundles decides the result too.
            "training": [job.described() for job in needed],
        },
        needs=tuple(job.name for job in needed),
        seconds=STARTING_S + len(seeds) * suite.n_actions * sum(per_action.get(env, 0.01) for env in suite.envs),
    )
