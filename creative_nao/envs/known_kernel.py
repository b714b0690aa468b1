"""The compiled heart of scoring: movements against everything their robots know, without a copy or a check.

The lanes of `measures._lanes` with the same expressions, so that a distance has the same bits; but the known movements
already lie side by side, and those of many robots are served by one call, which lets other threads run.
"""

from __future__ import annotations

import numpy as np

from creative_nao.measures._fused import squared_length
from creative_nao.model.kernels import compiled

LANES = 8
"""Known movements are kept in multiples of this: one 512-bit register of float64."""
BORDER = 1e30


@compiled()
def _against_eight_joints(x, width, n_steps, y, rows, out):
    """Distances of the first `width` lanes of x (ticks, 8, lanes), each `n_steps` long, to y (m, 8)."""
    m = y.shape[0]
    rows[:, : m + 1, :width] = BORDER
    rows[0, 0, :width] = 0
    for i in range(x.shape[0]):
        p, before, now = x[i], rows[i & 1], rows[1 - (i & 1)]
        for j in range(0, m - 1, 2):
            y0, y1, y2, y3 = y[j, 0], y[j, 1], y[j, 2], y[j, 3]
            y4, y5, y6, y7 = y[j, 4], y[j, 5], y[j, 6], y[j, 7]
            z0, z1, z2, z3 = y[j + 1, 0], y[j + 1, 1], y[j + 1, 2], y[j + 1, 3]
            z4, z5, z6, z7 = y[j + 1, 4], y[j + 1, 5], y[j + 1, 6], y[j + 1, 7]
            diag, up, up2, left, cell, cell2 = before[j], before[j + 1], before[j + 2], now[j], now[j + 1], now[j + 2]
            for v in range(np.uint64(0), np.uint64(width)):
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
            for v in range(np.uint64(0), np.uint64(width)):
                best = up[v] if up[v] < diag[v] else diag[v]
                best = left[v] if left[v] < best else best
                squares = squared_length(
                    p[0, v] - y0, p[1, v] - y1, p[2, v] - y2, p[3, v] - y3,
                    p[4, v] - y4, p[5, v] - y5, p[6, v] - y6, p[7, v] - y7,
                )  # fmt: skip
                cell[v] = np.sqrt(squares) + best
        before[0, :width] = BORDER  # only the very first cell may be entered from outside
        for v in range(width):
            if n_steps[v] == i + 1:
                out[v] = now[m, v]


@compiled()
def _against_more_joints(x, width, n_steps, y, rows, squares, out):
    """The same for 16, 24, ... joints: the squared distance is summed block by block first."""
    m = y.shape[0]
    rows[:, : m + 1, :width] = BORDER
    rows[0, 0, :width] = 0
    for i in range(x.shape[0]):
        before, now = rows[i & 1], rows[1 - (i & 1)]
        for j in range(m):
            squares[:] = 0
            for k in range(0, y.shape[1], 8):
                p, q = x[i, k : k + 8], y[j, k : k + 8]
                y0, y1, y2, y3, y4, y5, y6, y7 = q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7]
                for v in range(np.uint64(0), np.uint64(width)):
                    squares[v] += squared_length(
                        p[0, v] - y0, p[1, v] - y1, p[2, v] - y2, p[3, v] - y3,
                        p[4, v] - y4, p[5, v] - y5, p[6, v] - y6, p[7, v] - y7,
                    )  # fmt: skip
            diag, up, left, cell = before[j], before[j + 1], now[j], now[j + 1]
            for v in range(np.uint64(0), np.uint64(width)):
                best = up[v] if up[v] < diag[v] else diag[v]
                best = left[v] if left[v] < best else best
                cell[v] = np.sqrt(squares[v]) + best
        before[0, :width] = BORDER
        for v in range(width):
            if n_steps[v] == i + 1:
                out[v] = now[m, v]


@compiled()
def compare_rows(which, trajectories, known, n_steps, sizes, out):
    """Fill `out` (m, lanes) with the distances of movement k to everything that robot `which[k]` knows.

    trajectories: (m, T, n_joints); known: (n_robots, T, joints in eights, lanes); n_steps: (n_robots, lanes) length of
    each known movement; sizes: (n_robots,) how many there are. Lanes beyond the size are meaningless.
    """
    m, n_ticks, n_joints = trajectories.shape
    joints, lanes = known.shape[2], known.shape[3]
    y = np.zeros((n_ticks, joints))
    rows, squares = np.empty((2, n_ticks + 1, lanes)), np.empty(lanes)
    for k in range(m):
        robot = which[k]
        width = (sizes[robot] + LANES - 1) // LANES * LANES
        y[:, :n_joints] = trajectories[k]
        if joints == 8:
            _against_eight_joints(known[robot], width, n_steps[robot], y, rows, out[k])
        else:
            _against_more_joints(known[robot], width, n_steps[robot], y, rows, squares, out[k])


@compiled()
def judge_rows(which, generated, performed, dt_s, speed_limit, too_fast, excursion):
    """Tell of each movement whether a commanded joint is too fast, and how far the most moving performed joint travels.

    Both as in `measures.appropriateness`. Returns the first movement that is not finite, or -1.
    """
    m, n_ticks, n_joints = generated.shape
    for k in range(m):
        robot = which[k]
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
            if change / dt_s[robot] > speed_limit[robot, j]:
                too_fast[k] = True
            excursion[k] = max(excursion[k], high - low)
    return -1


@compiled()
def accept_rows(which, accepted, trajectories, distances, novelty, known, n_steps, sizes, n_basic, kept, pair_sum):
    """Let robot `which[k]` keep movement k where `accepted[k]`; there has to be room.

    kept: (n_robots, lanes) distance of each accepted movement to its nearest basic action; pair_sum: (n_robots,) sum of
    the distances between accepted movements.
    """
    for k in range(which.shape[0]):
        if accepted[k]:
            robot = which[k]
            place = sizes[robot]
            for t in range(trajectories.shape[1]):
                for j in range(trajectories.shape[2]):
                    known[robot, t, j, place] = trajectories[k, t, j]
            n_steps[robot, place] = trajectories.shape[1]
            kept[robot, place] = novelty[k]
            total = 0.0
            for lane in range(n_basic, place):
                total += distances[k, lane]
            pair_sum[robot] += total
            sizes[robot] = place + 1
