"""Connected regions of a chart, and the borders between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Regions(NamedTuple):
    """The connected regions of a labelled grid.

    Attributes:
        region: Region of each cell, numbered from 0 in the order of their first cells; -1 where the label is negative.
            Shape of the grid.
        label: Label of each region, shape (n_regions,).
        size: Cells of each region, shape (n_regions,).
    """

    region: np.ndarray
    label: np.ndarray
    size: np.ndarray


def connected_regions(labels: np.ndarray) -> Regions:
    """Join neighbouring cells of equal label; each cell has four neighbours, corners do not touch.

    Args:
        labels: Shape (n_rows, n_columns) of int; cells with a negative label belong to no region.

    Example:
        >>> connected_regions(np.array([[0, 1, 0], [0, 1, -1]])).region.tolist()
        [[0, 1, 2], [0, 1, -1]]
    """
    from creative_nao.pb_space.union_find import first_cells  # numba takes half a second to import

    root = first_cells(np.ascontiguousarray(labels, dtype=np.int64))
    firsts = np.flatnonzero((root == np.arange(root.size)) & (labels.ravel() >= 0))
    number = np.full(root.size, -1)
    number[firsts] = np.arange(len(firsts))
    region = np.where(labels >= 0, number[root].reshape(labels.shape), -1)
    sizes = np.bincount(region[region >= 0], minlength=len(firsts))
    return Regions(region, labels.ravel()[firsts], sizes)


def n_border_edges(labels: np.ndarray) -> int:
    """Return how many pairs of neighbouring cells of a grid have different labels."""
    return int((labels[1:] != labels[:-1]).sum() + (labels[:, 1:] != labels[:, :-1]).sum())
