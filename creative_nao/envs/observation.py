"""Observations of the environments: a flat vector whose layout is defined once, here, and checked by a test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from creative_nao.errors import SettingsError
from creative_nao.measures._dtw_kernels import compiled
from creative_nao.measures.outcome import ALL_OUTCOMES, APPROPRIATE

N_CELLS = 8
"""The PB space is divided into N_CELLS x N_CELLS cells."""
N_APPROPRIATE = len(APPROPRIATE)


@dataclass(frozen=True)
class ObservationPart:
    """Consecutive elements of the observation vector that belong together, from `low` to 1."""

    name: str
    start: int
    size: int
    low: float
    meaning: str

    @property
    def stop(self) -> int:
        """Index after the last element."""
        return self.start + self.size


def layout(n_actions: int = 6, n_pb: int = 2, n_joints: int = 0, n_slow: int = 0) -> tuple[ObservationPart, ...]:
    """Return the parts of the observation, in order.

    Args:
        n_actions: Basic actions.
        n_pb: PB units.
        n_joints: Joints whose posture is observed, or 0: only where the PB may change during a movement.
        n_slow: Neurons of P_S whose activity is observed there.
    """
    parts = [
        ("pb", n_pb, -1.0, "last PB vector"),
        ("outcome", len(ALL_OUTCOMES), 0.0, "last outcome, one-hot in the order of `OUTCOMES`"),
        ("novelty", 1, 0.0, "d / (d + scale), d the last action's distance to the nearest basic action"),
        ("nearest", n_actions, 0.0, "nearest basic action of the last action, one-hot"),
        ("known", 1, 0.0, "d / (d + scale), d its distance to everything known before it"),
        (
            "cells",
            N_CELLS**n_pb,
            -1.0,
            "cells of PB space: 0 untried, -1 in vain, else best reward r there as r / (r + 1)",
        ),
        ("coverage", 1, 0.0, "share of the cells tried"),
        ("step", 1, 0.0, "share of the episode that is over"),
    ]
    if n_joints:
        parts += [
            ("posture", n_joints, -1.0, "joint angles now, -1 and 1 are the ends of the basic actions' range"),
            ("slow", n_slow, -1.0, "activity of the slowest layer P_S"),
            ("phase", 1, 0.0, "share of the movement that has unfolded, 0 before a new one"),
        ]
    starts = np.cumsum([0, *(part[1] for part in parts)]).tolist()
    return tuple(ObservationPart(name, start, *rest) for (name, *rest), start in zip(parts, starts, strict=False))


def layout_table(parts: tuple[ObservationPart, ...]) -> str:
    """Return the layout as a table in Markdown, a row for each part."""
    rows = ["| index | name | meaning | min | max | unit |", "| --- | --- | --- | --- | --- | --- |"]
    for part in parts:
        index = f"{part.start}-{part.stop - 1}" if part.size > 1 else part.start
        rows.append(f"| {index} | {part.name} | {part.meaning} | {part.low:g} | 1 | 1 |")
    return "\n".join(rows)


def observation_space(parts: tuple[ObservationPart, ...]) -> Box:
    """Return the flat float32 Box of the observation."""
    low = np.concatenate([np.full(part.size, part.low, np.float32) for part in parts])
    return Box(low, np.ones_like(low), dtype=np.float32)


def cells_of(space: Box, n_pb: int) -> slice:
    """Return where the cells of a PB space of `n_pb` units stand in the observations of `space`.

    They follow from the bounds of the space: after the PB, the cells are the first values that may be negative. A space
    without them, of another project's environment, raises SettingsError.
    """
    negative = np.flatnonzero(space.low[n_pb:] < 0.0) + n_pb if len(space.shape) == 1 else np.empty(0, np.int64)
    size = N_CELLS**n_pb
    cells = slice(int(negative[0]), int(negative[0]) + size) if len(negative) >= size else slice(0)
    if cells.stop == 0 or np.any(space.low[cells] >= 0.0) or space.low[cells.stop] < 0.0:
        raise SettingsError(
            f"`observation_space` should have {size} cells of a PB space with {n_pb} units, as the observations of "
            f"CreativeNao/ environments do, but is {space}"
        )
    return cells


@compiled()
def _record_kernel(vectors, starts, env_ids, pb, outcome, nearest, novelty, known, reward):
    """Write one action each into the vectors (n_envs, size); `starts` are those of six parts, in this order."""
    at_outcome, at_novelty, at_nearest, at_known, at_cells, at_coverage = starts
    n_cells = at_coverage - at_cells
    for k in range(len(env_ids)):
        vector = vectors[env_ids[k]]
        vector[: pb.shape[2]] = pb[k, -1]
        vector[at_outcome:at_known] = 0.0
        vector[at_outcome + outcome[k]] = 1.0
        vector[at_novelty] = novelty[k] / (novelty[k] + 1.0)
        vector[at_nearest + nearest[k]] = 1.0
        vector[at_known] = known[k] / (known[k] + 1.0)
        value = max(reward[k] / (reward[k] + 1.0), 0.1) if outcome[k] < N_APPROPRIATE else -1.0
        for point in pb[k]:
            cell, stride = at_cells, 1
            for unit in range(pb.shape[2]):
                cell += int(min((point[unit] + 1.0) / 2.0 * N_CELLS, N_CELLS - 1)) * stride
                stride *= N_CELLS
            vector[cell] = max(vector[cell], value) if vector[cell] != 0.0 else value
        vector[at_coverage] = np.count_nonzero(vector[at_cells:at_coverage]) / n_cells


class ObservationBatch:
    """The observation vectors of one or many episodes, one row each, laid out in `parts`."""

    def __init__(self, parts: tuple[ObservationPart, ...], n_envs: int = 1) -> None:
        self._at = {part.name: slice(part.start, part.stop) for part in parts}
        self._starts = tuple(
            self._at[name].start for name in ("outcome", "novelty", "nearest", "known", "cells", "coverage")
        )
        self._vectors = np.zeros((n_envs, parts[-1].stop), np.float32)

    def clear(self, env_ids: Any = slice(None)) -> None:
        """Set the observations of these episodes to zero, as at their start."""
        self._vectors[env_ids] = 0.0

    def set_part(self, env_ids: np.ndarray, part: str, values: np.ndarray) -> None:
        """Write one part of these vectors: values (m, size), or (m,) for a part of one element."""
        self._vectors[env_ids, self._at[part]] = values if values.ndim == 2 else values[:, None]

    def record_action(
        self,
        env_ids: np.ndarray,
        *,
        pb: np.ndarray,
        outcome: np.ndarray,
        nearest: np.ndarray,
        novelty: np.ndarray,
        known: np.ndarray,
        reward: np.ndarray,
    ) -> None:
        """Write the result of one action of each episode.

        Args:
            env_ids: Which episodes, shape (m,).
            pb: The PB vectors of the action in [-1, 1], shape (m, n, n_pb): one, or several where the PB changed.
            outcome: Index of each outcome in `ALL_OUTCOMES`, shape (m,).
            nearest: Nearest basic action, shape (m,).
            novelty: Distance to it, in units of the reward scale, shape (m,).
            known: Distance to everything known before, in the same unit, shape (m,).
            reward: Reward of the action, shape (m,).
        """
        _record_kernel(self._vectors, self._starts, env_ids, pb, outcome, nearest, novelty, known, reward)

    def vectors(self) -> np.ndarray:
        """Return a copy of all observations, (n_envs, size)."""
        return self._vectors.copy()

    def vector(self, env_id: int = 0) -> np.ndarray:
        """Return a copy of one observation, (size,)."""
        return self._vectors[env_id].copy()

    def set_vector(self, env_id: int, vector: np.ndarray) -> None:
        """Replace one observation by what `vector` returned."""
        self._vectors[env_id] = vector
