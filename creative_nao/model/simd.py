"""SIMD vectors of float32 for numba code, exp, tanh and log for them, and `compiled`, the decorator that compiles.

The compiler turns a plain loop into SIMD instructions only when it can prove enough about it, and numbers that are left
over at its end are computed one by one. A `Vector` is a fixed number of lanes in a register: it can be loaded from an
array, added, multiplied and stored. LLVM splits vectors that are wider than the machine's.

The functions that do not access memory take a plain float32 as well, so that a formula is written once for both.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

from creative_nao.measures import _dtw_kernels

# pyright: reportIndexIssue=false, reportCallIssue=false, reportOperatorIssue=false

F = np.float32
FLOAT = ir.FloatType()
CONTRACT = ("contract",)  # a product and a sum may become one instruction


class Vector(types.Type):
    """A numba type: `n_lanes` float32 numbers in a register."""

    def __init__(self, n_lanes: int) -> None:
        self.n_lanes = n_lanes
        super().__init__(name=f"Vector({n_lanes})")


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, front_end_type: Vector) -> None:
        super().__init__(manager, front_end_type, ir.VectorType(FLOAT, front_end_type.n_lanes))


def spread(builder: ir.IRBuilder, scalar: ir.Value, n_lanes: int) -> ir.Value:
    """Emit a vector that holds `scalar` in every lane."""
    empty = ir.Constant(ir.VectorType(FLOAT, n_lanes), ir.Undefined)
    first = builder.insert_element(empty, scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), n_lanes), None)
    return builder.shuffle_vector(first, empty, zeros)


def call_llvm(builder: ir.IRBuilder, name: str, kind: ir.Type, *arguments: ir.Value) -> ir.Value:
    """Emit a call of an LLVM intrinsic whose arguments and result are all of type `kind`."""
    suffix = f"v{kind.count}f32" if isinstance(kind, ir.VectorType) else "f32"
    function_type = ir.FunctionType(kind, [kind] * len(arguments))
    return builder.call(cgutils.get_or_insert_function(builder.module, function_type, f"{name}.{suffix}"), arguments)


def element_pointer(context: Any, builder: ir.IRBuilder, array_type: Any, array: ir.Value, at_type: Any, at: ir.Value):
    """Emit the address of element `at` of a contiguous array, counted through all its rows. No bounds check."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [context.cast(builder, at, at_type, types.intp)])


def _reader_and_spreader(n_lanes: int) -> tuple[Any, Any]:
    """Return the intrinsics that load a vector from `array[at]` and that hold a number in every lane."""

    @intrinsic
    def load(typing_context, array, at):
        def generate(context, builder, signature, arguments):
            address = element_pointer(context, builder, array, arguments[0], at, arguments[1])
            pointer = builder.bitcast(address, ir.VectorType(FLOAT, n_lanes).as_pointer())
            return builder.load(pointer, align=4)

        return Vector(n_lanes)(array, at), generate

    @intrinsic
    def spread_scalar(typing_context, scalar):
        def generate(context, builder, signature, arguments):
            return spread(builder, context.cast(builder, arguments[0], scalar, types.float32), n_lanes)

        return Vector(n_lanes)(scalar), generate

    return load, spread_scalar


load8, spread8 = _reader_and_spreader(8)
load16, spread16 = _reader_and_spreader(16)


@intrinsic
def store(typing_context, vector, array, at):
    """Write a vector to `array[at]` and the elements behind it."""

    def generate(context, builder, signature, arguments):
        address = element_pointer(context, builder, array, arguments[1], at, arguments[2])
        pointer = builder.bitcast(address, arguments[0].type.as_pointer())
        builder.store(arguments[0], pointer, align=4)
        return context.get_dummy_value()

    return types.void(vector, array, at), generate


def _elementwise(n_arguments: int, emit: Callable[..., ir.Value]) -> Any:
    """Return an intrinsic of numbers or vectors; a number beside a vector is spread, then `emit` makes the code."""

    def define(*kinds):
        result = next((kind for kind in kinds if isinstance(kind, Vector)), kinds[0])

        def generate(context, builder, signature, arguments):
            values = list(arguments)
            for i, kind in enumerate(kinds):
                if isinstance(result, Vector) and not isinstance(kind, Vector):
                    values[i] = spread(builder, context.cast(builder, values[i], kind, types.float32), result.n_lanes)
            return emit(builder, *values)

        return result(*kinds), generate

    functions = {
        1: lambda typing_context, a: define(a),
        2: lambda typing_context, a, b: define(a, b),
        3: lambda typing_context, a, b, c: define(a, b, c),
    }
    return intrinsic(functions[n_arguments])


def _overload_operator(symbol: Any, instruction: str) -> None:
    operate = _elementwise(2, lambda builder, a, b: getattr(builder, instruction)(a, b, flags=CONTRACT))

    @overload(symbol, inline="always")
    def define(left, right):
        if isinstance(left, Vector) or isinstance(right, Vector):
            return lambda left, right: operate(left, right)
        return None


