"""Repertoire archive: basic actions and accepted movements of many robots, and the distances of new ones to them.

The movements that one robot knows lie side by side in lanes, as the kernel of `measures._dtw_kernels` reads them, so
that a distance has the bits of `measures.dtw_matrix`. One compiled call serves many robots and releases the interpreter
lock.
"""

from __future__ import annotations

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.measures._dtw_kernels import against_one
from creative_nao.model.simd import compiled

LANES = 8
"""Lanes are compared in multiples of this: one 512-bit register of float64."""
INITIAL_LANES = 40
"""Lanes that an archive has at first: six basic actions and an episode of thirty fit."""

MEASURES = ("appropriateness_pct", "novelty", "diversity")
"""The paper's three measures of an episode, as `RepertoireArchive.measures` names them."""


@compiled()
def _compare_kernel(env_ids, trajectories, known, n_steps, sizes, out):
    """Fill `out` (m, lanes) with the distances of movement k to everything that robot `env_ids[k]` knows.

    trajectories: (m, T, n_joints); known: (n_envs, T, joints in eights, lanes); n_steps: (n_envs, lanes) length of
    each known movement; sizes: (n_envs,) how many there are. Distances beyond that are infinite.
    """
    m, n_ticks, n_joints = trajectories.shape
    joints, lanes = known.shape[2], known.shape[3]
    y = np.zeros((n_ticks, joints))
    rows, squares = np.empty((2, n_ticks + 1, lanes)), np.empty(lanes)
    for k in range(m):
        env_id = env_ids[k]
        width = (sizes[env_id] + LANES - 1) // LANES * LANES
        y[:, :n_joints] = trajectories[k]
        against_one(known[env_id], width, n_steps[env_id], False, y, 0, rows, squares, out[k])
        out[k, sizes[env_id] :] = np.inf


@compiled()
def _accept_kernel(env_ids, accepted, trajectories, distances, known, n_steps, sizes, n_basic, novelty, pair_sum):
    """Append movement k to what robot `env_ids[k]` knows where `accepted[k]`; there has to be a free lane.

    novelty: (n_envs, lanes) distance of each accepted movement to its nearest basic action; pair_sum: (n_envs,) sum of
    the distances between accepted movements.
    """
    for k in range(env_ids.shape[0]):
        if accepted[k]:
            env_id = env_ids[k]
            lane = sizes[env_id]
            for t in range(trajectories.shape[1]):
                for j in range(trajectories.shape[2]):
                    known[env_id, t, j, lane] = trajectories[k, t, j]
            n_steps[env_id, lane] = trajectories.shape[1]
            novelty[env_id, lane] = distances[k, :n_basic].min()
            total = 0.0
            for other in range(n_basic, lane):
                total += distances[k, other]
            pair_sum[env_id] += total
            sizes[env_id] = lane + 1


