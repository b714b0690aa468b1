"""Dynamic time warping: how far apart two trajectories are when either may be slowed down or sped up.

The definition decides what a threshold of 10 means, so here it is in full. *Dependent multivariate*: all joints are
warped together. *Local cost*: the Euclidean distance of two postures, not squared. *Distance*: the sum of the local
costs along the path from the first pair of postures to the last that makes this sum smallest; a step advances in one
trajectory, in the other or in both, and all steps weigh the same. There is no window, no normalisation by length and no
root at the end. With angles in radians the distance is in radians; two actions of 50 postures that are 0.2 rad apart at
every posture and cannot be warped closer are 10 apart. `cumulative_cost` says the same in a few lines of plain Python;
`_dtw_kernels.py` is its compiled form.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from creative_nao.errors import SettingsError, ShapeError, shown

SERIAL_CELLS = 50_000_000  # below this many pairs of postures, starting threads costs more than it saves

MAX_VALUE = 1e9  # largest magnitude of a value; beyond it squares and sums could leave the range of float32

Trajectories = Sequence[ArrayLike] | np.ndarray
"""A list of (n_steps, n_joints) arrays, whose lengths may differ, or one (n, n_steps, n_joints) array."""

_threads = threading.Lock()
_threads_started_in: int | None = None


def as_numbers(values: object, name: str) -> np.ndarray:
    """Return an argument as an array of float64; anything but numbers is a ShapeError."""
    found = _as_array(values)
    if found.dtype.kind not in "fiub" or isinstance(found, np.ma.MaskedArray):
        raise ShapeError(f"`{name}` should be an array of numbers, but is {shown(values)}.")
    return found.astype(np.float64, copy=False)


def count_trajectories(series: Trajectories, name: str = "trajectories", least: int = 0) -> int:
    """Return how many trajectories there are; what is no list or array of them, or too few, is a ShapeError."""
    if not (isinstance(series, Sequence) or (isinstance(series, np.ndarray) and series.ndim)):
        raise ShapeError(
            f"`{name}` should be a list of (n_steps, n_joints) arrays or one (n, n_steps, n_joints) array, "
            f"but is {shown(series)}."
        )
    if len(series) < least:
        raise ShapeError(f"`{name}` should hold at least {least} actions, but holds {len(series)}.")
    return len(series)


def refuse_where(wrong: np.ndarray, values: np.ndarray, name: str, expected: str) -> None:
    """Refuse an argument if any of its values is `wrong`: the ShapeError names the first with its place."""
    if wrong.any():
        place = np.argwhere(wrong)[0].tolist()
        raise ShapeError(f"`{name}` should hold {expected}, but is {values[tuple(place)]} at {place}.")


def dtw(a: ArrayLike, b: ArrayLike) -> float:
    """Return the distance of a (n_steps_a, n_joints) to b (n_steps_b, n_joints) in the unit of their values.

    The module's text defines it.

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
        dtype: float64 or float32, for arithmetic and result, which has shape (len_a, len_b).

    Raises:
        ShapeError: If a trajectory is not such an array, is empty or holds NaN or infinity, or joints do not match.
    """
    kind = _arithmetic(dtype)
    first = _packed(list_a, "list_a", kind)
    second = first if list_b is None else _packed(list_b, "list_b", kind)
    return _fill(first, second, symmetric=list_b is None, names=("list_a", "list_b"))


def _arithmetic(dtype: DTypeLike) -> np.dtype[Any]:
    try:
        kind = np.dtype(dtype)
    except TypeError:
        raise SettingsError(f"`dtype` should be float32 or float64, but is {shown(dtype)}.") from None
    if kind not in (np.dtype(np.float32), np.dtype(np.float64)):
        raise SettingsError(f"`dtype` should be float32 or float64, but is {kind}.")
    return kind


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
    from creative_nao.measures import _dtw_kernels  # numba takes half a second to import

    # Lanes that are not filled are computed all the same, so the larger set goes there.
    x, y, target = (a, b, out) if len(a.order) >= len(b.order) else (b, a, np.zeros(out.shape[::-1], out.dtype))
    work: tuple[Any, ...] = (_dtw_kernels.LANE_BYTES // out.itemsize, *x[:3], *y[:3], symmetric, target)
    cells = float(len(x.values)) * len(y.values) / (2 if symmetric else 1)
    # A process forked from one whose threads run has lost them, and starting them again would end it.
    if cells < SERIAL_CELLS or _threads_started_in not in (None, os.getpid()):
        _dtw_kernels.fill_serial(*work)
    else:
        with _threads:
            _threads_started_in = os.getpid()
            _dtw_kernels.fill_parallel(*work)
    return out if target is out else np.ascontiguousarray(target.T)


def _packed(series: Trajectories, name: str, dtype: np.dtype[Any], single: bool = False) -> _Packed:
    """Check trajectories and lay them out for the kernel, with zeros as further joints up to a multiple of eight."""
    if isinstance(series, np.ndarray):
        if series.ndim != 3 or series.dtype.kind not in "fiu" or isinstance(series, np.ma.MaskedArray):
            raise ShapeError(
                f"`{name}` should be a list of (n_steps, n_joints) arrays or one (n, n_steps, n_joints) array "
                f"of numbers, but has {_told(series)}."
            )
        arrays, lengths, n_joints = [series], np.full(len(series), series.shape[1]), series.shape[2]
    else:
        count_trajectories(series, name)
        arrays = [_trajectory(one, name if single else f"{name}[{k}]") for k, one in enumerate(series)]
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
    if isinstance(series, np.ndarray):
        arrays = [series.reshape(int(offset[-1]), n_joints)]
    if len(arrays) == 1 and width == n_joints:
        values = np.ascontiguousarray(arrays[0], dtype)
    else:
        values = np.zeros((int(offset[-1]), width), dtype)
        if arrays:
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


def _trajectory(given: ArrayLike, name: str) -> np.ndarray:
    array = _as_array(given)
    if array.dtype.kind in "iu":
        array = array.astype(np.float64)
    if array.ndim != 2 or array.dtype.kind != "f" or isinstance(array, np.ma.MaskedArray):
        raise ShapeError(
            f"`{name}` should be an array of numbers of shape (n_steps, n_joints), but has {_told(array)}."
        )
    return array


def _told(array: np.ndarray) -> str:
    mask = "a mask, " if isinstance(array, np.ma.MaskedArray) else ""
    return f"{mask}shape {array.shape} and type {array.dtype}"


def _as_array(values: object) -> np.ndarray:
    """Return values as an array; an empty one of objects, which no check lets pass, where NumPy makes none of them.

    A masked array stays one and is refused, for what a mask hides cannot be compared.
    """
    try:
        return values if isinstance(values, np.ma.MaskedArray) else np.asarray(values)
    except (TypeError, ValueError, RuntimeError):
        return np.empty(0, dtype=object)


def dtw_pairs(
    trajectories: np.ndarray, first: ArrayLike, second: ArrayLike, dtype: DTypeLike = np.float64
) -> np.ndarray:
    """Return the distance of pair after pair, shape (n_pairs,), the same bits as `dtw` gives one at a time.

    A matrix of all distances of a map of 40,000 would need 12 GB; its 80,000 pairs of neighbours take half a second.

    Args:
        trajectories: Shape (n, n_steps, n_joints).
        first: Which trajectory is the first of each pair, shape (n_pairs,) of int.
        second: Which is the second.
        dtype: float64 or float32, for arithmetic and result.

    Raises:
        ShapeError: If shapes do not fit, a place is outside the trajectories, or a value is not finite.
    """
    kind = _arithmetic(dtype)
    series = _as_array(trajectories)
    values = _packed(series, "trajectories", kind).values
    places = [_places(given, name, len(series)) for given, name in ((first, "first"), (second, "second"))]
    if len(places[0]) != len(places[1]):
        raise ShapeError(f"`second` should be as long as `first`, {len(places[0])}, but has {len(places[1])} places.")
    out = np.zeros(len(places[0]), kind)
    if out.size:
        from creative_nao.measures import _dtw_kernels  # numba takes half a second to import

        _dtw_kernels.fill_pairs(values.reshape(len(series), series.shape[1], -1), *places, out)
    return out


def _places(given: ArrayLike, name: str, n: int) -> np.ndarray:
    places = _as_array(given)
    if not places.size and places.dtype.kind == "f":  # an empty list
        places = places.astype(np.int64)
    if places.ndim != 1 or places.dtype.kind not in "iu" or isinstance(places, np.ma.MaskedArray):
        raise ShapeError(f"`{name}` should be a list of places in `trajectories`, but has {_told(places)}.")
    refuse_where((places < 0) | (places >= n), places, name, f"places from 0 to {n - 1}")
    return places.astype(np.int64)


def cumulative_cost(a: ArrayLike, b: ArrayLike) -> list[list[float]]:
    """Return the cost of the best path to every pair of postures, in plain Python: slow, obvious, the definition.

    Entry (i, j) of the table, n + 1 rows and m + 1 columns, is the distance of the first i postures of a (n, n_joints)
    to the first j of b (m, n_joints), so the last one is `dtw(a, b)`; (0, 0) is 0, what begins outside is infinite.
    """
    one, other = as_numbers(a, "a"), as_numbers(b, "b")
    if one.ndim != 2 or other.ndim != 2 or one.shape[1] != other.shape[1] or not len(one) or not len(other):
        raise ShapeError(
            f"`a` and `b` should have shapes (n, n_joints) and (m, n_joints), but have {one.shape} and {other.shape}."
        )
    cost = np.sqrt(((one[:, None] - other[None]) ** 2).sum(axis=2)).tolist()
    best = [[np.inf] * (len(other) + 1) for _ in range(len(one) + 1)]
    best[0][0] = 0.0
    for i in range(len(one)):
        for j in range(len(other)):
            best[i + 1][j + 1] = cost[i][j] + min(best[i][j], best[i][j + 1], best[i + 1][j])
    return best


def warping_path(a: ArrayLike, b: ArrayLike) -> np.ndarray:
    """Return the best alignment of a (n, n_joints) and b (m, n_joints), whose cost is `dtw(a, b)`.

    These are pairs of steps from (0, 0) to (n - 1, m - 1), shape (length, 2) of int. Of equally good steps the diagonal
    one is taken, then one along `a`. Shapes that do not fit are a ShapeError.
    """
    best = cumulative_cost(a, b)
    n, m = len(best) - 1, len(best[0]) - 1
    i, j = n, m
    path = [(n - 1, m - 1)]
    while (i, j) != (1, 1):
        steps = ((i - 1, j - 1), (i - 1, j), (i, j - 1))
        i, j = min(steps, key=lambda place: best[place[0]][place[1]])
        path.append((i - 1, j - 1))
    return np.array(path[::-1])


def warping(a: ArrayLike, b: ArrayLike) -> float:
    """Return how far the best alignment of two trajectories leaves the diagonal on average, in [0, 1).

    0: the same things happen at the same share of the time; larger: earlier or later. Our own definition: the mean,
    along `warping_path`, of |i / (n - 1) - j / (m - 1)|; a trajectory of one step counts as 0.

    Example:
        The same rise, once at the beginning and once at the end of five steps:

        >>> early, late = np.array([[0.0], [1], [1], [1], [1]]), np.array([[0.0], [0], [0], [0], [1]])
        >>> warping(early, late), warping(early, early)
        (0.375, 0.0)
    """
    path = warping_path(a, b)
    last = np.maximum(path[-1], 1)
    shares = path / last
    return float(np.abs(shares[:, 0] - shares[:, 1]).mean())


def warping_diversity(trajectories: Trajectories) -> float:
    """Return the mean `warping` over all pairs of two or more, in [0, 1): how much a set varies in timing."""
    n = count_trajectories(trajectories, least=2)
    return float(np.mean([warping(trajectories[i], trajectories[j]) for i in range(n) for j in range(i)]))
