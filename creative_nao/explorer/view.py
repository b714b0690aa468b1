"""The square of the PB space that a map shows: the whole of it, or a window that somebody zoomed into."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from creative_nao.maps.picture import GridMap

SIZE = 600  # pixels of a map along each side, whatever it shows
SMALLEST = 0.002  # width of the narrowest window: a thousand times nearer than the whole map
ALL = 2.0  # width of the PB space


@dataclass(frozen=True)
class View:
    """A square of the PB space: the lowest values of the first and the second PB unit, and the length of its sides."""

    left: float
    bottom: float
    width: float

    @classmethod
    def whole(cls, resolution: int) -> View:
        """Return what a map of the whole PB space covers: its cells are squares around the points of its grid."""
        half_cell = 1 / (resolution - 1)
        return cls(-1 - half_cell, -1 - half_cell, ALL + 2 * half_cell)

    @classmethod
    def of(cls, grid: GridMap) -> View:
        """Return what a grid of cells covers."""
        cell = float(grid.pb[1, 0] - grid.pb[0, 0])
        return cls(float(grid.pb[0, 0]) - cell / 2, float(grid.pb[0, 1]) - cell / 2, cell * grid.resolution)

    @property
    def digits(self) -> int:
        """Decimals that tell neighbouring pixels apart, at least 3."""
        return max(3, math.ceil(-math.log10(self.width / SIZE)))

    def to_pb(self, x: float, y: float) -> tuple[float, float]:
        """Return the PB point under a pixel, in [-1, 1]; y goes down, PB 2 up."""
        raw = self.left + x / SIZE * self.width, self.bottom + (1 - y / SIZE) * self.width
        pb_1, pb_2 = (round(min(1.0, max(-1.0, value)), self.digits) for value in raw)
        return pb_1, pb_2

    def to_pixel(self, pb: Sequence[float]) -> tuple[float, float]:
        """Return the pixel of a PB point: the reverse of `to_pb`; it may lie outside."""
        return (pb[0] - self.left) / self.width * SIZE, SIZE - (pb[1] - self.bottom) / self.width * SIZE

    def shows(self, pb: Sequence[float]) -> bool:
        """Tell whether a PB point lies within."""
        return 0 <= pb[0] - self.left <= self.width and 0 <= pb[1] - self.bottom <= self.width

    def within(self, other: View) -> bool:
        """Tell whether all of it lies in another."""
        offsets = self.left - other.left, self.bottom - other.bottom
        return all(-1e-9 <= offset <= other.width - self.width + 1e-9 for offset in offsets)

    def grid(self, n: int) -> np.ndarray:
        """Return the middles of `n` x `n` cells, shape (n^2, 2), in the order of `maps.pb_grid`."""
        steps = (np.arange(n) + 0.5) * (self.width / n)
        first, second = np.meshgrid(self.left + steps, self.bottom + steps, indexing="xy")
        return np.clip(np.stack([first, second], axis=-1).reshape(-1, 2), -1.0, 1.0)

    def cells(self, grid: GridMap) -> tuple[np.ndarray, np.ndarray]:
        """Return which row and which column of a grid lies under each pixel row and column, twice shape (SIZE,)."""
        drawn, n = View.of(grid), grid.resolution
        middle = (np.arange(SIZE) + 0.5) / SIZE
        up = self.bottom + (1 - middle) * self.width - drawn.bottom
        across = self.left + middle * self.width - drawn.left
        rows, columns = (np.clip(np.floor(way / drawn.width * n).astype(np.int64), 0, n - 1) for way in (up, across))
        return rows, columns

    def zoomed(self, factor: float, around: Sequence[float]) -> View | None:
        """Return the view `factor` times nearer round a PB point that keeps its place; None is the whole map."""
        width = max(min(self.width, ALL) / factor, SMALLEST)
        if width >= ALL:
            return None
        left, bottom = (
            min(max(pb - (pb - low) * width / self.width, -1.0), 1.0 - width)
            for pb, low in zip(around, (self.left, self.bottom), strict=True)
        )
        return View(left, bottom, width)

    def following(self, pb: Sequence[float]) -> View:
        """Return the view itself if it shows a PB point, else one as wide with the point in its middle."""
        if self.shows(pb):
            return self
        left, bottom = (min(max(value - self.width / 2, -1.0), 1.0 - self.width) for value in pb)
        return View(left, bottom, self.width)


def cell_of(grid: GridMap, pb: Sequence[float]) -> int:
    """Return the index of the cell of a grid that a PB point lies in, or is nearest to."""
    drawn, n = View.of(grid), grid.resolution
    column, row = (
        min(max(math.floor((value - low) / drawn.width * n), 0), n - 1)
        for value, low in zip(pb, (drawn.left, drawn.bottom), strict=True)
    )
    return row * n + column
