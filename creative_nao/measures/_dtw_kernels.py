"""The compiled arithmetic of the measures: exact dynamic time warping of many pairs at once, and speeds of actions.

It is the fast form of what `dtw.py` defines. Up to 128 trajectories lie side by side as (tick, joint, lane). One
instruction then works on the same cell of the dynamic programme for 8 or 16 of them, all against one shared other
trajectory; a lane's answer is its last row's last cell. Two columns are done in one pass, because the postures of the
lanes then have to be read only half as often.

A lane never reads another lane, and every cell is computed by the same expression, so a distance has the same bits
whatever shares its batch, however many threads there are, and whichever of the two comes first. The expression is put
into every loop before that is compiled, and its instructions are fixed: left to itself, the compiler makes one
instruction of a product and a sum or leaves them two, depending on what else it compiles.

Throughout, p: (8, lanes) the lanes' postures at one tick; y: (m, 8) the other trajectory; before, now: (m + 1, lanes)
two rows of the dynamic programme; first, last: the lanes worked on.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numba import njit, prange, types
from numba.extending import intrinsic

from creative_nao.runtime import announce_compilation

# numba hands an intrinsic its first argument by itself.
# pyright: reportCallIssue=false

LANE_BYTES = 512  # size of one number of every trajectory in a batch: 128 trajectories in float32, 64 in float64
STEP = 16  # lanes go in steps of one 512-bit register of float32
PAIRS = 32  # pairs side by side: both members and two rows of the dynamic programme stay in a fast cache
BLOCK = 8  # joints handled by one expression; the caller pads with zeros, which change no distance
BORDER = 1e30  # where no path may come from. Infinity is never used
# Whether this machine has fused multiply-add; where it has not, a product and a sum are rounded one by one.
FUSES = bool(llvm.get_host_cpu_features().get("fma", not llvm.get_default_triple().startswith(("x86", "i"))))


announce_compilation()


def compiled(**options: Any) -> Any:
    """Compile at the first call and keep the machine code on disk, or in memory where no folder can be written."""

    def wrap(function: Any) -> Any:
        try:
            return njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # raised at import when there is no place for the cache
            return njit(nogil=True, **options)(function)

    return wrap


@intrinsic
def _add_square(typing_context: Any, total: Any, value: Any) -> Any:
    """Return total + value^2, rounded once where the machine `FUSES`."""
    if not (isinstance(total, types.Float) and total == value):
        raise TypeError(f"_add_square needs two floats of one type, but got {total} and {value}")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        start, factor = arguments
        if FUSES:
            return builder.fma(factor, factor, start)
        return builder.fadd(start, builder.fmul(factor, factor))

    return total(total, value), generate


@njit(inline="always")
def squared_length(a, b, c, d, e, f, g, h):
    """Return a^2 + b^2 + ... + h^2, added from the left."""
    half = _add_square(_add_square(_add_square(b * b, a), c), d)
    return _add_square(_add_square(_add_square(_add_square(half, e), f), g), h)


# `np.uint64` keeps numba's test for negative indices out of the loop; with it LLVM does not vectorise, 13 times slower.
# The eight names are not vanity either: a loop over the joints inside the lane loop costs a factor of 40.
@njit(inline="always")
def _fill_two_columns(p, y, j, before, now, first, last):
    """Fill the columns j + 1 and j + 2 of `now` in one pass: the lanes' postures have to be read only half as often."""
    y0, y1, y2, y3, y4, y5, y6, y7 = y[j, 0], y[j, 1], y[j, 2], y[j, 3], y[j, 4], y[j, 5], y[j, 6], y[j, 7]
    k = j + 1
    z0, z1, z2, z3, z4, z5, z6, z7 = y[k, 0], y[k, 1], y[k, 2], y[k, 3], y[k, 4], y[k, 5], y[k, 6], y[k, 7]
    diag, up, up2, left, cell, cell2 = before[j], before[j + 1], before[j + 2], now[j], now[j + 1], now[j + 2]
    for v in range(np.uint64(first), np.uint64(last)):
        p0, p1, p2, p3, p4, p5, p6, p7 = p[0, v], p[1, v], p[2, v], p[3, v], p[4, v], p[5, v], p[6, v], p[7, v]
        middle, far = up[v], up2[v]
        best = middle if middle < diag[v] else diag[v]
        best = left[v] if left[v] < best else best
        square = squared_length(p0 - y0, p1 - y1, p2 - y2, p3 - y3, p4 - y4, p5 - y5, p6 - y6, p7 - y7)
        near = np.sqrt(square) + best
        cell[v] = near
        best = far if far < middle else middle
        best = near if near < best else best
        square = squared_length(p0 - z0, p1 - z1, p2 - z2, p3 - z3, p4 - z4, p5 - z5, p6 - z6, p7 - z7)
        cell2[v] = np.sqrt(square) + best


