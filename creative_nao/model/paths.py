"""Paths through the PB space: one movement while the PB moves, or one movement at each stop of a walk (Fig. 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import SettingsError, ShapeError

if TYPE_CHECKING:
    from creative_nao.model.memory import Memory


@dataclass(frozen=True, eq=False)
class Walk:
    """Movements at evenly spaced stops of a path.

    Attributes:
        pb: The stops, shape (n_points, n_pb).
        trajectories: What the memory generates at each [rad], shape (n_points, n_steps, n_joints).
    """

    pb: np.ndarray
    trajectories: np.ndarray

    def __len__(self) -> int:
        return len(self.pb)


def walk(memory: Memory, points: ArrayLike, n_points: int, n_steps: int | None = None) -> Walk:
    """Stop at evenly spaced places of the line through `points` and generate one movement at each, as in Fig. 5.

    Args:
        memory: The memory.
        points: Corners of the line in [-1, 1], shape (n, n_pb).
        n_points: Stops, the first and the last point among them; at least 1, which is the first point.
        n_steps: Ticks of each movement; default: as long as the longest basic action.

    Raises:
        ShapeError: If `points` is not (n, n_pb) or leaves [-1, 1].
        SettingsError: If `n_points` or `n_steps` is below 1.
    """
    corners = checked_points(points, memory.network.n_pb)
    if n_points < 1:
        raise SettingsError(f"`n_points` should be at least 1, but is {n_points}")
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    reached = np.concatenate([[0.0], np.cumsum(lengths)])
    pb = _along(corners, reached, np.linspace(0.0, reached[-1], n_points))
    return Walk(pb, memory.generate(pb, n_steps))


def pb_of_each_tick(
    points: ArrayLike, n_pb: int, n_steps: int, at_ticks: Sequence[int] | np.ndarray | None = None
) -> np.ndarray:
    """Return the PB value at every tick of a movement whose PB moves in straight lines from point to point.

    Args:
        points: Where the PB moves, in [-1, 1], shape (n, n_pb).
        n_pb: PB units of the memory.
        n_steps: Ticks of the movement.
        at_ticks: When each point is reached, rising, shape (n,); before the first and after the last the PB rests.
            Two points at one tick are a jump: from that tick on the later one counts. Default: evenly from tick 0,
            which is given, to the last.

    Returns:
        Shape (n_steps, n_pb).

    Raises:
        ShapeError: If `points` is not (n, n_pb) or leaves [-1, 1].
        SettingsError: If `n_steps` is below 1, or `at_ticks` does not fit.
    """
    corners = checked_points(points, n_pb)
    if n_steps < 1:
        raise SettingsError(f"`n_steps` should be at least 1, but is {n_steps}")
    if at_ticks is None:
        reached = np.linspace(0.0, n_steps - 1, len(corners))
    else:
        reached = np.asarray(at_ticks, dtype=np.float64)
        if reached.shape != (len(corners),) or not (np.diff(reached) >= 0).all() or not np.isfinite(reached).all():
            raise SettingsError(
                f"`at_ticks` should hold {len(corners)} ticks, one for each point, none before the one ahead of it, "
                f"but is {np.asarray(at_ticks).tolist()}"
            )
    return _along(corners, reached, np.arange(n_steps, dtype=np.float64))


def checked_points(points: ArrayLike, n_pb: int) -> np.ndarray:
    """Return `points` as float64 (n, n_pb).

    Raises:
        ShapeError: If they are not, if there is none, or one lies outside [-1, 1].
    """
    corners = np.asarray(points, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != n_pb or not len(corners):
        raise ShapeError(f"`points` should have shape (n, {n_pb}) with n at least 1, but has {corners.shape}")
    inside = (np.abs(corners) <= 1).all(axis=1)  # false for NaN
    if not inside.all():
        row = int(np.flatnonzero(~inside)[0])
        raise ShapeError(f"`points` should lie in [-1, 1], but row {row} is {corners[row].tolist()}")
    return corners


def _along(corners: np.ndarray, reached: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the places on the line at `wanted`, its corners being reached at `reached`."""
    after = np.searchsorted(reached, wanted, side="right")
    left, right = np.clip(after - 1, 0, None), np.clip(after, None, len(corners) - 1)
    span = reached[right] - reached[left]
    share = np.clip((wanted - reached[left]) / np.where(span > 0, span, 1.0), 0.0, 1.0)[:, None]
    return corners[left] + share * (corners[right] - corners[left])
