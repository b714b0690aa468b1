"""Evenly spaced points of the two-dimensional PB space."""

from __future__ import annotations

import numpy as np

from creative_nao.errors import SettingsError

PAPER_RESOLUTION = 200
"""Points along each axis in the paper: 40,000 in all."""


def pb_grid(resolution: int = PAPER_RESOLUTION) -> np.ndarray:
    """Return `resolution` x `resolution` PB points evenly spaced in [-1, 1]^2, ends included.

    Args:
        resolution: Points along each axis, at least 2.

    Returns:
        Shape (resolution^2, 2), float64. The first PB unit changes fastest: point k lies in column k % resolution of
        the row k // resolution, rows going up with the second unit.

    Raises:
        SettingsError: If `resolution` is below 2.
    """
    if resolution < 2:
        raise SettingsError(f"`resolution` should be at least 2, but is {resolution}")
    axis = np.linspace(-1.0, 1.0, resolution)
    first, second = np.meshgrid(axis, axis, indexing="xy")
    return np.stack([first, second], axis=-1).reshape(-1, 2)


def neighbour_pairs(resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of neighbours in `pb_grid(resolution)`, each once: first members and second ones, as indices.

    Returns:
        Twice shape (2 * resolution * (resolution - 1),): neighbours in a row, then those above each other.
    """
    cells = np.arange(resolution**2).reshape(resolution, resolution)
    first = np.concatenate([cells[:, :-1].ravel(), cells[:-1].ravel()])
    second = np.concatenate([cells[:, 1:].ravel(), cells[1:].ravel()])
    return first, second


def nearest_cell(pb: np.ndarray, resolution: int = PAPER_RESOLUTION) -> np.ndarray:
    """Return the index in `pb_grid(resolution)` nearest to each PB point: (n, 2) in [-1, 1] into (n,)."""
    cell = np.rint((np.asarray(pb) + 1.0) / 2.0 * (resolution - 1)).astype(np.int64)
    return cell[:, 1] * resolution + cell[:, 0]
