"""What all checks share: the error that names a broken promise, and how results are held against it."""

from __future__ import annotations

from typing import Any

import numpy as np

from creative_nao.errors import CreativeNaoError


class ConformanceError(CreativeNaoError, AssertionError):
    """A promise is broken; the message says which, what was expected and what came."""


def demand(kept: Any, promise: str, found: object) -> None:
    """Raise unless a promise is kept.

    Raises:
        ConformanceError: Saying the promise and what was found instead.
    """
    if not kept:
        raise ConformanceError(f"{promise}, but found {found}")


def same(one: Any, other: Any) -> bool:
    """Tell whether two nested results are equal bit for bit; values that are not numbers equal themselves."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other, strict=True))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        left, right = np.asarray(one), np.asarray(other)
        return left.shape == right.shape and left.dtype == right.dtype and left.tobytes() == right.tobytes()
    return bool(one == other) or (one != one and other != other)
