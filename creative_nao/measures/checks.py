"""Refusing arrays with the first value that is wrong, and where it stands."""

from __future__ import annotations

import numpy as np

from creative_nao.errors import ShapeError


def refuse_where(wrong: np.ndarray, values: np.ndarray, name: str, expected: str) -> None:
    """Refuse an array some of whose values are wrong; where none is, nothing happens.

    Args:
        wrong: Whether each value is wrong, of bool, shape of `values`.
        values: The array.
        name: The argument that it was given as.
        expected: What it should hold.

    Raises:
        ShapeError: Naming the argument, what was expected, and the first wrong value with its place.
    """
    if wrong.any():
        place = np.argwhere(wrong)[0].tolist()
        raise ShapeError(f"`{name}` should hold {expected}, but is {values[tuple(place)]} at {place}.")
