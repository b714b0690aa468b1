"""Vector environments: many sub-environments at once, generated together, scored and performed in threads.

They give the same trajectories, bit for bit, as separate environments of the same seeds in Gymnasium's Sync or Async
vector environments.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from creative_nao.envs.episode_batch import EPISODE_ACTIONS, EpisodeBatch
from creative_nao.envs.executors import FRAME_DT_S
from creative_nao.envs.memory_set import MemoryLike
from creative_nao.envs.repertoire_env import checked_options, checked_pb
from creative_nao.envs.spec import EpisodeLength, Specified
from creative_nao.envs.state import EnvState, generator_from, generator_state
from creative_nao.envs.viewing import RENDER_MODES
from creative_nao.errors import SettingsError
from creative_nao.measures import Criteria
from creative_nao.model.config import check_kind
from creative_nao.robot import PhysicalLimits
from creative_nao.schema import Count, Seed, checked


class RepertoireVectorEnv(Specified, VectorEnv[np.ndarray, np.ndarray, np.ndarray]):  # pyright: ignore[reportIncompatibleVariableOverride]
    """Base of the vector environments.

    Args:
        num_envs: Number of sub-environments.
        memory: As of the single environment; over a split of the bank every sub-environment draws its own.
        n_actions: Actions in an episode.
        render_mode: `rgb_array`, `rgb_array_list`, `depth_array` or None; `render` returns one result per
            sub-environment.
        criteria: Where the lines between outcomes are drawn.
        overlay: Whether colour frames carry a caption.
        autoreset_mode: What happens when an episode has ended: `NEXT_STEP` (the next step begins a new one, as
            Gymnasium does by default), `SAME_STEP` (the new one begins at once, the old one's end is in `final_obs` and
            `final_info`) or `DISABLED` (`reset(options={"reset_mask": mask})` begins it).
        n_threads: Threads; None for one a processor core.
        max_episode_steps: Handed over by `gymnasium.make_vec`; the length of an episode is set by `n_actions` alone.

    Raises:
        NotFoundError: If there is no such memory.
        SettingsError: If a setting is of a wrong kind or out of range.
    """

    _single_name = ""
    """Class name of the single environment, whose states fit."""
    _modulated = False
    physics = False
    limits = PhysicalLimits()

    def __init__(
        self,
        num_envs: int = 1,
        memory: MemoryLike = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
        overlay: bool = False,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        n_threads: int | None = None,
        max_episode_steps: int | None = None,
    ) -> None:
        num_envs = checked(Count, num_envs, "num_envs")
        if render_mode == "human":
            raise SettingsError('`render_mode` "human" opens one window: use it with a single environment')
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError as error:
            known = ", ".join(mode.value for mode in AutoresetMode)
            raise SettingsError(f"`autoreset_mode` should be one of {known}, but is {autoreset_mode!r}") from error
        self._batch = EpisodeBatch(
            memory, num_envs, n_actions, criteria, modulated=self._modulated,
            limits=self.limits if self.physics else None,
            n_threads=n_threads, render_mode=render_mode, overlay=overlay,
        )  # fmt: skip
        self.num_envs, self.n_actions, self.render_mode = num_envs, self._batch.n_actions, render_mode
        length = None if isinstance(max_episode_steps, EpisodeLength) else max_episode_steps
        if checked(Count | None, length, "max_episode_steps") not in (None, n := self.n_actions * self.n_decisions):
            raise SettingsError(f"`max_episode_steps` should be {n}, as `n_actions` sets it, but is {length}")
        self.metadata = {
            "render_modes": [mode for mode in RENDER_MODES if mode != "human"],
            "render_fps": round(1 / FRAME_DT_S),
            "autoreset_mode": self.autoreset_mode,
        }
        self.criteria = self._batch.criteria
        self.single_observation_space = self._batch.observation_space
        self.single_action_space = Box(-1.0, 1.0, (self._batch.memories.first.n_pb,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._random: list[np.random.Generator | None] = [None] * num_envs
        self._ended = np.zeros(num_envs, bool)

    @property
    def n_decisions(self) -> int:
        """Steps that one action takes."""
        return self._batch.n_decisions

    @property
    def memories(self) -> tuple[Any, ...]:
        """The memory of each sub-environment's episode."""
        return tuple(spec.memory for spec in self._batch.specs)

    def _generator(self, env_id: int) -> np.random.Generator:
        generator = self._random[env_id]
        if generator is None:
            generator = self._random[env_id] = seeding.np_random()[0]
        return generator

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin episodes with empty repertoires.

        Args:
            seed: One seed per sub-environment; an int for that, the next, and so on.
            options: ``{"memory": name}`` takes this memory in all of them; ``{"reset_mask": mask}`` of bool, shape
                (num_envs,), begins only these episodes anew.

        Returns:
            The observations and, as `info`, the names of the memories.

        Raises:
            SettingsError: If the seeds or the mask do not fit.
            NotFoundError: If there is no such memory in this environment.
        """
        if isinstance(seed, list):
            seeds = checked(list[Seed | None], seed, "seed")
        else:
            first = checked(Seed | None, seed, "seed")
            seeds = [None if first is None else first + k for k in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise SettingsError(
                f"`seed` should hold {self.num_envs} seeds, one per sub-environment, but holds {len(seeds)}"
            )
        chosen = dict(checked_options(options, ("memory", "reset_mask")))
        mask = np.asarray(chosen.pop("reset_mask", np.ones(self.num_envs, bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise SettingsError(
                f'options["reset_mask"] should be {self.num_envs} bools, at least one of them true, but is {mask!r:.80}'
            )
        env_ids = np.flatnonzero(mask)
        for env_id in env_ids:
            if seeds[env_id] is not None:
                self._random[env_id] = seeding.np_random(seeds[env_id])[0]
        infos = self._begin(env_ids, chosen.get("memory"))
        self._ended[env_ids] = False
        return self._batch.observations.vectors(), infos

    def _begin(self, env_ids: np.ndarray, wanted: str | None = None) -> dict[str, Any]:
        """Begin episodes; return the names of their memories as `info`."""
        for env_id in env_ids:
            self._batch.reset(env_id, wanted, lambda env_id=env_id: self._generator(env_id))
        names = np.array([self._batch.specs[env_id].name for env_id in env_ids], object)
        return _vector_info(self.num_envs, env_ids, {"memory": names})

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step all sub-environments.

        Args:
            actions: PB vectors, (num_envs, n_pb); values beyond [-1, 1] are clipped. Those of sub-environments whose
                episode has ended are ignored with `NEXT_STEP`, where they begin a new one.

        Returns:
            Observations, rewards, terminations (never), truncations and `infos`, arrays over the sub-environments.

        Raises:
            ShapeError: If the actions do not have that shape or are not finite.
            SettingsError: If an episode has ended and was not begun anew with `DISABLED`.
        """
        batch = self._batch
        pb = checked_pb(actions, self.action_space.shape)
        beginning = np.flatnonzero(self._ended)
        if len(beginning) and self.autoreset_mode is not AutoresetMode.NEXT_STEP:
            raise SettingsError(
                f"the episodes of sub-environments {beginning.tolist()} have ended; begin them anew with "
                'reset(options={"reset_mask": mask}), since `autoreset_mode` is disabled'
            )
        infos = self._begin(beginning)
        env_ids = np.flatnonzero(~self._ended)
        rewards, truncated = np.zeros(self.num_envs), np.zeros(self.num_envs, bool)
        if len(env_ids):
            rewards[env_ids], terms, finished, finished_terms = batch.step(env_ids, pb[env_ids])
            truncated[env_ids] = batch.n_done[env_ids] >= self.n_actions
            parts = [(env_ids, terms), (env_ids[finished], finished_terms)]
            if self.autoreset_mode is AutoresetMode.SAME_STEP and truncated.any():
                infos |= self._end_and_begin(parts, truncated)
            else:
                infos |= self._infos(parts, np.ones(self.num_envs, bool))
                infos = self._with_measures(infos, truncated)
        self._ended = truncated & (self.autoreset_mode is not AutoresetMode.SAME_STEP)
        return batch.observations.vectors(), rewards, np.zeros(self.num_envs, bool), truncated, infos

    def _infos(self, parts: list[tuple[np.ndarray, dict[str, np.ndarray]]], chosen: np.ndarray) -> dict[str, Any]:
        """Return the terms of a step as `infos`, those of the `chosen` sub-environments only, (num_envs,) of bool."""
        infos: dict[str, Any] = {}
        for env_ids, terms in parts:
            rows = np.flatnonzero(chosen[env_ids])
            infos |= _vector_info(self.num_envs, env_ids[rows], {name: values[rows] for name, values in terms.items()})
        return infos

    def _end_and_begin(
        self, parts: list[tuple[np.ndarray, dict[str, np.ndarray]]], truncated: np.ndarray
    ) -> dict[str, Any]:
        """Begin the episodes that have ended; return `infos` with `final_obs` and `final_info` of their ends."""
        ended = np.flatnonzero(truncated)
        infos = self._infos(parts, ~truncated)
        final = np.empty(len(ended), object)
        final[:] = list(self._batch.observations.vectors()[ended])
        infos |= _vector_info(self.num_envs, ended, {"final_obs": final})
        infos["final_info"] = self._with_measures(self._infos(parts, truncated), truncated)
        infos["_final_info"] = truncated.copy()
        return infos | self._begin(ended)

    def _with_measures(self, infos: dict[str, Any], ended: np.ndarray) -> dict[str, Any]:
        for env_id in np.flatnonzero(ended).tolist():
            infos = self._add_info(infos, {"episode_measures": self._batch.measures(env_id)}, env_id)
        return infos

    def render(self) -> tuple[Any, ...] | None:
        """Show what each sub-environment executed since the last call, as the single environment's `render` does."""
        if self.render_mode is None:
            return None
        return tuple(self._batch.recorder.render(env_id) for env_id in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads and free what drawing took."""
        if hasattr(self, "_batch"):  # Gymnasium also closes a vector environment whose arguments were refused
            self._batch.close()

    def get_state(self) -> tuple[EnvState, ...]:
        """Return the exact state of each sub-environment; a single environment of the same kind takes it, too."""
        parts = [(*self._batch.get_state(env_id), generator_state(rng)) for env_id, rng in enumerate(self._random)]
        return tuple(EnvState(self._single_name, {**values, "random": rng}, arrays) for values, arrays, rng in parts)

    def set_state(self, states: tuple[EnvState, ...] | list[EnvState]) -> None:
        """Restore the state of each sub-environment: of `get_state` here or of a single environment made alike.

        Raises:
            SettingsError: If they are not one per sub-environment, of another environment, or a part of one does not
                fit.
            NotFoundError: If a memory is none of this environment's.
        """
        check_kind(tuple if isinstance(states, tuple) else list, states, "states")
        if len(states) != self.num_envs:
            raise SettingsError(
                f"`states` should hold {self.num_envs} states, one per sub-environment, but holds {len(states)}"
            )
        for env_id, (state, present) in enumerate(zip(states, self.get_state(), strict=True)):
            EnvState.check(state, present)
            self._batch.set_state(env_id, state.values, state.arrays)
            self._random[env_id] = generator_from(state.values["random"])
            ended = self._batch.n_done[env_id] >= self.n_actions
            self._ended[env_id] = ended and self.autoreset_mode is not AutoresetMode.SAME_STEP


def _vector_info(num_envs: int, env_ids: np.ndarray, terms: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return terms of some sub-environments, (m, ...), in Gymnasium's vector format: whole arrays, masks ``_name``."""
    infos: dict[str, Any] = {}
    if not len(env_ids):
        return infos
    mask = np.zeros(num_envs, bool)
    mask[env_ids] = True
    for name, values in terms.items():
        whole = values
        if len(env_ids) < num_envs:
            empty = None if values.dtype == object else 0
            whole = np.full((num_envs, *values.shape[1:]), empty, values.dtype)
            whole[env_ids] = values
        infos[name], infos[f"_{name}"] = whole, mask.copy()
    return infos
