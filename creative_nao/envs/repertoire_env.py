"""What all environments share: an episode in which the robot builds a repertoire of new actions."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box

from creative_nao.envs.archive import Repertoire
from creative_nao.envs.episode_batch import Episodes, Scored
from creative_nao.envs.executors import FRAME_DT_S, Body, Mind, Performed, SharedScene
from creative_nao.envs.memory_set import MemoryLike
from creative_nao.envs.state import EnvState, generator_from, generator_state
from creative_nao.envs.viewing import RENDER_MODES, Screen
from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import Criteria

EPISODE_ACTIONS = 30
"""Actions in an episode: the sample size of the paper's measures."""

ONLY_ROBOT = np.zeros(1, np.int64)
"""Whose movement it is, as `Episodes` asks: here always the first of one robot's."""


class RepertoireEnv(gym.Env[np.ndarray, np.ndarray]):
    """Base of the boxing environments: generates, has the action performed, scores it and keeps the repertoire.

    Args:
        memory: Shipped name such as ``half/0``, path of a memory file, or a memory; or a part of the bank, ``train``,
            ``validation`` or ``test``, from which every episode draws one.
        n_actions: Actions in an episode.
        render_mode: One of ``metadata["render_modes"]`` or None.
        criteria: Where the lines between outcomes are drawn; default: the paper's.
        overlay: Whether colour frames tell outcome, nearest basic action and reward.

    Raises:
        NotFoundError: If there is no such memory.
        SettingsError: If `n_actions` is below 1 or the render mode is unknown.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as in gym.Env
        "render_modes": list(RENDER_MODES),
        "render_fps": round(1 / FRAME_DT_S),
    }
    _unfolding = False

    def __init__(
        self,
        memory: MemoryLike = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
        overlay: bool = False,
    ) -> None:
        check_n_actions(n_actions)
        self.render_mode = render_mode
        self.n_actions = n_actions
        self._shared = SharedScene()
        self._screen = Screen(self._shared, render_mode, overlay)
        self._episodes = Episodes(memory, 1, criteria, self._unfolding)
        self.criteria = self._episodes.criteria
        self.observation_space = self._episodes.observation_space
        self.action_space = Box(-1.0, 1.0, (self._episodes.bank.first.n_pb,), np.float32)
        self._performer: Mind | Body = self._make_performer()

    def _make_performer(self) -> Mind | Body:
        return Mind(self._shared)

    @property
    def n_decisions(self) -> int:
        """Steps that one action takes."""
        return 1

    @property
    def memory(self) -> Any:
        """The memory of this episode."""
        return self._episodes.facts[0].memory

    @property
    def repertoire(self) -> Repertoire:
        """What the robot knows, the basic actions and those accepted in this episode."""
        return Repertoire(self._episodes.facts[0].demonstrations, self._episodes.knowledge)

    @property
    def scene(self) -> Any:
        """Ring, robot and bag; built when first needed."""
        return self._shared.scene

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode with an empty repertoire.

        Args:
            seed: Seed of the draw of memories; only environments over a part of the bank draw anything.
            options: ``{"memory": name}`` takes this memory of the part instead of drawing one.

        Returns:
            The observation, all zero, and an `info` with the name of the memory.

        Raises:
            NotFoundError: If the memory in `options` is not of the part that the environment was made with.
        """
        super().reset(seed=seed, options=options)
        self._episodes.begin(0, (options or {}).get("memory"), lambda: self.np_random)
        self._screen.clear()
        if isinstance(self._performer, Body):
            self._performer.reset()
        return self._episodes.observer.vector(), {"memory": self._episodes.facts[0].name}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Generate the movement of a PB point, perform and score it.

        Args:
            action: PB vector, shape (n_pb,); values beyond [-1, 1] are clipped.

        Returns:
            Observation, reward, terminated (always False), truncated (after `n_actions` steps) and `info`.

        Raises:
            ShapeError: If the action does not have shape (n_pb,) or is not finite.
        """
        pb = checked_pb(action, self.action_space.shape)
        generated = self._episodes.generate(ONLY_ROBOT, pb[None])
        reward, info = self._finish(pb[None, None], generated)
        done = int(self._episodes.n_actions[0])
        self._episodes.observer.put(ONLY_ROBOT, "step", np.array([min(done / self.n_actions, 1.0)]))
        truncated = done >= self.n_actions
        if self.render_mode == "human":
            self.render()
        return self._episodes.observer.vector(), reward, False, truncated, {"pb": pb, **info, "step": done}

    def _finish(self, pb: np.ndarray, generated: np.ndarray) -> tuple[float, dict[str, Any]]:
        """Have one movement, (1, n_steps, n_joints), performed and scored; return its reward and terms."""
        facts = self._episodes.facts[0]
        taught = facts.demonstrations
        performed: list[Performed] | None = None
        if isinstance(self._performer, Body) or self._screen.wanted:
            performed = [self._performer.perform(generated[0], taught.dt_s, taught.joints, self._screen.wanted)]
        scored = self._episodes.score(ONLY_ROBOT, pb, generated, performed)
        info = self._terms(scored)
        if performed is not None:
            info.update(performed[0].figures)
            self._screen.remember(0, performed[0], caption_of(info))
        n_tried = int(self._episodes.n_actions[0])
        if n_tried >= self.n_actions:
            info["episode_measures"] = self._episodes.knowledge.measures(0, n_tried)
        return float(scored.reward[0]), info

    def _terms(self, scored: Scored) -> dict[str, Any]:
        nearest = int(scored.nearest[0])
        return {
            "outcome": scored.outcome_names[0],
            "appropriate": bool(scored.appropriate[0]),
            "nearest": nearest,
            "nearest_name": self._episodes.facts[0].demonstrations.names[nearest],
            "distance": float(scored.distance[0]),
            "known_distance": float(scored.known_distance[0]),
            "reward_novelty": float(scored.reward[0]),
            "repertoire_size": int(self._episodes.knowledge.sizes[0]) - self._episodes.knowledge.n_basic,
            "trajectory": scored.trajectories[0],
        }

    def render(self) -> Any:
        """Show what was performed since the last call.

        Returns:
            `rgb_array`: the last movement at its widest (before the first action, the guard), uint8 (480, 640, 3).
            `depth_array`: the same moment as distances from the camera [m], float32 (480, 640).
            `rgb_array_list`: the film of all movements since the last call, `metadata["render_fps"]` frames a second.
            `human`: None; the movement is played in a window, which opens with the first action; called by `step`.

        Raises:
            MissingDependencyError: If this machine cannot draw or has no display; the message says what helps.
        """
        return self._screen.show()

    def close(self) -> None:
        """Close the window and free what drawing took; may be called again."""
        self._screen.close()

    def get_state(self) -> EnvState:
        """Return the exact state: an environment put into it goes on with the same bits."""
        values, arrays = self._episodes.state(0)
        values["random"] = generator_state(self._np_random)
        if isinstance(self._performer, Body):
            arrays["physics"] = self._performer.get_state()
        return EnvState(type(self).__name__, values, arrays)

    def set_state(self, state: EnvState) -> None:
        """Go back to a state of this environment or of one made alike.

        Raises:
            SettingsError: If it is one of another environment, or a part of it does not fit.
            NotFoundError: If its memory is none of this environment's.
        """
        state.check(self.get_state())
        self._episodes.restore(0, state.values, state.arrays)
        self._np_random = generator_from(state.values["random"])
        self._screen.clear()
        if isinstance(self._performer, Body):
            self._performer.set_state(state.arrays["physics"])


def check_n_actions(n_actions: int) -> None:
    """Refuse an episode without an action.

    Raises:
        SettingsError: Naming it.
    """
    if n_actions < 1:
        raise SettingsError(f"`n_actions` should be at least 1, but is {n_actions}")


def checked_pb(action: Any, shape: tuple[int, ...] | None) -> np.ndarray:
    """Return PB vectors as float64, clipped to [-1, 1].

    Raises:
        ShapeError: If they do not have this shape or are not finite.
    """
    pb = np.asarray(action, dtype=np.float64)
    if pb.shape != shape or not np.isfinite(pb).all():
        what = "a finite PB vector" if len(shape or ()) == 1 else "finite PB vectors"
        raise ShapeError(f"`action` should be {what} of shape {shape}, but is {action!r}")
    return np.clip(pb, -1.0, 1.0)


def caption_of(info: dict[str, Any]) -> str:
    """Return a caption: outcome, nearest basic action, reward."""
    return f"{info['outcome']}, nearest {info['nearest_name']}, reward {info['reward_novelty']:.2f}"
