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

from creative_nao.measures._fused import squared_length

LANE_BYTES = 512
"""Size of one number of every trajectory in a batch: 128 trajectories in float32, 64 in float64."""

STEP = 16
"""Lanes go in steps of one 512-bit register of float32."""

BLOCK = 8
"""Joints handled by one expression; the caller pads with zeros, which change no distance."""


def _jit(**options: Any) -> Any:
    """Compile at the first call and keep the machine code on disk, or in memory where no folder can be written."""

    def wrap(function: Any) -> Any:
        try:
            return njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # raised at import when there is no place for the cache
            return njit(nogil=True, **options)(function)

    return wrap


# No fast-math licence is taken: products and sums are fused by `squared_length`, everywhere alike.
# `np.uint64` keeps numba's test for negative indices out of the loop; with it LLVM does not vectorise, 13 times slower.
# The eight names are not vanity either: a loop over the joints inside the lane loop costs a factor of 40.
@_jit()
def _against_one(x, n_steps, y, start, rows, out):
    """Distances of the lanes `start` and above to one trajectory of eight joints.

    x: (ticks, 8, lanes) side by side; n_steps: (lanes,) their lengths, rising; y: (m, 8) the other trajectory;
    rows: (2, m + 1 or more, lanes) working memory; out: (lanes,) the distances.
    """
    m = y.shape[0]
    border = x.dtype.type(1e30)
    rows[:, : m + 1] = border
    rows[0, 0] = 0
    for i in range(x.shape[0]):
        while start + STEP < x.shape[2] and n_steps[start + STEP - 1] <= i:  # these lanes are done
            start += STEP
        p, before, now = x[i], rows[i & 1], rows[1 - (i & 1)]
        for j in range(0, m - 1, 2):
            y0, y1, y2, y3 = y[j, 0], y[j, 1], y[j, 2], y[j, 3]
            y4, y5, y6, y7 = y[j, 4], y[j, 5], y[j, 6], y[j, 7]
            z0, z1, z2, z3 = y[j + 1, 0], y[j + 1, 1], y[j + 1, 2], y[j + 1, 3]
            z4, z5, z6, z7 = y[j + 1, 4], y[j + 1, 5], y[j + 1, 6], y[j + 1, 7]
            diag, up, up2, left, cell, cell2 = before[j], before[j + 1], before[j + 2], now[j], now[j + 1], now[j + 2]
            for v in range(np.uint64(start), np.uint64(x.shape[2])):
                p0, p1, p2, p3, p4, p5, p6, p7 = p[0, v], p[1, v], p[2, v], p[3, v], p[4, v], p[5, v], p[6, v], p[7, v]
                middle, far = up[v], up2[v]
                best = middle if middle < diag[v] else diag[v]
                best = left[v] if left[v] < best else best
                squares = squared_length(p0 - y0, p1 - y1, p2 - y2, p3 - y3, p4 - y4, p5 - y5, p6 - y6, p7 - y7)
                near = np.sqrt(squares) + best
                cell[v] = near
                best = far if far < middle else middle
                best = near if near < best else best
                squares = squared_length(p0 - z0, p1 - z1, p2 - z2, p3 - z3, p4 - z4, p5 - z5, p6 - z6, p7 - z7)
                cell2[v] = np.sqrt(squares) + best
        if m & 1:
            j = m - 1
            y0, y1, y2, y3 = y[j, 0], y[j, 1], y[j, 2], y[j, 3]
            y4, y5, y6, y7 = y[j, 4], y[j, 5], y[j, 6], y[j, 7]
            diag, up, left, cell = before[j], before[m], now[j], now[m]
            for v in range(np.uint64(start), np.uint64(x.shape[2])):
                best = up[v] if up[v] < diag[v] else diag[v]
                best = left[v] if left[v] < best else best
                squares = squared_length(
                    p[0, v] - y0, p[1, v] - y1, p[2, v] - y2, p[3, v] - y3,
                    p[4, v] - y4, p[5, v] - y5, p[6, v] - y6, p[7, v] - y7,
                )  # fmt: skip
                cell[v] = np.sqrt(squares) + best
        before[0] = border  # only the very first cell may be entered from outside
        for v in range(np.uint64(start), np.uint64(x.shape[2])):
            if n_steps[v] == i + 1:
                out[v] = now[m, v]


@_jit()
def _against_one_wide(x, n_steps, y, start, rows, squares, out):
    """The same for 16, 24, ... joints: the squared distance is summed in `squares` (lanes,) block by block first."""
    m = y.shape[0]
    border = x.dtype.type(1e30)
    rows[:, : m + 1] = border
    rows[0, 0] = 0
    for i in range(x.shape[0]):
        while start + STEP < x.shape[2] and n_steps[start + STEP - 1] <= i:
            start += STEP
        before, now = rows[i & 1], rows[1 - (i & 1)]
        for j in range(m):
            squares[:] = 0
            for k in range(0, y.shape[1], BLOCK):
                p = x[i, k : k + BLOCK]
                y0, y1, y2, y3 = y[j, k], y[j, k + 1], y[j, k + 2], y[j, k + 3]
                y4, y5, y6, y7 = y[j, k + 4], y[j, k + 5], y[j, k + 6], y[j, k + 7]
                for v in range(np.uint64(start), np.uint64(x.shape[2])):
                    squares[v] += squared_length(
                        p[0, v] - y0, p[1, v] - y1, p[2, v] - y2, p[3, v] - y3,
                        p[4, v] - y4, p[5, v] - y5, p[6, v] - y6, p[7, v] - y7,
                    )  # fmt: skip
            diag, up, left, cell = before[j], before[j + 1], now[j], now[j + 1]
            for v in range(np.uint64(start), np.uint64(x.shape[2])):
                best = up[v] if up[v] < diag[v] else diag[v]
                best = left[v] if left[v] < best else best
                cell[v] = np.sqrt(squares[v]) + best
        before[0] = border
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
            if xs.shape[1] == BLOCK:
                _against_one(x, n_steps, y, start, rows, distances)
            else:
                _against_one_wide(x, n_steps, y, start, rows, squares, distances)
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
