"""Where the compiled engine keeps the numbers of a network: packed for its matrix product.

P_I/P_O, P_F, P_M and P_S form a chain, each connected with itself and its neighbours (the first not with itself). All
units lie side by side in one row of columns, and all weights are one matrix, senders in rows and receivers in columns.
It is cut into panels of `PANEL` receivers; a panel keeps only the senders that its receivers hear. Because who hears
whom is symmetric, the panels of the transposed matrix have the same shape.

Code columns are ordered unit by unit, with the joints side by side, so that the softmax of eight joints is computed in
the eight lanes of a register. Joints are filled up to a multiple of eight; columns that stand for nothing have no
weights.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from creative_nao.model.config import NetworkSettings
from creative_nao.model.parameters import Shapes, layer_time_constants, n_parameters, neighbour_mask, parameter_shapes
from creative_nao.model.product import PANEL

LINE = 16
"""Float32 numbers in a cache line of 64 bytes."""


class Layout(NamedTuple):
    """Sizes and places, as the compiled functions read them."""

    n_actions: int
    n_joints: int
    """Filled up to a multiple of eight."""
    n_codes: int
    """Columns of P_I and P_O: n_joints times softmax units; the hidden units begin at `first_hidden`."""
    first_hidden: int
    width: int
    """Columns, a multiple of `PANEL`."""
    row: int
    """Distance between two rows: an odd number of cache lines, so that a column of numbers spreads over the cache."""
    n_pb: int
    low: np.ndarray
    """First sender of each panel, int64."""
    high: np.ndarray
    """End of the senders of each panel."""
    place: np.ndarray
    """Where each panel begins in the packed vector."""
    bias: int
    """Where the biases begin in the packed vector, one per column."""
    w_pb: int
    """Where the PB weights begin, a row of `width` for each PB unit."""
    rho: int
    """Where rho begins, a row of `n_pb` for each action."""
    size: int
    """Length of the packed vector."""


def line_up(n: int, multiple: int) -> int:
    """Return the smallest multiple that is at least `n`."""
    return -(-n // multiple) * multiple


def aligned(*shape: int) -> np.ndarray:
    """Return zeros in float32 that begin at a cache line: loads that cross two lines take twice the time."""
    size = int(np.prod(shape))
    room = np.zeros(size + LINE, np.float32)
    start = -room.ctypes.data // room.itemsize % LINE
    return room[start : start + size].reshape(shape)


class Packing:
    """Translates between the flat vector of `parameters` and the packed one.

    Args:
        settings: Sizes of the network.
        n_codes: Length of a posture's softmax code.
        n_actions: Actions to learn.
    """

    def __init__(self, settings: NetworkSettings, n_codes: int, n_actions: int) -> None:
        self.shapes: Shapes = parameter_shapes(settings, n_codes, n_actions)
        n_units = settings.n_softmax_units
        n_joints = line_up(n_codes // n_units, 8)
        first_hidden = line_up(n_joints * n_units, LINE)
        starts = np.cumsum([0, first_hidden, *settings.layer_sizes])
        width = line_up(int(starts[-1]), PANEL)
        low, high = _heard(starts, width)
        place = np.cumsum([0, *((high - low) * PANEL)])
        bias = int(place[-1])
        w_pb = bias + width
        rho = w_pb + settings.n_pb * width
        size = line_up(rho + n_actions * settings.n_pb, LINE)
        self.layout = Layout(
            n_actions, n_joints, n_joints * n_units, first_hidden, width, width + LINE, settings.n_pb,
            low, high, place[:-1], bias, w_pb, rho, size,
        )  # fmt: skip
        joint, unit = np.divmod(np.arange(n_codes), n_units)
        self.code_columns = unit * n_joints + joint
        """Column of each element of a posture's code."""
        self.rate = np.ones(width, np.float32)
        self.rate[first_hidden : first_hidden + settings.n_hidden] = 1 / layer_time_constants(settings)
        self._flat, self._packed = self._pairs(settings)

    def _pairs(self, settings: NetworkSettings) -> tuple[np.ndarray, np.ndarray]:
        """Return which element of the flat vector is which of the packed one; weights fixed at zero are in none."""
        lay = self.layout
        fast = lay.first_hidden + np.arange(settings.layer_sizes[0])
        hidden = lay.first_hidden + np.arange(settings.n_hidden)
        codes = self.code_columns

        def weight(sender, receiver):
            panel, column = np.divmod(receiver[None, :], PANEL)
            return lay.place[panel] + (sender[:, None] - lay.low[panel]) * PANEL + column

        packed = {
            "w_in": weight(codes, fast),
            "w_out": weight(fast, codes),
            "w_hidden": np.where(neighbour_mask(settings) > 0, weight(hidden, hidden), -1),
            "w_pb": lay.w_pb + np.arange(lay.n_pb)[:, None] * lay.width + hidden,
            "b_out": lay.bias + codes,
            "b_hidden": lay.bias + hidden,
            "rho": lay.rho + np.arange(lay.n_actions * lay.n_pb),
        }
        targets = np.concatenate([packed[name].ravel() for name in self.shapes])
        real = np.flatnonzero(targets >= 0)
        return real, targets[real]

    def pack(self, flat: np.ndarray) -> np.ndarray:
        """Return the packed vector; what stands for nothing is zero."""
        packed = aligned(self.layout.size)
        packed[self._packed] = flat[self._flat]
        return packed

    def unpack(self, packed: np.ndarray, flat: np.ndarray) -> np.ndarray:
        """Return a copy of the flat vector with the numbers of the packed one."""
        new = flat.copy()
        new[self._flat] = packed[self._packed]
        return new

    def real(self) -> np.ndarray:
        """Return 1 for elements of the packed vector that are parameters, 0 for those that stand for nothing."""
        return self.pack(np.ones(n_parameters(self.shapes), np.float32))


def _heard(starts: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each panel, the first and the end of the columns that its receivers hear.

    Both are multiples of eight, because the weights are transposed in squares of that size.
    """
    n_parts = len(starts) - 1
    low, high = [], []
    for first in range(0, width, PANEL):
        inside = [p for p in range(n_parts) if starts[p] < first + PANEL and starts[p + 1] > first]
        # P_I/P_O, part 0, does not hear itself; a last panel may hold no unit at all.
        heard = [q for p in inside for q in (p - 1, p, p + 1) if 0 <= q < n_parts and (p, q) != (0, 0)]
        low.append(starts[min(heard)] // 8 * 8 if heard else 0)
        high.append(line_up(starts[max(heard) + 1], 8) if heard else 0)
    return np.array(low, np.int64), np.array(high, np.int64)
