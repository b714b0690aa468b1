"""The compiled heart of scoring: movements against everything their robots know, without a copy or a check.

The lanes of `measures._lanes` with the same expressions, so that a distance has the same bits; but the known movements
already lie side by side, and those of many robots are served by one call, which lets other threads run.
"""

from __future__ import annotations

import numpy as np

from creative_nao.measures._cells import BORDER, fill_row
from creative_nao.model.kernels import compiled

LANES = 8
"""Known movements are kept in multiples of this: one 512-bit register of float64."""


@compiled()
def _against_one(x, width, n_steps, y, rows, squares, out):
    """Distances of the first `width` lanes of x (ticks, joints, lanes), each `n_steps` long, to y (m, joints)."""
    m = y.shape[0]
    rows[:, : m + 1, :width] = BORDER
    rows[0, 0, :width] = 0
    for i in range(x.shape[0]):
        before, now = rows[i & 1], rows[1 - (i & 1)]
        fill_row(x[i], y, before, now, squares, 0, width)
        before[0, :width] = BORDER  # only the very first cell may be entered from outside
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
        _against_one(known[robot], width, n_steps[robot], y, rows, squares, out[k])


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
