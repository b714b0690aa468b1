"""`results.json`: a row per agent, environment and memory; figures are means with intervals, or null with a reason.

Also here:
- Are the parts of a result file what they should be? It may be a stranger's: every figure is looked at before use.
- Over all memories: each agent's mean, interquartile mean, profile and how it stands against the baseline.
"""

from __future__ import annotations

import contextlib
import json
import math
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from creative_nao import storage
from creative_nao.errors import CreativeNaoError, FileFormatError
from creative_nao.evaluation.protocol import Episode, episode_from_json
from creative_nao.evaluation.resolve_agents import actions_before, trained_here
from creative_nao.evaluation.statistics import (
    Estimate,
    compare,
    estimate,
    estimate_over_tasks,
    iqm,
    performance_profile,
    profile_band,
)
from creative_nao.evaluation.suites import Suite
from creative_nao.fields import Fields
from creative_nao.storage import as_json, read_text

MAX_ROWS = 100_000
_LONGEST_TEXT = 20_000


def check_rows(found: Fields, measured: tuple[str, ...]) -> None:
    """Check the rows of a result file, as far as they have the fields of a suite's.

    Args:
        found: The file.
        measured: Fields that hold a mean with an interval, or null.

    Raises:
        FileFormatError: Naming the row and the field.
    """
    found.text("suite")
    for row in found.objects("rows", MAX_ROWS):
        for name in row.values:
            if name in ("agent", "env", "memory"):
                row.text(name, longest=4_000)
            elif name in ("n_seeds", "n_actions"):
                row.whole(name, least=1)
            elif name in measured:
                _interval(row, name)
            elif name == "reward_per_seed":
                rewards = row.object(name)
                for seed in rewards.values:
                    if not seed.isdecimal() or len(seed) > 19:
                        raise FileFormatError(f"{rewards.where} should be named by seeds, but has `{seed[:40]}`")
                    rewards.number(seed)


def check_summary(found: Fields) -> None:
    """Check summary, record and baseline of a result file that is published.

    Raises:
        FileFormatError: Naming the entry and the field.
    """
    for entry in found.objects("summary", MAX_ROWS):
        for name in ("agent", "env"):
            entry.text(name, longest=4_000)
        for name in ("n_memories", "n_seeds"):
            entry.whole(name, least=1)
        entry.whole("n_actions_training", least=0)
        for name in ("reward_iqm", "reward", "oracle_share"):
            _interval(entry, name)
        if entry.any("reward_iqm") is None:
            raise entry.refuse("reward_iqm", "a mean with an interval")
        if entry.any("versus") is not None:
            versus = entry.object("versus")
            _interval(versus, "probability_of_improvement")
            versus.whole("n_memories_ahead", least=0)
    if found.any("baseline") is not None:
        found.text("baseline")
    record = found.object("record")
    record.text("command", _LONGEST_TEXT)
    versions = record.object("versions")
    for name in ("creative-nao", *versions.values):
        versions.text(name)
    suite = record.object("settings").object("suite")
    suite.whole("n_actions", least=1)
    if "about" in suite:
        suite.text("about", _LONGEST_TEXT)


@contextlib.contextmanager
def naming(what: str) -> Iterator[None]:
    """Turn what goes wrong over the parts of a file that are looked at in passing into an error that names the file.

    Args:
        what: Beginning of the message.

    Raises:
        FileFormatError: In place of the errors of Python over a missing part or one of another kind.
    """
    try:
        yield
    except CreativeNaoError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        raise FileFormatError(
            f"{what}: a part is missing or of another kind ({type(error).__name__}: {error})"
        ) from error


def _interval(found: Fields, name: str) -> None:
    if found.any(name) is None:
        return
    inner = found.object(name)
    inner.number("mean")
    if inner.any("low") is None and inner.any("high") is None:
        return
    inner.number("high", least=inner.number("low"))


THRESHOLDS = tuple(round(0.05 * place, 2) for place in range(21))
"""Shares of the oracle's reward at which a performance profile is read."""

Row = Mapping[str, Any]


