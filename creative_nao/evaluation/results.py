"""`results.json`: a row per agent, environment and memory, and a summary over memories.

Figures are means with intervals, or null with a reason. `collect` brings the results of jobs together, `make_results`
works the file out, `read_results` checks a file before it is used.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import jinja2
import numpy as np

from creative_nao import storage
from creative_nao.agents.registry import split_name
from creative_nao.errors import CreativeNaoError, FileFormatError, SettingsError
from creative_nao.evaluation.jobs import Job, oracle_of
from creative_nao.evaluation.pages import FIGURE_TITLES
from creative_nao.evaluation.protocol import Episode
from creative_nao.evaluation.statistics import (
    compare,
    estimate,
    estimate_over_tasks,
    iqm,
    performance_profile,
    profile_band,
    seed_sequence,
    worth,
)
from creative_nao.evaluation.suites import Suite, actions_before, resolve_agent, trained_here
from creative_nao.measures.outcome import PAPER_CRITERIA
from creative_nao.model.controls import CONTROLS
from creative_nao.schema import Count, Field, Text, must, parse, record

Row = Mapping[str, Any]
Entry = Mapping[str, Any]
MAX_ROWS = 20_000
MEASURED = (
    "appropriateness_pct", "novelty", "diversity", "reward", "oracle_share", "best", "coverage_pct", "regret",
    "refused_pct",
)  # fmt: skip
"""Fields of a row that are a mean with an interval, or null."""
THRESHOLDS = tuple(round(0.05 * place, 2) for place in range(21))
"""Shares of the oracle's reward at which a performance profile is read."""
NO_ORACLE = (
    "the oracle is exact only where the generated trajectory itself is scored: in physics it would have to perform "
    "the whole map"
)
NO_ORACLE_UNFOLDING = (
    "the oracle chooses from a map of single PB vectors; an action whose PB changes while it unfolds is on none"
)
NO_ORACLE_ASKED = "the suite has the oracle search no map but those that are drawn"
WHY_NONE = {
    "novelty": "no appropriate action to measure",
    "diversity": "fewer than two appropriate actions to compare",
    "oracle_share": "the map offers the oracle no appropriate action",
    "regret": "the map offers the oracle no appropriate action",
    "coverage_pct": "what the oracle chooses on this memory does not ship",
}
SAME = "the same for every seed: agent and environment draw nothing, so that seeds tell nothing of other episodes"
CURVE = "random"
"""The agent whose rewards with rising numbers of candidates are the measure of the others."""


Label = Annotated[str, Field(max_length=4_000)]
_SeedText = Annotated[str, must(lambda text: text.isdecimal() and len(text) <= 19, "a seed of at most 19 digits")]
_Rewards = Annotated[dict[_SeedText, float], Field(max_length=10_000)]


@record(closed=False)
class MeanInterval:
    """A mean with its 95 % interval; `low` and `high` are null where seeds leave it unknown: one, or all the same."""

    mean: float
    low: float | None
    high: float | None

    def __post_init__(self) -> None:
        if (self.low is None) != (self.high is None) or (self.low or 0.0) > (self.high or 0.0):
            raise SettingsError(f"`high` should be at least `low`, but is {self.high} with `low` {self.low}")


@record(closed=False)
class ResultRow:
    """One agent in one environment on one memory, as far as a file holds these fields."""

    agent: Label = ""
    env: Label = ""
    memory: Label = ""
    n_seeds: Count = 1
    n_actions: Count = 1
    appropriateness_pct: MeanInterval | None = None
    novelty: MeanInterval | None = None
    diversity: MeanInterval | None = None
    reward: MeanInterval | None = None
    oracle_share: MeanInterval | None = None
    reward_per_seed: _Rewards | None = None


@record(closed=False)
class ResultFile:
    """The rows of `results.json`, which every one has."""

    suite: Text
    rows: Annotated[tuple[ResultRow, ...], Field(max_length=MAX_ROWS)]


