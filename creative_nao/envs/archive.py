"""The compiled heart of scoring: movements against everything their robots know, without a copy or a check.

The lanes of `measures._lanes` with the same expressions, so that a distance has the same bits; but the known movements
already lie side by side, and those of many robots are served by one call, which lets other threads run.

Also here:
- What robots know during their episodes: the basic actions and what each has accepted since; many robots at a time.
- One robot's repertoire, and what a new action adds to it: the reward of all environments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from creative_nao.demonstrations import Demonstrations
from creative_nao.measures import reward_scale
from creative_nao.measures._dtw_kernels import BORDER, fill_row
from creative_nao.model.simd import compiled

LANES = 8
"""Known movements are kept in multiples of this: one 512-bit register of float64."""


@compiled()
def _against_one(x, width, n_steps, y, rows, squares, out):
    """Distances of the first `width` lanes of x (ticks, joints, lanes), each `n_steps` long, to y (m, joints)."""
    m = y.shape[0]
    rows[:, : m + 1, :width] = BORDER
    rows[0, 0, :width] = 0
    for i in range(x.shape[0]):
        before, now = rows[i & 1], rows[1 - (i & 1)]
        fill_row(x[i], y, before, now, squares, 0, width)
        before[0, :width] = BORDER  # only the very first cell may be entered from outside
        for v in range(width):
            if n_steps[v] == i + 1:
                out[v] = now[m, v]


@compiled()
def compare_rows(which, trajectories, known, n_steps, sizes, out):
    """Fill `out` (m, lanes) with the distances of movement k to everything that robot `which[k]` knows.

    trajectories: (m, T, n_joints); known: (n_robots, T, joints in eights, lanes); n_steps: (n_robots, lanes) length of
    each known movement; sizes: (n_robots,) how many there are. Lanes beyond the size are meaningless.
    """
    m, n_ticks, n_joints = trajectories.shape
    joints, lanes = known.shape[2], known.shape[3]
    y = np.zeros((n_ticks, joints))
    rows, squares = np.empty((2, n_ticks + 1, lanes)), np.empty(lanes)
    for k in range(m):
        robot = which[k]
        width = (sizes[robot] + LANES - 1) // LANES * LANES
        y[:, :n_joints] = trajectories[k]
        _against_one(known[robot], width, n_steps[robot], y, rows, squares, out[k])


@compiled()
def judge_rows(which, generated, performed, dt_s, speed_limit, too_fast, excursion):
    """Tell of each movement whether a commanded joint is too fast, and how far the most moving performed joint travels.

    Both as in `measures.appropriateness`. Returns the first movement that is not finite, or -1.
    """
    m, n_ticks, n_joints = generated.shape
    for k in range(m):
        robot = which[k]
        too_fast[k] = False
        excursion[k] = 0.0
        for j in range(n_joints):
            change, low, high = 0.0, performed[k, 0, j], performed[k, 0, j]
            for t in range(n_ticks):
                here = performed[k, t, j]
                if not (np.isfinite(generated[k, t, j]) and np.isfinite(here)):
                    return k
                low, high = min(low, here), max(high, here)
                if t > 0:
                    change = max(change, abs(generated[k, t, j] - generated[k, t - 1, j]))
            if change / dt_s[robot] > speed_limit[robot, j]:
                too_fast[k] = True
            excursion[k] = max(excursion[k], high - low)
    return -1


@compiled()
def accept_rows(which, accepted, trajectories, distances, novelty, known, n_steps, sizes, n_basic, kept, pair_sum):
    """Let robot `which[k]` keep movement k where `accepted[k]`; there has to be room.

    kept: (n_robots, lanes) distance of each accepted movement to its nearest basic action; pair_sum: (n_robots,) sum of
    the distances between accepted movements.
    """
    for k in range(which.shape[0]):
        if accepted[k]:
            robot = which[k]
            place = sizes[robot]
            for t in range(trajectories.shape[1]):
                for j in range(trajectories.shape[2]):
                    known[robot, t, j, place] = trajectories[k, t, j]
            n_steps[robot, place] = trajectories.shape[1]
            kept[robot, place] = novelty[k]
            total = 0.0
            for lane in range(n_basic, place):
                total += distances[k, lane]
            pair_sum[robot] += total
            sizes[robot] = place + 1


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