def summarise(rows: Sequence[Row], *, baseline: str, base_seed: int) -> list[dict[str, Any]]:
    """Return one entry per environment and agent, in the order of the rows.

    Args:
        rows: Rows of `results.json`.
        baseline: The agent that the others are compared with, by their rewards on the same memories.
        base_seed: Seed of the whole evaluation; decides the bootstrap samples.

    Returns:
        Entries with `agent`, `env`, `n_memories`, `n_seeds`, `n_actions_training`, `reward`, `reward_iqm`,
        `oracle_share`, `oracle_share_iqm` and `profile` (the last three null without an oracle), and `versus`: null
        for the baseline, else `baseline`, `probability_of_improvement`, `difference` (of the reward, with the memories
        kept), `difference_other_memories` (with the memories drawn anew too) and `n_memories_ahead`.
    """
    pairs = dict.fromkeys((row["env"], row["agent"]) for row in rows)
    return [_entry(rows, env, agent, baseline, base_seed) for env, agent in pairs]


def reward_table(rows: Sequence[Row], env: str, agent: str) -> np.ndarray:
    """Return an agent's rewards in an environment, shape (seeds, memories)."""
    chosen = [row for row in rows if (row["env"], row["agent"]) == (env, agent)]
    return np.array([list(row["reward_per_seed"].values()) for row in chosen], dtype=np.float64).T


def oracle_row(rows: Sequence[Row], env: str, agent: str) -> np.ndarray | None:
    """Return what the oracle earns on each memory, shape (memories,); None where one has no oracle or it earns 0."""
    best = [row["oracle_reward"] for row in rows if (row["env"], row["agent"]) == (env, agent)]
    return np.array(best) if all(best) else None


def _entry(rows: Sequence[Row], env: str, agent: str, baseline: str, base_seed: int) -> dict[str, Any]:
    first = next(row for row in rows if (row["env"], row["agent"]) == (env, agent))
    rewards, best = reward_table(rows, env, agent), oracle_row(rows, env, agent)

    def rng(field: str) -> np.random.Generator:
        return np.random.default_rng([base_seed, *(zlib.crc32(part.encode()) for part in (agent, env, field))])

    entry: dict[str, Any] = {
        "agent": agent,
        "env": env,
        "n_memories": rewards.shape[1],
        "n_seeds": rewards.shape[0],
        "n_actions_training": first["n_actions_training"],
        "reward": plain(estimate(rewards, rng=rng("reward"))),
        "reward_iqm": plain(estimate(rewards, rng=rng("reward_iqm"), statistic=iqm)),
        "oracle_share": None,
        "oracle_share_iqm": None,
        "profile": None,
        "versus": None,
    }
    if best is not None:
        shares = rewards / best
        low, high = profile_band(shares, np.array(THRESHOLDS), rng=rng("profile"))
        entry |= {
            "oracle_share": plain(estimate(shares, rng=rng("oracle_share"))),
            "oracle_share_iqm": plain(estimate(shares, rng=rng("oracle_share_iqm"), statistic=iqm)),
            "profile": {
                "threshold": list(THRESHOLDS),
                "share_above": performance_profile(shares, np.array(THRESHOLDS)).tolist(),
                "low": low.tolist(),
                "high": high.tolist(),
            },
        }
    if agent != baseline and any((row["env"], row["agent"]) == (env, baseline) for row in rows):
        theirs = reward_table(rows, env, baseline)
        # The two agents' seeds are independent: any pairing has the same mean, and an interval that holds.
        difference = rewards - theirs
        entry["versus"] = {
            "baseline": baseline,
            "probability_of_improvement": plain(compare(rewards, theirs, rng=rng("improvement"))),
            "difference": plain(estimate(difference, rng=rng("difference"))),
            "difference_other_memories": plain(estimate_over_tasks(difference, rng=rng("other_memories"))),
            "n_memories_ahead": int((difference.mean(axis=0) > 0.0).sum()),
        }
    return entry


def plain(found: Estimate) -> dict[str, float | None]:
    """Return an estimate as `results.json` holds it."""
    return {"mean": found.value, "low": found.low, "high": found.high}


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
    return storage.write_text(path, json.dumps(results, indent=2, allow_nan=False) + "\n")


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
