"""An agent's score on named memories: one episode for each memory and seed, reward by reward.

The same agent, memories and seeds give the same rewards, bit for bit on one machine; a bundle's recorded score is
checked that way.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box

from creative_nao.agents.base import Agent, Context
from creative_nao.errors import NotFoundError, SettingsError, nearest_name
from creative_nao.fields import Fields


@dataclass(frozen=True)
class PlayedEpisode:
    """What one episode came to.

    Attributes:
        memory: Name of the memory.
        seed: Seed of the environment and of the agent's draws.
        reward: Sum of the rewards.
        appropriateness_pct: Share of appropriate actions.
        novelty: Mean distance of the appropriate ones to the basic actions [rad], None without any.
        diversity: Mean distance between them [rad], None with fewer than two.
    """

    memory: str
    seed: int
    reward: float
    appropriateness_pct: float | None = None
    novelty: float | None = None
    diversity: float | None = None


@dataclass(frozen=True)
class Score:
    """A recorded score.

    Attributes:
        env: Environment it was played in.
        deterministic: Whether the most likely actions were played, or drawn ones.
        episodes: Every episode.
    """

    env: str
    deterministic: bool
    episodes: tuple[PlayedEpisode, ...]

    @property
    def mean(self) -> float:
        """Mean reward of an episode."""
        return math.fsum(one.reward for one in self.episodes) / len(self.episodes)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the mean, bootstrapped over memories (each one's seeds stay together)."""
        by_memory = [[one.reward for one in self.episodes if one.memory == name] for name in self.memories]
        means = np.array([math.fsum(rewards) / len(rewards) for rewards in by_memory])
        drawn = np.random.default_rng(0).integers(len(means), size=(10_000, len(means)))
        low, high = np.quantile(means[drawn].mean(axis=1), [0.025, 0.975])
        return float(low), float(high)

    @property
    def memories(self) -> tuple[str, ...]:
        """The memories, in the order of play."""
        return tuple(dict.fromkeys(one.memory for one in self.episodes))

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of each memory."""
        return tuple(dict.fromkeys(one.seed for one in self.episodes))

    def as_json(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {
            "env": self.env,
            "deterministic": self.deterministic,
            "mean": self.mean,
            "interval_95": list(self.interval),
            "episodes": [dataclasses.asdict(one) for one in self.episodes],
        }

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Score:
        """Return the score that `as_json` described.

        Raises:
            FileFormatError: If a part is missing or of another kind; the message names it.
        """
        found = Fields(values, "the score")
        episodes = tuple(_episode(one) for one in found.objects("episodes", most=100_000))
        if not episodes:
            raise ValueError("should hold at least one episode with a reward")
        return cls(found.text("env"), found.truth("deterministic"), episodes)


def _episode(told: Fields) -> PlayedEpisode:
    told.only([field.name for field in dataclasses.fields(PlayedEpisode)])
    measures = {
        name: None if told.values.get(name) is None else told.number(name)
        for name in ("appropriateness_pct", "novelty", "diversity")
    }
    seed = told.whole("seed", least=0)
    return PlayedEpisode(told.text("memory", longest=4_000), seed, told.number("reward"), **measures)


def play_episodes(
    agent: Agent,
    env_id: str,
    memories: Iterable[str],
    seeds: Sequence[int],
    *,
    env_kwargs: dict[str, Any] | None = None,
    progress: Callable[[int], None] | None = None,
) -> tuple[PlayedEpisode, ...]:
    """Let an agent play one episode for each memory and seed.

    Args:
        agent: The agent.
        env_id: Name of the environment.
        memories: Names or files of memories.
        seeds: Seeds; each decides the environment's and the agent's draws of an episode.
        env_kwargs: More settings of the environment.
        progress: Called with the number of episodes played.

    Raises:
        NotFoundError: If there is no such environment or memory.
        SettingsError: If its spaces are no boxes.
    """
    found: list[PlayedEpisode] = []
    for memory in memories:
        env = make_env(env_id, **{**(env_kwargs or {}), "memory": memory})
        try:
            for seed in seeds:
                found.append(_play_one(agent, env, memory, seed))
                if progress is not None:
                    progress(len(found))
        finally:
            env.close()
    return tuple(found)


def make_env(env_id: str, **arguments: Any) -> gym.Env:
    """Make an environment by name.

    Raises:
        NotFoundError: If there is none of this name; the message offers the nearest.
    """
    check_env(env_id)
    return gym.make(env_id, **arguments)


def check_env(env_id: str) -> EnvSpec:
    """Return the entry of an environment's name.

    Raises:
        NotFoundError: If there is none of this name; the message offers the nearest.
    """
    try:
        return gym.spec(env_id)
    except (gym.error.Error, ImportError) as error:
        from creative_nao.envs import ENVIRONMENTS

        raise NotFoundError(
            f"no environment `{env_id}`{nearest_name(env_id, ENVIRONMENTS)}; there are {', '.join(ENVIRONMENTS)}"
        ) from error


def _play_one(agent: Agent, env: gym.Env, memory: str, seed: int) -> PlayedEpisode:
    if not isinstance(env.action_space, Box) or not isinstance(env.observation_space, Box):
        raise SettingsError(f"environment {env} should have Box spaces, but has {env.action_space}")
    observation, _ = env.reset(seed=seed)
    inside: Any = env.unwrapped
    budget = getattr(inside, "n_actions", 30) * getattr(inside, "n_decisions", 1)
    known = getattr(inside, "memory", None)
    agent.begin(Context(env.action_space, env.observation_space, budget, np.random.default_rng(seed), known))
    rewards: list[float] = []
    info: dict[str, Any] = {}
    ended = False
    while not ended:
        pb = agent.ask(observation)
        observation, reward, terminated, truncated, info = env.step(pb)
        agent.tell(pb, observation, float(reward), info)
        rewards.append(float(reward))
        ended = terminated or truncated
    measures = info.get("episode_measures", {})
    return PlayedEpisode(
        memory,
        seed,
        math.fsum(rewards),
        *(
            None if measures.get(name) is None else float(measures[name])
            for name in ("appropriateness_pct", "novelty", "diversity")
        ),
    )
