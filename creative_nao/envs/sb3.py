"""Adapter of a Gymnasium vector environment to the `VecEnv` interface of Stable-Baselines3.

SB3 is imported with this module, which `creative_nao.envs.SB3VecEnv` loads when first used.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.env_util import is_wrapped
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices

from creative_nao.errors import NotFoundError, SettingsError, nearest_name
from creative_nao.model.config import check_kind

_END_TERMS = ("final_obs", "final_info")


class SB3VecEnv(VecEnv):
    """Gives a Gymnasium vector environment the interface that the algorithms of Stable-Baselines3 train on.

    Sub-environments answer one by one, as in `DummyVecEnv`: options, attributes, methods, `indices`. The `info` at the
    end of an episode holds its return and length, `episode`, so that `ep_rew_mean` is logged without a `VecMonitor`.
    The end of a rehearsal, which the agent's commits bring about, is none of a time limit (`TimeLimit.truncated`).

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
            try:
                made = gym.make_vec(
                    venv, num_envs, vectorization_mode="vector_entry_point",
                    autoreset_mode=AutoresetMode.SAME_STEP, **arguments,
                )  # fmt: skip
            except gym.error.UnregisteredEnv as error:
                raise NotFoundError(f"no environment `{venv}`{nearest_name(venv, gym.registry)}") from error
        check_kind(made, VectorEnv, "venv")
        mode = made.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise SettingsError(
                f"`venv` should have autoreset_mode SAME_STEP, as Stable-Baselines3 needs it, but has {mode}"
            )
        self.venv = made
        # Else Stable-Baselines3 would expect more reward after the budget's end, and an agent that can would hasten it.
        self._ends_itself = getattr(getattr(made.unwrapped, "single_class", None), "_rehearsal", False)
        self._actions: np.ndarray | None = None
        self._begin_terms: set[str] = set()
        self._returns, self._lengths = np.zeros(made.num_envs), np.zeros(made.num_envs, np.int64)
        self._began = np.full(made.num_envs, time.perf_counter())
        super().__init__(made.num_envs, made.single_observation_space, made.single_action_space)

    def reset(self) -> np.ndarray:
        """Begin all episodes, each with the seed and the options set for it before, which are then used up."""
        if len(self._options) != self.num_envs:
            raise SettingsError(f"`options` should be {self.num_envs}, one a copy, but are {len(self._options)}")
        observations: Any = None
        infos: dict[str, Any] = {}
        if all(options == self._options[0] for options in self._options):
            seeds: list[int | None] | None = None if all(seed is None for seed in self._seeds) else list(self._seeds)
            observations, infos = self.venv.reset(seed=seeds, options=self._options[0] or None)
            self.reset_infos = [_info_of(infos, k) for k in range(self.num_envs)]
        else:
            if not self._begin_terms:  # Gymnasium's own take a mask only when all have begun once
                self.venv.reset()
            for k, options in enumerate(self._options):
                only = {"reset_mask": np.arange(self.num_envs) == k}
                observations, infos = self.venv.reset(seed=list(self._seeds), options={**options, **only})
                self.reset_infos[k] = _info_of(infos, k)
        self._begin_terms = set(infos)
        self._returns[:], self._lengths[:], self._began[:] = 0.0, 0, time.perf_counter()
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
        self._returns += rewards
        self._lengths += 1
        now = time.perf_counter()
        for k in np.flatnonzero(ended).tolist():
            # What stands beside the beginning of the new episode, a wrapper has added: it tells of the end.
            begun = {name: value for name, value in all_infos[k].items() if name in self._begin_terms}
            added = {name: value for name, value in all_infos[k].items() if name not in self._begin_terms}
            length, seconds = int(self._lengths[k]), round(now - float(self._began[k]), 6)
            self.reset_infos[k] = begun
            all_infos[k] = {
                "episode": {"r": float(self._returns[k]), "l": length, "t": seconds},
                **added,
                **_info_of(infos["final_info"], k),
                "terminal_observation": infos["final_obs"][k],
                "TimeLimit.truncated": bool(truncated[k] and not terminated[k] and not self._ends_itself),
            }
        self._returns[ended], self._lengths[ended], self._began[ended] = 0.0, 0, now
        return observations, rewards.astype(np.float32), ended, all_infos

    def close(self) -> None:
        """Close the vector environment."""
        self.venv.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return a frame of each sub-environment."""
        frames = self.venv.render()
        return list(frames) if frames is not None else [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of each sub-environment asked for."""
        if not hasattr(self.venv.unwrapped, "envs"):
            each = self.venv.unwrapped.get_attr(attr_name)  # pyright: ignore[reportAttributeAccessIssue]
            return [each[k] for k in self._get_indices(indices)]
        return [env.get_wrapper_attr(attr_name) for env in self._chosen(indices, "get_attr")]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of each sub-environment asked for."""
        for env in self._chosen(indices, "set_attr"):
            setattr(env, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of each sub-environment asked for and return the results."""
        called = [env.get_wrapper_attr(method_name) for env in self._chosen(indices, "env_method")]
        return [method(*method_args, **method_kwargs) for method in called]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Tell of each sub-environment asked for whether it is wrapped so."""
        return [is_wrapped(env, wrapper_class) for env in self._chosen(indices, "env_is_wrapped")]

    def _chosen(self, indices: VecEnvIndices, called: str) -> list[Any]:
        envs = getattr(self.venv.unwrapped, "envs", None)
        if envs is None:
            raise SettingsError(f"`{called}` needs sub-environments in this process, but those of {self.venv} are not")
        return [envs[k] for k in self._get_indices(indices)]


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
