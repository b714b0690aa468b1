"""The Vendi score: how many different actions a set amounts to."""

from __future__ import annotations

import numpy as np

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.checks import refuse_where
from creative_nao.measures.dtw import Trajectories, dtw_matrix

LENGTH_SCALE_RAD = 10.0
"""Distance at which two actions are alike to 1/e: the threshold up to which an action counts as learned [rad]."""


def vendi_score(similarity: np.ndarray) -> float:
    """Return the effective number of different items (Friedman and Dieng 2023, arXiv:2210.02410).

    The exponential of the Shannon entropy of the eigenvalues of K / n. From 1 (all alike) to n (nothing in common);
    more is more diverse. A similarity that is no kernel, as one made of warping distances need not be, has a few
    negative eigenvalues; they count as 0, and the others are brought back to the sum 1.

    Args:
        similarity: K, shape (n, n), symmetric, 1 on the diagonal.

    Raises:
        ShapeError: If it is no such matrix.

    Example:
        The two examples of the authors' own package, which cuts off after four digits:

        >>> points = np.array([0, 0, 10, 10, 20, 20])
        >>> float(np.floor(1e4 * vendi_score(np.exp(-np.abs(points[:, None] - points)))) / 1e4)
        2.9999
        >>> float(np.floor(1e4 * vendi_score(np.array([[1, 0.9, 0], [0.9, 1, 0], [0, 0, 1]]))) / 1e4)
        2.1573
    """
    matrix = np.asarray(similarity, dtype=np.float64)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not len(matrix):
        raise ShapeError(f"`similarity` should have shape (n, n) with n at least 1, but has {matrix.shape}.")
    refuse_where(~np.isfinite(matrix), matrix, "similarity", "finite numbers")
    refuse_where(~np.isclose(matrix, matrix.T), matrix, "similarity", "a symmetric matrix")
    diagonal = np.diag(matrix)
    refuse_where(~np.isclose(diagonal, 1.0), diagonal, "similarity", "ones on its diagonal")
    eigenvalues = np.linalg.eigvalsh(matrix / len(matrix))
    shares = eigenvalues[eigenvalues > 0] / eigenvalues[eigenvalues > 0].sum()
    return float(np.exp(-np.sum(shares * np.log(shares))))


def dtw_similarity(trajectories: Trajectories, length_scale_rad: float = LENGTH_SCALE_RAD) -> np.ndarray:
    """Return how alike trajectories are, exp(-distance / length scale), shape (n, n) in (0, 1].

    Args:
        trajectories: A list of (n_steps, n_joints) arrays or one (n, n_steps, n_joints) array [rad].
        length_scale_rad: Distance at which two are alike to 1/e [rad].

    Raises:
        SettingsError: If the length scale is not above 0.
        ShapeError: If shapes do not fit.
    """
    if not length_scale_rad > 0:
        raise SettingsError(f"`length_scale_rad` should be above 0, but is {length_scale_rad}.")
    return np.exp(-dtw_matrix(trajectories) / length_scale_rad)