class RepertoireArchive:
    """What `n_envs` robots know: their basic actions and the movements each has accepted since.

    The reward of an appropriate movement is its distance to everything known, divided by `scale`, the mean pairwise
    distance of the basic actions: a movement counts as new once, and diversity is what is left to earn.

    Args:
        n_envs: How many robots.
        n_basic: Basic actions of each.
        n_steps: Ticks of the longest movement.
        n_joints: Joints.

    Attributes:
        sizes: How many movements each robot knows, basic actions included, shape (n_envs,).
        scale: Unit of each robot's reward [rad], shape (n_envs,).
    """

    def __init__(self, n_envs: int, n_basic: int, n_steps: int, n_joints: int) -> None:
        self.n_basic, self.n_joints = n_basic, n_joints
        lanes = max(INITIAL_LANES, -(-n_basic // LANES) * LANES)
        self._known = np.zeros((n_envs, n_steps, -(-n_joints // 8) * 8, lanes))
        self._n_steps = np.zeros((n_envs, lanes), np.int64)
        self._novelty = np.zeros((n_envs, lanes))
        self._pair_sum = np.zeros(n_envs)
        self.sizes = np.full(n_envs, n_basic, np.int64)
        self.scale = np.ones(n_envs)

    def set_basic_actions(self, env_id: int, demonstrations: Demonstrations, scale: float) -> None:
        """Let a robot know these basic actions and nothing else; `scale` is the unit of its reward [rad]."""
        for lane, trajectory in enumerate(demonstrations.trajectories):
            self._known[env_id, : len(trajectory), : self.n_joints, lane] = trajectory
            self._n_steps[env_id, lane] = len(trajectory)
        self.scale[env_id] = scale
        self.clear(env_id)

    def clear(self, env_id: int) -> None:
        """Remove all accepted movements of a robot."""
        self.sizes[env_id] = self.n_basic
        self._pair_sum[env_id] = 0.0

    def compare(self, env_ids: np.ndarray, trajectories: np.ndarray) -> np.ndarray:
        """Return the distances of movements to everything that their robots `env_ids`, (m,), know.

        Finite `trajectories` (m, n_steps, n_joints) [rad] become (m, lanes) [rad]: basic actions first, then accepted
        movements; infinite beyond what is known.
        """
        out = np.empty((len(env_ids), self._known.shape[3]))
        _compare_kernel(env_ids, trajectories, self._known, self._n_steps, self.sizes, out)
        return out

    def accept(
        self, env_ids: np.ndarray, accepted: np.ndarray, trajectories: np.ndarray, distances: np.ndarray
    ) -> None:
        """Add each movement to its robot's archive where `accepted`; `distances` are those of `compare`."""
        if self.sizes[env_ids].max() == self._known.shape[3]:
            self._double_lanes()
        _accept_kernel(
            env_ids, accepted, trajectories, distances,
            self._known, self._n_steps, self.sizes, self.n_basic, self._novelty, self._pair_sum,
        )  # fmt: skip

    def _double_lanes(self) -> None:
        def doubled(array: np.ndarray) -> np.ndarray:
            return np.concatenate([array, np.zeros_like(array)], axis=-1)

        self._known, self._n_steps, self._novelty = map(doubled, (self._known, self._n_steps, self._novelty))

    def accepted(self, env_id: int) -> list[np.ndarray]:
        """Return a robot's accepted movements, each (n_steps, n_joints) [rad], as copies."""
        lanes = range(self.n_basic, int(self.sizes[env_id]))
        return [self._known[env_id, : self._n_steps[env_id, lane], : self.n_joints, lane].copy() for lane in lanes]

    def measures(self, env_id: int, n_tried: int) -> dict[str, float | None]:
        """Return the paper's three measures of a robot's accepted movements after `n_tried` actions.

        Returns:
            `appropriateness_pct`: accepted actions [%]; `novelty`: their mean distance to the nearest basic action
            [rad], None if there are none; `diversity`: their mean distance to each other [rad], None if there are
            fewer than two.
        """
        size = int(self.sizes[env_id])
        n = size - self.n_basic
        return {
            "appropriateness_pct": 100.0 * n / n_tried if n_tried else 0.0,
            "novelty": float(self._novelty[env_id, self.n_basic : size].mean()) if n else None,
            "diversity": float(self._pair_sum[env_id]) / (n * (n - 1) / 2) if n > 1 else None,
        }

    def get_state(self, env_id: int) -> dict[str, np.ndarray]:
        """Return a robot's accepted movements as arrays that `set_state` takes."""
        size = int(self.sizes[env_id])
        known = self._known[env_id, :, : self.n_joints, self.n_basic : size]
        return {
            "accepted": known.transpose(2, 0, 1).copy(),
            "novelty": self._novelty[env_id, self.n_basic : size].copy(),
            "pair_sum": self._pair_sum[env_id : env_id + 1].copy(),
        }

    def set_state(self, env_id: int, arrays: dict[str, np.ndarray]) -> None:
        """Replace a robot's accepted movements by those of `get_state`."""
        size = self.n_basic + len(arrays["accepted"])
        while size > self._known.shape[3]:
            self._double_lanes()
        self._known[env_id, :, : self.n_joints, self.n_basic : size] = arrays["accepted"].transpose(1, 2, 0)
        self._n_steps[env_id, self.n_basic : size] = self._known.shape[1]
        self._novelty[env_id, self.n_basic : size] = arrays["novelty"]
        self._pair_sum[env_id] = arrays["pair_sum"][0]
        self.sizes[env_id] = size