def read_results(path: Path) -> dict[str, Any]:
    """Return the content of a `results.json` as plain values, after checking its rows.

    Raises:
        NotFoundError: If there is no such file.
        FileFormatError: If it is not one; the message names the part.
    """
    found = storage.read_json(path, "results")
    parse(ResultFile, found, f"results {path}")
    return found


def write_results(path: Path, results: dict[str, Any]) -> Path:
    """Write `results.json`: strict JSON, no NaN."""
    return storage.write_json(path, results)


@contextlib.contextmanager
def naming(what: str) -> Iterator[None]:
    """Raise a FileFormatError that begins with `what` where a part of a file is missing or of another kind."""
    try:
        yield
    except CreativeNaoError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError, jinja2.UndefinedError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise FileFormatError(f"{what}: a part is missing or of another kind ({reason})") from error


def verdict(entry: Entry) -> str:
    """Return `ahead`, `behind` or `open`: whether the difference from the baseline would hold on other memories too.

    The interval that decides is the wider one, for which memories are drawn anew as well as seeds.
    """
    found = entry["versus"]["difference_other_memories"]
    if found["low"] is None or found["low"] <= 0.0 <= found["high"]:
        return "open"
    return "ahead" if found["low"] > 0.0 else "behind"


def entries_of(results: Mapping[str, Any], env: str, by: str = "reward") -> list[Entry]:
    """Return the summary of one environment, the highest figure first."""
    return sorted((e for e in results["summary"] if e["env"] == env), key=lambda entry: -entry[by]["mean"])


@record
class Training:
    """Training curve of one seed."""

    agent: str
    memory: str
    seed: int
    n_actions: tuple[int, ...]
    """Actions generated when each training episode ended."""
    reward: tuple[float, ...]
    seconds: float


@record
class Oracle:
    """What the greedy oracle earns on the whole map of a memory, and what the map is made of."""

    memory: str
    pb: tuple[tuple[float, ...], ...]
    """What it chose, in order."""
    rewards: tuple[float, ...]
    """Reward of each of its actions, in order."""
    shares_pct: dict[str, float]
    """Share of each outcome on the map."""


THRESHOLD_RAD = PAPER_CRITERIA.learned_threshold


@dataclass(frozen=True)
class Measured:
    """Everything the jobs of a suite found, in the order of the suite."""

    episodes: tuple[Episode, ...]
    trainings: tuple[Training, ...]
    oracles: dict[str, Oracle]
    taught: tuple[dict[str, Any], ...] = ()
    """What was told of each memory of a set that was trained in the run folder (`job_handlers.train_set`)."""

    def of(self, memory: str, env: str, agent: str) -> list[Episode]:
        """Return an agent's episodes in an environment on a memory, seed by seed."""
        return [e for e in self.episodes if (e.memory, e.env, e.agent) == (memory, env, agent)]


def collect(suite: Suite, jobs: Sequence[Job], done: Mapping[str, Mapping[str, Any]]) -> Measured:
    """Put the results of jobs, given by the jobs' names, in the order of the suite.

    Raises:
        FileFormatError: If a result is damaged; the message names the job.
    """
    episodes: list[Episode] = []
    trainings: list[Training] = []
    oracles: dict[str, Oracle] = {}
    taught: list[dict[str, Any]] = []
    for job in jobs:
        spec, result, where = job.spec, done[job.name], f"result of job {job.name}"
        if job.kind == "play":
            episodes += [parse(Episode, values, where) for values in result["episodes"]]
        elif job.kind == "chart" and spec["oracle"] == "found":
            memory = spec["memory"]["name"]
            values = {name: result[f"oracle_{name}"] for name in ("pb", "rewards")}
            oracles[memory] = parse(Oracle, {"memory": memory, "shares_pct": result["shares_pct"], **values}, where)
        elif job.kind == "teach-set":
            taught += result["memories"]
        elif job.kind == "train":
            values = {name: result[name] for name in ("seed", "n_actions", "reward", "seconds")}
            values |= {"agent": spec["agent"], "memory": spec["memory"]["name"]}
            trainings.append(parse(Training, values, where))
    for memory in suite.memories:
        if memory not in oracles and (ours := oracle_of(suite, memory)) is not None:
            pb, rewards = tuple(map(tuple, ours.pb.tolist())), tuple(ours.rewards.tolist())
            oracles[memory] = Oracle(memory, pb, rewards, ours.shares_pct)
    episodes.sort(
        key=lambda e: (suite.memories.index(e.memory), suite.envs.index(e.env), suite.agents.index(e.agent), e.seed)
    )
    trainings.sort(key=lambda t: (t.memory, t.agent, t.seed))
    taught.sort(key=lambda one: suite.memories.index(one["memory"]))
    return Measured(tuple(episodes), tuple(trainings), oracles, tuple(taught))


