"""The arithmetic of `dtw.py`: exact dynamic time warping of many pairs at once, compiled with numba.

Up to 128 trajectories lie side by side as (tick, joint, lane). One instruction then works on the same cell of the
dynamic programme for 8 or 16 of them, all against one shared other trajectory; a lane's answer is its last row's last
cell. Two columns are done in one pass, because the postures of the lanes then have to be read only half as often.

A lane never reads another lane, and every cell is computed by the same expression, so a distance has the same bits
whatever shares its batch, however many threads there are, and whichever of the two comes first.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange

from creative_nao.measures._cells import BORDER, fill_row

LANE_BYTES = 512
"""Size of one number of every trajectory in a batch: 128 trajectories in float32, 64 in float64."""

STEP = 16
"""Lanes go in steps of one 512-bit register of float32."""


def _jit(**options: Any) -> Any:
    """Compile at the first call and keep the machine code on disk, or in memory where no folder can be written."""

    def wrap(function: Any) -> Any:
        try:
            return njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # raised at import when there is no place for the cache
            return njit(nogil=True, **options)(function)

    return wrap


@_jit()
def _against_one(x, n_steps, y, start, rows, squares, out):
    """Distances of the lanes `start` and above to one trajectory.

    x: (ticks, joints, lanes) side by side; n_steps: (lanes,) their lengths, rising; y: (m, joints) the other;
    rows: (2, m + 1 or more, lanes) and squares: (lanes,) working memory; out: (lanes,) the distances.
    """
    m = y.shape[0]
    rows[:, : m + 1] = BORDER
    rows[0, 0] = 0
    for i in range(x.shape[0]):
        while start + STEP < x.shape[2] and n_steps[start + STEP - 1] <= i:  # these lanes are done
            start += STEP
        before, now = rows[i & 1], rows[1 - (i & 1)]
        fill_row(x[i], y, before, now, squares, start, x.shape[2])
        before[0] = BORDER  # only the very first cell may be entered from outside
        for v in range(np.uint64(start), np.uint64(x.shape[2])):
            if n_steps[v] == i + 1:
                out[v] = now[m, v]


@_jit()
def _batch(first, lanes, xs, x_offset, x_order, ys, y_offset, y_order, symmetric, out):
    """Fill the entries of `out` for the batch of `xs` that begins at place `first` of the order by length."""
    count = min(lanes, x_order.shape[0] - first)
    width = (count + STEP - 1) // STEP * STEP
    begin, n_steps = np.empty(width, np.int64), np.empty(width, np.int64)
    for lane in range(width):  # lanes beyond the last trajectory repeat it and are never read
        a = x_order[first + min(lane, count - 1)]
        begin[lane], n_steps[lane] = x_offset[a], x_offset[a + 1] - x_offset[a]
    x = np.zeros((n_steps[width - 1], xs.shape[1], width), xs.dtype)
    for lane in range(width):
        for t in range(n_steps[lane]):
            for k in range(xs.shape[1]):
                x[t, k, lane] = xs[begin[lane] + t, k]
    longest = y_order[y_order.shape[0] - 1]
    rows = np.empty((2, y_offset[longest + 1] - y_offset[longest] + 1, width), xs.dtype)
    squares, distances = np.empty(width, xs.dtype), np.empty(width, xs.dtype)
    for place in range(y_order.shape[0]):
        b = y_order[place]
        start = max(0, place + 1 - first) // STEP * STEP if symmetric else 0
        if start < count:
            y = ys[y_offset[b] : y_offset[b + 1]]
            _against_one(x, n_steps, y, start, rows, squares, distances)
            for lane in range(start, count):
                if not symmetric or first + lane > place:
                    out[x_order[first + lane], b] = distances[lane]
                    if symmetric:
                        out[b, x_order[first + lane]] = distances[lane]


# Two functions: numba's cache has one entry for both ways of compiling one function, and loads the wrong one.
@_jit()
def fill_serial(lanes, xs, x_offset, x_order, ys, y_offset, y_order, symmetric, out):
    """Fill `out` (len_x, len_y) with distances; `xs` and `ys` hold all ticks in a row, `*_offset` where each begins."""
    for b in range((x_order.shape[0] + lanes - 1) // lanes):
        _batch(b * lanes, lanes, xs, x_offset, x_order, ys, y_offset, y_order, symmetric, out)


@_jit(parallel=True)
def fill_parallel(lanes, xs, x_offset, x_order, ys, y_offset, y_order, symmetric, out):
    """Do the same as `fill_serial`, the batches shared between threads."""
    n = (x_order.shape[0] + lanes - 1) // lanes
    for i in prange(n):  # short and long batches by turns, so that the threads get even shares
        b = n - 1 - i // 2 if i % 2 else i // 2
        _batch(b * lanes, lanes, xs, x_offset, x_order, ys, y_offset, y_order, symmetric, out)
