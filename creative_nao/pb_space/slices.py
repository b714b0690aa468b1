"""A chart over two of several PB units, the others held: a slice through a PB space that no sheet of paper holds."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import Criteria, score
from creative_nao.model import Memory
from creative_nao.pb_space.chart import MAX_RESOLUTION, PBMap
from creative_nao.pb_space.grid import PAPER_RESOLUTION, pb_grid
from creative_nao.provenance import record


@dataclass(frozen=True, eq=False, kw_only=True)
class PBSlice(PBMap):
    """A scored grid over two PB units. Everything a `PBMap` has, and where the slice lies.

    `pb` and `learned_pb` are seen in the plane of the slice, shape (..., 2): a basic action whose other PB values
    differ from `at` lies before or behind it. Read back from a file it is a `PBMap`, its place in the record.

    Attributes:
        axes: The two PB units, counted from 0: the horizontal and the vertical one.
        at: PB value of all units, shape (n_pb,); the two of `axes` do not count.
    """

    axes: tuple[int, int]
    at: np.ndarray

    @property
    def full_pb(self) -> np.ndarray:
        """The points with all their PB values, shape (n, n_pb)."""
        return _filled(self.pb, self.axes, self.at)

    def plot(self, path: str | os.PathLike[str] | None = None, **options: Any) -> Any:
        """Draw the slice as `PBMap.plot` draws a map, its two PB units at the axes."""
        from creative_nao.pb_space.picture import draw_map, write_figure

        held = ", ".join(f"PB {k + 1} = {v:.3g}" for k, v in enumerate(self.at) if k not in self.axes)
        figure = draw_map(self, **{"title": f"Slice at {held}" if held else None, **options})
        figure.axes[0].set(xlabel=f"PB {self.axes[0] + 1}", ylabel=f"PB {self.axes[1] + 1}")
        if path is not None:
            write_figure(figure, path)
        return figure


def pb_slice(
    memory: Memory,
    axes: Sequence[int] = (0, 1),
    at: ArrayLike | None = None,
    resolution: int = PAPER_RESOLUTION,
    criteria: Criteria | None = None,
) -> PBSlice:
    """Generate and score a grid over two PB units of a memory with two or more.

    Args:
        memory: The memory.
        axes: Two different PB units, counted from 0.
        at: PB value of every unit in [-1, 1], shape (n_pb,), those of `axes` being ignored; for example
            ``memory.pb[2]``, to cut through the third basic action. Default: 0.
        resolution: Points along each axis.
        criteria: Where the lines between the outcomes are drawn; default: the paper's.

    Raises:
        SettingsError: If `axes` are not two different units of the memory or `resolution` is out of range.
        ShapeError: If `at` is not (n_pb,) in [-1, 1].
    """
    n_pb = memory.network.n_pb
    pair = tuple(int(k) for k in axes)
    if len(pair) != 2 or pair[0] == pair[1] or not all(0 <= k < n_pb for k in pair):
        raise SettingsError(
            f"`axes` should be two different PB units of this memory, from 0 to {n_pb - 1}, but is {tuple(axes)}"
        )
    if resolution > MAX_RESOLUTION:
        raise SettingsError(f"`resolution` should be at most {MAX_RESOLUTION}, but is {resolution}")
    place = np.zeros(n_pb) if at is None else np.array(at, dtype=np.float64)
    if place.shape != (n_pb,) or not (np.abs(place) <= 1).all():
        raise ShapeError(f"`at` should hold {n_pb} PB values in [-1, 1], but is {place.tolist()}")
    pb = pb_grid(resolution)
    trajectories = memory.generate(_filled(pb, pair, place))
    scores = score(trajectories, memory.demonstrations, Criteria() if criteria is None else criteria)
    settings = {"memory": memory.name, "resolution": resolution, "axes": list(pair), "at": place.tolist()}
    return PBSlice(
        resolution=resolution,
        pb=pb,
        outcome=scores.outcome,
        nearest=scores.nearest,
        distance=scores.novelty,
        learned_pb=memory.pb[:, list(pair)],
        names=memory.demonstrations.names,
        record=record(settings=settings),
        trajectories=trajectories,
        dt_s=memory.dt_s,
        axes=pair,
        at=place,
    )


def _filled(pb: np.ndarray, axes: tuple[int, int], at: np.ndarray) -> np.ndarray:
    full = np.repeat(at[None], len(pb), axis=0)
    full[:, list(axes)] = pb
    return full
