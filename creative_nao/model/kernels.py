"""What the compiled engines share: how to compile, and exp, tanh and log in float32.

numba without a vector math library calls these functions one number at a time, ten times slower than a polynomial that
the compiler can turn into SIMD instructions. Each takes a float32 or a `Vector` of them.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false, reportOperatorIssue=false

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from creative_nao.model.vectors import at_least, at_most, exponent_of, round_down, two_to_the

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


@compiled(inline="always")
def exp32(x):
    """Exponential in [-87, 88]; smaller numbers count as -87. Relative error below 2e-7.

    2^n times a Taylor polynomial of degree 7 in the rest r, |r| <= ln(2) / 2.
    """
    x = at_least(x, F(-87.0))
    n = round_down(x * F(1.4426950408889634) + F(0.5))
    r = x - n * F(0.693359375)  # ln 2 in two pieces, so that the subtraction is exact
    r = r - n * F(-2.12194440e-4)
    p = r * F(1 / 5040) + F(1 / 720)
    p = p * r + F(1 / 120)
    p = p * r + F(1 / 24)
    p = p * r + F(1 / 6)
    p = p * r + F(0.5)
    p = p * r + F(1.0)
    p = p * r + F(1.0)
    return p * two_to_the(n)


@compiled(inline="always")
def tanh32(x):
    """Hyperbolic tangent; absolute error below 4e-7.

    x P(x^2) / Q(x^2), both of degree 4, fitted to tanh on [0, 9] for the smallest largest error (1.8e-8 before
    rounding).
    """
    x = at_most(at_least(x, F(-9.0)), F(9.0))
    z = x * x
    p = z * F(1.318426523511107e-08) + F(2.0471863535931334e-05)
    p = p * z + F(0.003486584173515439)
    p = p * z + F(0.13373199105262756)
    p = p * z + F(0.9999998807907104)
    q = z * F(7.702681159571512e-07) + F(0.00032713887048885226)
    q = q * z + F(0.025841986760497093)
    q = q * z + F(0.4670649766921997)
    q = q * z + F(1.0)
    return x * p / q


@compiled(inline="always")
def log32(x):
    """Natural logarithm of positive, normal numbers; absolute error below 1e-7 near 1, else relative below 2e-7.

    e ln(2) + 2 artanh(s), where x = m 2^e and s = (m - 1) / (m + 1), |s| <= 0.172, by the first terms of its series.
    """
    e = exponent_of(x)
    m = x * two_to_the(e * F(-1.0))
    s = (m - F(1.0)) / (m + F(1.0))
    z = s * s
    p = z * F(2 / 9) + F(2 / 7)
    p = p * z + F(2 / 5)
    p = p * z + F(2 / 3)
    p = p * z + F(2.0)
    return e * F(0.6931471805599453) + s * p
