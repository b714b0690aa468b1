"""Vector environments: many sub-environments at once, generated together, scored and performed in threads.

They give the same trajectories, bit for bit, as separate environments of the same seeds in Gymnasium's Sync or Async
vector environments.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from creative_nao.envs.archive import MEASURES
from creative_nao.envs.episode_batch import EPISODE_ACTIONS, EpisodeBatch
from creative_nao.envs.executors import FRAME_DT_S
from creative_nao.envs.memory_set import MemoryLike
from creative_nao.envs.observation import CELLS
from creative_nao.envs.repertoire_env import RepertoireEnv, checked_options, checked_pb, checked_points
from creative_nao.envs.spec import EpisodeLength, Specified
from creative_nao.envs.state import EnvState
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
        n_imagined: How many movements each sub-environment may imagine in an episode.
        observation: What is observed, as of the single environment.
        max_episode_steps: Handed over by `gymnasium.make_vec`; the length of an episode is set by `n_actions` alone.
        drawing: `width`, `height` and `camera_name` of frames, as of the single environment.

    Raises:
        NotFoundError: If there is no such memory.
        SettingsError: If a setting is of a wrong kind or out of range.
    """

    single_class: type[RepertoireEnv] = RepertoireEnv
    """Class of the single environment."""
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
        n_imagined: int = 0,
        observation: str = CELLS,
        max_episode_steps: int | None = None,
        **drawing: Any,
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
            memory, num_envs, n_actions, criteria,
            modulated=self.single_class._modulated, rehearsal=self.single_class._rehearsal,
            limits=self.limits if self.physics else None,
            n_threads=n_threads, render_mode=render_mode, overlay=overlay,
            n_imagined=n_imagined, observation=observation, **drawing,
        )  # fmt: skip
        self.num_envs, self.render_mode = num_envs, render_mode
        self.n_actions, self.n_imagined = self._batch.n_actions, self._batch.n_imagined
        setting = "n_imagined" if self.single_class._rehearsal else "n_actions"
        length = None if isinstance(max_episode_steps, EpisodeLength) else max_episode_steps
        if checked(Count | None, length, "max_episode_steps") not in (None, n := self.max_episode_steps):
            raise SettingsError(f"`max_episode_steps` should be {n}, as `{setting}` sets it, but is {length}")
        self.metadata = {
            "render_modes": [mode for mode in RENDER_MODES if mode != "human"],
            "render_fps": round(1 / FRAME_DT_S),
            "autoreset_mode": self.autoreset_mode,
        }
        self.criteria = self._batch.criteria
        same = {"physics": self.physics, "limits": self.limits}
        self.envs = [self.single_class.of_batch(self._batch, env_id, **same) for env_id in range(num_envs)]
        """Each sub-environment as a single environment: its attributes, `get_state`, `render`, ..."""
        self.single_observation_space = self.envs[0].observation_space
        self.single_action_space = self.envs[0].action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    @property
    def _ended(self) -> np.ndarray:
        """Which episodes are over and were not begun anew, (num_envs,)."""
        return self._batch.ended()

    @property
    def memories(self) -> tuple[Any, ...]:
        """The memory of each sub-environment's episode."""
        return tuple(spec.memory for spec in self._batch.specs)

    @property
    def n_imagined_used(self) -> np.ndarray:
        """Movements imagined in each sub-environment's episode so far, (num_envs,)."""
        return self._batch.n_imagined_done.copy()

    def imagine(self, pb: np.ndarray, env_ids: Any = None) -> dict[str, np.ndarray]:
        """Generate and score movements without performing them; see `imagine` of the single environment.

        `pb` and what is returned have the sub-environment in front: (m, n_pb) or (m, n, n_pb), and (m, ...) or
        (m, n, ...). `env_ids` are m rising numbers of sub-environments, None for all; others raise SettingsError. If
        one has less left of its budget, none imagines.
        """
        who = np.arange(self.num_envs) if env_ids is None else np.asarray(env_ids)
        fits = who.ndim == 1 and who.size > 0 and who.dtype.kind in "iu"
        if not fits or who[0] < 0 or who[-1] >= self.num_envs or (np.diff(who) <= 0).any():
            raise SettingsError(
                f"`env_ids` should be rising numbers of sub-environments below {self.num_envs}, but is {env_ids!r:.80}"
            )
        return self._batch.imagine(who, checked_points(pb, self._batch, len(who)))

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of each sub-environment, or get an attribute, as Gymnasium's own vector environments do."""
        found = [getattr(env, name) for env in self.envs]
        return tuple(one(*args, **kwargs) if callable(one) else one for one in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each sub-environment."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of each sub-environment: a list or tuple holds one value each, all else is for all.

        Raises:
            SettingsError: If there are not as many values as sub-environments.
        """
        each = values if isinstance(values, list | tuple) else [values] * self.num_envs
        for env, value in zip(self.envs, self._one_each(each, "values"), strict=True):
            setattr(env, name, value)

    def _one_each(self, values: Sequence[Any], name: str) -> Sequence[Any]:
        if len(values) != self.num_envs:
            what = f"{self.num_envs} {name.removesuffix('s')}s, one per sub-environment"
            raise SettingsError(f"`{name}` should hold {what}, but holds {len(values)}")
        return values

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | list[dict[str, Any] | None] | None = None,
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin episodes with empty repertoires.

        Args:
            seed: One seed per sub-environment; an int for that, the next, and so on.
            options: ``{"memory": name}`` takes this memory in all of them; ``{"reset_mask": mask}`` of bool, shape
                (num_envs,), begins only these episodes anew. A list holds the options of each sub-environment.

        Returns:
            The observations and, as `info`, the names of the memories.

        Raises:
            SettingsError: If seeds, options or the mask do not fit.
            NotFoundError: If there is no such memory in this environment.
        """
        if isinstance(seed, list):
            seeds = checked(list[Seed | None], seed, "seed")
        else:
            first = checked(Seed | None, seed, "seed")
            seeds = [None if first is None else first + k for k in range(self.num_envs)]
        self._one_each(seeds, "seed")
        chosen: list[dict[str, Any]]
        if isinstance(options, list):
            each = self._one_each(options, "options")
            chosen, mask = [checked_options(one, ("memory",)) for one in each], None
        else:
            shared = dict(checked_options(options, ("memory", "reset_mask")))
            mask, chosen = shared.pop("reset_mask", None), [shared] * self.num_envs
        mask = np.ones(self.num_envs, bool) if mask is None else np.asarray(mask)
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise SettingsError(
                f'options["reset_mask"] should be {self.num_envs} bools, at least one of them true, but is {mask!r:.80}'
            )
        env_ids = np.flatnonzero(mask)
        infos = self._begin(env_ids, {}, seeds, chosen)
        return self._batch.observations.vectors(), infos

    def _begin(
        self,
        env_ids: np.ndarray,
        infos: dict[str, Any],
        seeds: Sequence[int | None] | None = None,
        options: Sequence[Any] | None = None,
    ) -> dict[str, Any]:
        """Begin episodes with the seeds and options of all sub-environments; return `infos` with theirs."""
        for k in env_ids.tolist():
            _, info = self.envs[k].reset(seed=seeds and seeds[k], options=options and options[k])
            infos = self._add_info(infos, info, k)
        return infos

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
        ended = self._ended
        beginning, env_ids = np.flatnonzero(ended), np.flatnonzero(~ended)
        if len(beginning) and self.autoreset_mode is AutoresetMode.DISABLED:
            raise SettingsError(
                f"the episodes of sub-environments {beginning.tolist()} have ended; begin them anew with "
                'reset(options={"reset_mask": mask}), since `autoreset_mode` is disabled'
            )
        rewards, truncated, infos = np.zeros(self.num_envs), np.zeros(self.num_envs, bool), {}
        if len(env_ids):
            rewards[env_ids], terms, finished, finished_terms = batch.step(env_ids, pb[env_ids])
            truncated[env_ids] = batch.ended(env_ids)
            if not (self.single_class._modulated or self.single_class._rehearsal):  # all terms in every step
                terms["memory"] = np.array([batch.specs[env_id].name for env_id in env_ids], object)
            parts = [(env_ids, terms), (env_ids[finished], finished_terms)]
            if self.autoreset_mode is AutoresetMode.SAME_STEP and truncated.any():
                infos = self._end_and_begin(parts, truncated)
            else:
                infos = self._infos(parts, ~ended, truncated)
        infos = self._begin(beginning, infos)
        return batch.observations.vectors(), rewards, np.zeros(self.num_envs, bool), truncated, infos

    def _infos(
        self, parts: list[tuple[np.ndarray, dict[str, np.ndarray]]], chosen: np.ndarray, truncated: np.ndarray
    ) -> dict[str, Any]:
        """Return the terms of a step as `infos`, those of the `chosen` sub-environments only, (num_envs,) of bool."""
        infos: dict[str, Any] = {}
        for env_ids, terms in parts:
            rows = np.flatnonzero(chosen[env_ids])
            infos |= _vector_info(self.num_envs, env_ids[rows], {name: values[rows] for name, values in terms.items()})
        told = chosen if "memory" in infos else chosen & truncated
        if told.any():
            found = {env_id: self._batch.measures(env_id) for env_id in np.flatnonzero(chosen & truncated).tolist()}
            of_all = {name: np.zeros(self.num_envs) for name in MEASURES}
            for env_id, measures in found.items():
                for name, value in measures.items():
                    of_all[name][env_id] = value
            masks = {f"_{name}": told.copy() for name in MEASURES}
            infos |= {"episode_measures": of_all | masks, "_episode_measures": told.copy()}
        return infos

    def _end_and_begin(
        self, parts: list[tuple[np.ndarray, dict[str, np.ndarray]]], truncated: np.ndarray
    ) -> dict[str, Any]:
        """Begin the episodes that have ended; return `infos` with `final_obs` and `final_info` of their ends."""
        ended = np.flatnonzero(truncated)
        infos = self._infos(parts, ~truncated, truncated)
        final = np.empty(len(ended), object)
        final[:] = list(self._batch.observations.vectors()[ended])
        infos |= _vector_info(self.num_envs, ended, {"final_obs": final})
        infos["final_info"] = self._infos(parts, truncated, truncated)
        infos["_final_info"] = truncated.copy()
        return self._begin(ended, infos)

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
        return tuple(env.get_state() for env in self.envs)

    def set_state(self, states: tuple[EnvState, ...] | list[EnvState]) -> None:
        """Restore the state of each sub-environment: of `get_state` here or of a single environment made alike.

        Raises:
            SettingsError: If they are not one per sub-environment, of another environment, or a part of one does not
                fit.
            NotFoundError: If a memory is none of this environment's.
        """
        check_kind(states, tuple if isinstance(states, tuple) else list, "states")
        self._one_each(states, "states")
        for state, present in zip(states, self.get_state(), strict=True):
            EnvState.check(state, present)
        for env, state in zip(self.envs, states, strict=True):
            env.set_state(state)


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