def make_results(suite: Suite, measured: Measured, *, base_seed: int) -> dict[str, Any]:
    """Return the content of `results.json`; the seed of the whole evaluation decides the bootstrap samples too."""
    keys = itertools.product(suite.memories, suite.envs, suite.agents)
    told = {name: _told(suite, name) for name in suite.agents}
    rows = [_row(suite, measured, memory, env, agent, base_seed, told[agent]) for memory, env, agent in keys]
    results = {
        "suite": suite.name,
        "rows": rows,
        "baseline": suite.baseline if suite.baseline in suite.agents else None,
        "summary": summarise(rows, baseline=suite.baseline, base_seed=base_seed),
    }
    if measured.taught:
        results["memories"] = list(measured.taught)
        results["conditions"] = compare_conditions(measured.taught, base_seed)
    return results


def compare_conditions(taught: Sequence[Mapping[str, Any]], base_seed: int) -> list[dict[str, Any]]:
    """Return an entry for each condition with the paper's figures over the maps of its memories.

    `figures` are means over seeds and sets, `per_set` the same set by set; `n_recalled` counts the memories that give
    every action back. `versus` are the differences from the condition `reference` on the same sets and seeds,
    `versus_other_sets` with the sets drawn anew too: a network's reference is `half`, or the first network, a control's
    the network whose PB points it takes. A figure that a map without usable movements lacks counts as 0.
    """
    conditions, sets = (list(dict.fromkeys(one[key] for one in taught)) for key in ("condition", "set"))
    networks = [name for name in conditions if name not in CONTROLS]

    def values(condition: str, figure: str) -> np.ndarray:  # (seeds, sets)
        own = [one for one in taught if one["condition"] == condition]
        return np.array([[one[figure] or 0.0 for one in own if one["set"] == name] for name in sets]).T

    def rng(*parts: str) -> np.random.Generator:
        return np.random.default_rng(seed_sequence(base_seed, "conditions", *parts))

    found = []
    for place, condition in enumerate(conditions):
        first = "half" if "half" in networks else networks[0]
        network = [name for name in conditions[:place] if name in networks]
        reference = network[-1] if condition in CONTROLS else first
        own = {figure: values(condition, figure) for figure in FIGURE_TITLES}
        gaps = {figure: array - values(reference, figure) for figure, array in own.items()}
        per_set = {
            name: {key: estimate(array[:, k], rng=rng(condition, key, name)) for key, array in own.items()}
            for k, name in enumerate(sets)
        }
        memories = [one for one in taught if one["condition"] == condition]
        found.append({
            "condition": condition,
            "n_memories": len(memories),
            "n_recalled": sum(max(one["reproduction_dtw"].values()) <= THRESHOLD_RAD for one in memories),
            "figures": {key: estimate(array, rng=rng(condition, key)) for key, array in own.items()},
            "per_set": per_set,
            "reference": reference,
            "versus": {key: estimate(gap, rng=rng(condition, key, "versus")) for key, gap in gaps.items()},
            "versus_other_sets": {
                key: estimate_over_tasks(gap, rng=rng(condition, key, "sets")) for key, gap in gaps.items()
            },
        })  # fmt: skip
    return found


