"""The definition of the distance in plain Python: slow, obvious, and what the tests hold `dtw.py` against."""

from __future__ import annotations

import numpy as np


def dtw_reference(a: np.ndarray, b: np.ndarray) -> float:
    """Return the distance of two trajectories, shapes (n, n_joints) and (m, n_joints)."""
    n, m = len(a), len(b)
    best = np.full((n + 1, m + 1), np.inf)
    best[0, 0] = 0.0
    for i in range(n):
        for j in range(m):
            cost = np.sqrt(np.sum((a[i] - b[j]) ** 2))
            best[i + 1, j + 1] = cost + min(best[i, j], best[i, j + 1], best[i + 1, j])
    return float(best[n, m])
