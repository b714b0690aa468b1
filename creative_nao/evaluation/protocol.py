"""How an agent is judged: it plays one episode, and every action it generates is written down."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from creative_nao import storage
from creative_nao.agents.base import Agent
from creative_nao.agents.play import play_episode, told_measures
from creative_nao.evaluation.statistics import seed_sequence
from creative_nao.measures import dtw_matrix
from creative_nao.measures.outcome import PAPER_CRITERIA, PHYSICAL_FAULTS
from creative_nao.schema import record


@record
class ActionRecord:
    """One generated action and what became of it."""

    step: int
    """Place in the episode, from 1."""
    pb: tuple[float, ...]
    """PB vector; where it changes while an action unfolds, the last one."""
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
    n_imagined: int = 0
    """Movements imagined since the action before."""


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
    coverage_pct: float | None = None
    """Share of the movements that the oracle would choose of which the agent has found one alike; None where the oracle
    is not known beforehand."""

    @property
    def reward(self) -> float:
        """Sum of the rewards."""
        return math.fsum(action.reward for action in self.actions)

    @property
    def n_imagined(self) -> int:
        """Movements imagined."""
        return sum(action.n_imagined for action in self.actions)

    @property
    def best(self) -> float:
        """Largest reward of a movement."""
        return max(action.reward for action in self.actions)

    @property
    def refused_pct(self) -> float:
        """Share of the movements that the body refused."""
        return 100.0 * sum(action.outcome in PHYSICAL_FAULTS for action in self.actions) / len(self.actions)


EPISODE_KEYS = ("agent", "env", "memory", "seed")


def random_streams(base_seed: int, seed: int, agent: str) -> tuple[np.random.Generator, int]:
    """Return the generator of an agent and the seed of its environment for one repetition.

    They do not depend on the environment: an agent that does not look at observations plays the same PB vectors in
    physics and in the mental environment, so that the two can be compared action by action.
    """
    for_agent, for_env = seed_sequence(base_seed, seed, agent).spawn(2)
    return np.random.default_rng(for_agent), int(for_env.generate_state(1)[0])


def play(
    agent: Agent, env: gym.Env, *, env_id: str, memory: str, seed: int, base_seed: int = 0, n_actions: int = 30,
    oracle_set: Sequence[np.ndarray] | np.ndarray | None = None,
) -> Episode:  # fmt: skip
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
        oracle_set: The movements that the oracle would choose, to tell how many of them were found.

    Raises:
        SettingsError: If the episode is shorter or longer than the budget, or the spaces are no boxes.
    """
    rng, env_seed = random_streams(base_seed, seed, agent.name)
    start = time.perf_counter()
    records: list[ActionRecord] = []
    found: list[np.ndarray] = []
    info: dict[str, Any] = {}
    n_before = 0
    for pb, reward, info, n_imagined in play_episode(agent, env, seed=env_seed, rng=rng, n_actions=n_actions):
        if "outcome" in info:  # else the action is still unfolding
            records.append(
                ActionRecord(
                    step=len(records) + 1,
                    pb=tuple(map(float, pb)),
                    outcome=str(info["outcome"]),
                    appropriate=bool(info["appropriate"]),
                    nearest=str(info["nearest_name"]),
                    reward=reward,
                    **{name: info[name] for name in ("distance", "known_distance", "repertoire_size")},
                    n_imagined=n_imagined - n_before,
                )
            )
            n_before = n_imagined
            if oracle_set is not None and info["appropriate"]:
                found.append(info["trajectory"])
    return Episode(
        agent=agent.name,
        env=env_id,
        memory=memory,
        seed=seed,
        actions=tuple(records),
        **told_measures(info),
        seconds=time.perf_counter() - start,
        coverage_pct=None if oracle_set is None else coverage_pct(found, oracle_set),
    )


def coverage_pct(found: Sequence[np.ndarray], oracle_set: Sequence[np.ndarray] | np.ndarray) -> float:
    """Return of how many of the oracle's movements one alike was found [%]: as alike as what counts as learned."""
    if not len(found) or not len(oracle_set):
        return 0.0
    nearest = dtw_matrix(oracle_set, found).min(axis=1)
    return 100.0 * float((nearest <= PAPER_CRITERIA.learned_threshold).mean())


def write_episodes(path: str | Path, episodes: Sequence[Episode]) -> Path:
    """Write every action of `episodes` as CSV, a row each, a column for each PB unit; figures keep all their digits."""
    fields = [field.name for field in dataclasses.fields(ActionRecord)]
    n_pb = max((len(action.pb) for episode in episodes for action in episode.actions), default=0)
    columns = [f"pb_{unit + 1}" for unit in range(n_pb)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*EPISODE_KEYS, fields[0], *columns, *fields[2:]])
    for episode in episodes:
        keys = [getattr(episode, key) for key in EPISODE_KEYS]
        for action in episode.actions:
            step, pb, *others = (getattr(action, name) for name in fields)
            writer.writerow([*keys, step, *pb, *[""] * (n_pb - len(pb)), *others])
    return storage.write_text(path, text.getvalue())
