"""The square of the PB space that a map shows: the whole of it, or a window that somebody zoomed into."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

SIZE = 600
"""Pixels of a map along each side, whatever it shows."""
SMALLEST = 0.002
"""Width of the narrowest window: a thousand times nearer than the whole map."""
ALL = 2.0
"""Width of the PB space."""


class Grid(Protocol):
    """Points on a square grid, such as a `PBMap`."""

    @property
    def resolution(self) -> int:
        """Points along each axis."""
        ...

    @property
    def pb(self) -> np.ndarray:
        """The points, shape (resolution^2, 2), the first PB unit fastest."""
        ...


@dataclass(frozen=True)
class View:
    """A square of the PB space.

    Attributes:
        left: Lowest value of the first PB unit.
        bottom: Lowest value of the second.
        width: Length of its memory_panels.
    """

    left: float
    bottom: float
    width: float

    @classmethod
    def whole(cls, resolution: int) -> View:
        """Return what a map of the whole PB space covers: its cells are squares round the points of its grid."""
        half_cell = 1 / (resolution - 1)
        return cls(-1 - half_cell, -1 - half_cell, ALL + 2 * half_cell)

    @classmethod
    def of(cls, grid: Grid) -> View:
        """Return what a grid of cells covers."""
        cell = float(grid.pb[1, 0] - grid.pb[0, 0])
        return cls(float(grid.pb[0, 0]) - cell / 2, float(grid.pb[0, 1]) - cell / 2, cell * grid.resolution)

    @property
    def digits(self) -> int:
        """Decimals that tell neighbouring pixels apart, at least 3."""
        return max(3, math.ceil(-math.log10(self.width / SIZE)))

    def to_pb(self, x: float, y: float) -> tuple[float, float]:
        """Return the PB point under a pixel, in [-1, 1]; y goes down, PB 2 up."""

        def one(low: float, share: float) -> float:
            return round(min(1.0, max(-1.0, low + share * self.width)), self.digits)

        return one(self.left, x / SIZE), one(self.bottom, 1 - y / SIZE)

    def to_pixel(self, pb: Sequence[float]) -> tuple[float, float]:
        """Return the pixel of a PB point: the reverse of `to_pb`; it may lie outside."""
        return (pb[0] - self.left) / self.width * SIZE, SIZE - (pb[1] - self.bottom) / self.width * SIZE

    def shows(self, pb: Sequence[float]) -> bool:
        """Tell whether a PB point lies within."""
        return 0 <= pb[0] - self.left <= self.width and 0 <= pb[1] - self.bottom <= self.width

    def within(self, other: View) -> bool:
        """Tell whether all of it lies in another."""
        slack = 1e-9
        return all(
            low >= other_low - slack and low + self.width <= other_low + other.width + slack
            for low, other_low in ((self.left, other.left), (self.bottom, other.bottom))
        )

    def grid(self, n: int) -> np.ndarray:
        """Return the middles of `n` x `n` cells, shape (n^2, 2), in the order of `pb_space.pb_grid`."""
        steps = (np.arange(n) + 0.5) * (self.width / n)
        first, second = np.meshgrid(self.left + steps, self.bottom + steps, indexing="xy")
        return np.clip(np.stack([first, second], axis=-1).reshape(-1, 2), -1.0, 1.0)

    def cells(self, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        """Return which row and which column of a grid lies under each pixel row and column, twice shape (SIZE,)."""
        drawn = View.of(grid)
        middle = (np.arange(SIZE) + 0.5) / SIZE

        def one(low: float, drawn_low: float, share: np.ndarray) -> np.ndarray:
            cell = np.floor((low + share * self.width - drawn_low) / drawn.width * grid.resolution)
            return np.clip(cell.astype(np.int64), 0, grid.resolution - 1)

        return one(self.bottom, drawn.bottom, 1 - middle), one(self.left, drawn.left, middle)

    def zoomed(self, factor: float, around: Sequence[float]) -> View | None:
        """Return the view `factor` times nearer round a PB point that keeps its place; None is the whole map."""
        width = max(min(self.width, ALL) / factor, SMALLEST)
        if width >= ALL:
            return None

        def one(low: float, middle: float) -> float:
            return min(max(middle - (middle - low) * width / self.width, -1.0), 1.0 - width)

        return View(one(self.left, around[0]), one(self.bottom, around[1]), width)

    def following(self, pb: Sequence[float]) -> View:
        """Return the view itself if it shows a PB point, else one as wide with the point in its middle."""
        if self.shows(pb):
            return self
        low = [min(max(value - self.width / 2, -1.0), 1.0 - self.width) for value in pb]
        return View(low[0], low[1], self.width)


def cell_of(grid: Grid, pb: Sequence[float]) -> int:
    """Return the index of the cell of a grid that a PB point lies in, or is nearest to."""
    drawn, n = View.of(grid), grid.resolution
    column, row = (
        min(max(math.floor((value - low) / drawn.width * n), 0), n - 1)
        for value, low in zip(pb, (drawn.left, drawn.bottom), strict=True)
    )
    return row * n + column
