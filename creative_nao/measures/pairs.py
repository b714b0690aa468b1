"""The warping distance of chosen pairs: of neighbours in a map, or of what a robot meant and what it did."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.checks import refuse_where
from creative_nao.measures.dtw import MAX_VALUE


def dtw_pairs(
    trajectories: np.ndarray, first: ArrayLike, second: ArrayLike, dtype: DTypeLike = np.float64
) -> np.ndarray:
    """Return the distance of pair after pair, the same bits as `dtw` gives one at a time.

    A matrix of all distances of a map of 40,000 would need 12 GB; its 80,000 pairs of neighbours take half a second.

    Args:
        trajectories: Shape (n, n_steps, n_joints).
        first: Which trajectory is the first of each pair, shape (n_pairs,) of int.
        second: Which is the second.
        dtype: float64 or float32, for arithmetic and result.

    Returns:
        Shape (n_pairs,).

    Raises:
        ShapeError: If shapes do not fit, a place is outside the trajectories, or a value is not finite.
        SettingsError: If `dtype` is something else.
    """
    kind = np.dtype(dtype)
    if kind not in (np.dtype(np.float32), np.dtype(np.float64)):
        raise SettingsError(f"`dtype` should be float32 or float64, but is {kind}.")
    values = np.asarray(trajectories)
    if values.ndim != 3 or values.dtype.kind not in "fiu" or 0 in values.shape[1:]:
        raise ShapeError(
            "`trajectories` should be an (n, n_steps, n_joints) array of numbers with at least one posture and one "
            f"joint, but has shape {values.shape} and type {values.dtype}."
        )
    if values.size and not (values.min() >= -MAX_VALUE and values.max() <= MAX_VALUE):  # needs no room, unlike a mask
        refuse_where(~(np.abs(values) <= MAX_VALUE), values, "trajectories", f"finite values up to {MAX_VALUE:g}")
    places = [_places(given, name, len(values)) for given, name in ((first, "first"), (second, "second"))]
    if len(places[0]) != len(places[1]):
        raise ShapeError(f"`second` should be as long as `first`, {len(places[0])}, but has {len(places[1])} places.")
    out = np.zeros(len(places[0]), kind)
    if out.size:
        from creative_nao.measures import _pairs  # numba takes half a second to import

        _pairs.fill(np.ascontiguousarray(values, np.float64 if values.dtype.kind != "f" else None), *places, out)
    return out


def _places(given: ArrayLike, name: str, n: int) -> np.ndarray:
    places = np.asarray(given)
    if places.size == 0:
        places = places.astype(np.int64)
    if places.ndim != 1 or places.dtype.kind not in "iu":
        raise ShapeError(
            f"`{name}` should be a list of places in `trajectories`, but has shape {places.shape} and type "
            f"{places.dtype}."
        )
    if places.size and not (places.min() >= 0 and places.max() < n):
        raise ShapeError(
            f"`{name}` should hold places from 0 to {n - 1}, but reaches from {places.min()} to {places.max()}."
        )
    return places.astype(np.int64)
