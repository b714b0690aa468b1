"""What robots know during their episodes: the basic actions and what each has accepted since; many robots at a time."""

from __future__ import annotations

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.envs.known_kernel import LANES, accept_rows, compare_rows

_ROOM = 40
"""Known movements that fit at first: six basic actions and an episode of thirty."""


class Knowledge:
    """The known movements of `n_robots` robots, side by side as the kernel reads them.

    Args:
        n_robots: How many.
        n_basic: Basic actions of each.
        n_steps: Ticks of the longest movement.
        n_joints: Joints.

    Attributes:
        sizes: How many movements each robot knows, shape (n_robots,).
        scale: Unit of each robot's reward [rad], shape (n_robots,).
    """

    def __init__(self, n_robots: int, n_basic: int, n_steps: int, n_joints: int) -> None:
        self.n_basic, self.n_joints = n_basic, n_joints
        lanes = max(_ROOM, -(-n_basic // LANES) * LANES)
        self._known = np.zeros((n_robots, n_steps, -(-n_joints // 8) * 8, lanes))
        self._n_steps = np.zeros((n_robots, lanes), np.int64)
        self._kept = np.zeros((n_robots, lanes))
        self._pair_sum = np.zeros(n_robots)
        self.sizes = np.full(n_robots, n_basic, np.int64)
        self.scale = np.ones(n_robots)

    @property
    def n_lanes(self) -> int:
        """How many known movements `compare` has room for."""
        return self._known.shape[3]

    def teach(self, robot: int, demonstrations: Demonstrations, scale: float) -> None:
        """Let a robot know these basic actions and nothing else."""
        for lane, trajectory in enumerate(demonstrations.trajectories):
            self._known[robot, : len(trajectory), : self.n_joints, lane] = trajectory
            self._n_steps[robot, lane] = len(trajectory)
        self.scale[robot] = scale
        self.forget(robot)

    def forget(self, robot: int) -> None:
        """Let a robot forget everything but its basic actions."""
        self.sizes[robot] = self.n_basic
        self._pair_sum[robot] = 0.0

    def compare(self, robots: np.ndarray, trajectories: np.ndarray) -> np.ndarray:
        """Return the distance of each movement to everything its robot knows.

        Args:
            robots: Which robot made each movement, shape (m,).
            trajectories: Shape (m, n_steps, n_joints) [rad], finite.

        Returns:
            Shape (m, lanes) [rad]: basic actions first, then accepted ones; infinite beyond what is known.
        """
        out = np.full((len(robots), self._known.shape[3]), np.inf)
        compare_rows(robots, trajectories, self._known, self._n_steps, self.sizes, out)
        out[np.arange(out.shape[1]) >= self.sizes[robots, None]] = np.inf
        return out

    def accept(self, robots: np.ndarray, accepted: np.ndarray, trajectories: np.ndarray, distances: np.ndarray) -> None:
        """Let each robot keep its movement where `accepted`; `distances` is what `compare` said of them."""
        if self.sizes[robots].max() == self._known.shape[3]:
            self._make_room()
        novelty = distances[:, : self.n_basic].min(axis=1)
        accept_rows(
            robots, accepted, trajectories, distances, novelty,
            self._known, self._n_steps, self.sizes, self.n_basic, self._kept, self._pair_sum,
        )  # fmt: skip

    def _make_room(self) -> None:
        def twice(array: np.ndarray) -> np.ndarray:
            return np.concatenate([array, np.zeros_like(array)], axis=-1)

        self._known, self._n_steps, self._kept = twice(self._known), twice(self._n_steps), twice(self._kept)

    def accepted(self, robot: int) -> list[np.ndarray]:
        """Return a robot's repertoire, each (n_steps, n_joints) [rad], as copies."""
        lanes = range(self.n_basic, int(self.sizes[robot]))
        return [self._known[robot, : self._n_steps[robot, lane], : self.n_joints, lane].copy() for lane in lanes]

    def measures(self, robot: int, n_tried: int) -> dict[str, float | None]:
        """Return the paper's three measures of a robot's repertoire after `n_tried` actions.

        Returns:
            `appropriateness_pct`: accepted actions [%]; `novelty`: their mean distance to the nearest basic action
            [rad], None if there are none; `diversity`: their mean distance to each other [rad], None if there are
            fewer than two.
        """
        size = int(self.sizes[robot])
        n = size - self.n_basic
        return {
            "appropriateness_pct": 100.0 * n / n_tried if n_tried else 0.0,
            "novelty": float(self._kept[robot, self.n_basic : size].mean()) if n else None,
            "diversity": float(self._pair_sum[robot]) / (n * (n - 1) / 2) if n > 1 else None,
        }

    def state(self, robot: int) -> dict[str, np.ndarray]:
        """Return what a robot has accepted, as arrays that `restore` takes."""
        size = int(self.sizes[robot])
        accepted = self.accepted(robot)
        empty = np.zeros((0, self._known.shape[1], self.n_joints))
        return {
            "accepted": np.stack(accepted) if accepted else empty,
            "novelty": self._kept[robot, self.n_basic : size].copy(),
            "pair_sum": self._pair_sum[robot : robot + 1].copy(),
        }

    def restore(self, robot: int, arrays: dict[str, np.ndarray]) -> None:
        """Let a robot know what `state` told."""
        size = self.n_basic + len(arrays["accepted"])
        while size > self._known.shape[3]:
            self._make_room()
        self._known[robot, :, : self.n_joints, self.n_basic : size] = arrays["accepted"].transpose(1, 2, 0)
        self._n_steps[robot, self.n_basic : size] = self._known.shape[1]
        self._kept[robot, self.n_basic : size] = arrays["novelty"]
        self._pair_sum[robot] = arrays["pair_sum"][0]
        self.sizes[robot] = size
