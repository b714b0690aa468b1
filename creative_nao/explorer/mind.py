"""One memory, asked for movements: what lies at a PB point or along a path, and what it is worth."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

import numpy as np

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.joints import JOINTS
from creative_nao.measures import score, speed_limits
from creative_nao.measures.score import APPROPRIATE
from creative_nao.model import Memory


@dataclass(frozen=True, eq=False)
class Recall:
    """A movement that a memory made, and what it is worth.

    Attributes:
        points: Where in the PB space it comes from, shape (n, 2); a path has more than one point.
        trajectory: Joint angles [rad], shape (n_steps, 8).
        outcome: `learned`, `unlearned`, `fluctuating` or `non_moving`.
        nearest: Place of the basic action most like it.
        novelty: DTW distance to that one [rad].
        speeds: Speed of each joint between ticks [rad/s], shape (n_steps - 1, 8).
    """

    points: np.ndarray
    trajectory: np.ndarray
    outcome: str
    nearest: int
    novelty: float
    speeds: np.ndarray

    @property
    def pb(self) -> tuple[float, float]:
        """Where the PB ends."""
        return float(self.points[-1, 0]), float(self.points[-1, 1])

    @property
    def appropriate(self) -> bool:
        """Whether a robot can use it."""
        return self.outcome in APPROPRIATE


class Mind:
    """A memory behind a lock: worker threads of many browser tabs ask it one after the other.

    Args:
        memory: A memory with two PB units and the eight arm joints.

    Raises:
        SettingsError: If the memory has other joints or another number of PB units.
    """

    def __init__(self, memory: Memory) -> None:
        if memory.network.n_pb != 2:
            raise SettingsError(
                f"the explorer shows memories with n_pb = 2, but {memory.name} has {memory.network.n_pb}"
            )
        if memory.joints != JOINTS:
            raise SettingsError(
                f"the explorer shows memories of the eight arm joints {', '.join(JOINTS)}, "
                f"but {memory.name} has {', '.join(memory.joints)}"
            )
        self.memory = memory
        self.limit_rad_s = speed_limits(memory.demonstrations)
        self._lock = threading.Lock()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the basic actions."""
        return self.memory.demonstrations.names

    def recall(self, points: np.ndarray) -> Recall:
        """Let the memory move at a PB point, or along several.

        Args:
            points: Shape (n, 2) in [-1, 1]; with more than one, the PB moves from each to the next.

        Raises:
            ShapeError: If `points` has another shape, is not finite or leaves [-1, 1].
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not len(points) or not (np.abs(points) <= 1).all():
            raise ShapeError(f"`points` should have shape (n, 2) and lie in [-1, 1], but is {points.tolist()}")
        with self._lock:
            alone = len(points) == 1
            trajectory = self.memory.generate(points)[0] if alone else self.memory.generate_path(points)
            return self._judged(points, trajectory)

    def judge(self, points: np.ndarray, trajectory: np.ndarray) -> Recall:
        """Say what a movement from elsewhere is worth, for instance a recording [rad], shape (n_steps, 8)."""
        with self._lock:
            return self._judged(np.asarray(points, dtype=np.float64), trajectory)

    def recognise(self, trajectory: np.ndarray) -> tuple[np.ndarray, float, Recall]:
        """Find the point of the memory most like a recording [rad] at the memory's tick, shape (n_steps, 8).

        Returns:
            The PB point, the DTW distance left [rad], and the recording itself, judged.
        """
        with self._lock:
            found = self.memory.infer_pb(trajectory)
            return found.pb, float(found.error), self._judged(found.pb[None], trajectory)

    def _judged(self, points: np.ndarray, trajectory: np.ndarray) -> Recall:
        scores = score(trajectory[None], self.memory.demonstrations)
        return Recall(
            points, trajectory, str(scores.outcome[0]), int(scores.nearest[0]), float(scores.novelty[0]),
            np.abs(np.diff(trajectory, axis=0)) / self.memory.dt_s,
        )  # fmt: skip


def as_coordinate(value: object, otherwise: float = 0.0) -> float:
    """Return a PB coordinate in [-1, 1] from anything a browser sends; what is no finite number gives `otherwise`."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return otherwise
    return min(1.0, max(-1.0, number)) if math.isfinite(number) else otherwise
