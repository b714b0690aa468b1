"""Movements under way, of one or many robots: a decision about the PB every few ticks, the network's state goes on."""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.envs.episodes import Episodes
from creative_nao.envs.state import OF_THE_NETWORK
from creative_nao.errors import SettingsError
from creative_nao.model.memory import Memory
from creative_nao.model.stepping import Stepper, Unfolding

DECISION_TICKS = 5
"""Ticks from one decision to the next."""


class Movements:
    """The movements under way of the robots of `episodes`, one each.

    Args:
        episodes: Their episodes; every memory has to be a `creative_nao.Memory`.

    Attributes:
        n_decisions: Decisions of a movement; the last one holds for what is left of it.
        n_decided: Decisions taken in the movement under way, shape (n_robots,).
    """

    def __init__(self, episodes: Episodes) -> None:
        facts = episodes.bank.first
        if not isinstance(facts.memory, Memory):
            raise SettingsError(
                "`memory` should be a `creative_nao.Memory`, whose network can be stopped between ticks, "
                f"but is a {type(facts.memory).__name__}"
            )
        n_robots, n_joints = len(episodes.n_actions), len(facts.demonstrations.joints)
        self._episodes = episodes
        self._n_steps = facts.n_steps
        self.n_decisions = -(-facts.n_steps // DECISION_TICKS)
        self.n_decided = np.zeros(n_robots, np.int64)
        self._angles = np.zeros((n_robots, facts.n_steps, n_joints))
        self._pb = np.zeros((n_robots, self.n_decisions, facts.n_pb))
        encoding = facts.memory.encoding
        self._low, self._high = encoding.references[:, 0], encoding.references[:, -1]
        self._steppers: dict[int, Stepper] = {}
        self._under_way: list[Unfolding] = [self._stepper(robot).begin(1) for robot in range(n_robots)]
        self._posture = np.zeros((n_robots, n_joints))
        for robot in range(n_robots):
            self.begin(robot)

    def _stepper(self, robot: int) -> Stepper:
        memory = self._episodes.facts[robot].memory
        if id(memory) not in self._steppers:
            self._steppers[id(memory)] = Stepper(memory)
        return self._steppers[id(memory)]

    def begin(self, robot: int) -> None:
        """Begin a robot's episode: it stands in its initial posture, and its observation tells so."""
        self.next(robot)
        self._posture[robot] = self._episodes.facts[robot].demonstrations.initial_posture
        self._tell_body(np.array([robot]))

    def next(self, robot: int) -> None:
        """Begin a robot's next movement: nothing of it has unfolded, the network is at rest."""
        self.n_decided[robot] = 0
        self._under_way[robot] = self._stepper(robot).begin(1)

    def advance(self, robots: np.ndarray, pb: np.ndarray) -> None:
        """Let the movements of these robots unfold until their next decision, under PB vectors (m, n_pb)."""
        for robot, point in zip(robots, pb, strict=True):
            under_way, decided = self._under_way[robot], self.n_decided[robot]
            first = under_way.tick
            n_ticks = min(DECISION_TICKS, self._n_steps - first)
            angles = self._stepper(robot).advance(under_way, point[None], n_ticks)[0]
            self._angles[robot, first : first + n_ticks] = angles
            self._posture[robot] = angles[-1]
            self._pb[robot, decided] = point
            self.n_decided[robot] = decided + 1

    def finished(self, robots: np.ndarray) -> np.ndarray:
        """Tell whose movement has unfolded, (m,) of bool."""
        return self.n_decided[robots] == self.n_decisions

    def tick(self, robots: np.ndarray) -> np.ndarray:
        """Return how many ticks have unfolded, (m,)."""
        return np.minimum(self.n_decided[robots] * DECISION_TICKS, self._n_steps)

    def posture(self, robots: np.ndarray) -> np.ndarray:
        """Return where the joints stand [rad], a copy of (m, n_joints)."""
        return self._posture[robots]

    def trajectories(self, robots: np.ndarray) -> np.ndarray:
        """Return the movements, a copy of (m, n_steps, n_joints) [rad]."""
        return self._angles[robots]

    def pb_paths(self, robots: np.ndarray) -> np.ndarray:
        """Return their PB vectors, a copy of (m, n_decisions, n_pb)."""
        return self._pb[robots]

    def tell(self, robots: np.ndarray, pb: np.ndarray, progress: np.ndarray) -> None:
        """Bring the observations up to date.

        Args:
            robots: Which robots, (m,).
            pb: Their last PB vectors, (m, n_pb).
            progress: Share of each one's episode that is over, (m,).
        """
        self._episodes.observer.put(robots, "pb", pb)
        self._episodes.observer.put(robots, "step", progress)
        self._tell_body(robots)

    def _tell_body(self, robots: np.ndarray) -> None:
        observer = self._episodes.observer
        share = 2.0 * (self._posture[robots] - self._low) / (self._high - self._low) - 1.0
        observer.put(robots, "posture", np.clip(share, -1.0, 1.0))
        n_slow = self._stepper(0).n_slow
        slow = np.concatenate([self._under_way[robot].activity[:, -n_slow:] for robot in robots])
        observer.put(robots, "slow", np.clip(slow, -1.0, 1.0))
        observer.put(robots, "phase", self.n_decided[robots] / self.n_decisions)

    def state(self, robot: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return a robot's movement under way as JSON-able values and arrays, for `restore`."""
        under_way = self._under_way[robot]
        values = {"n_decided": int(self.n_decided[robot]), "tick": under_way.tick}
        arrays = {
            "network_code": under_way.code.copy(),
            "network_state": under_way.state.copy(),
            "network_activity": under_way.activity.copy(),
            "unfolded": self._angles[robot].copy(),
            "pb_path": self._pb[robot].copy(),
            "posture": self._posture[robot].copy(),
        }
        return values, arrays

    def restore(self, robot: int, values: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Take over what `state` told; the robot's memory has to be in place already.

        Raises:
            SettingsError: If it does not fit the memory's network.
        """
        decided, tick = values["n_decided"], values["tick"]
        if decided >= self.n_decisions or tick != min(decided * DECISION_TICKS, self._n_steps):
            raise SettingsError(
                f"`state`: its `n_decided` should be below {self.n_decisions}, its `tick` {DECISION_TICKS} times that, "
                f"but they are {decided} and {tick}"
            )
        rest = self._stepper(robot).begin(1)
        for name, array in zip(OF_THE_NETWORK, (rest.code, rest.state, rest.activity), strict=True):
            if arrays[name].shape != array.shape:
                raise SettingsError(
                    f"`state`: its array `{name}` should have shape {array.shape}, but has {arrays[name].shape}"
                )
        self.n_decided[robot] = decided
        self._under_way[robot] = Unfolding(tick, *(arrays[name].copy() for name in OF_THE_NETWORK))
        self._angles[robot] = arrays["unfolded"]
        self._pb[robot] = arrays["pb_path"]
        self._posture[robot] = arrays["posture"]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_steppers": {}}  # they are found by the identity of a memory, which a copy has not