def _told(suite: Suite, agent: str) -> dict[str, Any]:
    """Return what an agent was given: its track, candidates for each movement, and actions in training."""
    if trained_here(agent):
        number = split_name(agent)[1] or 1
        return {"track": "outcomes", "n_candidates": number, "n_actions_training": suite.ppo.n_generated}
    made = resolve_agent(agent)
    return {"track": str(made.track), "n_candidates": made.n_candidates, "n_actions_training": actions_before(agent)}


def _row(
    suite: Suite, measured: Measured, memory: str, env: str, agent: str, base_seed: int, told: Mapping[str, Any]
) -> dict[str, Any]:
    episodes = measured.of(memory, env, agent)
    trainings = [t for t in measured.trainings if (t.memory, t.agent) == (memory, agent)]
    row: dict[str, Any] = {"agent": agent, "env": env, "memory": memory}
    row |= {"n_seeds": len(episodes), "n_actions": suite.n_actions}
    row |= {**told, "n_imagined": sum(e.n_imagined for e in episodes) / len(episodes)}
    best = None
    if env in suite.oracle_envs and memory in measured.oracles:
        best = math.fsum(measured.oracles[memory].rewards)
    for field in MEASURED:
        if field in ("oracle_share", "regret") and best is None:
            reason = NO_ORACLE_UNFOLDING if "Modulation" in env else NO_ORACLE
            row[field], row[f"{field}_reason"] = None, reason if suite.charted == "all" else NO_ORACLE_ASKED
            continue
        if field == "oracle_share":
            values = [episode.reward / best if best else None for episode in episodes]
        elif field == "regret":
            values = [best - episode.reward if best else None for episode in episodes]
        else:
            values = [getattr(episode, field) for episode in episodes]
        stream = seed_sequence(base_seed, agent, env, memory, field)
        row |= _field(field, values, np.random.default_rng(stream))
    return {
        **row,
        "reward_iqm": float(iqm(np.array([[episode.reward] for episode in episodes]))),
        "reward_per_seed": {str(episode.seed): episode.reward for episode in episodes},
        "oracle_reward": best,
        "outcomes": dict(sorted(Counter(action.outcome for e in episodes for action in e.actions).items())),
        "seconds": math.fsum(episode.seconds for episode in episodes) / len(episodes),
        "seconds_training": math.fsum(t.seconds for t in trainings) / len(trainings) if trainings else 0.0,
    }


def _field(field: str, values: Sequence[float | None], rng: np.random.Generator) -> dict[str, Any]:
    known = [value for value in values if value is not None]
    if not known:
        return {field: None, f"{field}_reason": WHY_NONE[field]}
    found = estimate(np.array(known), rng=rng)
    if field == "reward":
        found = _over_seeds(found, np.array(known))
    described: dict[str, Any] = {field: found}
    reasons = []
    if len(known) < len(values):
        reasons.append(f"over {len(known)} of {len(values)} seeds; in the others {WHY_NONE[field]}")
    if found["low"] is None:
        reasons.append("no interval from a single seed" if len(known) == 1 else SAME)
    if reasons:
        described[f"{field}_reason"] = "; ".join(reasons)
    return described


def summarise(rows: Sequence[Row], *, baseline: str, base_seed: int) -> list[dict[str, Any]]:
    """Return one entry per environment and agent, in the order of the rows.

    `oracle_share`, `oracle_share_iqm` and `profile` are null without an oracle. `versus`, null for the baseline,
    compares the rewards on the same memories: `difference` keeps the memories, `difference_other_memories` draws them
    anew too. `worth` is how many uniform candidates a movement would earn as much, by the rewards of `random@1`,
    `random@2`, ... on the same memories; null where fewer than two of these take part.
    """
    pairs = dict.fromkeys((row["env"], row["agent"]) for row in rows)
    return [_entry(rows, env, agent, baseline, base_seed) for env, agent in pairs]


