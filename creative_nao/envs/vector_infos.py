"""The terms of many copies in Gymnasium's vector format: arrays over all copies, and who has a term."""

from __future__ import annotations

from typing import Any

import numpy as np


def vector_terms(n: int, robots: np.ndarray, terms: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return terms of some copies as arrays over all n, each with its mask ``_name``; others hold 0 or None.

    Args:
        n: Number of copies.
        robots: Which copies have the terms, shape (m,), rising.
        terms: Arrays over them, (m, ...), by name.
    """
    infos: dict[str, Any] = {}
    if not len(robots):
        return infos
    for name, values in terms.items():
        if len(robots) == n:
            whole = values
        else:
            whole = (
                np.full(n, None, object) if values.dtype == object else np.zeros((n, *values.shape[1:]), values.dtype)
            )
            whole[robots] = values
        mask = np.zeros(n, bool)
        mask[robots] = True
        infos[name], infos[f"_{name}"] = whole, mask
    return infos


def objects(values: list[Any]) -> np.ndarray:
    """Return values of any kind as an array of objects, (m,)."""
    out = np.empty(len(values), object)
    out[:] = values
    return out


def rows(terms: dict[str, np.ndarray], places: np.ndarray) -> dict[str, np.ndarray]:
    """Return the terms of some of the copies only."""
    return {name: values[places] for name, values in terms.items()}
