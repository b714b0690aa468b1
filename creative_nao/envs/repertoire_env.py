"""Base of the single environments: an episode in which the robot builds a repertoire of new actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box

from creative_nao.envs.archive import MEASURES
from creative_nao.envs.episode_batch import EPISODE_ACTIONS, EpisodeBatch
from creative_nao.envs.executors import FRAME_DT_S
from creative_nao.envs.memory_set import MemoryLike
from creative_nao.envs.observation import CELLS
from creative_nao.envs.spec import Specified, leave_text_as_it_is
from creative_nao.envs.state import EnvState, generator_from, generator_state
from creative_nao.envs.viewing import RENDER_MODES
from creative_nao.errors import SettingsError, ShapeError, nearest_name
from creative_nao.measures import Criteria
from creative_nao.robot import PhysicalLimits
from creative_nao.schema import Seed, checked

leave_text_as_it_is()


class RepertoireEnv(Specified, gym.Env[np.ndarray, np.ndarray]):  # pyright: ignore[reportIncompatibleVariableOverride]
    """Base of the boxing environments: generates, has the action executed, scores it and keeps the repertoire.

    Args:
        memory: Shipped name such as ``half/0``, path of a memory file, or a memory; or a split of the bank, ``train``,
            ``validation`` or ``test``, from which every episode draws one.
        n_actions: Actions in an episode.
        render_mode: One of ``metadata["render_modes"]`` or None.
        criteria: Where the lines between outcomes are drawn, also as a dictionary; default: the paper's.
        overlay: Whether colour frames carry a caption: outcome, nearest basic action, reward.
        n_imagined: How many movements `imagine` may imagine in an episode.
        observation: What is observed: ``cells`` as in -v0; else every try of the episode, as far as the `Track` of this
            name knows: ``outcomes``, ``points``, or ``trajectories`` as in -v1.
        drawing: Of frames: ``width`` (640) and ``height`` (480) in pixels, and ``camera_name``: ``close``,
            ``ringside``, ``side``, ``left`` or ``nao/top_camera``.

    Raises:
        NotFoundError: If there is no such memory.
        SettingsError: If an argument is of a wrong kind or out of range, or the memory does not suit.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as in gym.Env
        "render_modes": list(RENDER_MODES),
        "render_fps": round(1 / FRAME_DT_S),
    }
    _modulated = False
    _rehearsal = False
    physics = False
    """Whether the robot performs each movement."""
    limits = PhysicalLimits()
    """From where on a performance counts as failed."""

    def __init__(
        self,
        memory: MemoryLike = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
        overlay: bool = False,
        n_imagined: int = 0,
        observation: str = CELLS,
        **drawing: Any,
    ) -> None:
        batch = EpisodeBatch(
            memory, 1, n_actions, criteria, modulated=self._modulated, rehearsal=self._rehearsal,
            limits=self.limits if self.physics else None, render_mode=render_mode, overlay=overlay,
            n_imagined=n_imagined, observation=observation, **drawing,
        )  # fmt: skip
        self._join(batch, 0)

    def _join(self, batch: EpisodeBatch, env_id: int) -> None:
        """Be the environment of one episode of a batch."""
        self._batch, self._env_id, self._env_ids = batch, env_id, np.array([env_id])
        self.render_mode = batch.recorder.mode
        self.n_actions, self.n_imagined = batch.n_actions, batch.n_imagined
        self.criteria = batch.criteria
        self.observation_space = batch.observation_space
        self.action_space = Box(-1.0, 1.0, (batch.n_action,), np.float32)

    @classmethod
    def of_batch(cls, batch: EpisodeBatch, env_id: int, **attributes: Any) -> Self:
        """Return the environment of one episode of a vector environment's batch, with these further attributes."""
        env = cls.__new__(cls)
        vars(env).update(attributes)
        env._join(batch, env_id)
        return env

    @property
    def n_imagined_used(self) -> int:
        """Movements imagined in this episode so far."""
        return int(self._batch.n_imagined_done[self._env_id])

    @property
    def memory(self) -> Any:
        """The memory of this episode."""
        return self._batch.specs[self._env_id].memory

    @property
    def repertoire(self) -> list[np.ndarray]:
        """The movements accepted in this episode, each (n_steps, n_joints) [rad], as copies."""
        return self._batch.archive.accepted(self._env_id)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode with an empty repertoire.

        Args:
            seed: Seed of the draw of memories; only environments over a split of the bank draw anything.
            options: ``{"memory": name}`` takes this memory of the split instead of drawing one.

        Returns:
            The observation and an `info` with the name of the memory; where each step is a movement also with what
            `step` tells, zeros and empty texts.

        Raises:
            SettingsError: If the seed is none, or there is no such option.
            NotFoundError: If the memory in `options` is not of the split that the environment was made with.
        """
        wanted = checked_options(options, ("memory", "minari_autoseed")).get("memory")
        super().reset(seed=checked(Seed | None, seed, "seed"))
        batch, env_id = self._batch, self._env_id
        batch.reset(env_id, wanted, lambda: self.np_random)
        return batch.observations.vector(env_id), self._info(batch.blank_terms(self._env_ids), False)

    def _info(self, terms: dict[str, np.ndarray], ended: bool) -> dict[str, Any]:
        """Return terms of `info` as plain values, with those that `reset` and `step` have in common."""
        batch, complete = self._batch, not (self._modulated or self._rehearsal)
        info = _first(terms)
        if complete or not terms:
            info["memory"] = batch.specs[self._env_id].name
        if complete or ended:
            info["episode_measures"] = batch.measures(self._env_id) if ended else dict.fromkeys(MEASURES, 0.0)
        return info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Generate, execute and score the movement of a PB point; where the PB may change, its next five ticks.

        Args:
            action: PB vector, shape (n_pb,); values beyond [-1, 1] are clipped.

        Returns:
            Observation, reward, terminated (always False), truncated (after `n_actions` movements) and `info`.

        Raises:
            ShapeError: If the action does not have shape (n_pb,) or is not finite.
            SettingsError: If the episode has ended.
        """
        batch, env_id = self._batch, self._env_id
        if batch.ended(env_id):
            raise SettingsError(
                f"the episode has ended after {batch.n_done[env_id]} movements; begin another with `reset`"
            )
        pb = checked_pb(action, self.action_space.shape)[None]
        rewards, terms, _, finished_terms = batch.step(self._env_ids, pb)
        truncated = bool(batch.ended(env_id))
        info = self._info({**terms, **finished_terms}, truncated)
        if self.render_mode == "human":
            self.render()
        return batch.observations.vector(env_id), float(rewards[0]), False, truncated, info

    def imagine(self, pb: np.ndarray) -> dict[str, Any]:
        """Generate and score movements without performing them; nothing changes but the count `n_imagined_used`.

        Args:
            pb: One PB vector, shape (n_pb,), or several, (n, n_pb), each of them one of the budget `n_imagined`. Where
                the PB may change during a movement also those of all its decisions, (n, n_decisions, n_pb). Values
                beyond [-1, 1] are clipped.

        Returns:
            The terms that `info` would have if they were performed now, in `BoxingMental` to the bit: plain values for
            one vector, else arrays over the n movements.

        Raises:
            ShapeError: If `pb` has another shape or is not finite.
            SettingsError: If that is more than what is left of the budget; then nothing is imagined.
        """
        return _first(self._batch.imagine(self._env_ids, checked_points(pb, self._batch)[None]))

    def render(self) -> Any:
        """Show what was executed since the last call.

        Returns:
            `rgb_array`: the last movement at its widest (before the first action, the guard), uint8 (height, width, 3).
            `depth_array`: the same moment as distances from the camera [m], float32 (height, width).
            `rgb_array_list`: the film of all movements since the last call, `metadata["render_fps"]` frames a second.
            `human`: None; the movement is played in a window, which opens with the first action; called by `step`.

        Raises:
            MissingDependencyError: If this machine cannot draw or has no display; the message says what helps.
        """
        return self._batch.recorder.render(self._env_id)

    def close(self) -> None:
        """Close the window and free what drawing took; may be called again."""
        self._batch.close()

    def get_state(self) -> EnvState:
        """Return the exact state: an environment put into it goes on with the same bits."""
        values, arrays = self._batch.get_state(self._env_id)
        return EnvState(type(self).__name__, {**values, "random": generator_state(self._np_random)}, arrays)

    def set_state(self, state: EnvState) -> None:
        """Restore a state of this environment or of one made alike.

        Raises:
            SettingsError: If it is one of another environment, or a part of it does not fit.
            NotFoundError: If its memory is none of this environment's.
        """
        EnvState.check(state, self.get_state())  # which also refuses what is no state
        self._batch.set_state(self._env_id, state.values, state.arrays)
        self._np_random = generator_from(state.values["random"])


