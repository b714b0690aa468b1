"""Episodes of any agent as a Minari dataset, for offline reinforcement learning."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np

from creative_nao.agents.base import Agent
from creative_nao.agents.play import check_env, make_env, play_episode
from creative_nao.agents.training import memories_of
from creative_nao.errors import SettingsError, load_extra
from creative_nao.schema import Index, checked, must

NAME = re.compile(r"([A-Za-z0-9_-]{1,80}/){0,2}[A-Za-z0-9_-]{1,80}-v[0-9]{1,6}")
"""Of a dataset: namespace, environment and what it holds, with a version."""
_DatasetName = Annotated[str, must(NAME.fullmatch, "a name as `creative_nao/BoxingMental/random-v0`")]
FOLDER = "MINARI_DATASETS_PATH"
"""Environment variable that tells Minari where its datasets lie."""


class _Recording(gym.Wrapper):
    """Keeps everything of the last episode."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        self.observations, self.steps = [observation], []
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.observations.append(observation)
        self.steps.append((np.array(action), float(reward), terminated, truncated))
        return observation, reward, terminated, truncated, info


def record_dataset(
    agent: Agent,
    env_id: str,
    memory: str,
    seeds: Sequence[int],
    out: str | os.PathLike[str],
    dataset_id: str,
    *,
    progress: Callable[[int], None] = lambda _: None,
) -> Path:
    """Let an agent play and write its episodes as a Minari dataset; return the dataset's folder.

    Args:
        agent: Plays one episode for each memory and seed.
        env_id: Name of the environment.
        memory: A memory by name or file, or a part of the bank; then each episode tells its memory in its options.
        seeds: Each decides the environment's and the agent's draws of an episode.
        out: Folder of datasets; with `MINARI_DATASETS_PATH` set to it, `minari.load_dataset(dataset_id)` reads it.
        dataset_id: As Minari names datasets: ``creative_nao/BoxingMental/random-v0``.
        progress: Called with the number of episodes played.

    Raises:
        MissingDependencyError: If Minari is not installed.
        SettingsError: If `dataset_id` is no such name, or there is a dataset of it.
        NotFoundError: If there is no such environment or memory.
    """
    minari, _ = (load_extra(package, "minari", "a dataset of Minari") for package in ("minari", "h5py"))
    from minari.data_collector import EpisodeBuffer

    seeds = checked(tuple[Index, ...], tuple(seeds), "seeds")
    check_env(env_id)
    folder = Path(out).absolute()
    checked(_DatasetName, dataset_id, "dataset_id")
    if (folder / dataset_id).exists():
        raise SettingsError(f"there is a dataset `{dataset_id}` in {folder}; choose another version or folder")
    names = memories_of(memory)
    env, buffers = _Recording(make_env(env_id, memory, agent)), []
    try:
        for name in names:
            options = None if names == (memory,) else {"memory": name}
            for seed in seeds:
                for _ in play_episode(agent, env, seed=seed, rng=np.random.default_rng(seed), options=options):
                    pass
                actions, rewards, terminations, truncations = zip(*env.steps, strict=True)
                arrays: dict[str, Any] = {"observations": np.array(env.observations), "actions": np.array(actions)}
                buffers.append(
                    EpisodeBuffer(
                        id=len(buffers), seed=seed, options=options, **arrays, rewards=list(rewards),
                        terminations=list(terminations), truncations=list(truncations),
                    )
                )  # fmt: skip
                progress(len(buffers))
        with _datasets_in(folder), warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that nobody's address is in it
            minari.create_dataset_from_buffers(
                dataset_id, buffers, env=env.unwrapped.spec, action_space=env.action_space,
                observation_space=env.observation_space, algorithm_name=agent.name, author="creative-nao agent record",
                code_permalink="creative_nao", description=f"{agent.name} ({agent.track}) in {env_id}",
                requirements=[f"creative-nao=={importlib.metadata.version('creative-nao')}"],
            )  # fmt: skip
    finally:
        env.close()
    return folder / dataset_id


@contextlib.contextmanager
def _datasets_in(folder: Path) -> Iterator[None]:
    """Let Minari write into a folder while inside."""
    before = os.environ.get(FOLDER)
    os.environ[FOLDER] = str(folder)
    try:
        yield
    finally:
        os.environ.pop(FOLDER)
        if before is not None:
            os.environ[FOLDER] = before
