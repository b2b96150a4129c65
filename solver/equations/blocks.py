"""The blocks of a body's SID in the pool: where they stand, once for all.

First come mass, mdCM, J and H; then rows over the elastic coordinates, then square
matrices, each component by component; behind them the cube of Ke1, if any. A stiffened
body has zeros for J, Cr and Oe and turns in its mean axes instead, with H, tilt, slope
and what begins with the coupling: `mean_axes`. Kernels read `Ct1(x, pool, o, nq, k, l)`
with the start o of the body and any translation x of the space.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..compiler.inner import inner
from ..compiler.lanes import row_times
from ..compiler.values import Symmetric, Vector, formula
from ..space.algebra import load, size

#: Numbers of components: of a translation, a rotation and a symmetric matrix.
SIZES = {2: {"number": 1, "move": 2, "turn": 1, "pair": 1}}
SIZES[3] = {"number": 1, "move": 3, "turn": 3, "pair": 6}
HEAD = {"mass": "number", "mdCM": "move", "J0": "pair", "H0": "pair"}
ROWS = {
    "Ct0": "move",
    "Cr0": "turn",
    "J1": "pair",
    "Oe0": "pair",
    "ksigma": "number",
    "tilt": "turn",
    "slope": "pair",
}
SQUARES = {
    "Ke": "number",
    "De": "number",
    "Cr1": "turn",
    "Ge": "turn",
    "Oe1": "pair",
    "Ct1": "move",
    "coupling": "turn",
    "bow": "pair",
    "free_turning": "turn",
    "free_mass": "number",
}


def _starts(blocks: dict[str, str], dimension: int) -> dict[str, int]:
    """Components before each block, and of all under the name ""."""
    starts, total = {}, 0
    for name, kind in blocks.items():
        starts[name] = total
        total += SIZES[dimension][kind]
    return starts | {"": total}


_STARTS = {d: [_starts(b, d) for b in (HEAD, ROWS, SQUARES)] for d in SIZES}


def _read(kind: str, dimension: int, a: Any, at: Any, stride: Any) -> Any:
    if kind == "number":
        return a[at]
    many = range(SIZES[dimension][kind])
    value = Symmetric if kind == "pair" else Vector
    return value(*(a[at + i * stride] for i in many))


def _head(name: str) -> Callable[..., Any]:
    def read(x: Any, pool: Any, o: Any) -> Any:
        head, _, _ = _STARTS[len(x)]
        return _read(HEAD[name], len(x), pool, o + head[name], 1)

    return formula(read)


def _row(name: str) -> Callable[..., Any]:
    def read(x: Any, pool: Any, o: Any, nq: Any, k: Any) -> Any:
        head, rows, _ = _STARTS[len(x)]
        at = nq * rows[name] + (o + head[""] + k)
        return _read(ROWS[name], len(x), pool, at, nq)

    return formula(read)


def _square(name: str) -> Callable[..., Any]:
    def read(x: Any, pool: Any, o: Any, nq: Any, k: Any, i: Any) -> Any:
        head, rows, squares = _STARTS[len(x)]
        square = nq * nq
        at = square * squares[name] + nq * rows[""] + (o + head[""] + k * nq + i)
        return _read(SQUARES[name], len(x), pool, at, square)

    return formula(read)


def _start(name: str) -> Callable[..., Any]:
    """Where row k of a square matrix begins, of its first component."""

    def start(x: Any, o: Any, nq: Any, k: Any) -> Any:
        head, rows, squares = _STARTS[len(x)]
        return nq * nq * squares[name] + nq * rows[""] + (o + head[""] + k * nq)

    return formula(start)


@formula
def cube_at(x: Any, o: Any, nq: Any) -> Any:
    """Where Ke1 stands."""
    head, rows, squares = _STARTS[len(x)]
    return o + head[""] + nq * rows[""] + nq * nq * squares[""]


mass, mdCM, J0, H0 = map(_head, HEAD)
Ct0, Cr0, J1, Oe0, ksigma, tilt, slope = map(_row, ROWS)
Ke, De, Cr1, Ge, Oe1, Ct1, coupling, bow, free_turning, free_mass = map(
    _square, SQUARES
)
MULTIPLIED = "Ke", "De", "Cr1", "Ge", "Oe1", "Ct1"
Ke_row, De_row, Cr1_row, Ge_row, Oe1_row, Ct1_row = map(_start, MULTIPLIED)


@inner()
def row_product(like, work, pool, at, nq, x, first):
    """A row of a square matrix times x[first:]; its entries are values like that."""
    for c in range(size(like)):
        work.scratch[c] = row_times(pool, at + c * nq * nq, x, first, nq)
    return load(like, work.scratch, 0)
