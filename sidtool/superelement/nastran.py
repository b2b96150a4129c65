"""Superelement for Nastran: matrices in an OUTPUT4 file, or DMIG bulk data.

Source: MSC Nastran Quick Reference Guide, entries DMIG, GRID and SPOINT, module
OUTPUT4 (formatted, non-sparse).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sidtool.formats.base.sid import Array

from .craig_bampton import Superelement

#: Numbers on a line of an OUTPUT4 file, each of 23 characters.
_PER_LINE = 3
#: Forms of matrices: rectangular, symmetric.
_RECTANGULAR, _SYMMETRIC = 2, 6
#: Real numbers in double precision.
_REAL_DOUBLE = 2
#: Modal coordinates are scalar points with numbers above this and above all grids.
_FIRST_SCALAR = 100_000


def op4_text(element: Superelement) -> str:
    """Return the matrices KAAX, MAAX, BAAX and the positions XYZ of the interfaces."""
    matrices = {
        "KAAX": (element.stiffness, _SYMMETRIC),
        "MAAX": (element.mass, _SYMMETRIC),
        "BAAX": (element.damping, _SYMMETRIC),
        "XYZ": (element.positions, _RECTANGULAR),
    }
    lines = [
        line for name, value in matrices.items() for line in _op4_lines(name, *value)
    ]
    return "\n".join(lines) + "\n"


def _op4_lines(name: str, matrix: Array, form: int) -> Iterator[str]:
    rows, columns = matrix.shape
    header = f"{columns:8d}{rows:8d}{form:8d}{_REAL_DOUBLE:8d}{name:<8s}"
    yield f"{header}1P,{_PER_LINE}E23.16"
    for number, column in enumerate(matrix.T, 1):
        there = np.flatnonzero(column)
        if there.size:
            first, last = there[0], there[-1]
            yield f"{number:8d}{first + 1:8d}{last - first + 1:8d}"
            yield from _number_lines(column[first : last + 1])
    yield f"{columns + 1:8d}{1:8d}{1:8d}"
    yield from _number_lines(np.ones(1))


def _number_lines(values: Array) -> Iterator[str]:
    for k in range(0, len(values), _PER_LINE):
        yield "".join(f"{value:23.16E}" for value in values[k : k + _PER_LINE])


def dmig_text(element: Superelement) -> str:
    """Return bulk data: interfaces as GRID, modes as SPOINT, and DMIG matrices."""
    points = scalar_points(element)
    lines = [
        f"$ Superelement {_printable(element.title)}".rstrip(),
        "$ Case control: K2GG = KAAX, M2GG = MAAX, B2GG = BAAX",
    ]
    for name, number, position in zip(
        element.interfaces, element.numbers, element.positions, strict=True
    ):
        x, y, z = (f"{value:16.9E}" for value in position)
        lines += [
            f"$ interface {_printable(name)}",
            f"GRID*   {number:16d}{'':16s}{x}{y}",
            f"*       {z}",
        ]
    if points:
        lines.append(f"SPOINT  {points[0]:8d}THRU    {points[-1]:8d}")
    rows = [(g, c) for g in element.numbers for c in range(1, 7)]
    rows += [(point, 0) for point in points]
    matrices = {
        "KAAX": element.stiffness,
        "MAAX": element.mass,
        "BAAX": element.damping,
    }
    for name, matrix in matrices.items():
        lines += _dmig_lines(name, matrix, rows)
    return "\n".join(lines) + "\n"


def scalar_points(element: Superelement) -> list[int]:
    """Return the numbers of the scalar points of the modes."""
    first = max(_FIRST_SCALAR, *element.numbers) + 1
    return list(range(first, first + element.n_modes))


def _dmig_lines(name: str, matrix: Array, rows: list[tuple[int, int]]) -> Iterator[str]:
    yield f"DMIG    {name:<8s}{0:8d}{_SYMMETRIC:8d}{_REAL_DOUBLE:8d}{0:8d}"
    for j, (grid, component) in enumerate(rows):
        there = np.flatnonzero(matrix[j:, j]) + j
        if there.size:
            yield f"DMIG*   {name:<16s}{grid:16d}{component:16d}"
        for i in there:
            number = f"{matrix[i, j]:.9E}".replace("E", "D")
            yield f"*       {rows[i][0]:16d}{rows[i][1]:16d}{number:>16s}"


def _printable(text: str) -> str:
    """Return a text for a comment: printable ASCII of at most 60 characters."""
    return "".join(c if " " <= c <= "~" else "?" for c in text)[:60]
