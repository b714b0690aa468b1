"""Warping: do two actions differ in when things happen, beside what happens?"""

from __future__ import annotations

import numpy as np

from creative_nao.errors import ShapeError


def warping_path(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the best alignment of two trajectories, whose cost is `dtw(a, b)`.

    Of equally good steps the diagonal one is taken, then one along `a`.

    Args:
        a: Shape (n, n_joints) [rad].
        b: Shape (m, n_joints) [rad].

    Returns:
        Pairs of steps from (0, 0) to (n - 1, m - 1), shape (length, 2) of int.

    Raises:
        ShapeError: If shapes do not fit.
    """
    one, other = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if one.ndim != 2 or other.ndim != 2 or one.shape[1] != other.shape[1] or not len(one) or not len(other):
        raise ShapeError(
            f"`a` and `b` should have shapes (n, n_joints) and (m, n_joints), but have {one.shape} and {other.shape}."
        )
    cost = np.sqrt(((one[:, None] - other[None]) ** 2).sum(axis=2)).tolist()
    n, m = len(one), len(other)
    best = [[np.inf] * (m + 1) for _ in range(n + 1)]
    best[0][0] = 0.0
    for i in range(n):
        for j in range(m):
            best[i + 1][j + 1] = cost[i][j] + min(best[i][j], best[i][j + 1], best[i + 1][j])
    i, j = n, m
    path = [(n - 1, m - 1)]
    while (i, j) != (1, 1):
        steps = ((i - 1, j - 1), (i - 1, j), (i, j - 1))
        i, j = min(steps, key=lambda place: best[place[0]][place[1]])
        path.append((i - 1, j - 1))
    return np.array(path[::-1])


def warping(a: np.ndarray, b: np.ndarray) -> float:
    """Return how far the best alignment of two trajectories leaves the diagonal on average, in [0, 1).

    0: the same things happen at the same share of the time; larger: earlier or later. Our own definition: the mean,
    along `warping_path`, of |i / (n - 1) - j / (m - 1)|; a trajectory of one step counts as 0.

    Raises:
        ShapeError: If shapes do not fit.

    Example:
        The same rise, once at the beginning and once at the end of five steps:

        >>> early, late = np.array([[0.0], [1], [1], [1], [1]]), np.array([[0.0], [0], [0], [0], [1]])
        >>> warping(early, late), warping(early, early)
        (0.375, 0.0)
    """
    path = warping_path(a, b)
    last = np.maximum(path[-1], 1)
    shares = path / last
    return float(np.abs(shares[:, 0] - shares[:, 1]).mean())


def warping_diversity(trajectories: list[np.ndarray] | np.ndarray) -> float:
    """Return the mean `warping` over all pairs, in [0, 1): how much a set varies in timing; higher is more.

    Raises:
        ShapeError: If there are fewer than two trajectories, or shapes do not fit.
    """
    n = len(trajectories)
    if n < 2:
        raise ShapeError(f"`trajectories` should hold at least two actions, but holds {n}.")
    return float(np.mean([warping(trajectories[i], trajectories[j]) for i in range(n) for j in range(i)]))