def _first(terms: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return the terms of the first movement as plain values."""
    return {
        name: value.item() if isinstance(value := values[0], np.generic) else value for name, values in terms.items()
    }


def checked_options(options: Any, known: tuple[str, ...]) -> dict[str, Any]:
    """Return the options of `reset`, an empty dictionary for None; what is no dictionary of `known` ones is refused."""
    for name in (chosen := checked(dict[str, Any] | None, options, "options") or {}):
        if name not in known:
            raise SettingsError(
                f"`options`: no option `{name}`{nearest_name(name, known)}; there are {', '.join(known)}"
            )
    return chosen


def checked_points(pb: Any, batch: EpisodeBatch, n_envs: int | None = None) -> np.ndarray:
    """Return what is to be imagined as `checked_pb` does: (n_pb,), (n, n_pb) or the PB of all decisions.

    For `n_envs` environments their number comes first in the shape.
    """
    ahead, n_pb = () if n_envs is None else (n_envs,), batch.memories.first.n_pb
    forms = [(*ahead, n_pb), (*ahead, "n", n_pb)]
    forms += [(*ahead, "n", batch.n_decisions, n_pb)] if batch.rollout is not None else []

    def fits(shape: tuple[int, ...]) -> bool:
        pairs = [zip(form, shape, strict=True) for form in forms if len(form) == len(shape) and 0 not in shape]
        return any(all(size in ("n", have) for size, have in pair) for pair in pairs)

    shapes = " or ".join(str(form).replace("'", "") for form in forms)
    return _checked(pb, fits, f"`pb` should be finite PB vectors of shape {shapes}")


def checked_pb(action: Any, shape: tuple[int, ...] | None) -> np.ndarray:
    """Return PB vectors as float64, clipped to [-1, 1]; another shape or what is not finite raises ShapeError."""
    what = "a finite PB vector" if len(shape or ()) == 1 else "finite PB vectors"
    return _checked(action, lambda have: have == shape, f"`action` should be {what} of shape {shape}")


def _checked(value: Any, fits: Callable[[tuple[int, ...]], bool], expected: str) -> np.ndarray:
    try:
        pb = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        pb = np.empty(0)
    if not fits(pb.shape) or not np.isfinite(pb).all() or isinstance(value, np.ma.MaskedArray):
        raise ShapeError(f"{expected}, but is {value!r:.200}")
    return np.minimum(np.maximum(pb, -1.0), 1.0)