@njit(inline="always")
def _add_squares(p, q, squares, first, last):
    """Add to `squares` (lanes,) the squared distance of eight joints; q: (8,) the other posture."""
    q0, q1, q2, q3, q4, q5, q6, q7 = q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7]
    for v in range(np.uint64(first), np.uint64(last)):
        squares[v] += squared_length(
            p[0, v] - q0, p[1, v] - q1, p[2, v] - q2, p[3, v] - q3,
            p[4, v] - q4, p[5, v] - q5, p[6, v] - q6, p[7, v] - q7,
        )  # fmt: skip


@njit(inline="always")
def fill_column(squares, j, before, now, first, last):
    """Fill column j + 1 of `now`, the squared distances being there."""
    diag, up, left, cell = before[j], before[j + 1], now[j], now[j + 1]
    for v in range(np.uint64(first), np.uint64(last)):
        best = up[v] if up[v] < diag[v] else diag[v]
        best = left[v] if left[v] < best else best
        cell[v] = np.sqrt(squares[v]) + best


@njit(inline="always")
def fill_row(p, y, before, now, squares, first, last):
    """Fill a row of the dynamic programme, save its border; squares: (lanes,) working memory.

    p and y may have 8, 16, 24, ... joints; with eight, two columns are done in one pass.
    """
    j = 0
    if y.shape[1] == BLOCK:
        while j + 1 < y.shape[0]:
            _fill_two_columns(p, y, j, before, now, first, last)
            j += 2
    while j < y.shape[0]:
        squares[:] = 0
        for k in range(0, y.shape[1], BLOCK):
            _add_squares(p[k : k + BLOCK], y[j, k : k + BLOCK], squares, first, last)
        fill_column(squares, j, before, now, first, last)
        j += 1


@compiled()
def against_one(x, width, n_steps, sorted_lanes, y, start, rows, squares, out):
    """Fill `out` (lanes,) with the distances of the lanes from `start` up to `width` to one trajectory.

    x: (ticks, joints, lanes) side by side; n_steps: (lanes,) their lengths; sorted_lanes: whether these rise, so that
    lanes which are done can be left out; y: (m, joints) the other; rows: (2, m + 1 or more, lanes) and squares:
    (lanes,) working memory.
    """
    m = y.shape[0]
    rows[:, : m + 1, :width] = BORDER
    rows[0, 0, :width] = 0
    for i in range(x.shape[0]):
        while sorted_lanes and start + STEP < width and n_steps[start + STEP - 1] <= i:
            start += STEP
        before, now = rows[i & 1], rows[1 - (i & 1)]
        fill_row(x[i], y, before, now, squares, start, width)
        before[0, :width] = BORDER  # only the very first cell may be entered from outside
        for v in range(np.uint64(start), np.uint64(width)):
            if n_steps[v] == i + 1:
                out[v] = now[m, v]


@compiled()
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
            against_one(x, width, n_steps, True, y, start, rows, squares, distances)
            for lane in range(start, count):
                if not symmetric or first + lane > place:
                    out[x_order[first + lane], b] = distances[lane]
                    if symmetric:
                        out[b, x_order[first + lane]] = distances[lane]


