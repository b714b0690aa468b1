"""Other readings of the paper's DTW distance: a path for each joint, a window, a squared cost, a mean over the path."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures import dtw_matrix

Trajectories = Sequence[np.ndarray] | np.ndarray


def dtw_variant_matrix(
    a: Trajectories,
    b: Trajectories,
    *,
    dependent: bool = True,
    window: int | None = None,
    normalise: bool = False,
    squared: bool = False,
) -> np.ndarray:
    """Return the distance of every trajectory of `a` to every one of `b` under another reading of the definition.

    The default settings are the project's definition and give what `dtw_matrix` gives.

    Args:
        a: A list of (n_steps, n_joints) arrays, whose lengths may differ, or one (n, n_steps, n_joints) array.
        b: The others.
        dependent: Whether all joints share one path.
        window: Largest difference of two matched ticks, 0 or more; None: any.
        normalise: Whether to divide by the number of pairs on the path.
        squared: Whether the local cost is squared.

    Returns:
        Shape (len(a), len(b)), float64: in the unit of the values, or its square where `squared`.

    Raises:
        SettingsError: If `window` is negative.
        ShapeError: If a trajectory is empty, not finite, or has other joints than the rest.

    Example:
        >>> float(dtw_variant_matrix([[[0.0], [2.0]]], [[[0.0], [1.0]]], squared=True, normalise=True)[0, 0])
        0.5
    """
    if window is not None and window < 0:
        raise SettingsError(f"`window` should be 0 or more ticks, or None, but is {window}.")
    if dependent and window is None and not normalise and not squared:
        return dtw_matrix(a, b)
    first, second = _flat(a, "a"), _flat(b, "b")
    out = np.zeros((len(first[1]) - 1, len(second[1]) - 1))
    if out.size:
        if first[0].shape[1] != second[0].shape[1]:
            raise ShapeError(
                f"`b` should have the joints of `a`, {first[0].shape[1]} columns, but has {second[0].shape[1]}."
            )
        limit = -1 if window is None else window
        _fill(*first, *second, dependent, limit, normalise, squared, out)
    return out


def _flat(series: Trajectories, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return all ticks in a row, (n_ticks, n_joints) float64, and where each trajectory begins, (n + 1,)."""
    arrays = [np.asarray(one, dtype=np.float64) for one in series]
    for place, one in enumerate(arrays):
        wanted = arrays[0].shape[1] if arrays[0].ndim == 2 else "n_joints"
        if one.ndim != 2 or not one.size or one.shape[1] != wanted:
            raise ShapeError(f"`{name}[{place}]` should have shape (n_steps >= 1, {wanted}), but has {one.shape}.")
        if not np.isfinite(one).all():
            raise ShapeError(f"`{name}[{place}]` should hold finite values, but holds {one[~np.isfinite(one)][0]}.")
    offset = np.concatenate([[0], np.cumsum([len(one) for one in arrays])]).astype(np.int64)
    return (np.ascontiguousarray(np.concatenate(arrays)) if arrays else np.zeros((0, 1))), offset


@njit(nogil=True, cache=True)
def _one_distance(a, b, window, normalise, squared, cost, cells):
    """Return the distance of a (n, joints) to b (m, joints), all joints warped together.

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


@njit(nogil=True, cache=True)
def _fill(a, a_offset, b, b_offset, dependent, window, normalise, squared, out):
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
                out[p, q] = _one_distance(x, y, allowed, normalise, squared, cost, cells)
            else:
                total = 0.0
                for k in range(x.shape[1]):
                    one, other = x[:, k : k + 1], y[:, k : k + 1]
                    total += _one_distance(one, other, allowed, normalise, squared, cost, cells)
                out[p, q] = total
