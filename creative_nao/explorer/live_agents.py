"""Agents that play before the eyes of the page: an episode in a memory, try by try."""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.agents import UNTRAINED, as_agent, load_agent, make_agent, shipped_agents
from creative_nao.agents.play import play_episode
from creative_nao.envs import BoxingMentalEnv
from creative_nao.errors import NotFoundError, nearest_name
from creative_nao.model import Memory

ENVIRONMENT = "BoxingMental-v0"
BASELINES = ("map_elites", "random")
N_TRIES = 30


def agents_for(memory: Memory) -> list[str]:
    """Return the agents that can play in a memory, the trained ones first."""
    trained = [name for name in shipped_agents() if name.endswith(f"/{ENVIRONMENT}")]
    return [*sorted(trained, reverse=True), *(name for name in BASELINES if name in UNTRAINED)]


def tries(memory: Memory, name: str, seed: int) -> dict[str, Any]:
    """Let an agent play one episode and return its tries: PB point, reward and outcome of each, JSON values.

    NotFoundError if there is no such agent.
    """
    known = agents_for(memory)
    if name not in known:
        raise NotFoundError(f"no agent `{name:.40}`{nearest_name(name, known)}; there are {', '.join(known)}")
    agent = make_agent(name) if name in UNTRAINED else as_agent(load_agent(name))
    env = BoxingMentalEnv(memory, n_actions=N_TRIES)
    played = play_episode(agent, env, seed=seed, rng=np.random.default_rng(seed), n_actions=N_TRIES)
    return {
        "tries": [
            {
                "pb": [float(value) for value in step.pb],
                "reward": float(step.reward),
                "outcome": str(step.info["outcome"]),
            }
            for step in played
        ]
    }