# Two functions: numba's cache has one entry for both ways of compiling one function, and loads the wrong one.
@compiled()
def fill_serial(lanes, xs, x_offset, x_order, ys, y_offset, y_order, symmetric, out):
    """Fill `out` (len_x, len_y) with distances; `xs` and `ys` hold all ticks in a row, `*_offset` where each begins."""
    for b in range((x_order.shape[0] + lanes - 1) // lanes):
        _batch(b * lanes, lanes, xs, x_offset, x_order, ys, y_offset, y_order, symmetric, out)


@compiled(parallel=True)
def fill_parallel(lanes, xs, x_offset, x_order, ys, y_offset, y_order, symmetric, out):
    """Do the same as `fill_serial`, the batches shared between threads."""
    n = (x_order.shape[0] + lanes - 1) // lanes
    for i in prange(n):  # short and long batches by turns, so that the threads get even shares
        b = n - 1 - i // 2 if i % 2 else i // 2
        _batch(b * lanes, lanes, xs, x_offset, x_order, ys, y_offset, y_order, symmetric, out)


@compiled()
def _gather(values, places, width, out):
    """Lay the trajectories at `places` side by side; lanes beyond the last repeat it."""
    for lane in range(width):
        one = values[places[min(lane, places.shape[0] - 1)]]
        for t in range(one.shape[0]):
            for k in range(one.shape[1]):
                out[t, k, lane] = one[t, k]


@compiled()
def _batch_of_pairs(values, first, second, out):
    """Fill `out` (n,); the expressions are those of `fill_row`, so a pair has the same bits as elsewhere."""
    n, m = first.shape[0], values.shape[1]
    width = (n + STEP - 1) // STEP * STEP
    x, y = np.empty((m, values.shape[2], width), out.dtype), np.empty((m, values.shape[2], width), out.dtype)
    _gather(values, first, width, x)
    _gather(values, second, width, y)
    rows, squares = np.full((2, m + 1, width), BORDER, out.dtype), np.empty(width, out.dtype)
    rows[0, 0] = 0
    for i in range(m):
        before, now = rows[i & 1], rows[1 - (i & 1)]
        for j in range(m):
            squares[:] = 0
            for k in range(0, x.shape[1], BLOCK):
                p, q = x[i, k : k + BLOCK], y[j, k : k + BLOCK]
                for v in range(np.uint64(0), np.uint64(width)):
                    squares[v] += squared_length(
                        p[0, v] - q[0, v], p[1, v] - q[1, v], p[2, v] - q[2, v], p[3, v] - q[3, v],
                        p[4, v] - q[4, v], p[5, v] - q[5, v], p[6, v] - q[6, v], p[7, v] - q[7, v],
                    )  # fmt: skip
            fill_column(squares, j, before, now, 0, width)
        before[0] = BORDER  # only the very first cell may be entered from outside
    out[:] = rows[m & 1, m, :n]


@compiled()
def fill_pairs(values, first, second, out):
    """Fill `out` (n,) with the distances of values[first] to values[second]; values: (N, ticks, joints in eights)."""
    for start in range(0, first.shape[0], PAIRS):
        stop = min(start + PAIRS, first.shape[0])
        _batch_of_pairs(values, first[start:stop], second[start:stop], out[start:stop])


@compiled()
def measure_rows(which, generated, performed, dt_s, speed_limit, too_fast, excursion):
    """Fill `too_fast` and `excursion`, both (m,), of m actions; return the first that is not finite, or -1.

    The twin of `outcome.largest_speeds` and `excursions`, with the same bits, for the hot path of the environments.

    which: (m,) the row of `dt_s` [s] and `speed_limit` (n, n_joints) [rad/s] that holds for each action; generated,
    performed: (m, n_steps, n_joints) [rad]. The speed is that of the command, the excursion that of what was performed.
    """
    m, n_ticks, n_joints = generated.shape
    for k in range(m):
        row = which[k]
        too_fast[k] = False
        excursion[k] = 0.0
        for j in range(n_joints):
            change, low, high = 0.0, performed[k, 0, j], performed[k, 0, j]
            for t in range(n_ticks):
                here = performed[k, t, j]
                if not (np.isfinite(generated[k, t, j]) and np.isfinite(here)):
                    return k
                low, high = min(low, here), max(high, here)
                if t > 0:
                    change = max(change, abs(generated[k, t, j] - generated[k, t - 1, j]))
            if change / dt_s[row] > speed_limit[row, j]:
                too_fast[k] = True
            excursion[k] = max(excursion[k], high - low)
    return -1
