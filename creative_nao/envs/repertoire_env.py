"""What both environments share: an episode in which the robot builds a repertoire of new actions."""

from __future__ import annotations

import abc
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box

from creative_nao.envs.observation import APPROPRIATE, Observer, observation_space
from creative_nao.envs.repertoire import Repertoire
from creative_nao.envs.stage import FRAME_DT_S, Stage
from creative_nao.errors import NotFoundError, SettingsError, ShapeError, nearest_name
from creative_nao.measures import Criteria, excursion_limit, excursions, largest_speeds, speed_limits
from creative_nao.model import SPLITS, Memory, load_memory, split_memories

if TYPE_CHECKING:
    from creative_nao.robot.scene import Scene

EPISODE_ACTIONS = 30
"""Actions in an episode: the sample size of the paper's measures."""


@dataclass(frozen=True)
class Performed:
    """One action as it was performed.

    Attributes:
        trajectory: What is scored [rad], shape (n_steps, n_joints): generated in the mind or measured on the robot.
        fault: Physical outcome that makes it inappropriate, or None.
        figures: Further numbers for `info`.
    """

    trajectory: np.ndarray
    fault: str | None
    figures: dict[str, Any]


class RepertoireEnv(gym.Env[np.ndarray, np.ndarray], abc.ABC):
    """Base of the boxing environments: generates, has the action performed, scores it and keeps the repertoire.

    Args:
        memory: Shipped name such as ``half/0``, path of a memory file, or a `Memory`; or a part of the bank, ``train``,
            ``validation`` or ``test``, from which every episode draws one.
        n_actions: Actions in an episode.
        render_mode: One of ``metadata["render_modes"]`` or None.
        criteria: Where the lines between outcomes are drawn; default: the paper's.

    Raises:
        NotFoundError: If there is no such memory.
        SettingsError: If `n_actions` is below 1 or the render mode is unknown.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as in gym.Env
        "render_modes": ["human", "rgb_array", "rgb_array_list"],
        "render_fps": round(1 / FRAME_DT_S),
    }

    def __init__(
        self,
        memory: str | os.PathLike[str] | Memory = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
    ) -> None:
        if n_actions < 1:
            raise SettingsError(f"`n_actions` should be at least 1, but is {n_actions}")
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise SettingsError(
                f"`render_mode` should be one of {', '.join(self.metadata['render_modes'])} or None, "
                f"but is {render_mode!r}"
            )
        self.render_mode = render_mode
        self.n_actions = n_actions
        self.criteria = Criteria() if criteria is None else criteria
        self._bank = split_memories(memory) if isinstance(memory, str) and memory in SPLITS else ()
        self._loaded: dict[str, Memory] = {}
        if self._bank:
            self._use(self._bank[0])
        else:
            self._use(memory if isinstance(memory, Memory) else os.fspath(memory))
        n_actions_known, n_pb = self.memory.demonstrations.n_actions, self.memory.network.n_pb
        self._observer = Observer(n_actions_known, n_pb)
        self.observation_space = observation_space(n_actions_known, n_pb)
        self.action_space = Box(-1.0, 1.0, (n_pb,), np.float32)
        self._step = 0
        self._stage: Stage | None = None
        self._scene: Scene | None = None
        self._film: list[tuple[np.ndarray, float]] = []

    def _use(self, memory: str | Memory) -> None:
        """Make a memory the one of the coming episode; memories of the bank are loaded once."""
        if not isinstance(memory, Memory):
            if memory not in self._loaded:
                self._loaded[memory] = load_memory(memory)
            memory = self._loaded[memory]
        self.memory = memory
        self.repertoire = Repertoire(memory.demonstrations)
        self._speed_limit = speed_limits(memory.demonstrations, self.criteria)
        self._excursion_limit = excursion_limit(memory.demonstrations, self.criteria)

    @property
    def scene(self) -> Scene:
        """Ring, robot and bag; built when first needed."""
        if self._scene is None:
            from creative_nao.robot.scene import Scene

            self._scene = Scene()
        return self._scene

    @abc.abstractmethod
    def _perform(self, generated: np.ndarray) -> Performed:
        """Perform a generated trajectory, (n_steps, n_joints) [rad]."""

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
        self._choose((options or {}).get("memory"))
        self._step = 0
        self.repertoire.clear()
        self._observer.clear()
        self._film.clear()
        return self._observer.vector(), {"memory": self.memory.name}

    def _choose(self, wanted: str | None) -> None:
        if wanted is not None and wanted not in (self._bank or (self.memory.name,)):
            known = self._bank or (self.memory.name,)
            raise NotFoundError(
                f'options["memory"]: no memory `{wanted}`{nearest_name(wanted, known)} in this environment; '
                f"there are {', '.join(known)}"
            )
        if self._bank:
            self._use(wanted or self._bank[int(self.np_random.integers(len(self._bank)))])

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Generate the movement of a PB point, perform and score it.

        Args:
            action: PB vector, shape (n_pb,); values beyond [-1, 1] are clipped.

        Returns:
            Observation, reward, terminated (always False), truncated (after `n_actions` steps) and `info`.

        Raises:
            ShapeError: If the action does not have shape (n_pb,) or is not finite.
        """
        pb = self._checked(action)
        generated = self.memory.generate(pb[None])[0]
        performed = self._perform(generated)
        novelty = self.repertoire.compare(performed.trajectory)
        outcome = self._outcome(generated, performed, novelty.distance)
        appropriate = outcome in APPROPRIATE
        reward = self.repertoire.reward(novelty) if appropriate else 0.0
        if appropriate:
            self.repertoire.accept(performed.trajectory, novelty)
        self._step += 1
        truncated = self._step >= self.n_actions
        self._observer.record(
            pb=pb,
            outcome=outcome,
            nearest=novelty.nearest,
            novelty=novelty.distance / self.repertoire.scale,
            known=novelty.known_distance / self.repertoire.scale,
            reward=reward,
            progress=min(self._step / self.n_actions, 1.0),
        )
        info = {
            "pb": pb,
            "outcome": outcome,
            "appropriate": appropriate,
            "nearest": novelty.nearest,
            "nearest_name": self.memory.demonstrations.names[novelty.nearest],
            "distance": novelty.distance,
            "known_distance": novelty.known_distance,
            "reward_novelty": reward,
            "repertoire_size": len(self.repertoire),
            "step": self._step,
            "trajectory": performed.trajectory,
            **performed.figures,
        }
        if truncated:
            info["episode_measures"] = self.repertoire.measures(self._step)
        if self.render_mode == "human":
            self.render()
        return self._observer.vector(), reward, False, truncated, info

    def render(self) -> Any:
        """Show what was performed since the last call.

        Returns:
            `rgb_array`: the last movement at its widest (before the first action, the guard), uint8 (480, 640, 3).
            `rgb_array_list`: the film of all movements since the last call, `metadata["render_fps"]` frames a second.
            `human`: None; the movement is played in a window, which opens with the first action; called by `step`.

        Raises:
            MissingDependencyError: If this machine cannot draw or has no display; the message says what helps.
        """
        if self.render_mode is None:
            return None
        if self.render_mode == "human" and not self._film:
            return None
        if self._stage is None:
            self._stage = Stage(self.scene)
        film = self._film or [(self.scene.guard_qpos()[None], FRAME_DT_S)]
        if self.render_mode == "rgb_array":
            self._film = film[-1:]
            return self._stage.draw(self._stage.widest(film[-1][0]))
        self._film = []
        if self.render_mode == "human":
            for frames, frame_dt_s in film:
                self._stage.play(frames, frame_dt_s)
            return None
        return [self._stage.draw(snapshot) for frames, _ in film for snapshot in frames]

    def close(self) -> None:
        """Close the window and free what drawing took; may be called again."""
        if self._stage is not None:
            self._stage.close()
            self._stage = None

    def _remember(self, frames: np.ndarray, frame_dt_s: float) -> None:
        """Keep the snapshots of a performance, (n_frames, nq), for `render`."""
        if self.render_mode == "rgb_array":
            self._film.clear()  # only the last movement is ever asked for
        self._film.append((frames, frame_dt_s))

    def _checked(self, action: np.ndarray) -> np.ndarray:
        pb = np.asarray(action, dtype=np.float64)
        if pb.shape != self.action_space.shape or not np.isfinite(pb).all():
            raise ShapeError(
                f"`action` should be a finite PB vector of shape {self.action_space.shape}, but is {action!r}"
            )
        return np.clip(pb, -1.0, 1.0)

    def _outcome(self, generated: np.ndarray, performed: Performed, distance: float) -> str:
        """Name the outcome; speed is judged on what is commanded, all else on what was performed."""
        if (largest_speeds([generated], self.memory.dt_s)[0] > self._speed_limit).any():
            return "fluctuating"
        if performed.fault is not None:
            return performed.fault
        if excursions([performed.trajectory])[0].max() < self._excursion_limit:
            return "non_moving"
        return "learned" if distance <= self.criteria.learned_threshold else "unlearned"
