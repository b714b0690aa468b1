"""Many copies of `CreativeNao/BoxingModulation-v0` at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.envs.crew import Bodies
from creative_nao.envs.performers import check_arms
from creative_nao.envs.state import EnvState
from creative_nao.envs.unfolding import Movements
from creative_nao.envs.vector_env import RepertoireVectorEnv
from creative_nao.robot import PhysicalLimits


class BoxingModulationVectorEnv(RepertoireVectorEnv):
    """Many copies of `CreativeNao/BoxingModulation-v0`; see `BoxingModulationEnv` and `RepertoireVectorEnv`.

    Args:
        physics: Whether the robot performs each movement.
        limits: From where on a performance counts as failed.
        arguments: Those of `RepertoireVectorEnv`.
    """

    _unfolding = True
    _kind = "BoxingModulationEnv"

    def __init__(
        self, num_envs: int = 1, *, physics: bool = False, limits: PhysicalLimits | None = None, **arguments: Any
    ) -> None:
        super().__init__(num_envs, **arguments)
        self.physics = physics
        if physics:
            check_arms(self._episodes.bank.first.demonstrations.joints)
            self._performer = Bodies(self._crew, self._shared, PhysicalLimits() if limits is None else limits)
        self._movements = Movements(self._episodes)

    def _begin(self, robots: np.ndarray, wanted: str | None = None) -> None:
        super()._begin(robots, wanted)
        for robot in robots:
            self._movements.begin(robot)

    def _act(
        self, robots: np.ndarray, pb: np.ndarray
    ) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
        movements, episodes = self._movements, self._episodes
        movements.advance(robots, pb)
        n = movements.n_decisions
        terms = {
            "pb": pb,
            "step": episodes.n_actions[robots] * n + movements.n_decided[robots],
            "tick": movements.tick(robots),
            "posture": movements.posture(robots),
        }
        rewards, finished = np.zeros(len(robots)), {"robots": robots[:0]}
        through = np.flatnonzero(movements.finished(robots))
        if len(through):
            who = robots[through]
            path = movements.pb_paths(who)
            scored, scored_terms = self._finish(who, path, movements.trajectories(who))
            rewards[through] = scored.reward
            finished = {"robots": who, **scored_terms, "pb_path": path}
            for robot in who:
                movements.next(robot)
        done = (episodes.n_actions[robots] + movements.n_decided[robots] / n) / self.n_actions
        movements.tell(robots, pb, np.minimum(done, 1.0))
        return rewards, terms, finished

    def _state(self, robot: int) -> EnvState:
        state = super()._state(robot)
        values, arrays = self._movements.state(robot)
        return EnvState(state.kind, {**state.values, **values}, {**state.arrays, **arrays})

    def _restore(self, robot: int, state: EnvState) -> None:
        super()._restore(robot, state)
        self._movements.restore(robot, state.values, state.arrays)
