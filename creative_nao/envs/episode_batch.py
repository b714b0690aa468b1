"""The episodes of one or many robots: what their movements are worth, what they then know and see.

Every environment, single or vectorised, is a thin shell around this one place, so that they cannot disagree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from creative_nao.envs.archive import Knowledge, judge_rows
from creative_nao.envs.executors import Performed
from creative_nao.envs.memory_set import Bank, Facts, MemoryLike
from creative_nao.envs.observation import APPROPRIATE, OUTCOMES, Observer, Part, layout, observation_space
from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import Criteria

_OUTCOMES = np.array(OUTCOMES, dtype=object)
_PLACE = {name: place for place, name in enumerate(OUTCOMES)}
_LEARNED, _UNLEARNED = _PLACE["learned"], _PLACE["unlearned"]
_FLUCTUATING, _NON_MOVING = _PLACE["fluctuating"], _PLACE["non_moving"]


@dataclass(frozen=True, eq=False)
class Scored:
    """What m movements were worth; arrays over them.

    Attributes:
        robots: Whose they are, (m,).
        trajectories: What was scored [rad], (m, n_steps, n_joints).
        outcome: Place in `OUTCOMES`, (m,).
        nearest: Nearest basic action, (m,).
        distance: DTW distance to it [rad], (m,).
        known_distance: DTW distance to everything known before [rad], (m,).
        reward: What each earned, (m,).
    """

    robots: np.ndarray
    trajectories: np.ndarray
    outcome: np.ndarray
    nearest: np.ndarray
    distance: np.ndarray
    known_distance: np.ndarray
    reward: np.ndarray

    @property
    def outcome_names(self) -> np.ndarray:
        """The outcomes by name, (m,) of object."""
        return _OUTCOMES[self.outcome]

    @property
    def appropriate(self) -> np.ndarray:
        """Which movements joined the repertoire, (m,) of bool."""
        return self.outcome < len(APPROPRIATE)


class Weighed(NamedTuple):
    """How m movements compare, before any of them is judged; arrays over them.

    Attributes:
        distances: DTW distance to everything the robot knows [rad], (m, lanes), as `Knowledge.compare` tells it.
        too_fast: Whether a joint is commanded faster than allowed, (m,) of bool.
        excursion: How far the most moving joint travels [rad], (m,).
    """

    distances: np.ndarray
    too_fast: np.ndarray
    excursion: np.ndarray


class Episodes:
    """Side by side, the episodes of `n_robots` robots.

    Args:
        memory: What they act from, see `Bank`.
        n_robots: How many.
        criteria: Where the lines between outcomes are drawn.
        unfolding: Whether observations tell posture and P_S, for a PB that moves.

    Attributes:
        facts: The memory of each robot's episode.
        n_actions: Actions each has finished in its episode, shape (n_robots,).
    """

    def __init__(
        self, memory: MemoryLike, n_robots: int = 1, criteria: Criteria | None = None, unfolding: bool = False
    ) -> None:
        self.criteria = Criteria() if criteria is None else criteria
        self.bank = Bank(memory, self.criteria)
        first = self.bank.first
        n_joints = len(first.demonstrations.joints)
        n_slow = 0
        if unfolding:
            network = getattr(first.memory, "network", None)
            if network is None:
                raise SettingsError(
                    "`memory` should be a `creative_nao.Memory`, whose network can be stopped between ticks, "
                    f"but is a {type(first.memory).__name__}"
                )
            n_slow = network.layer_sizes[-1]
        self.parts: tuple[Part, ...] = layout(
            first.demonstrations.n_actions, first.n_pb, n_joints if unfolding else 0, n_slow
        )
        self.observation_space = observation_space(self.parts)
        self.knowledge = Knowledge(n_robots, first.demonstrations.n_actions, first.n_steps, n_joints)
        self.observer = Observer(self.parts, n_robots)
        self.n_actions = np.zeros(n_robots, np.int64)
        self.facts: list[Facts] = [first] * n_robots
        self._dt_s = np.zeros(n_robots)
        self._speed_limit = np.zeros((n_robots, n_joints))
        self._excursion_limit = np.zeros(n_robots)
        for robot in range(n_robots):
            self.use(robot, first)

    def use(self, robot: int, facts: Facts) -> None:
        """Give a robot this memory and an empty repertoire."""
        self.facts[robot] = facts
        self.knowledge.teach(robot, facts.demonstrations, facts.scale)
        self._dt_s[robot] = facts.demonstrations.dt_s
        self._speed_limit[robot] = facts.speed_limit
        self._excursion_limit[robot] = facts.excursion_limit

    def begin(self, robot: int, wanted: str | None, rng: Any) -> None:
        """Begin an episode of one robot.

        Args:
            robot: Which.
            wanted: Name of the memory to take, or None to draw one of the bank.
            rng: Called for a generator if one is needed.

        Raises:
            NotFoundError: If there is no such memory in this environment.
        """
        facts = self.bank.draw(rng) if wanted is None else self.bank.named(wanted)
        if facts is self.facts[robot]:
            self.knowledge.forget(robot)
        else:
            self.use(robot, facts)
        self.observer.clear(robot)
        self.n_actions[robot] = 0

    def generate(self, robots: np.ndarray, pb: np.ndarray) -> np.ndarray:
        """Let each robot's memory act from its PB point, (m, n_pb); robots of one memory together.

        Raises:
            ShapeError: If a memory does not return the trajectories it should.
        """
        first = self.facts[robots[0]]
        if all(self.facts[robot] is first for robot in robots):
            return _generated(first, pb)
        out = np.empty((len(robots), first.n_steps, len(first.demonstrations.joints)))
        groups: dict[int, list[int]] = {}
        for place, robot in enumerate(robots):
            groups.setdefault(id(self.facts[robot]), []).append(place)
        for places in groups.values():
            out[places] = _generated(self.facts[robots[places[0]]], pb[places])
        return out

    def room(self, n: int) -> tuple[np.ndarray, Weighed]:
        """Return arrays, not filled yet, for n movements and what `weigh` says of them."""
        first = self.bank.first
        generated = np.empty((n, first.n_steps, len(first.demonstrations.joints)))
        return generated, Weighed(np.empty((n, self.knowledge.n_lanes)), np.empty(n, bool), np.empty(n))

    def weigh(self, robots: np.ndarray, generated: np.ndarray, trajectories: np.ndarray) -> Weighed:
        """Compare a movement of each robot with what it knows. Changes nothing, so that threads may share the work.

        Args:
            robots: Whose movements these are, shape (m,).
            generated: What was commanded [rad], (m, n_steps, n_joints).
            trajectories: What came of it [rad], the same shape.

        Raises:
            ShapeError: If an angle is not finite.
        """
        too_fast, excursion = np.zeros(len(robots), bool), np.zeros(len(robots))
        bad = judge_rows(robots, generated, trajectories, self._dt_s, self._speed_limit, too_fast, excursion)
        if bad >= 0:
            raise ShapeError(
                f"a memory should generate, and a robot measure, finite angles, but movement {bad} of "
                f"{len(robots)} holds one that is not"
            )
        return Weighed(self.knowledge.compare(robots, trajectories), too_fast, excursion)

    def score(
        self,
        robots: np.ndarray,
        pb: np.ndarray,
        generated: np.ndarray,
        performed: Sequence[Performed] | None = None,
        weighed: Weighed | None = None,
    ) -> Scored:
        """Score a movement of each robot, let appropriate ones join the repertoires and bring observations up to date.

        Args:
            robots: Whose movements these are, shape (m,).
            pb: The PB vectors of each, (m, n, n_pb).
            generated: What was commanded [rad], (m, n_steps, n_joints).
            performed: What came of it; None if the generated movements themselves are scored.
            weighed: What `weigh` says of them, if it was asked already.
        """
        trajectories = generated if performed is None else np.stack([one.trajectory for one in performed])
        distances, too_fast, excursion = self.weigh(robots, generated, trajectories) if weighed is None else weighed
        to_basic = distances[:, : self.knowledge.n_basic]
        nearest = to_basic.argmin(axis=1)
        distance = to_basic.min(axis=1)
        known_distance = distances.min(axis=1)
        outcome = np.where(distance <= self.criteria.learned_threshold, _LEARNED, _UNLEARNED)
        outcome[excursion < self._excursion_limit[robots]] = _NON_MOVING
        if performed is not None:
            for place, one in enumerate(performed):
                if one.fault is not None:
                    outcome[place] = _PLACE[one.fault]
        outcome[too_fast] = _FLUCTUATING  # judged on what is commanded, before all that came of it
        appropriate = outcome < len(APPROPRIATE)
        scale = self.knowledge.scale[robots]
        known = known_distance / scale
        reward = np.where(appropriate, known, 0.0)
        self.knowledge.accept(robots, appropriate, trajectories, distances)
        self.n_actions[robots] += 1
        self.observer.record(
            robots, pb=pb, outcome=outcome, nearest=nearest, novelty=distance / scale, known=known, reward=reward
        )
        return Scored(robots, trajectories, outcome, nearest, distance, known_distance, reward)

    def state(self, robot: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return one robot's episode as JSON-able values and arrays, for `restore`."""
        values = {"memory": self.facts[robot].name, "n_actions": int(self.n_actions[robot])}
        return values, {"observation": self.observer.vector(robot), **self.knowledge.state(robot)}

    def restore(self, robot: int, values: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Take over what `state` told.

        Raises:
            NotFoundError: If its memory is none of this environment's.
        """
        self.use(robot, self.bank.named(values["memory"], "`state`"))
        self.n_actions[robot] = values["n_actions"]
        self.observer.restore(robot, arrays["observation"])
        self.knowledge.restore(robot, arrays)


def _generated(facts: Facts, pb: np.ndarray) -> np.ndarray:
    trajectories = facts.memory.generate(pb)
    expected = len(pb), facts.n_steps, len(facts.demonstrations.joints)
    if np.shape(trajectories) != expected:
        raise ShapeError(
            f"memory `{facts.name}` should generate trajectories of shape {expected}, but gave {np.shape(trajectories)}"
        )
    return np.ascontiguousarray(trajectories, dtype=np.float64)
