"""The matrix product of the training engine: tiles of the result stay in registers while the inner index runs.

Every element is a sum in ascending order of the inner index, whatever the tile it falls into, so results depend neither
on the width of the machine's registers nor on how rows are cut into tiles.
"""

# pyright: reportIndexIssue=false, reportCallIssue=false

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic

from creative_nao.model.kernels import compiled
from creative_nao.model.vectors import FLOAT, call_llvm, element_pointer, spread


def _has_512_bit_registers() -> bool:
    asked = getattr(config, "CPU_FEATURES", None)  # numba can be told to compile for another processor
    return bool(llvm.get_host_cpu_features().get("avx512f")) if asked is None else "+avx512f" in asked


N_LANES = 16 if _has_512_bit_registers() else 8
PANEL = 2 * N_LANES
"""Columns of a tile: two registers."""
TALLEST = 8 if N_LANES == 16 else 6
"""Most rows of a tile: with two registers a row they, a row of b and one number of a fill the registers."""


def _tile(n_rows: int) -> Any:
    """Return an intrinsic for `n_rows` rows of a panel: out[i, :] = start[i, :] + sum over k of a[i, k] b[k, :].

    Each matrix is an array, the index of its first element and its strides in elements; the columns of b, start and
    out are consecutive.
    """

    @intrinsic
    def multiply(
        typing_context, a, a_first, a_row, a_inner, b, b_first, b_inner, n_inner, start, start_first, start_row,
        out, out_first, out_row,
    ):  # fmt: skip
        def generate(context, builder, signature, arguments):
            kinds = signature.args
            word = ir.IntType(64)
            vector = ir.VectorType(FLOAT, N_LANES)

            def whole(i):
                return context.cast(builder, arguments[i], kinds[i], types.intp)

            def address(i, offset=None):
                base = element_pointer(context, builder, kinds[i], arguments[i], kinds[i + 1], arguments[i + 1])
                return base if offset is None else builder.gep(base, [offset])

            def vectors_at(pointer):
                for half in range(2):
                    place = builder.gep(pointer, [ir.Constant(word, half * N_LANES)])
                    yield builder.bitcast(place, vector.as_pointer())

            def times(stride, i):
                return builder.mul(stride, ir.Constant(word, i))

            (a_row, a_inner), b_inner, n_inner = (whole(2), whole(3)), whole(6), whole(7)
            start_row, out_row = whole(10), whole(13)
            sums = [
                builder.load(place, align=4)
                for i in range(n_rows)
                for place in vectors_at(address(8, times(start_row, i)))
            ]
            a_starts, b_start = [address(0, times(a_row, i)) for i in range(n_rows)], address(4)
            before = builder.block
            loop, after = builder.append_basic_block("inner"), builder.append_basic_block("after")
            builder.cbranch(builder.icmp_signed(">", n_inner, ir.Constant(word, 0)), loop, after)

            builder.position_at_end(loop)
            k = builder.phi(word)
            k.add_incoming(ir.Constant(word, 0), before)
            running = [builder.phi(vector) for _ in sums]
            for phi, value in zip(running, sums, strict=True):
                phi.add_incoming(value, before)
            b_row = builder.gep(b_start, [builder.mul(k, b_inner)])
            b_vectors = [builder.load(place, align=4) for place in vectors_at(b_row)]
            a_at = builder.mul(k, a_inner)
            new = []
            for i in range(n_rows):
                factor = spread(builder, builder.load(builder.gep(a_starts[i], [a_at])), N_LANES)
                for half in range(2):
                    new.append(
                        call_llvm(builder, "llvm.fmuladd", vector, factor, b_vectors[half], running[2 * i + half])
                    )
            k_next = builder.add(k, ir.Constant(word, 1))
            k.add_incoming(k_next, loop)
            for phi, value in zip(running, new, strict=True):
                phi.add_incoming(value, loop)
            builder.cbranch(builder.icmp_signed("<", k_next, n_inner), loop, after)

            builder.position_at_end(after)
            finished = [builder.phi(vector) for _ in sums]
            for phi, none, value in zip(finished, sums, new, strict=True):
                phi.add_incoming(none, before)
                phi.add_incoming(value, loop)
            for i in range(n_rows):
                for half, place in enumerate(vectors_at(address(11, times(out_row, i)))):
                    builder.store(finished[2 * i + half], place, align=4)
            return context.get_dummy_value()

        return types.void(
            a, a_first, a_row, a_inner, b, b_first, b_inner, n_inner, start, start_first, start_row,
            out, out_first, out_row,
        ), generate  # fmt: skip

    return multiply


_tile1, _tile2, _tile3, _tile4, _tile5, _tile6, _tile7, _tile8 = (_tile(n_rows) for n_rows in range(1, 9))


@compiled(inline="always")
def multiply_panel(
    a, a_at, a_row, a_inner, b, b_at, b_inner, n_inner, start, start_at, start_row, out, out_at, out_row, n_rows
):
    """Compute out = start + a b for `PANEL` columns and any number of rows.

    The matrices lie in flat arrays: `a_at` is the index of the first element of a, `a_row` and `a_inner` the distance
    to the next one along its rows and along the inner index, and so on. `start` may be `out`.
    """
    n_tiles = (n_rows + TALLEST - 1) // TALLEST
    done = 0
    for tile in range(n_tiles):  # heights differ by one at most
        end = n_rows * (tile + 1) // n_tiles
        height = end - done
        x, s, o = a_at + done * a_row, start_at + done * start_row, out_at + done * out_row
        if height == 6:
            _tile6(a, x, a_row, a_inner, b, b_at, b_inner, n_inner, start, s, start_row, out, o, out_row)
        elif height == 8:
            _tile8(a, x, a_row, a_inner, b, b_at, b_inner, n_inner, start, s, start_row, out, o, out_row)
        elif height == 7:
            _tile7(a, x, a_row, a_inner, b, b_at, b_inner, n_inner, start, s, start_row, out, o, out_row)
        elif height == 5:
            _tile5(a, x, a_row, a_inner, b, b_at, b_inner, n_inner, start, s, start_row, out, o, out_row)
        elif height == 4:
            _tile4(a, x, a_row, a_inner, b, b_at, b_inner, n_inner, start, s, start_row, out, o, out_row)
        elif height == 3:
            _tile3(a, x, a_row, a_inner, b, b_at, b_inner, n_inner, start, s, start_row, out, o, out_row)
        elif height == 2:
            _tile2(a, x, a_row, a_inner, b, b_at, b_inner, n_inner, start, s, start_row, out, o, out_row)
        else:
            _tile1(a, x, a_row, a_inner, b, b_at, b_inner, n_inner, start, s, start_row, out, o, out_row)
        done = end


@compiled()
def multiply_panels(lay, first_panel, rows, rows_at, weights, start, start_row, out):
    """Multiply the rows of all actions at one tick with packed weights: out = start + rows weights, from a panel on.

    Args:
        lay: `layout.Layout`.
        first_panel: Panels before this one are left out.
        rows: Array that holds the rows, `lay.row` apart, the first at `rows_at`.
        weights: Panels as in the packed vector.
        start: Rows that the sums begin with, `start_row` apart.
        out: Rows of the result, `lay.row` apart.
    """
    for p in range(first_panel, lay.low.size):
        multiply_panel(
            rows, rows_at + lay.low[p], lay.row, 1, weights, lay.place[p], PANEL, lay.high[p] - lay.low[p],
            start, p * PANEL, start_row, out, p * PANEL, lay.row, lay.n_actions,
        )  # fmt: skip
