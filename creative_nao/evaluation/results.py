"""`results.json`: a row per agent, environment and memory; figures are means with intervals, or null with a reason."""

from __future__ import annotations

import json
import math
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import atomic
from creative_nao.evaluation.entrants import actions_before, trained_here
from creative_nao.evaluation.protocol import Episode, episode_from_json
from creative_nao.evaluation.result_checks import check_rows
from creative_nao.evaluation.statistics import estimate, iqm
from creative_nao.evaluation.suites import Suite
from creative_nao.evaluation.summary import summarise
from creative_nao.fields import Fields
from creative_nao.untrusted import as_json, read_text

MEASURED = ("appropriateness_pct", "novelty", "diversity", "reward", "oracle_share")
"""Fields of a row that are a mean with an interval, or null."""

NO_ORACLE = (
    "the oracle is exact only where the generated trajectory itself is scored: in physics it would have to perform "
    "the whole map"
)
NO_ORACLE_UNFOLDING = (
    "the oracle chooses from a map of single PB vectors; an action whose PB changes while it unfolds is on none"
)
WHY_NONE = {
    "novelty": "no appropriate action to measure",
    "diversity": "fewer than two appropriate actions to compare",
    "oracle_share": "the map offers the oracle no appropriate action",
}


@dataclass(frozen=True)
class Training:
    """Training curve of one seed."""

    agent: str
    memory: str
    seed: int
    n_actions: tuple[int, ...]
    reward: tuple[float, ...]
    seconds: float


@dataclass(frozen=True)
class Oracle:
    """What the greedy oracle earns on the whole map of a memory, and what the map is made of."""

    memory: str
    pb: tuple[tuple[float, float], ...]
    """What it chose, in order."""
    rewards: tuple[float, ...]
    """Reward of each of its actions, in order."""
    shares_pct: dict[str, float]
    """Share of each outcome on the map."""


@dataclass(frozen=True)
class Measured:
    """Everything the jobs of a suite brought home, in the order of the suite."""

    episodes: tuple[Episode, ...]
    trainings: tuple[Training, ...]
    oracles: dict[str, Oracle]


def collect(suite: Suite, results: Iterable[Mapping[str, Any]]) -> Measured:
    """Put the jobs' results in order; in which order they came makes no difference.

    Args:
        suite: What was evaluated.
        results: Of all jobs, each with its `kind`, `spec` and `result` under these names.
    """
    episodes: list[Episode] = []
    trainings: list[Training] = []
    oracles: dict[str, Oracle] = {}
    for entry in results:
        kind, spec, result = entry["kind"], entry["spec"], entry["result"]
        if kind == "play":
            episodes += [episode_from_json(values) for values in result["episodes"]]
        elif kind == "chart":
            chosen = tuple((first, second) for first, second in result["oracle_pb"])
            earned = tuple(result["oracle_rewards"])
            memory = spec["memory"]["name"]
            oracles[memory] = Oracle(memory, chosen, earned, result["shares_pct"])
        elif kind == "train":
            curve = tuple(result["n_actions"]), tuple(result["reward"])
            trainings.append(Training(spec["agent"], spec["memory"]["name"], spec["seed"], *curve, result["seconds"]))
    episodes.sort(
        key=lambda e: (suite.memories.index(e.memory), suite.envs.index(e.env), suite.agents.index(e.agent), e.seed)
    )
    trainings.sort(key=lambda t: (t.memory, t.agent, t.seed))
    return Measured(tuple(episodes), tuple(trainings), oracles)


def make_results(suite: Suite, measured: Measured, *, base_seed: int) -> dict[str, Any]:
    """Return the content of `results.json`.

    Args:
        suite: What was evaluated.
        measured: All episodes, trainings and oracles.
        base_seed: Seed of the whole evaluation; decides the bootstrap samples too.
    """
    rows = []
    for memory in suite.memories:
        for env in suite.envs:
            for agent in suite.agents:
                chosen = [e for e in measured.episodes if (e.memory, e.env, e.agent) == (memory, env, agent)]
                trainings = [t for t in measured.trainings if (t.memory, t.agent) == (memory, agent)]
                oracle = measured.oracles.get(memory) if env in suite.oracle_envs else None
                rows.append(_row(suite, chosen, trainings, oracle, base_seed))
    return {
        "suite": suite.name,
        "rows": rows,
        "baseline": suite.baseline if suite.baseline in suite.agents else None,
        "summary": summarise(rows, baseline=suite.baseline, base_seed=base_seed),
    }


def write_results(path: Path, results: dict[str, Any]) -> Path:
    """Write `results.json`: strict JSON, no NaN."""
    return atomic.write_text(path, json.dumps(results, indent=2, allow_nan=False) + "\n")


def read_results(path: Path) -> dict[str, Any]:
    """Read a `results.json`.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is not one; the message names the part.
    """
    found = as_json(read_text(path, "results"), f"results {path}")
    check_rows(Fields(found, f"results {path}"), MEASURED)
    return found


def _row(
    suite: Suite, episodes: Sequence[Episode], trainings: Sequence[Training], oracle: Oracle | None, base_seed: int
) -> dict[str, Any]:
    first = episodes[0]
    row: dict[str, Any] = {
        "agent": first.agent,
        "env": first.env,
        "memory": first.memory,
        "n_seeds": len(episodes),
        "n_actions": suite.n_actions,
    }
    best = math.fsum(oracle.rewards) if oracle is not None else None
    for field in MEASURED:
        if field == "oracle_share" and best is None:
            row[field], row[f"{field}_reason"] = None, NO_ORACLE_UNFOLDING if "Modulation" in first.env else NO_ORACLE
            continue
        if field == "oracle_share":
            values = [episode.reward / best if best else None for episode in episodes]
        else:
            values = [getattr(episode, field) for episode in episodes]
        seed = [base_seed, *(zlib.crc32(part.encode()) for part in (first.agent, first.env, first.memory, field))]
        row |= _field(field, values, np.random.default_rng(seed))
    trained = suite.ppo.n_generated if trained_here(first.agent) else actions_before(first.agent)
    return {
        **row,
        "reward_iqm": float(iqm(np.array([[episode.reward] for episode in episodes]))),
        "reward_per_seed": {str(episode.seed): episode.reward for episode in episodes},
        "oracle_reward": best,
        "outcomes": dict(sorted(Counter(action.outcome for e in episodes for action in e.actions).items())),
        "n_actions_training": trained,
        "seconds": math.fsum(episode.seconds for episode in episodes) / len(episodes),
        "seconds_training": math.fsum(t.seconds for t in trainings) / len(trainings) if trainings else 0.0,
    }


def _field(field: str, values: Sequence[float | None], rng: np.random.Generator) -> dict[str, Any]:
    known = [value for value in values if value is not None]
    if not known:
        return {field: None, f"{field}_reason": WHY_NONE[field]}
    found = estimate(np.array(known), rng=rng)
    described: dict[str, Any] = {field: {"mean": found.value, "low": found.low, "high": found.high}}
    reasons = []
    if len(known) < len(values):
        reasons.append(f"over {len(known)} of {len(values)} seeds; in the others {WHY_NONE[field]}")
    if found.low is None:
        reasons.append("no interval from a single seed")
    if reasons:
        described[f"{field}_reason"] = "; ".join(reasons)
    return described
