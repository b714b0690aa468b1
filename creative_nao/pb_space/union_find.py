"""The compiled heart of `regions.py`: which cells of a grid hang together."""

from __future__ import annotations

import numpy as np

from creative_nao.model.kernels import compiled


@compiled()
def first_cells(labels):
    """Return for each cell of `labels`, (n_rows, n_columns) of int, the first cell of its region, (n_cells,)."""
    n_rows, n_columns = labels.shape
    root = np.arange(n_rows * n_columns)
    for i in range(n_rows):
        for j in range(n_columns):
            for side in range(2):
                if (side == 0 and j > 0 and labels[i, j - 1] == labels[i, j]) or (
                    side == 1 and i > 0 and labels[i - 1, j] == labels[i, j]
                ):
                    a = i * n_columns + j
                    b = a - 1 if side == 0 else a - n_columns
                    while root[a] != a:
                        root[a] = root[root[a]]
                        a = root[a]
                    while root[b] != b:
                        root[b] = root[root[b]]
                        b = root[b]
                    if a < b:
                        root[b] = a
                    else:
                        root[a] = b
    for cell in range(root.shape[0]):  # a root is the smallest of its region, so one pass in order is enough
        root[cell] = root[root[cell]]
    return root
