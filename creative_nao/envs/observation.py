"""What an agent sees of an episode: a flat vector, its layout told once here and checked by a test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from creative_nao import measures
from creative_nao.errors import SettingsError
from creative_nao.measures.outcome import APPROPRIATE

OF_THE_BODY = ("joint_limit", "torque_saturated", "tracking_error", "self_collision", "fell")
"""Outcomes that only a body has; `robot.first_failure` says which comes first where several hold."""
OUTCOMES = (*measures.OUTCOMES, *OF_THE_BODY)
"""Every outcome of an action, mental or physical, in the order of the observation, where the appropriate ones lead."""
N_CELLS = 8
"""Coverage of the PB space is told in N_CELLS x N_CELLS cells."""


@dataclass(frozen=True)
class Part:
    """A stretch of the observation vector."""

    name: str
    start: int
    size: int
    low: float
    high: float
    meaning: str

    @property
    def stop(self) -> int:
        """Index after the last element."""
        return self.start + self.size


def layout(n_actions: int = 6, n_pb: int = 2, n_joints: int = 0, n_slow: int = 0) -> tuple[Part, ...]:
    """Return the parts of the observation, in order.

    Args:
        n_actions: Basic actions.
        n_pb: PB units.
        n_joints: Joints whose posture is told, or 0: only where the PB may change while a movement unfolds.
        n_slow: Neurons of P_S whose activity is told there.
    """
    parts = [
        ("pb", n_pb, -1.0, 1.0, "last PB vector"),
        ("outcome", len(OUTCOMES), 0.0, 1.0, "last outcome, one-hot in the order of `OUTCOMES`"),
        ("novelty", 1, 0.0, 1.0, "d / (d + scale), d the last action's distance to the nearest basic action"),
        ("nearest", n_actions, 0.0, 1.0, "nearest basic action of the last action, one-hot"),
        ("known", 1, 0.0, 1.0, "d / (d + scale), d its distance to everything known before it"),
        (
            "cells",
            N_CELLS**n_pb,
            -1.0,
            1.0,
            "cells of PB space: 0 untried, -1 in vain, else best reward r there as r / (r + 1)",
        ),
        ("coverage", 1, 0.0, 1.0, "share of the cells tried"),
        ("step", 1, 0.0, 1.0, "share of the episode that is over"),
    ]
    if n_joints:
        parts += [
            ("posture", n_joints, -1.0, 1.0, "joint angles now, -1 and 1 are the ends of the basic actions' range"),
            ("slow", n_slow, -1.0, 1.0, "activity of the slowest layer P_S"),
            ("phase", 1, 0.0, 1.0, "share of the movement that has unfolded, 0 before a new one"),
        ]
    found, start = [], 0
    for name, size, low, high, meaning in parts:
        found.append(Part(name, start, size, low, high, meaning))
        start += size
    return tuple(found)


def observation_space(parts: tuple[Part, ...]) -> Box:
    """Return the flat float32 Box of the observation."""
    low = np.concatenate([np.full(part.size, part.low, np.float32) for part in parts])
    high = np.concatenate([np.full(part.size, part.high, np.float32) for part in parts])
    return Box(low, high, dtype=np.float32)


def cells_of(space: Box, n_pb: int) -> slice:
    """Return where an observation tells about the cells of PB space.

    The bounds of the vector say it: after the PB, the cells are the first values that may be negative.

    Args:
        space: Space of the observations of one of this project's environments.
        n_pb: PB units.

    Raises:
        SettingsError: If there is no such stretch.
    """
    negative = np.flatnonzero(space.low[n_pb:] < 0.0) + n_pb if len(space.shape) == 1 else np.empty(0, np.int64)
    size = N_CELLS**n_pb
    found = slice(int(negative[0]), int(negative[0]) + size) if len(negative) >= size else slice(0)
    if found.stop == 0 or np.any(space.low[found] >= 0.0) or space.low[found.stop] < 0.0:
        raise SettingsError(
            f"`observation_space` should tell {size} cells of a PB space with {n_pb} units, as the observations of "
            f"CreativeNao/ environments do, but is {space}"
        )
    return found


class Observer:
    """Keeps the observation vectors of one or many episodes up to date, one row each.

    Args:
        parts: The layout of a vector.
        n_robots: How many episodes.
    """

    def __init__(self, parts: tuple[Part, ...], n_robots: int = 1) -> None:
        self._at = {part.name: slice(part.start, part.stop) for part in parts}
        self._n_pb = self._at["pb"].stop
        self._n_cells = self._at["cells"].stop - self._at["cells"].start
        self._vectors = np.zeros((n_robots, parts[-1].stop), np.float32)

    def clear(self, robots: Any = slice(None)) -> None:
        """Begin new episodes of these robots: everything is zero."""
        self._vectors[robots] = 0.0

    def put(self, robots: np.ndarray, part: str, values: np.ndarray) -> None:
        """Write one part of the vectors of these robots, values (m, size) or (m,) for a part of one element."""
        where = self._at[part]
        self._vectors[robots, where] = values if values.ndim == 2 else values[:, None]

    def record(
        self,
        robots: np.ndarray,
        *,
        pb: np.ndarray,
        outcome: np.ndarray,
        nearest: np.ndarray,
        novelty: np.ndarray,
        known: np.ndarray,
        reward: np.ndarray,
    ) -> None:
        """Take in one action of each robot.

        Args:
            robots: Which robots, shape (m,).
            pb: The PB vectors of the action in [-1, 1], shape (m, n, n_pb): one, or several where the PB moved.
            outcome: Each one's place in `OUTCOMES`, shape (m,).
            nearest: Nearest basic action, shape (m,).
            novelty: Distance to it, in units of the reward scale, shape (m,).
            known: Distance to everything known before, in the same unit, shape (m,).
            reward: What the action earned, shape (m,).
        """
        vectors, at = self._vectors, self._at
        vectors[robots, at["pb"]] = pb[:, -1]
        vectors[robots, at["outcome"].start : at["nearest"].stop] = 0.0
        vectors[robots, at["outcome"].start + outcome] = 1.0
        vectors[robots, at["novelty"].start] = novelty / (novelty + 1.0)
        vectors[robots, at["nearest"].start + nearest] = 1.0
        vectors[robots, at["known"].start] = known / (known + 1.0)
        earned = np.where(outcome < len(APPROPRIATE), np.maximum(reward / (reward + 1.0), 0.1), -1.0)
        column = np.minimum((pb + 1.0) / 2.0 * N_CELLS, N_CELLS - 1).astype(np.int64)
        cells = at["cells"].start + column @ N_CELLS ** np.arange(self._n_pb)
        for cell in cells.T:
            before = vectors[robots, cell]
            vectors[robots, cell] = np.where(before != 0.0, np.maximum(before, earned), earned)
        tried = np.count_nonzero(vectors[robots, at["cells"]], axis=1)
        vectors[robots, at["coverage"].start] = tried / self._n_cells

    def vectors(self) -> np.ndarray:
        """Return a fresh copy of all observations, (n_robots, size)."""
        return self._vectors.copy()

    def vector(self, robot: int = 0) -> np.ndarray:
        """Return a fresh copy of one robot's observation."""
        return self._vectors[robot].copy()

    def restore(self, robot: int, vector: np.ndarray) -> None:
        """Take over what `vector` returned."""
        self._vectors[robot] = vector
