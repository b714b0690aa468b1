"""The matrix product of compiled training and generation, and the layout of the numbers that training multiplies.

Tiles of the result stay in registers while the inner index runs. Every element is a sum in ascending order of the inner
index, whatever the tile it falls into, so results depend neither on the width of the machine's registers nor on how
rows are cut into tiles.
"""

from __future__ import annotations

from typing import NamedTuple

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic

from creative_nao.model.config import NetworkSettings, Shapes, layer_time_constants, neighbour_mask, parameter_shapes
from creative_nao.model.simd import FLOAT, call_llvm, compiled, element_pointer, spread

# pyright: reportIndexIssue=false, reportCallIssue=false


def _has_512_bit_registers() -> bool:
    asked = getattr(config, "CPU_FEATURES", None)  # numba can be told to compile for another processor
    return bool(llvm.get_host_cpu_features().get("avx512f")) if asked is None else "+avx512f" in asked


N_LANES = 16 if _has_512_bit_registers() else 8
PANEL = 2 * N_LANES  # columns of a tile: two registers
TALLEST = 8 if N_LANES == 16 else 6  # most rows of a tile: they, a row of b and a number of a fill the registers


@intrinsic
def _multiply_tile(
    typing_context, n_rows, a, a_first, a_row, a_inner, b, b_first, b_inner, n_inner, start, start_first, start_row,
    out, out_first, out_row,
):  # fmt: skip
    """Compute out[i, :] = start[i, :] + sum over k of a[i, k] b[k, :] for 1 to `TALLEST` rows of a panel.

    Each matrix is an array, the index of its first element and its strides in elements; the columns of b, start and
    out are consecutive. One loop is emitted for each number of rows.
    """
    word, vector = ir.IntType(64), ir.VectorType(FLOAT, N_LANES)

    def generate(context, builder, signature, arguments):
        kinds = signature.args
        n_rows, _, _, a_row, a_inner, _, _, b_inner, n_inner, _, _, start_row, _, _, out_row = (
            context.cast(builder, argument, kind, types.intp) if isinstance(kind, types.Integer) else None
            for argument, kind in zip(arguments, kinds, strict=True)
        )

        def address(matrix, row_stride, i):
            base = element_pointer(
                context, builder, kinds[matrix], arguments[matrix], kinds[matrix + 1], arguments[matrix + 1]
            )
            return builder.gep(base, [builder.mul(row_stride, ir.Constant(word, i))])

        def registers(pointer):
            for half in range(2):
                place = builder.gep(pointer, [ir.Constant(word, half * N_LANES)])
                yield builder.bitcast(place, vector.as_pointer())

        def emit_rows(height):
            """Emit the loop over the inner index, which keeps `height` rows of sums in registers."""
            rows = range(height)
            sums = [builder.load(r, align=4) for i in rows for r in registers(address(9, start_row, i))]
            a_rows, b_start = [address(1, a_row, i) for i in rows], address(5, b_inner, 0)
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
            b_vectors = [builder.load(place, align=4) for place in registers(b_row)]
            a_at = builder.mul(k, a_inner)
            new = []
            for i in rows:
                factor = spread(builder, builder.load(builder.gep(a_rows[i], [a_at])), N_LANES)
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
            results = [builder.phi(vector) for _ in sums]
            for phi, none, value in zip(results, sums, new, strict=True):
                phi.add_incoming(none, before)
                phi.add_incoming(value, loop)
            places = [place for i in rows for place in registers(address(12, out_row, i))]
            for value, place in zip(results, places, strict=True):
                builder.store(value, place, align=4)

        end = builder.append_basic_block("end")
        switch = builder.switch(n_rows, end)
        for height in range(1, TALLEST + 1):
            block = builder.append_basic_block(f"rows_{height}")
            switch.add_case(ir.Constant(word, height), block)
            builder.position_at_end(block)
            emit_rows(height)
            builder.branch(end)
        builder.position_at_end(end)
        return context.get_dummy_value()

    return types.void(
        n_rows, a, a_first, a_row, a_inner, b, b_first, b_inner, n_inner, start, start_first, start_row,
        out, out_first, out_row,
    ), generate  # fmt: skip


@compiled(inline="always")
def multiply_panel(
    a, a_at, a_row, a_inner, b, b_at, b_inner, n_inner, start, start_at, start_row, out, out_at, out_row, n_rows
):
    """Compute out = start + a b for `PANEL` columns and any number of rows.

    The matrices lie in contiguous arrays: `a_at` is the index of the first element of a, `a_row` and `a_inner` the
    distance to the next one along its rows and along the inner index, and so on. `start` may be `out`.
    """
    n_tiles = (n_rows + TALLEST - 1) // TALLEST
    done = 0
    for tile in range(n_tiles):  # heights differ by one at most
        end = n_rows * (tile + 1) // n_tiles
        _multiply_tile(
            end - done, a, a_at + done * a_row, a_row, a_inner, b, b_at, b_inner, n_inner,
            start, start_at + done * start_row, start_row, out, out_at + done * out_row, out_row,
        )  # fmt: skip
        done = end


@compiled()
def multiply_panels(lay, first_panel, rows, rows_at, weights, start, start_row, out):
    """Multiply the rows of all actions at one tick with packed weights: out = start + rows weights, from a panel on.

    The first row lies at `rows_at`; rows and results are `lay.row` apart, what the sums begin with `start_row`.
    """
    for p in range(first_panel, lay.low.size):
        multiply_panel(
            rows, rows_at + lay.low[p], lay.row, 1, weights, lay.place[p], PANEL, lay.high[p] - lay.low[p],
            start, p * PANEL, start_row, out, p * PANEL, lay.row, lay.n_actions,
        )  # fmt: skip


