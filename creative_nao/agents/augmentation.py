"""Show an agent in training every memory from eight sides: the axes of the PB space flipped and swapped.

What a PB unit's sign means, and which unit is the first, is an accident of a memory's training. Each episode gets one
of the 2^n_pb n_pb! ways to flip and swap the axes; actions and observations are turned alike, so that the agent meets a
consistent world. Only training does this: agents are judged on the memories as they are.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from creative_nao.envs.observation import N_CELLS, cells_of
from creative_nao.envs.state import generator_from, generator_state
from creative_nao.errors import SettingsError


class FlippedSwappedAxes(VecEnvWrapper):
    """Turns the PB axes of every episode anew, in each copy of an environment.

    The agent's PB vector a becomes the environment's b with b[i] = signs[i] * a[order[i]]; `pb` and `cells` of its
    observations are turned back. What `info` tells stays the environment's.

    Args:
        venv: Copies of an environment of this project.

    Attributes:
        chosen: Which way each copy's episode is turned, shape (num_envs,); 0 leaves everything as it is.

    Raises:
        SettingsError: If observations hold no cells of the PB space.
    """

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        if not isinstance(venv.observation_space, Box) or not isinstance(venv.action_space, Box):
            raise SettingsError(f"`venv` should have Box spaces, but has {venv.observation_space}")
        self._n_pb = int(np.prod(venv.action_space.shape))
        ways = turns(self._n_pb)
        self._orders = np.array([order for order, _ in ways])
        self._signs = np.array([signs for _, signs in ways], np.float32)
        self._cells = cells_of(venv.observation_space, self._n_pb)
        self._cell_tables = np.array([_cell_table(order, signs) for order, signs in ways])
        self._random = np.random.default_rng(0)
        self.chosen = np.zeros(self.num_envs, np.int64)

    @property
    def n_ways(self) -> int:
        """Ways to turn the axes: 8 with two PB units."""
        return len(self._orders)

    def seed(self, seed: int | None = None) -> Any:
        """Seed the environments and the draw of ways."""
        self._random = np.random.default_rng(None if seed is None else [seed, self.n_ways])
        return super().seed(seed)

    def reset(self) -> np.ndarray:
        """Begin all episodes, each turned in a way of its own."""
        observations = self.venv.reset()
        self.chosen = self._random.integers(self.n_ways, size=self.num_envs)
        return self.as_seen(np.asarray(observations), self.chosen)

    def step_async(self, actions: np.ndarray) -> None:
        """Take the agent's PB vectors, shape (num_envs, n_pb)."""
        self.venv.step_async(self.as_meant(actions, self.chosen))

    def step_wait(self) -> Any:
        """Step; a copy whose episode has ended gets another way for its next one."""
        told: Any = self.venv.step_wait()
        observations, rewards, ended, infos = told
        over = np.flatnonzero(ended)
        for robot in over:
            last = infos[robot]["terminal_observation"]
            turned = self.as_seen(last[None], self.chosen[robot : robot + 1])[0]
            infos[robot] = {**infos[robot], "terminal_observation": turned}
        if len(over):
            self.chosen = self.chosen.copy()
            self.chosen[over] = self._random.integers(self.n_ways, size=len(over))
        return self.as_seen(observations, self.chosen), rewards, ended, infos

    def as_meant(self, pb: np.ndarray, ways: np.ndarray) -> np.ndarray:
        """Return the environment's PB vectors for the agent's, both (n, n_pb); ways: (n,)."""
        return self._signs[ways] * np.take_along_axis(pb, self._orders[ways], axis=1)

    def as_seen(self, observations: np.ndarray, ways: np.ndarray) -> np.ndarray:
        """Return the agent's observations for the environment's, both (n, n_values); ways: (n,)."""
        seen = observations.copy()
        np.put_along_axis(seen, self._orders[ways], self._signs[ways] * observations[:, : self._n_pb], axis=1)
        seen[:, self._cells] = np.take_along_axis(observations[:, self._cells], self._cell_tables[ways], axis=1)
        return seen

    def get_state(self) -> tuple[dict[str, Any], np.ndarray]:
        """Return the generator's state as plain values, and the way of each copy."""
        values = generator_state(self._random)
        assert values is not None
        return values, self.chosen.copy()

    def set_state(self, values: dict[str, Any], chosen: np.ndarray) -> None:
        """Take over what `get_state` returned.

        Raises:
            SettingsError: If it is no such state.
        """
        found, ways = generator_from(values), np.array(chosen, dtype=np.int64)
        if found is None or ways.shape != (self.num_envs,) or not ((ways >= 0) & (ways < self.n_ways)).all():
            raise SettingsError(f"`chosen` should hold {self.num_envs} ways from 0 to {self.n_ways - 1}")
        self._random, self.chosen = found, ways


def turns(n_pb: int) -> tuple[tuple[tuple[int, ...], tuple[float, ...]], ...]:
    """Return every way to swap and flip `n_pb` axes as (order, signs); the first leaves all as it is.

    Example:
        >>> len(turns(2)), turns(2)[0]
        (8, ((0, 1), (1.0, 1.0)))
    """
    swaps = itertools.permutations(range(n_pb))
    return tuple(itertools.product(swaps, itertools.product((1.0, -1.0), repeat=n_pb)))


def _cell_table(order: tuple[int, ...], signs: tuple[float, ...]) -> np.ndarray:
    """Return, for each of the agent's cells, the place of the environment's cell it is."""
    n_pb = len(order)
    strides = N_CELLS ** np.arange(n_pb)
    agents = np.arange(N_CELLS**n_pb)[:, None] // strides % N_CELLS
    environments = agents[:, order]
    environments = np.where(np.array(signs) > 0.0, environments, N_CELLS - 1 - environments)
    return environments @ strides