def _rewards(rows: Sequence[Row]) -> np.ndarray:  # shape (seeds, memories)
    return np.array([list(row["reward_per_seed"].values()) for row in rows], dtype=np.float64).T


def _over_seeds(found: dict[str, Any], values: np.ndarray) -> dict[str, Any]:
    """Return a mean without its interval where all seeds, the first axis, gave the same: they were no sample."""
    return {**found, "low": None, "high": None} if len(values) > 1 and (values == values[0]).all() else found


def _mean_over(rows: Sequence[Row], field: str) -> float | None:
    """Return the mean of a field over memories; None where a row lacks it."""
    found = [row.get(field) for row in rows]
    values: list[Any] = [value["mean"] if isinstance(value, Mapping) else value for value in found]
    return None if None in values else math.fsum(values) / len(values)


def _entry(rows: Sequence[Row], env: str, agent: str, baseline: str, base_seed: int) -> dict[str, Any]:
    own, others = ([row for row in rows if (row["env"], row["agent"]) == (env, who)] for who in (agent, baseline))
    rewards, best = _rewards(own), [row["oracle_reward"] for row in own]

    def rng(field: str) -> np.random.Generator:
        return np.random.default_rng(seed_sequence(base_seed, agent, env, field))

    entry: dict[str, Any] = {
        "agent": agent,
        "env": env,
        "n_memories": rewards.shape[1],
        "n_seeds": rewards.shape[0],
        "n_actions_training": own[0]["n_actions_training"],
        **{name: own[0].get(name) for name in ("track", "n_candidates", "n_actions")},
        **{name: _mean_over(own, name) for name in ("n_imagined", "best", "coverage_pct", "regret", "refused_pct")},
        "worth": None,
        "worth_most": None,
        "reward_other_memories": estimate_over_tasks(rewards, rng=rng("reward_other_memories")),
        "reward": _over_seeds(estimate(rewards, rng=rng("reward")), rewards),
        "reward_iqm": estimate(rewards, rng=rng("reward_iqm"), statistic=iqm),
        "oracle_share": None,
        "oracle_share_iqm": None,
        "profile": None,
        "versus": None,
    }
    numbers = sorted({k for base, k in (split_name(row["agent"]) for row in rows) if base == CURVE and k is not None})
    on_curve = {k: [r for r in rows if (r["env"], r["agent"]) == (env, f"{CURVE}@{k}")] for k in numbers}
    curve = [(k, _rewards(some)) for k, some in on_curve.items() if some]
    if len(curve) > 1 and all(one.shape[1:] == rewards.shape[1:] for _, one in curve):
        entry |= {"worth": worth(rewards, curve, rng=rng("worth")), "worth_most": curve[-1][0]}
    if all(best):  # every memory has an oracle, which earns something
        shares = rewards / np.array(best)
        low, high = profile_band(shares, np.array(THRESHOLDS), rng=rng("profile"))
        entry |= {
            "oracle_share": estimate(shares, rng=rng("oracle_share")),
            "oracle_share_iqm": estimate(shares, rng=rng("oracle_share_iqm"), statistic=iqm),
            "profile": {
                "threshold": list(THRESHOLDS),
                "share_above": performance_profile(shares, np.array(THRESHOLDS)).tolist(),
                "low": low.tolist(),
                "high": high.tolist(),
            },
        }
    if agent != baseline and others:
        theirs = _rewards(others)
        # The two agents' seeds are independent: any pairing has the same mean, and an interval that holds.
        difference = rewards - theirs
        entry["versus"] = {
            "baseline": baseline,
            "probability_of_improvement": compare(rewards, theirs, rng=rng("improvement")),
            "difference": estimate(difference, rng=rng("difference")),
            "difference_other_memories": estimate_over_tasks(difference, rng=rng("other_memories")),
            "n_memories_ahead": int((difference.mean(axis=0) > 0.0).sum()),
        }
    return entry
