"""What an agent sees of an episode: a flat vector, its layout told once here and checked by a test."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from gymnasium.spaces import Box

OUTCOMES = (
    "learned",
    "unlearned",
    "fluctuating",
    "non_moving",
    "joint_limit",
    "torque_saturated",
    "tracking_error",
    "self_collision",
    "fell",
)
"""Every outcome of an action, mental or physical, in the order of the observation. The first two are appropriate."""
APPROPRIATE = OUTCOMES[:2]
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


def layout(n_actions: int = 6, n_pb: int = 2) -> tuple[Part, ...]:
    """Return the parts of the observation, in order, for `n_actions` basic actions and `n_pb` PB units."""
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
            "PB space in cells: 0 untried, -1 tried in vain, else best reward r there as r / (r + 1)",
        ),
        ("coverage", 1, 0.0, 1.0, "share of the cells tried"),
        ("step", 1, 0.0, 1.0, "share of the episode that is over"),
    ]
    found, start = [], 0
    for name, size, low, high, meaning in parts:
        found.append(Part(name, start, size, low, high, meaning))
        start += size
    return tuple(found)


def observation_space(n_actions: int, n_pb: int) -> Box:
    """Return the flat float32 Box of the observation."""
    parts = layout(n_actions, n_pb)
    low = np.concatenate([np.full(part.size, part.low, np.float32) for part in parts])
    high = np.concatenate([np.full(part.size, part.high, np.float32) for part in parts])
    return Box(low, high, dtype=np.float32)


@dataclass
class Observer:
    """Keeps the observation vector of one episode up to date."""

    n_actions: int
    n_pb: int
    _vector: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        """Lay out the vector."""
        parts = layout(self.n_actions, self.n_pb)
        self._slices = {part.name: slice(part.start, part.stop) for part in parts}
        self._size = parts[-1].stop
        self.clear()

    def clear(self) -> None:
        """Begin a new episode: everything is zero."""
        self._vector = np.zeros(self._size, np.float32)

    def record(
        self,
        *,
        pb: np.ndarray,
        outcome: str,
        nearest: int,
        novelty: float,
        known: float,
        reward: float,
        progress: float,
    ) -> None:
        """Take in one action.

        Args:
            pb: The PB vector, shape (n_pb,) in [-1, 1].
            outcome: One of `OUTCOMES`.
            nearest: Nearest basic action.
            novelty: Distance to it, in units of the reward scale.
            known: Distance to everything known before, in the same unit.
            reward: What the action earned.
            progress: Share of the episode that is over.
        """
        part = {name: self._vector[where] for name, where in self._slices.items()}
        part["pb"][:] = pb
        part["outcome"][:] = 0.0
        part["outcome"][OUTCOMES.index(outcome)] = 1.0
        part["novelty"][:] = novelty / (novelty + 1.0)
        part["nearest"][:] = 0.0
        part["nearest"][nearest] = 1.0
        part["known"][:] = known / (known + 1.0)
        column = np.minimum((np.asarray(pb) + 1.0) / 2.0 * N_CELLS, N_CELLS - 1).astype(int)
        cell = int(np.ravel_multi_index(tuple(column[::-1]), (N_CELLS,) * self.n_pb))
        earned = max(reward / (reward + 1.0), 0.1) if outcome in APPROPRIATE else -1.0
        before = part["cells"][cell]
        part["cells"][cell] = max(before, earned) if before != 0.0 else earned
        part["coverage"][:] = np.count_nonzero(part["cells"]) / part["cells"].size
        part["step"][:] = progress

    def vector(self) -> np.ndarray:
        """Return a fresh copy of the observation."""
        return self._vector.copy()
