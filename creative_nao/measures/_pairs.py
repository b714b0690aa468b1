"""The arithmetic of `pairs.py`: as `_lanes.py`, but every lane is a pair of its own, both of whose members differ."""

from __future__ import annotations

import numpy as np

from creative_nao.measures._cells import BLOCK, BORDER, fill_column, squared_length
from creative_nao.measures._lanes import STEP, _jit

LANES = 32
"""Pairs side by side: both members and two rows of the dynamic programme stay in a fast cache."""


@_jit()
def _side_by_side(x, y, rows, squares):
    """Fill row 0 or 1 of `rows`, returned, column by column; its last column holds the distances.

    x, y: (ticks, joints, lanes) the members of the pairs; rows: (2, ticks + 1, lanes) and squares: (lanes,) working
    memory. The expressions are those of `_cells.py`, so a pair has the same bits as elsewhere.
    """
    m = y.shape[0]
    rows[:] = BORDER
    rows[0, 0] = 0
    for i in range(x.shape[0]):
        before, now = rows[i & 1], rows[1 - (i & 1)]
        for j in range(m):
            squares[:] = 0
            for k in range(0, x.shape[1], BLOCK):
                p, q = x[i, k : k + BLOCK], y[j, k : k + BLOCK]
                for v in range(np.uint64(0), np.uint64(x.shape[2])):
                    squares[v] += squared_length(
                        p[0, v] - q[0, v], p[1, v] - q[1, v], p[2, v] - q[2, v], p[3, v] - q[3, v],
                        p[4, v] - q[4, v], p[5, v] - q[5, v], p[6, v] - q[6, v], p[7, v] - q[7, v],
                    )  # fmt: skip
            fill_column(squares, j, before, now, 0, x.shape[2])
        before[0] = BORDER  # only the very first cell may be entered from outside
    return x.shape[0] & 1


@_jit()
def _gather(values, places, width, out):
    """Lay the trajectories at `places` side by side; lanes beyond the last repeat it."""
    for lane in range(width):
        one = values[places[min(lane, places.shape[0] - 1)]]
        for t in range(one.shape[0]):
            for k in range(one.shape[1]):
                out[t, k, lane] = one[t, k]


@_jit()
def _batch(values, first, second, out):
    n = first.shape[0]
    width = (n + STEP - 1) // STEP * STEP
    joints = (values.shape[2] + BLOCK - 1) // BLOCK * BLOCK
    x = np.zeros((values.shape[1], joints, width), out.dtype)
    y = np.zeros((values.shape[1], joints, width), out.dtype)
    _gather(values, first, width, x)
    _gather(values, second, width, y)
    rows, squares = np.empty((2, values.shape[1] + 1, width), out.dtype), np.empty(width, out.dtype)
    last = _side_by_side(x, y, rows, squares)
    out[:] = rows[last, values.shape[1], :n]


@_jit()
def fill(values, first, second, out):
    """Fill `out` (n,) with the distances of values[first] to values[second]; values: (N, ticks, joints)."""
    for start in range(0, first.shape[0], LANES):
        stop = min(start + LANES, first.shape[0])
        _batch(values, first[start:stop], second[start:stop], out[start:stop])
