"""Wrappers that show the tries of an episode otherwise: as an image for convolutional policies, as rows for attention.

They take the environments whose observation has `tries`: -v1 and `CreativeNao/BoxingRehearsal-v0`. `GridObservation`
and `SetObservation` wrap single environments, `GridVectorObservation` and `SetVectorObservation` vector environments,
whose `final_obs` they show alike.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box, Dict, MultiBinary, Space
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from creative_nao.envs.observation import split
from creative_nao.errors import SettingsError
from creative_nao.measures.outcome import APPROPRIATE
from creative_nao.model.config import check_kind
from creative_nao.schema import Field, checked

Resolution = Annotated[int, Field(ge=2, le=1000)]


class _View(ABC):
    """What flat observations of an environment become; `space` is that of one."""

    space: Space[Any]

    def __init__(self, env: Any) -> None:
        self.parts, self.columns = getattr(env, "observation_parts", ()), getattr(env, "try_columns", ())
        if not self.columns:
            raise SettingsError(
                f"`env` should observe every try, as CreativeNao/ environments of -v1 and rehearsal do, but is {env}"
            )
        self.at = {column.name: slice(column.start, column.stop) for column in self.columns}
        self.n_pb = env.memory.pb.shape[1] if hasattr(env, "memory") else env.memories[0].pb.shape[1]

    @abstractmethod
    def __call__(self, observations: np.ndarray) -> Any:
        """Return the views of observations (n, size), with n as the first size of every array."""

    def one(self, observation: np.ndarray) -> Any:
        """Return the view of one observation, (size,)."""
        views = self(observation[None])
        return {name: view[0] for name, view in views.items()} if isinstance(views, dict) else views[0]


class _GridView(_View):
    """Images (n, n_channels, resolution, resolution), rows by PB unit 2, columns by PB unit 1."""

    def __init__(self, env: Any, resolution: int) -> None:
        super().__init__(env)
        self.resolution = checked(Resolution, resolution, "resolution")
        size = self.at["pb"].stop - self.at["pb"].start
        if self.n_pb != 2 or size != 2:
            what = f"{self.n_pb} PB units" if self.n_pb != 2 else f"{size // 2} PB vectors a movement"
            raise SettingsError(f"a grid shows one point of two PB units a movement, but this environment has {what}")
        drawn = {part.name: part.stop - part.start for part in self.columns if part.name not in ("pb", "outcome")}
        self.channels = ["tried", "appropriate"]
        for name, n in list(drawn.items())[1:]:
            self.channels += [name] if n == 1 else [f"{name}_{k}" for k in range(n)]
        self.channels += [part.name for part in self.parts if part.name != "tries"]
        self.space = Box(0.0, 1.0, (len(self.channels), self.resolution, self.resolution), np.float32)

    def _places(self, pb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return row and column of PB points (..., 2)."""
        places = np.rint((pb + 1.0) / 2.0 * (self.resolution - 1)).astype(np.int64)
        return places[..., 1], places[..., 0]

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        found, at = split(observations, self.parts, self.columns), self.at
        images = np.zeros((len(observations), len(self.channels), *[self.resolution] * 2), np.float32)
        who, row = np.nonzero(found["tries"][..., 0])
        tries = found["tries"][who, row]
        outcome = at["outcome"].start
        appropriate = tries[:, outcome : outcome + len(APPROPRIATE)].sum(axis=1, keepdims=True)
        values = np.concatenate([tries[:, :1], appropriate, tries[:, at["reward"].start :]], axis=1)
        y, x = self._places(tries[:, at["pb"]])
        images[who[:, None], np.arange(values.shape[1]), y[:, None], x[:, None]] = values
        channel = values.shape[1]
        for name in self.channels[channel:]:
            if name == "points":
                y, x = self._places(found[name].reshape(len(observations), -1, 2))
                images[np.arange(len(observations))[:, None], channel, y, x] = 1.0
            else:
                images[:, channel] = found[name][..., None]
            channel += 1
        return images


