"""Over all memories: each agent's mean, interquartile mean, profile and how it stands against the baseline.

Everything is worked out from the rows alone, so that a published result file can be checked by working it out again.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from creative_nao.evaluation.statistics import (
    Estimate,
    compare,
    estimate,
    estimate_over_tasks,
    iqm,
    performance_profile,
    profile_band,
)

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
