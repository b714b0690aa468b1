"""How an agent is judged: it plays one episode, and every action it generates is written down."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from creative_nao import storage
from creative_nao.agents.base import Agent
from creative_nao.agents.play import play_episode, told_measures
from creative_nao.evaluation.statistics import seed_sequence
from creative_nao.schema import record


@record
class ActionRecord:
    """One generated action and what became of it."""

    step: int
    """Place in the episode, from 1."""
    pb_1: float
    """PB vector; where it changes while an action unfolds, the last one."""
    pb_2: float
    outcome: str
    """learned, unlearned, or why it is inappropriate."""
    appropriate: bool
    nearest: str
    """The basic action most like it."""
    distance: float
    """DTW distance to that basic action [rad]."""
    known_distance: float
    """DTW distance to the most similar of everything known before: basic actions and repertoire [rad]."""
    reward: float
    repertoire_size: int


@record
class Episode:
    """One episode of one agent."""

    agent: str
    env: str
    memory: str
    seed: int
    actions: tuple[ActionRecord, ...]
    appropriateness_pct: float
    novelty: float | None
    """None when no action was appropriate."""
    diversity: float | None
    """None when fewer than two actions were appropriate."""
    seconds: float

    @property
    def reward(self) -> float:
        """Sum of the rewards."""
        return math.fsum(action.reward for action in self.actions)


EPISODE_KEYS = ("agent", "env", "memory", "seed")
COLUMNS = (*EPISODE_KEYS, *(field.name for field in dataclasses.fields(ActionRecord)))


def random_streams(base_seed: int, seed: int, agent: str) -> tuple[np.random.Generator, int]:
    """Return the generator of an agent and the seed of its environment for one repetition.

    They do not depend on the environment: an agent that does not look at observations plays the same PB vectors in
    physics and in the mental environment, so that the two can be compared action by action.
    """
    for_agent, for_env = seed_sequence(base_seed, seed, agent).spawn(2)
    return np.random.default_rng(for_agent), int(for_env.generate_state(1)[0])


def play(
    agent: Agent, env: gym.Env, *, env_id: str, memory: str, seed: int, base_seed: int = 0, n_actions: int = 30
) -> Episode:
    """Let `agent` play one episode.

    Args:
        agent: The agent.
        env: An environment with the terms of this project's in `info`.
        env_id: Name of the environment, for the record.
        memory: Name of the environment's memory.
        seed: Which repetition this is.
        base_seed: Seed of the whole evaluation.
        n_actions: The budget; the environment should end the episode there. Where an action unfolds over several
            decisions, the agent is asked for each.

    Raises:
        SettingsError: If the episode is shorter or longer than the budget, or the spaces are no boxes.
    """
    rng, env_seed = random_streams(base_seed, seed, agent.name)
    start = time.perf_counter()
    records: list[ActionRecord] = []
    info: dict[str, Any] = {}
    for pb, reward, info in play_episode(agent, env, seed=env_seed, rng=rng, n_actions=n_actions):
        if "outcome" in info:  # else the action is still unfolding
            records.append(
                ActionRecord(
                    step=len(records) + 1,
                    pb_1=float(pb[0]),
                    pb_2=float(pb[1]),
                    outcome=str(info["outcome"]),
                    appropriate=bool(info["appropriate"]),
                    nearest=str(info["nearest_name"]),
                    reward=reward,
                    **{name: info[name] for name in ("distance", "known_distance", "repertoire_size")},
                )
            )
    return Episode(
        agent=agent.name,
        env=env_id,
        memory=memory,
        seed=seed,
        actions=tuple(records),
        **told_measures(info),
        seconds=time.perf_counter() - start,
    )


def write_episodes(path: str | Path, episodes: Iterable[Episode]) -> Path:
    """Write every action of `episodes` as CSV, a row each; figures keep all their digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for episode in episodes:
        keys = [getattr(episode, key) for key in EPISODE_KEYS]
        writer.writerows([*keys, *dataclasses.astuple(action)] for action in episode.actions)
    return storage.write_text(path, text.getvalue())