LINE = 16  # float32 numbers in a cache line of 64 bytes


class Layout(NamedTuple):
    """Sizes and places, as the compiled functions read them."""

    n_actions: int
    n_joints: int  # filled up to a multiple of eight
    n_codes: int  # columns of P_I and P_O: n_joints times softmax units; the hidden units begin at `first_hidden`
    first_hidden: int
    width: int  # columns, a multiple of `PANEL`
    row: int  # distance between two rows: an odd number of cache lines, so that a column spreads over the cache
    n_pb: int
    low: np.ndarray  # first presynaptic unit of each panel, int64
    high: np.ndarray  # end of the presynaptic units of each panel
    place: np.ndarray  # where each panel begins in the packed vector
    bias: int  # where the biases begin in the packed vector, one per column
    w_pb: int  # where the PB weights begin, a row of `width` for each PB unit
    rho: int  # where rho begins, a row of `n_pb` for each action
    size: int  # length of the packed vector


def line_up(n: int, multiple: int) -> int:
    """Return the smallest multiple that is at least `n`."""
    return -(-n // multiple) * multiple


def aligned(*shape: int) -> np.ndarray:
    """Return zeros in float32 that begin at a cache line: loads that cross two lines take twice the time."""
    size = int(np.prod(shape))
    room = np.zeros(size + LINE, np.float32)
    start = -room.ctypes.data // room.itemsize % LINE
    return room[start : start + size].reshape(shape)


class Packing:
    """Translates between the flat vector of `config.parameter_shapes` and the packed one."""

    def __init__(self, settings: NetworkSettings, n_codes: int, n_actions: int) -> None:
        self.shapes: Shapes = parameter_shapes(settings, n_codes, n_actions)
        n_units = settings.n_softmax_units
        n_joints = line_up(n_codes // n_units, 8)
        first_hidden = line_up(n_joints * n_units, LINE)
        starts = np.cumsum([0, first_hidden, *settings.layer_sizes])
        width = line_up(int(starts[-1]), PANEL)
        low, high = _presynaptic(starts, width)
        place = np.cumsum([0, *((high - low) * PANEL)])
        bias = int(place[-1])
        w_pb = bias + width
        rho = w_pb + settings.n_pb * width
        size = line_up(rho + n_actions * settings.n_pb, LINE)
        self.layout = Layout(
            n_actions, n_joints, n_joints * n_units, first_hidden, width, width + LINE, settings.n_pb,
            low, high, place[:-1], bias, w_pb, rho, size,
        )  # fmt: skip
        joint, unit = np.divmod(np.arange(n_codes), n_units)
        self.code_columns = unit * n_joints + joint  # of each element of a posture's code
        self.rate = np.ones(width, np.float32)
        self.rate[first_hidden : first_hidden + settings.n_hidden] = 1 / layer_time_constants(settings)
        self._flat, self._packed = self._pairs(settings)
        self.real = aligned(size)  # 1 for elements of the packed vector that are parameters, 0 for the padding
        self.real[self._packed] = 1

    def _pairs(self, settings: NetworkSettings) -> tuple[np.ndarray, np.ndarray]:
        """Return which element of the flat vector is which of the packed one; weights fixed at zero are in none."""
        lay = self.layout
        fast = lay.first_hidden + np.arange(settings.layer_sizes[0])
        hidden = lay.first_hidden + np.arange(settings.n_hidden)
        codes = self.code_columns

        def weight(pre, post):  # presynaptic and postsynaptic units
            panel, column = np.divmod(post[None, :], PANEL)
            return lay.place[panel] + (pre[:, None] - lay.low[panel]) * PANEL + column

        packed = {
            "w_in": weight(codes, fast),
            "w_out": weight(fast, codes),
            "w_hidden": np.where(neighbour_mask(settings) > 0, weight(hidden, hidden), -1),
            "w_pb": lay.w_pb + np.arange(lay.n_pb)[:, None] * lay.width + hidden,
            "b_out": lay.bias + codes,
            "b_hidden": lay.bias + hidden,
            "rho": lay.rho + np.arange(lay.n_actions * lay.n_pb),
        }
        targets = np.concatenate([packed[name].ravel() for name in self.shapes])
        real = np.flatnonzero(targets >= 0)
        return real, targets[real]

    def pack(self, flat: np.ndarray) -> np.ndarray:
        """Return the packed vector; its padding is zero."""
        packed = aligned(self.layout.size)
        packed[self._packed] = flat[self._flat]
        return packed

    def unpack(self, packed: np.ndarray, flat: np.ndarray) -> np.ndarray:
        """Return a copy of the flat vector with the numbers of the packed one."""
        new = flat.copy()
        new[self._flat] = packed[self._packed]
        return new


def _presynaptic(starts: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each panel, the first and the end of the columns that its units have input from.

    Both are multiples of eight, because the weights are transposed in squares of that size.
    """
    n_parts = len(starts) - 1
    low, high = [], []
    for first in range(0, width, PANEL):
        inside = [p for p in range(n_parts) if starts[p] < first + PANEL and starts[p + 1] > first]
        # P_I/P_O, part 0, has no input from itself; a last panel may hold no unit at all.
        parts = [q for p in inside for q in (p - 1, p, p + 1) if 0 <= q < n_parts and (p, q) != (0, 0)]
        low.append(starts[min(parts)] // 8 * 8 if parts else 0)
        high.append(line_up(starts[max(parts) + 1], 8) if parts else 0)
    return np.array(low, np.int64), np.array(high, np.int64)
