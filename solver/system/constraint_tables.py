"""The table of constraints, ordered along the mechanism, and their Jacobian by body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..space import layout as at
from ..space.layout import IntTable
from .constraints import Constraint
from .ingredients import Ingredients, Reference
from .ordering import reverse_cuthill_mckee
from .scene import Row


@dataclass(frozen=True, eq=False)
class ConstraintTables:
    """Constraints for the kernels.

    constraint, segment : tables
    rows : constraint rows of each joint and drive
    bandwidth : of the Schur complement on the multipliers
    from_start : (entry of the pool, constraint row) of constants that the assembled
        start decides
    """

    constraint: IntTable
    segment: IntTable
    rows: tuple[Row, ...]
    bandwidth: int
    from_start: tuple[tuple[int, int], ...]


def constraint_tables(
    parts: Ingredients,
    constraints: list[Constraint],
    markers: dict[Reference, int],
    body: IntTable,
    marker: IntTable,
) -> ConstraintTables:
    """Tables of the constraints; fills the references of `body` to the segments."""
    point = 2 if parts.planar else 3
    counts = [point if c.primitive.kind == at.COINCIDENT else 1 for c in constraints]
    ends = [(markers[c.a], markers[c.b]) for c in constraints]
    owners = [tuple(int(marker[m, at.M_BODY]) for m in pair) for pair in ends]
    first, bandwidth = _first_rows(constraints, counts, owners, body)
    table = np.zeros((len(constraints), at.N_CONSTRAINT), np.int64)
    for i, c in enumerate(constraints):
        table[i, at.KIND] = c.primitive.kind
        table[i, at.ROW] = first[i]
        table[i, [at.MARKER_A, at.MARKER_B]] = ends[i]
        table[i, at.C_DATA] = parts.pool.add(c.primitive.data)
        table[i, [at.C_DRIVE, at.C_LAW]] = c.drive, c.law
    segment = _segments(table, counts, owners, body)
    rows = _rows(constraints, first, counts)
    return ConstraintTables(
        table, segment, rows, bandwidth, _from_start(constraints, table)
    )


def _first_rows(
    constraints: list[Constraint],
    counts: list[int],
    owners: list[tuple[int, ...]],
    body: IntTable,
) -> tuple[dict[int, int], int]:
    """First row of each constraint, and the bandwidth that this order gives."""
    groups = _groups(constraints)
    order, bandwidth = reverse_cuthill_mckee(
        [tuple(b for i in group for b in owners[i]) for group in groups],
        [counts[group[0]] for group in groups],
        body[:, at.NV],
    )
    first: dict[int, int] = {}
    row = 0
    for g in order:
        first |= dict.fromkeys(groups[g], row)
        row += counts[groups[g][0]]
    return first, bandwidth


def _groups(constraints: list[Constraint]) -> list[list[int]]:
    """Constraints that share their rows."""
    groups: list[list[int]] = []
    for i, constraint in enumerate(constraints):
        if constraint.primitive.continues:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _segments(
    table: IntTable, counts: list[int], owners: list[tuple[int, ...]], body: IntTable
) -> IntTable:
    """Entries of the constraint Jacobian by body; fills the references to them."""
    found = []
    for i, pair in enumerate(owners):
        for side, b in enumerate(pair):
            column = (at.SEG_A, at.SEG_B)[side]
            table[i, column] = -1
            if body[b, at.NV] > 0:
                found += [(b, i, column, k) for k in range(counts[i])]
    found.sort()
    segment = np.zeros((len(found), at.N_SEGMENT), np.int64)
    offset = 0
    for s, (b, i, column, k) in enumerate(found):
        segment[s] = table[i, at.ROW] + k, b, offset
        offset += body[b, at.NV]
        if k == 0:
            table[i, column] = s
    owner = segment[:, at.S_BODY]
    for b in range(len(body)):
        body[b, at.SEG0] = np.searchsorted(owner, b)
        body[b, at.SEG1] = np.searchsorted(owner, b, side="right")
    return segment


def _rows(
    constraints: list[Constraint], first: dict[int, int], counts: list[int]
) -> tuple[Row, ...]:
    return tuple(
        Row(c.owner, first[i], counts[i])
        for i, c in enumerate(constraints)
        if not c.primitive.continues
    )


def _from_start(
    constraints: list[Constraint], table: IntTable
) -> tuple[tuple[int, int], ...]:
    return tuple(
        (int(row[at.C_DATA]) + c.primitive.from_start, int(row[at.ROW]))
        for c, row in zip(constraints, table, strict=True)
        if c.primitive.from_start >= 0
    )
