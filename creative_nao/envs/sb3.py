"""Adapter of a Gymnasium vector environment to the `VecEnv` interface of Stable-Baselines3.

SB3 is imported with this module, which `creative_nao.envs.SB3VecEnv` loads when first used.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices

from creative_nao.errors import SettingsError

_END_TERMS = ("final_obs", "final_info")


class SB3VecEnv(VecEnv):
    """Gives a Gymnasium vector environment the interface that the algorithms of Stable-Baselines3 train on.

    Args:
        venv: A vector environment with `autoreset_mode` `SAME_STEP`, or the name of a registered environment.
        num_envs: Number of sub-environments, with a name.
        arguments: Handed to the environment, with a name.

    Raises:
        SettingsError: If the vector environment resets in another way.

    Example:
        >>> env = SB3VecEnv("CreativeNao/BoxingMental-v0", num_envs=4)
        >>> env.reset().shape
        (4, 85)
    """

    def __init__(self, venv: VectorEnv | str, num_envs: int = 8, **arguments: Any) -> None:
        made: Any = venv
        if isinstance(venv, str):
            made = gym.make_vec(
                venv, num_envs, vectorization_mode="vector_entry_point",
                autoreset_mode=AutoresetMode.SAME_STEP, **arguments,
            )  # fmt: skip
        mode = made.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise SettingsError(
                f"`venv` should have autoreset_mode SAME_STEP, as Stable-Baselines3 needs it, but has {mode}"
            )
        self.venv = made
        self._actions: np.ndarray | None = None
        super().__init__(made.num_envs, made.single_observation_space, made.single_action_space)

    def reset(self) -> np.ndarray:
        """Begin all episodes with the seeds and options set before, which are then used up."""
        seeds: list[int | None] | None = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        options = next((chosen for chosen in self._options if chosen), None)
        observations, infos = self.venv.reset(seed=seeds, options=options)
        self.reset_infos = [_info_of(infos, k) for k in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Step; return observations, rewards, ends and one `info` per sub-environment."""
        observations, rewards, terminated, truncated, infos = self.venv.step(self._actions)
        ended = np.logical_or(terminated, truncated)
        all_infos = [_info_of(infos, k) for k in range(self.num_envs)]
        for k in np.flatnonzero(ended):
            self.reset_infos[k] = all_infos[k]
            all_infos[k] = {
                **_info_of(infos["final_info"], int(k)),
                "terminal_observation": infos["final_obs"][k],
                "TimeLimit.truncated": bool(truncated[k] and not terminated[k]),
            }
        return observations, rewards.astype(np.float32), ended, all_infos

    def close(self) -> None:
        """Close the vector environment."""
        self.venv.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return a frame of each sub-environment."""
        frames = self.venv.render()
        return list(frames) if frames is not None else [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the vector environment, the same for every sub-environment asked for."""
        return [getattr(self.venv, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the vector environment, for all sub-environments; for some, SettingsError is raised."""
        self._all(indices, "set_attr")
        setattr(self.venv, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the vector environment once; its result is returned for each; for some: SettingsError."""
        self._all(indices, "env_method")
        return [getattr(self.venv, method_name)(*method_args, **method_kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each: sub-environments are rows of arrays, nothing wraps them."""
        return [False for _ in self._get_indices(indices)]

    def _all(self, indices: VecEnvIndices, called: str) -> None:
        if len(list(self._get_indices(indices))) != self.num_envs:
            raise SettingsError(f"`{called}` works on all sub-environments at once, but `indices` is {indices!r}")


def _info_of(infos: dict[str, Any], k: int) -> dict[str, Any]:
    """Return the terms of one sub-environment out of Gymnasium's vector format, as plain values."""
    info: dict[str, Any] = {}
    for name, values in infos.items():
        if name.startswith("_") or name in _END_TERMS:
            continue
        mask = infos.get(f"_{name}")
        if mask is None or mask[k]:
            value = _info_of(values, k) if isinstance(values, dict) else values[k]
            info[name] = value.item() if isinstance(value, np.generic) else value
    return info
