"""Dynamic time warping: how far apart two trajectories are when either may be slowed down or sped up.

The definition decides what a threshold of 10 means, so here it is in full. *Dependent multivariate*: all joints are
warped together. *Local cost*: the Euclidean distance of two postures, not squared. *Distance*: the sum of the local
costs along the path from the first pair of postures to the last that makes this sum smallest; a step advances in one
trajectory, in the other or in both, and all steps weigh the same. There is no window, no normalisation by length and no
root at the end. With angles in radians the distance is in radians; two actions of 50 postures that are 0.2 rad apart at
every posture and cannot be warped closer are 10 apart. `dtw_reference.py` says the same in a few lines of plain Python.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from creative_nao.errors import SettingsError, ShapeError

SERIAL_CELLS = 50_000_000
"""Below this many pairs of postures, starting threads costs more than it saves."""

MAX_VALUE = 1e9
"""Largest magnitude of a value; beyond it squares and sums could leave the range of float32."""

Trajectories = Sequence[ArrayLike] | np.ndarray
"""A list of (n_steps, n_joints) arrays, whose lengths may differ, or one (n, n_steps, n_joints) array."""

_threads = threading.Lock()
_threads_started_in: int | None = None


def dtw(a: ArrayLike, b: ArrayLike) -> float:
    """Return the distance of two trajectories in the unit of their values; the module's text defines it.

    Args:
        a: Shape (n_steps_a, n_joints).
        b: Shape (n_steps_b, n_joints).

    Raises:
        ShapeError: If one is not such an array, is empty or holds NaN or infinity, or their joints do not match.

    Example:
        >>> dtw([[0.0], [1.0], [2.0]], [[0.0], [2.0]])
        1.0
    """
    first = _packed([a], "a", np.dtype(np.float64), single=True)
    second = _packed([b], "b", np.dtype(np.float64), single=True)
    return float(_fill(first, second, symmetric=False, names=("a", "b"))[0, 0])


def dtw_matrix(list_a: Trajectories, list_b: Trajectories | None = None, dtype: DTypeLike = np.float64) -> np.ndarray:
    """Return the distance of every trajectory of `list_a` to every one of `list_b`; the module's text defines it.

    The same pair gets the same bits in whatever company, order and number of threads it is computed. In float32 it is
    twice as fast; the relative error is below 2e-6 for distances above 0.01 (two actions 1e-5 rad apart can be off by
    more), which is what large maps are scored with. Printed figures are made in float64.

    Args:
        list_a: Trajectories of shape (n_steps, n_joints), a list or one (n, n_steps, n_joints) array.
        list_b: The others, or None for `list_a` itself: each pair is then computed once.
        dtype: float64 or float32, for arithmetic and result.

    Returns:
        Distances, shape (len_a, len_b).

    Raises:
        ShapeError: If a trajectory is not such an array, is empty or holds NaN or infinity, or joints do not match.
        SettingsError: If `dtype` is something else.
    """
    kind = np.dtype(dtype)
    if kind not in (np.dtype(np.float32), np.dtype(np.float64)):
        raise SettingsError(f"`dtype` should be float32 or float64, but is {kind}.")
    first = _packed(list_a, "list_a", kind)
    second = first if list_b is None else _packed(list_b, "list_b", kind)
    return _fill(first, second, symmetric=list_b is None, names=("list_a", "list_b"))


class _Packed(NamedTuple):
    """Trajectories one behind the other: values (all ticks, joints), where each begins, their order by length."""

    values: np.ndarray
    offset: np.ndarray
    order: np.ndarray
    n_joints: int


def _fill(a: _Packed, b: _Packed, *, symmetric: bool, names: tuple[str, str]) -> np.ndarray:
    global _threads_started_in
    out = np.zeros((len(a.order), len(b.order)), a.values.dtype)
    if not out.size:
        return out
    if a.n_joints != b.n_joints:
        raise ShapeError(
            f"`{names[1]}` should have the joints of `{names[0]}`, {a.n_joints} columns, but has {b.n_joints}."
        )
    from creative_nao.measures import _lanes  # numba takes half a second to import

    # Lanes that are not filled are computed all the same, so the larger set goes there.
    x, y, target = (a, b, out) if len(a.order) >= len(b.order) else (b, a, np.zeros(out.shape[::-1], out.dtype))
    work: tuple[Any, ...] = (_lanes.LANE_BYTES // out.itemsize, *x[:3], *y[:3], symmetric, target)
    cells = float(len(x.values)) * len(y.values) / (2 if symmetric else 1)
    # A process forked from one whose threads run has lost them, and starting them again would end it.
    if cells < SERIAL_CELLS or _threads_started_in not in (None, os.getpid()):
        _lanes.fill_serial(*work)
    else:
        with _threads:
            _threads_started_in = os.getpid()
            _lanes.fill_parallel(*work)
    return out if target is out else np.ascontiguousarray(target.T)


def _packed(series: Trajectories, name: str, dtype: np.dtype[Any], single: bool = False) -> _Packed:
    """Check trajectories and lay them out for the kernel, with zeros as further joints up to a multiple of eight."""
    if isinstance(series, np.ndarray):
        if series.ndim != 3 or series.dtype.kind not in "fiu":
            raise ShapeError(
                f"`{name}` should be a list of (n_steps, n_joints) arrays or one (n, n_steps, n_joints) array "
                f"of numbers, but has shape {series.shape} and type {series.dtype}."
            )
        arrays = None
        lengths = np.full(len(series), series.shape[1])
        n_joints = series.shape[2]
    else:
        arrays = [_as_array(one, name if single else f"{name}[{k}]") for k, one in enumerate(series)]
        lengths = np.array([len(one) for one in arrays], dtype=np.int64)
        n_joints = arrays[0].shape[1] if arrays else 0
        for k, one in enumerate(arrays):
            if one.shape[1] != n_joints:
                raise ShapeError(
                    f"`{name}[{k}]` should have the joints of `{name}[0]`, {n_joints} columns, but has {one.shape[1]}."
                )
    if len(lengths) and (lengths.min() < 1 or n_joints < 1):
        place = "" if single else f"[{int(np.argmin(lengths))}]"
        raise ShapeError(
            f"`{name}{place}` should have at least one posture and one joint, "
            f"but has shape ({lengths.min()}, {n_joints})."
        )
    offset = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    width = -(-n_joints // 8) * 8
    if arrays is None and width == n_joints:
        values = np.ascontiguousarray(np.asarray(series).reshape(-1, n_joints), dtype)
    else:
        values = np.zeros((int(offset[-1]), width), dtype)
        if arrays is None:
            values[:, :n_joints] = np.asarray(series).reshape(-1, n_joints)
        elif arrays:
            np.concatenate(arrays, out=values[:, :n_joints], casting="same_kind")
    # A comparison with NaN is false, so this asks for finite values as well.
    if values.size and not (values.min() >= -MAX_VALUE and values.max() <= MAX_VALUE):
        tick, joint = np.argwhere(~(np.abs(values) <= MAX_VALUE))[0]
        one = int(np.searchsorted(offset, tick, side="right")) - 1
        place = "" if single else f"[{one}]"
        raise ShapeError(
            f"`{name}{place}` should hold finite values up to {MAX_VALUE:g}, "
            f"but is {values[tick, joint]} at step {tick - offset[one]}, joint {joint}."
        )
    return _Packed(values, offset, np.argsort(lengths, kind="stable"), n_joints)


def _as_array(trajectory: ArrayLike, called: str) -> np.ndarray:
    try:
        array = np.asarray(trajectory)
        if array.dtype.kind in "iu":
            array = array.astype(np.float64)
    except (TypeError, ValueError):
        array = np.empty(0, dtype=object)
    if array.ndim != 2 or array.dtype.kind != "f":
        raise ShapeError(
            f"`{called}` should be an array of numbers of shape (n_steps, n_joints), "
            f"but has shape {array.shape} and type {array.dtype}."
        )
    return array
