"""What the robot knows during an episode, and what a new action adds to it: the reward of all environments."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.measures import dtw_matrix, reward_scale


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


@dataclass
class Repertoire:
    """The basic actions and the actions accepted in this episode.

    The reward of an appropriate action is its distance to everything known, divided by the mean pairwise distance of
    the basic
    actions: a movement counts as new once, and diversity is what is left to earn.
    """

    demonstrations: Demonstrations
    accepted: list[np.ndarray] = field(default_factory=list)
    """Trajectories accepted so far [rad], each (n_steps, n_joints)."""
    distances: list[float] = field(default_factory=list)
    """Distance of each to its nearest basic action [rad]."""
    pairwise: list[np.ndarray] = field(default_factory=list)
    """Distance of each to those accepted before it [rad]."""

    def __post_init__(self) -> None:
        """Work out the unit of the reward once."""
        self.scale = reward_scale(self.demonstrations)

    def __len__(self) -> int:
        return len(self.accepted)

    def clear(self) -> None:
        """Forget everything but the basic actions."""
        self.accepted, self.distances, self.pairwise = [], [], []

    def compare(self, trajectory: np.ndarray) -> Novelty:
        """Measure a trajectory (n_steps, n_joints) [rad] against everything known; nothing is changed."""
        known = [*self.demonstrations.trajectories, *self.accepted]
        distances = dtw_matrix([trajectory], known)[0]
        n_basic = self.demonstrations.n_actions
        nearest = int(distances[:n_basic].argmin())
        return Novelty(float(distances[nearest]), nearest, float(distances.min()), distances[n_basic:])

    def reward(self, novelty: Novelty) -> float:
        """Return what an appropriate action of this novelty earns; 1 is as far as basic actions are from each other."""
        return novelty.known_distance / self.scale

    def accept(self, trajectory: np.ndarray, novelty: Novelty) -> None:
        """Add an appropriate action to the repertoire."""
        self.accepted.append(trajectory)
        self.distances.append(novelty.distance)
        self.pairwise.append(novelty.to_repertoire)

    def measures(self, n_tried: int) -> dict[str, float | None]:
        """Return the paper's three measures of the repertoire after `n_tried` actions.

        Returns:
            `appropriateness_pct`: accepted actions [%]; `novelty`: their mean distance to the nearest basic action
            [rad], None if there are none; `diversity`: their mean distance to each other [rad], None if there are
            fewer than two.
        """
        pairs = np.concatenate(self.pairwise) if self.pairwise else np.zeros(0)
        return {
            "appropriateness_pct": 100.0 * len(self) / n_tried if n_tried else 0.0,
            "novelty": float(np.mean(self.distances)) if self.distances else None,
            "diversity": float(pairs.mean()) if pairs.size else None,
        }
