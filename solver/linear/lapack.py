"""LAPACK for kernels: LU factors of large blocks, through scipy's own pointers.

The kernels' loops are quicker on the small blocks of most bodies; see `LARGE`. A block
stored by rows is the transpose of what LAPACK takes it for, so that it solves with the
transposed factor.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any

import numpy as np
from numba import int64, types
from numba.extending import get_cython_function_address, intrinsic

from ..compiler.compiling import inner
from ..compiler.tables import Table, TableType
from ..compiler.views import Pointer, PointerType
from ..space.layout import Integers

#: Blocks from this size on go to LAPACK: measured, real blocks.
LARGE = 24

# Entries of Lapack.word: arguments that LAPACK takes by address
SIZE, ONE, INFO, TRANSPOSED = range(4)


FACTOR = types.void(*[int64] * 6)
SOLVE = types.void(*[int64] * 9)


class Lapack(Table):
    """The factorisation and the solution of one precision.

    factor, solve : getrf and getrs, whose arguments are all addresses
    word : see the entries above
    """

    factor: Annotated[Any, PointerType(FACTOR)]
    solve: Annotated[Any, PointerType(SOLVE)]
    word: Integers


LAPACK = TableType(Lapack)


@cache
def lapack(kind: str, largest: int) -> Lapack:
    """The routines for real ("d") or complex ("z") blocks up to a size.

    Without large blocks scipy is not even imported.
    """
    module = "scipy.linalg.cython_lapack"
    names = (f"{kind}getrf", f"{kind}getrs")
    found = [
        get_cython_function_address(module, name) if largest >= LARGE else 0
        for name in names
    ]
    word = np.array([0, 1, 0, ord("T")], np.int64)
    factor, solve = Pointer(found[0], FACTOR), Pointer(found[1], SOLVE)
    return Lapack(factor=factor, solve=solve, word=word)


@intrinsic
def address(typing: Any, array: Any, index: Any):  # type: ignore[no-untyped-def]
    """Address of one entry of a vector."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = builder.gep(builder.extract_value(values[0], 0), [values[1]])
        return builder.ptrtoint(place, context.get_value_type(int64))

    return int64(array, int64), generate


@inner()
def factor_large(lapack, A, o, n, pivots, first):
    """LU of the n x n block at o, in place; 1 if singular."""
    word = lapack.word
    word[SIZE], word[INFO] = n, 0
    size = address(word, SIZE)
    lapack.factor(
        size, size, address(A, o), size, address(pivots, first), address(word, INFO)
    )
    return 0 if word[INFO] == 0 else 1


@inner()
def solve_large(lapack, A, o, n, pivots, first, x, at):
    """Solves with a factor of `factor_large`; x[at:at+n] is overwritten."""
    word = lapack.word
    word[SIZE] = n
    size = address(word, SIZE)
    lapack.solve(
        address(word, TRANSPOSED),
        size,
        address(word, ONE),
        address(A, o),
        size,
        address(pivots, first),
        address(x, at),
        size,
        address(word, INFO),
    )
