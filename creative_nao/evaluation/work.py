"""What a job's process does: train an agent, judge one, or chart a memory."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box

from creative_nao.agents.bundle import BundleHeader, save_bundle
from creative_nao.agents.ppo import settings_from, train_ppo
from creative_nao.agents.registry import make_agent
from creative_nao.evaluation.oracle import chart_memory
from creative_nao.evaluation.protocol import episode_to_json, play

Report = Callable[[float], None]
"""Takes the share of the work that is done."""


def train(spec: dict[str, Any], folder: Path, report: Report) -> dict[str, Any]:
    """Train an agent, write its bundle and return its training curve."""
    start = time.perf_counter()
    settings = settings_from(spec["settings"])
    seed = int(np.random.SeedSequence([spec["base_seed"], spec["seed"]]).generate_state(1)[0] % 2**31)
    policy, curve = train_ppo(
        spec["env"],
        settings=settings,
        seed=seed,
        env_kwargs={"memory": spec["memory"]},
        progress=lambda done, planned: report(done / planned),
    )
    assert isinstance(policy.observation_space, Box)
    assert isinstance(policy.action_space, Box)
    header = BundleHeader(
        agent=spec["agent"],
        settings=settings,
        env=spec["env"],
        memory=spec["memory"],
        seed=seed,
        n_actions_training=settings.n_generated,
        observation_space=policy.observation_space,
        action_space=policy.action_space,
    )
    save_bundle(folder / spec["bundle"], header, policy)
    return {
        "seed": spec["seed"],
        "n_actions": list(curve.n_actions),
        "reward": list(curve.reward),
        "seconds": time.perf_counter() - start,
    }


def judge(spec: dict[str, Any], folder: Path, report: Report) -> dict[str, Any]:
    """Let an agent play one episode per seed and environment; return the episodes."""
    episodes = []
    total = len(spec["envs"]) * len(spec["seeds"])
    for env_id in spec["envs"]:
        env = gym.make(env_id, memory=spec["memory"])
        try:
            for place, seed in enumerate(spec["seeds"]):
                agent = make_agent(spec["agent"], folder / spec["bundles"][place] if spec["bundles"] else None)
                episode = play(
                    agent,
                    env,
                    env_id=env_id,
                    memory=spec["memory"],
                    seed=seed,
                    base_seed=spec["base_seed"],
                    n_actions=spec["n_actions"],
                )
                episodes.append(episode_to_json(episode))
                report(len(episodes) / total)
        finally:
            env.close()
    return {"episodes": episodes}


def chart(spec: dict[str, Any], folder: Path, report: Report) -> dict[str, Any]:
    """Score the whole map of a memory, write it, and return what the greedy oracle earns on it."""
    start = time.perf_counter()
    env = gym.make(spec["env"], memory=spec["memory"])
    try:
        memory = env.unwrapped.memory  # pyright: ignore[reportAttributeAccessIssue]
        charted, oracle = chart_memory(memory, spec["resolution"], spec["n_actions"], report)
    finally:
        env.close()
    charted.save(folder / spec["chart"])
    return {**oracle, "seconds": time.perf_counter() - start}


WORK: dict[str, Callable[[dict[str, Any], Path, Report], dict[str, Any]]] = {
    "train": train,
    "play": judge,
    "chart": chart,
}
