"""The grid of evenly spaced points over a two-dimensional PB space: points, neighbours, connected regions, borders."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from creative_nao.errors import ShapeError
from creative_nao.measures.dtw import as_numbers
from creative_nao.schema import Field, checked

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
    checked(Annotated[int, Field(ge=2)], resolution, "resolution")
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


def nearest_cell(pb: ArrayLike, resolution: int = PAPER_RESOLUTION) -> np.ndarray:
    """Return the index in `pb_grid(resolution)` nearest to each PB point: (n, 2) in [-1, 1] into (n,).

    Raises:
        ShapeError: If the points are not (n, 2).
    """
    points = as_numbers(pb, "pb")
    if points.ndim != 2 or points.shape[1] != 2:
        raise ShapeError(f"`pb` should have shape (n, 2), but has {points.shape}")
    cell = np.rint((points + 1.0) / 2.0 * (resolution - 1)).astype(np.int64)
    return cell[:, 1] * resolution + cell[:, 0]


def region_sizes(mask: np.ndarray) -> np.ndarray:
    """Return how many cells each connected region of a grid has, in the order of their first cells, shape (n_regions,).

    Args:
        mask: Which cells are taken, shape (n_rows, n_columns) of bool; each has four neighbours, corners do not touch.

    Example:
        >>> region_sizes(np.array([[1, 0, 1], [1, 0, 0]], dtype=bool)).tolist()
        [2, 1]
    """
    labels = np.zeros(mask.shape, dtype=np.int32)
    ndimage.label(mask, output=labels)
    return np.bincount(labels.ravel())[1:]


def n_border_edges(labels: np.ndarray) -> int:
    """Return how many pairs of neighbouring cells of a grid have different labels."""
    return int((labels[1:] != labels[:-1]).sum() + (labels[:, 1:] != labels[:, :-1]).sum())
