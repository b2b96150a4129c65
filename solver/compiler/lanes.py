"""Scalar products of rows that stand in arrays, several terms at a time.

Loops of kernels are not vectorised, see `machine`: most are short. What grows with the
square of the elastic coordinates are products of constant matrices with vectors. They
have eight partial sums, on every processor: results do not depend on its registers.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import int64, types
from numba.core import cgutils
from numba.extending import intrinsic

from .inner import inner
from .values import REAL
from .views import INDEX

LANES = 8
_WHOLE = ir.IntType(32)


def _lanes(builder: Any, view: Any, index: Any, count: int) -> Any:
    """Consecutive reals of an array, real or complex, from entry `index` on."""
    place = builder.gep(builder.extract_value(view, 0), [index])
    kind = ir.VectorType(REAL, count).as_pointer()
    return builder.load(builder.bitcast(place, kind), align=8)


def _chosen(builder: Any, lanes: Any, places: list[int]) -> Any:
    """Some of the lanes, in this order."""
    mask = ir.Constant(ir.VectorType(_WHOLE, len(places)), places)
    return builder.shuffle_vector(lanes, lanes, mask)


def _summed(builder: Any, lanes: Any, parts: int) -> list[Any]:
    """Sums of every second of so many lanes, or of all."""
    count = LANES
    while count > parts:
        count //= 2
        low = _chosen(builder, lanes, list(range(count)))
        high = _chosen(builder, lanes, list(range(count, 2 * count)))
        lanes = builder.fadd(low, high)
    return [builder.extract_element(lanes, _WHOLE(k)) for k in range(parts)]


@intrinsic
def _products(typing: Any, a: Any, i: Any, x: Any, k: Any, n: Any):  # type: ignore[no-untyped-def]
    """Sum of a[i + j] x[k + j] over j below n, a multiple of the lanes."""
    parts = 2 if isinstance(x.dtype, types.Complex) else 1
    many = LANES // parts

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        a, i, x, k, n = values
        zeros = [ir.Constant(REAL, 0.0)] * LANES
        none = ir.Constant(ir.VectorType(REAL, LANES), zeros)
        total = cgutils.alloca_once_value(builder, none)
        with cgutils.for_range(builder, builder.sdiv(n, INDEX(many))) as loop:
            at = builder.mul(loop.index, INDEX(many))
            left = _lanes(builder, a, builder.add(i, at), many)
            left = _chosen(builder, left, [lane // parts for lane in range(LANES)])
            right = _lanes(builder, x, builder.add(k, at), LANES)
            sums = builder.fadd(builder.load(total), builder.fmul(left, right))
            builder.store(sums, total)
        sums = _summed(builder, builder.load(total), parts)
        return sums[0] if parts == 1 else cgutils.pack_struct(builder, sums)

    return x.dtype(a, int64, x, int64, int64), generate


@inner()
def row_times(a, i, x, k, n):
    """Sum of a[i + j] x[k + j] over j below n, one at least; x is real or complex."""
    whole = n & -LANES
    if whole > 0:
        total, done = _products(a, i, x, k, whole), whole
    else:
        total, done = a[i] * x[k], 1
    for j in range(done, n):
        total += a[i + j] * x[k + j]
    return total
