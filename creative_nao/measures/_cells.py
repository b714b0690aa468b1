"""One step of exact dynamic time warping for many lanes at once: what every kernel of it shares.

Every function is put into the loop of its caller before that is compiled. One expression for all kernels, of
instructions that the compiler cannot choose, gives the distance of two movements the same bits in all of them: left to
itself, it may make one instruction of a product and a sum or leave them two, depending on what else it compiles.

Throughout, p: (8, lanes) the lanes' postures at one tick; y: (m, 8) the other trajectory; before, now: (m + 1, lanes)
two rows of the dynamic programme; first, last: the lanes worked on.
"""

# numba hands an intrinsic its first argument by itself.
# pyright: reportCallIssue=false
from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numba import njit, types
from numba.extending import intrinsic

BLOCK = 8
"""Joints handled by one expression; the caller pads with zeros, which change no distance."""

BORDER = 1e30
"""Where no path may come from. Infinity is never used."""

FUSES = bool(llvm.get_host_cpu_features().get("fma", not llvm.get_default_triple().startswith(("x86", "i"))))
"""Whether this machine has the instruction; where it has not, a product and a sum are rounded one by one."""


@intrinsic
def _add_square(typing_context: Any, total: Any, value: Any) -> Any:
    """Return total + value^2, rounded once where the machine `FUSES`."""
    if not (isinstance(total, types.Float) and total == value):
        raise TypeError(f"_add_square needs two floats of one type, but got {total} and {value}")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        start, factor = arguments
        if FUSES:
            return builder.fma(factor, factor, start)
        return builder.fadd(start, builder.fmul(factor, factor))

    return total(total, value), generate


@njit(inline="always")
def squared_length(a, b, c, d, e, f, g, h):
    """Return a^2 + b^2 + ... + h^2, added from the left."""
    half = _add_square(_add_square(_add_square(b * b, a), c), d)
    return _add_square(_add_square(_add_square(_add_square(half, e), f), g), h)


# `np.uint64` keeps numba's test for negative indices out of the loop; with it LLVM does not vectorise, 13 times slower.
# The eight names are not vanity either: a loop over the joints inside the lane loop costs a factor of 40.
@njit(inline="always")
def _fill_two_columns(p, y, j, before, now, first, last):
    """Fill the columns j + 1 and j + 2 of `now` in one pass: the lanes' postures have to be read only half as often."""
    y0, y1, y2, y3, y4, y5, y6, y7 = y[j, 0], y[j, 1], y[j, 2], y[j, 3], y[j, 4], y[j, 5], y[j, 6], y[j, 7]
    k = j + 1
    z0, z1, z2, z3, z4, z5, z6, z7 = y[k, 0], y[k, 1], y[k, 2], y[k, 3], y[k, 4], y[k, 5], y[k, 6], y[k, 7]
    diag, up, up2, left, cell, cell2 = before[j], before[j + 1], before[j + 2], now[j], now[j + 1], now[j + 2]
    for v in range(np.uint64(first), np.uint64(last)):
        p0, p1, p2, p3, p4, p5, p6, p7 = p[0, v], p[1, v], p[2, v], p[3, v], p[4, v], p[5, v], p[6, v], p[7, v]
        middle, far = up[v], up2[v]
        best = middle if middle < diag[v] else diag[v]
        best = left[v] if left[v] < best else best
        square = squared_length(p0 - y0, p1 - y1, p2 - y2, p3 - y3, p4 - y4, p5 - y5, p6 - y6, p7 - y7)
        near = np.sqrt(square) + best
        cell[v] = near
        best = far if far < middle else middle
        best = near if near < best else best
        square = squared_length(p0 - z0, p1 - z1, p2 - z2, p3 - z3, p4 - z4, p5 - z5, p6 - z6, p7 - z7)
        cell2[v] = np.sqrt(square) + best


@njit(inline="always")
def _add_squares(p, q, squares, first, last):
    """Add to `squares` (lanes,) the squared distance of eight joints; q: (8,) the other posture."""
    q0, q1, q2, q3, q4, q5, q6, q7 = q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7]
    for v in range(np.uint64(first), np.uint64(last)):
        squares[v] += squared_length(
            p[0, v] - q0, p[1, v] - q1, p[2, v] - q2, p[3, v] - q3,
            p[4, v] - q4, p[5, v] - q5, p[6, v] - q6, p[7, v] - q7,
        )  # fmt: skip


@njit(inline="always")
def fill_column(squares, j, before, now, first, last):
    """Fill column j + 1 of `now`, the squared distances being there."""
    diag, up, left, cell = before[j], before[j + 1], now[j], now[j + 1]
    for v in range(np.uint64(first), np.uint64(last)):
        best = up[v] if up[v] < diag[v] else diag[v]
        best = left[v] if left[v] < best else best
        cell[v] = np.sqrt(squares[v]) + best


@njit(inline="always")
def fill_row(p, y, before, now, squares, first, last):
    """Fill a row of the dynamic programme, save its border; squares: (lanes,) working memory.

    p and y may have 8, 16, 24, ... joints; with eight, two columns are done in one pass.
    """
    j = 0
    if y.shape[1] == BLOCK:
        while j + 1 < y.shape[0]:
            _fill_two_columns(p, y, j, before, now, first, last)
            j += 2
    while j < y.shape[0]:
        squares[:] = 0
        for k in range(0, y.shape[1], BLOCK):
            _add_squares(p[k : k + BLOCK], y[j, k : k + BLOCK], squares, first, last)
        fill_column(squares, j, before, now, first, last)
        j += 1