_overload_operator(operator.add, "fadd")
_overload_operator(operator.sub, "fsub")
_overload_operator(operator.mul, "fmul")
_overload_operator(operator.truediv, "fdiv")

# The larger, or the smaller, of a value and a bound; a value that is not a number stays so.
at_least = _elementwise(2, lambda builder, x, bound: builder.select(builder.fcmp_ordered("<", x, bound), bound, x))
at_most = _elementwise(2, lambda builder, x, bound: builder.select(builder.fcmp_ordered(">", x, bound), bound, x))
round_down = _elementwise(1, lambda builder, x: call_llvm(builder, "llvm.floor", x.type, x))
square_root = _elementwise(1, lambda builder, x: call_llvm(builder, "llvm.sqrt", x.type, x))
# a b + c, rounded once where the processor can: for a sum of two products, where the compiler is else free to choose.
multiply_add = _elementwise(3, lambda builder, a, b, c: call_llvm(builder, "llvm.fmuladd", b.type, a, b, c))


def _integers(kind: ir.Type) -> tuple[ir.Type, Any]:
    """Return the int32 type that matches a float type, and how to make constants of it."""
    whole = ir.VectorType(ir.IntType(32), kind.count) if isinstance(kind, ir.VectorType) else ir.IntType(32)
    return whole, lambda value: ir.Constant(whole, [value] * kind.count if isinstance(kind, ir.VectorType) else value)


@functools.partial(_elementwise, 1)
def two_to_the(builder: Any, exponent: Any) -> Any:
    """Return 2^exponent for whole exponents from -126 to 127, by writing the exponent's bits."""
    whole, number = _integers(exponent.type)
    biased = builder.add(builder.fptosi(exponent, whole), number(127))
    return builder.bitcast(builder.shl(biased, number(23)), exponent.type)


_HALF_ROOT = 0x3F3504F3  # bits of sqrt(1/2): mantissas are taken from [sqrt(1/2), sqrt(2))


@functools.partial(_elementwise, 1)
def exponent_of(builder: Any, value: Any) -> Any:
    """Return the whole number e of value = m 2^e, m in [sqrt(1/2), sqrt(2)), value positive and normal."""
    whole, number = _integers(value.type)
    bits = builder.sub(builder.bitcast(value, whole), number(_HALF_ROOT))
    return builder.sitofp(builder.ashr(bits, number(23)), value.type)


@intrinsic
def sum_of_lanes(typing_context, vector):
    """Return the sum of all lanes, added one after the other."""

    def generate(context, builder, signature, arguments):
        total = builder.extract_element(arguments[0], ir.Constant(ir.IntType(32), 0))
        for lane in range(1, vector.n_lanes):
            total = builder.fadd(total, builder.extract_element(arguments[0], ir.Constant(ir.IntType(32), lane)))
        return total

    return types.float32(vector), generate


@intrinsic
def transpose8(typing_context, source, source_first, source_row, target, target_first, target_row):
    """Write the transpose of a square of 8 x 8 numbers; each matrix is an array, its first element and its stride."""

    def generate(context, builder, signature, arguments):
        kinds, kind = signature.args, ir.VectorType(FLOAT, 8)

        def places(i):
            base = element_pointer(context, builder, kinds[i], arguments[i], kinds[i + 1], arguments[i + 1])
            stride = context.cast(builder, arguments[i + 2], kinds[i + 2], types.intp)
            for n in range(8):
                place = builder.gep(base, [builder.mul(stride, ir.Constant(ir.IntType(64), n))])
                yield builder.bitcast(place, kind.as_pointer())

        rows = [builder.load(place, align=4) for place in places(0)]
        # Swap ever larger blocks: single numbers of neighbouring rows, then pairs, then fours.
        for size in (1, 2, 4):
            keep = [lane if not lane & size else lane - size + 8 for lane in range(8)]
            swap = [lane + size if not lane & size else lane + 8 for lane in range(8)]
            for upper in [n for n in range(8) if not n & size]:
                pair = rows[upper], rows[upper + size]
                for row, lanes in ((upper, keep), (upper + size, swap)):
                    mask = ir.Constant(ir.VectorType(ir.IntType(32), 8), lanes)
                    rows[row] = builder.shuffle_vector(*pair, mask)
        for row, place in zip(rows, places(3), strict=True):
            builder.store(row, place, align=4)
        return context.get_dummy_value()

    return types.void(source, source_first, source_row, target, target_first, target_row), generate


# `contract` alone of the fast-math flags is on: it lets a multiplication and an addition become one instruction, which
# is the same in every lane, so results do not depend on how work was batched.
compiled = functools.partial(_dtw_kernels.compiled, fastmath={"contract"}, error_model="numpy")


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
