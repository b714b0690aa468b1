"""Arithmetic that the compiled engines share: exp, tanh and a small matrix product, all in float32.

Everything is written so that the compiler turns the innermost loop into SIMD instructions. numba without a vector math
library calls exp and tanh one number at a time, ten times slower, so both are polynomials here.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

F = np.float32


def compiled(**options: Any) -> Callable[[Callable], Any]:
    """Compile with numba and cache the machine code; without a writable place, compile anew in each process.

    `contract` alone of the fast-math flags is on: it lets a multiplication and an addition become one instruction,
    which is the same in every lane, so results do not depend on how work was batched.
    """

    def wrap(function: Callable) -> Any:
        settings = {"fastmath": {"contract"}, "nogil": True, "error_model": "numpy", **options}
        try:
            return njit(cache=True, **settings)(function)
        except RuntimeError:
            return njit(**settings)(function)

    return wrap


@intrinsic
def _float_of_bits(typing_context, bits):
    """Read an int32 as the float32 of the same bits."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.FloatType())

    return types.float32(types.int32), generate


@compiled(inline="always")
def exp32(x):
    """Exponential of a float32 in [-87, 88]; smaller ones count as -87. Relative error below 2e-7.

    2^n times a Taylor polynomial of degree 7 in the rest r, |r| <= ln(2) / 2.
    """
    x = max(x, F(-87.0))
    n = np.floor(x * F(1.4426950408889634) + F(0.5))
    r = x - n * F(0.693359375)  # ln 2 in two pieces, so that the subtraction is exact
    r = r - n * F(-2.12194440e-4)
    p = F(1 / 5040)
    p = p * r + F(1 / 720)
    p = p * r + F(1 / 120)
    p = p * r + F(1 / 24)
    p = p * r + F(1 / 6)
    p = p * r + F(0.5)
    p = p * r + F(1.0)
    p = p * r + F(1.0)
    return p * _float_of_bits((np.int32(n) + np.int32(127)) << np.int32(23))


@compiled(inline="always")
def tanh32(x):
    """Hyperbolic tangent of a float32; absolute error below 4e-7.

    x P(x^2) / Q(x^2), both of degree 4, fitted to tanh on [0, 9] for the smallest largest error (1.8e-8 before
    rounding).
    """
    x = min(max(x, F(-9.0)), F(9.0))
    z = x * x
    p = F(1.318426523511107e-08)
    p = p * z + F(2.0471863535931334e-05)
    p = p * z + F(0.003486584173515439)
    p = p * z + F(0.13373199105262756)
    p = p * z + F(0.9999998807907104)
    q = F(7.702681159571512e-07)
    q = q * z + F(0.00032713887048885226)
    q = q * z + F(0.025841986760497093)
    q = q * z + F(0.4670649766921997)
    q = q * z + F(1.0)
    return x * p / q


@compiled()
def add_product(a, b, out):
    """Add the matrix product a b to `out`: (n, k) times (k, m) onto (n, m), `b` and `out` contiguous in their rows.

    Three rows and four inner steps at a time: twelve multiply-adds for ten loads and stores. At the sizes of this
    network that beats a general matrix library, which has to pack its operands first.
    """
    n_rows, n_inner = a.shape
    n_columns = b.shape[1]
    full_rows = n_rows - n_rows % 3
    full_inner = n_inner - n_inner % 4
    for n in range(0, full_rows, 3):
        o0, o1, o2 = out[n], out[n + 1], out[n + 2]
        for k in range(0, full_inner, 4):
            b0, b1, b2, b3 = b[k], b[k + 1], b[k + 2], b[k + 3]
            a00, a01, a02, a03 = a[n, k], a[n, k + 1], a[n, k + 2], a[n, k + 3]
            a10, a11, a12, a13 = a[n + 1, k], a[n + 1, k + 1], a[n + 1, k + 2], a[n + 1, k + 3]
            a20, a21, a22, a23 = a[n + 2, k], a[n + 2, k + 1], a[n + 2, k + 2], a[n + 2, k + 3]
            for i in range(n_columns):
                o0[i] = o0[i] + a00 * b0[i] + a01 * b1[i] + a02 * b2[i] + a03 * b3[i]
                o1[i] = o1[i] + a10 * b0[i] + a11 * b1[i] + a12 * b2[i] + a13 * b3[i]
                o2[i] = o2[i] + a20 * b0[i] + a21 * b1[i] + a22 * b2[i] + a23 * b3[i]
        for k in range(full_inner, n_inner):
            row = b[k]
            for i in range(n_columns):
                o0[i] += a[n, k] * row[i]
                o1[i] += a[n + 1, k] * row[i]
                o2[i] += a[n + 2, k] * row[i]
    for n in range(full_rows, n_rows):
        o0 = out[n]
        for k in range(n_inner):
            row, factor = b[k], a[n, k]
            for i in range(n_columns):
                o0[i] += factor * row[i]
