"""Data augmentation by the symmetries of the PB axes.

What a PB unit's sign means, and which unit is the first, is an accident of a memory's training. With augmentation each
training episode flips and swaps the axes by one of 2^n_pb n_pb! symmetries, actions and observations alike, so that
the agent meets a consistent world. Only training does this: agents are evaluated on the memories as they are.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from creative_nao.envs.observation import N_CELLS, cells_of, tries_of
from creative_nao.envs.state import generator_from, generator_state
from creative_nao.errors import SettingsError


class FlippedSwappedAxes(VecEnvWrapper):
    """Draws a symmetry of the PB axes for every episode of each sub-environment.

    The agent's PB vector a becomes the environment's b with b[i] = signs[i] * a[order[i]]; `pb` and `cells` of its
    observations, or `points` and `tries`, are transformed back. `info` stays the environment's.

    Args:
        venv: A vector environment of this project.

    Attributes:
        symmetry: Index of each sub-environment's symmetry, shape (num_envs,); 0 is the identity.

    Raises:
        SettingsError: If observations hold neither cells of the PB space nor tries.
    """

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        if not isinstance(venv.observation_space, Box) or not isinstance(venv.action_space, Box):
            raise SettingsError(f"`venv` should have Box spaces, but has {venv.observation_space}")
        size, self._cells, pb = int(np.prod(venv.action_space.shape)), slice(0), [0]
        try:
            parts, columns = tries_of(venv.observation_space)
        except SettingsError:
            self._n_pb = size
            self._cells = cells_of(venv.observation_space, size)
        else:
            at, self._n_pb = {part.name: part for part in parts}, columns[1].size
            points = range(0, at["points"].stop if "points" in at else 0, self._n_pb)
            pb = [*points, *range(at["tries"].start + columns[1].start, at["tries"].stop, columns[-1].stop)]
        self._places = np.array(pb)[:, None] + np.arange(self._n_pb)  # where PB vectors are observed
        table = symmetries(self._n_pb)
        self._orders = np.array([order for order, _ in table])
        self._signs = np.array([signs for _, signs in table], np.float32)
        tables = [_cell_table(*one) if self._cells.stop else np.empty(0, np.int64) for one in table]
        self._cell_tables = np.array(tables)
        self._random = np.random.default_rng(0)
        self.symmetry = np.zeros(self.num_envs, np.int64)

    @property
    def n_symmetries(self) -> int:
        """Symmetries of the axes: 8 with two PB units."""
        return len(self._orders)

    def seed(self, seed: int | None = None) -> Any:
        """Seed the environments and the draw of symmetries."""
        self._random = np.random.default_rng(None if seed is None else [seed, self.n_symmetries])
        return super().seed(seed)

    def reset(self) -> np.ndarray:
        """Begin all episodes, each with a symmetry of its own."""
        observations = self.venv.reset()
        self.symmetry = self._random.integers(self.n_symmetries, size=self.num_envs)
        return self.to_agent(np.asarray(observations), self.symmetry)

    def step_async(self, actions: np.ndarray) -> None:
        """Take the agent's PB vectors, shape (num_envs, n_pb)."""
        self.venv.step_async(self.to_env(actions, self.symmetry))

    def step_wait(self) -> Any:
        """Step; a sub-environment whose episode has ended gets another symmetry for its next one."""
        stepped: Any = self.venv.step_wait()
        observations, rewards, dones, infos = stepped
        ended = np.flatnonzero(dones)
        for k in ended:
            last = self.to_agent(infos[k]["terminal_observation"][None], self.symmetry[k : k + 1])[0]
            infos[k] = {**infos[k], "terminal_observation": last}
        if len(ended):
            self.symmetry = self.symmetry.copy()
            self.symmetry[ended] = self._random.integers(self.n_symmetries, size=len(ended))
        return self.to_agent(observations, self.symmetry), rewards, dones, infos

    def to_env(self, pb: np.ndarray, symmetry: np.ndarray) -> np.ndarray:
        """Return the environment's actions for the agent's, both (n, n_pb or n_pb + 1); symmetry: (n,)."""
        turned = self._signs[symmetry] * np.take_along_axis(pb[:, : self._n_pb], self._orders[symmetry], axis=1)
        return np.concatenate([turned, pb[:, self._n_pb :]], axis=1)

    def to_agent(self, observations: np.ndarray, symmetry: np.ndarray) -> np.ndarray:
        """Return the agent's observations for the environment's, both (n, n_values); symmetry: (n,)."""
        mapped = observations.copy()
        seen = self._signs[symmetry][:, None] * observations[:, self._places]
        turned = np.empty_like(seen)
        np.put_along_axis(turned, np.broadcast_to(self._orders[symmetry][:, None], seen.shape), seen, axis=2)
        mapped[:, self._places] = turned
        mapped[:, self._cells] = np.take_along_axis(observations[:, self._cells], self._cell_tables[symmetry], axis=1)
        return mapped

    def get_state(self) -> tuple[dict[str, Any], np.ndarray]:
        """Return the generator's state as plain values, and each sub-environment's symmetry."""
        values = generator_state(self._random)
        assert values is not None
        return values, self.symmetry.copy()

    def set_state(self, values: dict[str, Any], symmetry: np.ndarray) -> None:
        """Take over what `get_state` returned.

        Raises:
            SettingsError: If it is no such state.
        """
        rng, symmetry = generator_from(values), np.array(symmetry, dtype=np.int64)
        in_range = ((symmetry >= 0) & (symmetry < self.n_symmetries)).all()
        if rng is None or symmetry.shape != (self.num_envs,) or not in_range:
            raise SettingsError(f"`symmetry` should hold {self.num_envs} numbers from 0 to {self.n_symmetries - 1}")
        self._random, self.symmetry = rng, symmetry


def symmetries(n_pb: int) -> tuple[tuple[tuple[int, ...], tuple[float, ...]], ...]:
    """Return every way to swap and flip `n_pb` axes as (order, signs); the first is the identity.

    Example:
        >>> len(symmetries(2)), symmetries(2)[0]
        (8, ((0, 1), (1.0, 1.0)))
    """
    swaps = itertools.permutations(range(n_pb))
    return tuple(itertools.product(swaps, itertools.product((1.0, -1.0), repeat=n_pb)))


def _cell_table(order: tuple[int, ...], signs: tuple[float, ...]) -> np.ndarray:
    """Return, for each of the agent's cells, the index of the environment's cell it is."""
    n_pb = len(order)
    strides = N_CELLS ** np.arange(n_pb)
    agents = np.arange(N_CELLS**n_pb)[:, None] // strides % N_CELLS
    environments = agents[:, order]
    environments = np.where(np.array(signs) > 0.0, environments, N_CELLS - 1 - environments)
    return environments @ strides
