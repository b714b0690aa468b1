"""Other readings of "dynamic time warping", to see which conclusions depend on ours (`dtw.py` defines that one).

The paper names the distance without defining it, and libraries differ in four respects; each can be chosen here:

- *dependent*: all joints are warped together along one path. *Independent*: each joint has its own path, and the
  distances of the joints are added.
- *window* (Sakoe and Chiba 1978): tick i of one may only be matched with ticks i - w to i + w of the other. For unequal
  lengths the window is at least their difference, since no path would reach the end otherwise.
- *normalise*: the distance is divided by the number of pairs on its path, which is the path that is cheapest before
  dividing and, of equally cheap ones, the shortest. (Minimising the quotient itself would be another problem.)
- *squared*: the local cost is the squared Euclidean distance of two postures; no root is taken at the end.
"""

from __future__ import annotations

import numpy as np

from creative_nao.errors import SettingsError, ShapeError
from creative_nao.measures.dtw import Trajectories, dtw_matrix


def dtw_variant_matrix(
    a: Trajectories,
    b: Trajectories,
    *,
    dependent: bool = True,
    window: int | None = None,
    normalise: bool = False,
    squared: bool = False,
) -> np.ndarray:
    """Return the distance of every trajectory of `a` to every one of `b` under another reading of the definition.

    The default settings are the project's definition and give what `dtw_matrix` gives.

    Args:
        a: A list of (n_steps, n_joints) arrays, whose lengths may differ, or one (n, n_steps, n_joints) array.
        b: The others.
        dependent: Whether all joints share one path.
        window: Largest difference of two matched ticks, 0 or more; None: any.
        normalise: Whether to divide by the number of pairs on the path.
        squared: Whether the local cost is squared.

    Returns:
        Shape (len(a), len(b)), float64: in the unit of the values, or its square where `squared`.

    Raises:
        SettingsError: If `window` is negative.
        ShapeError: If a trajectory is empty, not finite, or has other joints than the rest.

    Example:
        >>> float(dtw_variant_matrix([[[0.0], [2.0]]], [[[0.0], [1.0]]], squared=True, normalise=True)[0, 0])
        0.5
    """
    if window is not None and window < 0:
        raise SettingsError(f"`window` should be 0 or more ticks, or None, but is {window}.")
    if dependent and window is None and not normalise and not squared:
        return dtw_matrix(a, b)
    from creative_nao.measures import _variant_kernel  # numba takes half a second to import

    first, second = _flat(a, "a"), _flat(b, "b")
    out = np.zeros((len(first[1]) - 1, len(second[1]) - 1))
    if out.size:
        if first[0].shape[1] != second[0].shape[1]:
            raise ShapeError(
                f"`b` should have the joints of `a`, {first[0].shape[1]} columns, but has {second[0].shape[1]}."
            )
        limit = -1 if window is None else window
        _variant_kernel.fill(*first, *second, dependent, limit, normalise, squared, out)
    return out


def _flat(series: Trajectories, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return all ticks in a row, (n_ticks, n_joints) float64, and where each trajectory begins, (n + 1,)."""
    arrays = [np.asarray(one, dtype=np.float64) for one in series]
    for place, one in enumerate(arrays):
        wanted = arrays[0].shape[1] if arrays[0].ndim == 2 else "n_joints"
        if one.ndim != 2 or not one.size or one.shape[1] != wanted:
            raise ShapeError(f"`{name}[{place}]` should have shape (n_steps >= 1, {wanted}), but has {one.shape}.")
        if not np.isfinite(one).all():
            raise ShapeError(f"`{name}[{place}]` should hold finite values, but holds {one[~np.isfinite(one)][0]}.")
    offset = np.concatenate([[0], np.cumsum([len(one) for one in arrays])]).astype(np.int64)
    return (np.ascontiguousarray(np.concatenate(arrays)) if arrays else np.zeros((0, 1))), offset