class _SetView(_View):
    """The parts by name: `tries` (n, n_rows, width), `mask` (n, n_rows), `points` (n, n_basic, n_pb), the others."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        flat = getattr(env, "single_observation_space", env.observation_space)
        low = {name: array[0] for name, array in self(flat.low[None]).items()}
        mask = MultiBinary(len(low.pop("mask")))
        self.space = Dict({"mask": mask, **{name: Box(array, 1.0, dtype=np.float32) for name, array in low.items()}})

    def __call__(self, observations: np.ndarray) -> dict[str, np.ndarray]:
        found = {name: array.copy() for name, array in split(observations, self.parts, self.columns).items()}
        if "points" in found:
            found["points"] = found["points"].reshape(len(observations), -1, self.n_pb)
        return {"mask": (found["tries"][..., 0] > 0.0).astype(np.int8), **found}


class _SingleWrapper(gym.ObservationWrapper[Any, Any, Any], RecordConstructorArgs):
    _view: type[_View]

    def __init__(self, env: gym.Env[Any, Any], **arguments: Any) -> None:
        RecordConstructorArgs.__init__(self, **arguments)
        check_kind(env, gym.Env, "env")
        super().__init__(env)
        self.view = self._view(env.unwrapped, **arguments)
        self.observation_space = self.view.space

    def observation(self, observation: np.ndarray) -> Any:
        """Return the view of an observation."""
        return self.view.one(observation)


class _VectorWrapper(VectorWrapper[Any, Any, Any, Any, Any], RecordConstructorArgs):
    _view: type[_View]

    def __init__(self, env: VectorEnv[Any, Any, Any], **arguments: Any) -> None:
        RecordConstructorArgs.__init__(self, **arguments)
        check_kind(env, VectorEnv, "env")
        super().__init__(env)
        self.view = self._view(env.unwrapped, **arguments)
        self.single_observation_space = self.view.space
        self.observation_space = batch_space(self.view.space, env.num_envs)

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin episodes; see the wrapped environment."""
        observations, infos = self.env.reset(seed=seed, options=options)
        return self.view(observations), infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step all sub-environments; see the wrapped environment."""
        observations, *rest, infos = self.env.step(actions)
        if "final_obs" in infos:
            final = np.empty_like(infos["final_obs"])
            for k in np.flatnonzero(infos["_final_obs"]):
                final[k] = self.view.one(infos["final_obs"][k])
            infos = {**infos, "final_obs": final}
        return self.view(observations), *rest, infos


class GridObservation(_SingleWrapper):
    """Draws the tries as an image, for convolutional policies.

    The observation is Box(0, 1, (n_channels, resolution, resolution), float32); row y, column x is the cell nearest to
    the PB point (-1 + 2 x / (resolution - 1), -1 + 2 y / (resolution - 1)), and the last try in a cell is drawn.
    `view.channels` names the channels: `tried`, `appropriate`, `reward`, `distances_0`, ... to each basic action, in
    rehearsal `performed` and `candidate`; `points` is 1 at the learned PB points, `step` and `imagined` are the same
    everywhere. What the track of the environment does not hold is not there. `CnnPolicy` of Stable-Baselines3 takes it
    with a resolution from 36 on and ``policy_kwargs={"normalize_images": False}``.

    Args:
        env: An environment whose observation has tries of two PB units.
        resolution: Cells on each side, 2 to 1,000.

    Raises:
        SettingsError: If the environment has no such observation, more than two PB units, or a PB that changes during a
            movement.

    Example:
        >>> import gymnasium as gym
        >>> from creative_nao.envs import GridObservation
        >>> GridObservation(gym.make("creative_nao:CreativeNao/BoxingMental-v1")).observation_space.shape
        (11, 32, 32)
    """

    _view = _GridView

    def __init__(self, env: gym.Env[Any, Any], resolution: int = 32) -> None:
        super().__init__(env, resolution=resolution)


class GridVectorObservation(_VectorWrapper):
    """Draws the tries of every sub-environment as an image; see `GridObservation`."""

    _view = _GridView

    def __init__(self, env: VectorEnv[Any, Any, Any], resolution: int = 32) -> None:
        super().__init__(env, resolution=resolution)


class SetObservation(_SingleWrapper):
    """Gives the tries as rows with a mask, for attention; any number of PB units.

    The observation is a Dict: `tries` (n_rows, width), a row a try as on the page of the environment; `mask` (n_rows,)
    1 where there is a try; `points` (n_basic, n_pb), if the track holds them; and every other part of the flat one.

    Args:
        env: An environment whose observation has tries.

    Raises:
        SettingsError: If it has none.

    Example:
        >>> import gymnasium as gym
        >>> from creative_nao.envs import SetObservation
        >>> sorted(SetObservation(gym.make("creative_nao:CreativeNao/BoxingMental-v1")).observation_space)
        ['mask', 'points', 'step', 'tries']
    """

    _view = _SetView


class SetVectorObservation(_VectorWrapper):
    """Gives the tries of every sub-environment as rows with a mask; see `SetObservation`."""

    _view = _SetView
