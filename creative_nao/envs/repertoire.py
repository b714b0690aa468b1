"""One robot's repertoire, and what a new action adds to it: the reward of all environments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.envs.knowledge import Knowledge
from creative_nao.measures import reward_scale


@dataclass(frozen=True)
class Novelty:
    """How far a trajectory lies from what is known.

    Attributes:
        distance: DTW distance to the nearest basic action [rad].
        nearest: Which basic action that is.
        known_distance: DTW distance to the nearest of the basic actions and the repertoire [rad].
        to_repertoire: DTW distance to each action of the repertoire [rad], shape (size,).
    """

    distance: float
    nearest: int
    known_distance: float
    to_repertoire: np.ndarray


class Repertoire:
    """The basic actions and the actions accepted in this episode, of one of the robots of a `Knowledge`.

    The reward of an appropriate action is its distance to everything known, divided by the mean pairwise distance of
    the basic actions: a movement counts as new once, and diversity is what is left to earn.

    Args:
        demonstrations: The basic actions.
        knowledge: Where they are kept; by default a place of its own.
        robot: Which of its robots.
    """

    def __init__(self, demonstrations: Demonstrations, knowledge: Knowledge | None = None, robot: int = 0) -> None:
        self.demonstrations = demonstrations
        if knowledge is None:
            n_steps = max(len(trajectory) for trajectory in demonstrations.trajectories)
            knowledge = Knowledge(1, demonstrations.n_actions, n_steps, len(demonstrations.joints))
            knowledge.teach(0, demonstrations, reward_scale(demonstrations))
        self._knowledge = knowledge
        self._robots = np.array([robot])

    def __len__(self) -> int:
        return int(self._knowledge.sizes[self._robots[0]]) - self._knowledge.n_basic

    @property
    def scale(self) -> float:
        """Mean pairwise distance of the basic actions, the unit of the reward [rad]."""
        return float(self._knowledge.scale[self._robots[0]])

    @property
    def accepted(self) -> list[np.ndarray]:
        """Trajectories accepted so far [rad], each (n_steps, n_joints), as copies."""
        return self._knowledge.accepted(int(self._robots[0]))

    def compare(self, trajectory: np.ndarray) -> Novelty:
        """Measure a trajectory (n_steps, n_joints) [rad] against everything known; nothing is changed."""
        distances = self._knowledge.compare(self._robots, np.asarray(trajectory, np.float64)[None])[0]
        n_basic = self._knowledge.n_basic
        nearest = int(distances[:n_basic].argmin())
        to_repertoire = distances[n_basic : n_basic + len(self)].copy()
        return Novelty(float(distances[nearest]), nearest, float(distances.min()), to_repertoire)

    def reward(self, novelty: Novelty) -> float:
        """Return what an appropriate action of this novelty earns; 1 is as far as basic actions are from each other."""
        return novelty.known_distance / self.scale

    def accept(self, trajectory: np.ndarray) -> None:
        """Add an appropriate action, (n_steps, n_joints) [rad], to the repertoire."""
        movement = np.asarray(trajectory, np.float64)[None]
        distances = self._knowledge.compare(self._robots, movement)
        self._knowledge.accept(self._robots, np.ones(1, bool), movement, distances)

    def measures(self, n_tried: int) -> dict[str, float | None]:
        """Return the paper's three measures after `n_tried` actions; see `Knowledge.measures`."""
        return self._knowledge.measures(int(self._robots[0]), n_tried)
