"""The arithmetic of `dtw_variants.py`, compiled with numba: one pair at a time, made for choice, not for speed."""

from __future__ import annotations

import numpy as np

from creative_nao.measures._lanes import _jit


@_jit()
def one_distance(a, b, window, normalise, squared, cost, cells):
    """Distance of a (n, joints) to b (m, joints), all joints warped together.

    window: cells with |i - j| above it are closed; cost, cells: (2, m + 1 or more) working memory for the cheapest path
    to each cell of a row and, of equally cheap ones, the fewest cells on it.
    """
    n, m, n_joints = a.shape[0], b.shape[0], a.shape[1]
    cost[:, : m + 1] = np.inf
    cells[:, : m + 1] = 0
    cost[0, 0] = 0.0
    for i in range(n):
        before, now = i & 1, 1 - (i & 1)
        cost[now, : m + 1] = np.inf
        for j in range(max(0, i - window), min(m, i + window + 1)):
            local = 0.0
            for k in range(n_joints):
                local += (a[i, k] - b[j, k]) ** 2
            if not squared:
                local = np.sqrt(local)
            best, steps = cost[before, j], cells[before, j]
            up, up_steps = cost[before, j + 1], cells[before, j + 1]
            if up < best or (up == best and up_steps < steps):
                best, steps = up, up_steps
            left, left_steps = cost[now, j], cells[now, j]
            if left < best or (left == best and left_steps < steps):
                best, steps = left, left_steps
            cost[now, j + 1], cells[now, j + 1] = local + best, steps + 1
    last = 1 - ((n - 1) & 1)
    return cost[last, m] / cells[last, m] if normalise else cost[last, m]


@_jit()
def fill(a, a_offset, b, b_offset, dependent, window, normalise, squared, out):
    """Fill `out` (len_a, len_b); `a` and `b` hold all ticks in a row, `*_offset` where each trajectory begins.

    window: below 0 there is none.
    """
    longest = 1
    for q in range(out.shape[1]):
        longest = max(longest, b_offset[q + 1] - b_offset[q])
    cost, cells = np.empty((2, longest + 1)), np.empty((2, longest + 1), np.int64)
    for p in range(out.shape[0]):
        x = a[a_offset[p] : a_offset[p + 1]]
        for q in range(out.shape[1]):
            y = b[b_offset[q] : b_offset[q + 1]]
            n, m = x.shape[0], y.shape[0]
            allowed = max(window, abs(n - m)) if window >= 0 else max(n, m)
            if dependent:
                out[p, q] = one_distance(x, y, allowed, normalise, squared, cost, cells)
            else:
                total = 0.0
                for k in range(x.shape[1]):
                    one, other = x[:, k : k + 1], y[:, k : k + 1]
                    total += one_distance(one, other, allowed, normalise, squared, cost, cells)
                out[p, q] = total
