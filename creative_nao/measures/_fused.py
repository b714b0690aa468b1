"""The squared distance of two postures, of fused multiply-adds that are written down instead of hoped for.

Left to itself, the compiler may make one instruction of a product and a sum or leave them two, and which it does can
depend on what else it compiles. One expression for every kernel, of instructions it cannot choose, gives the distance
of two movements the same bits in all of them.
"""

# numba hands an intrinsic its first argument by itself.
# pyright: reportCallIssue=false
from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from numba import njit, types
from numba.extending import intrinsic

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
