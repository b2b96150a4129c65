"""Constraint table of the kernels: rows, segments of the Jacobian and bandwidth.

The order of the rows keeps the bandwidth of the Schur complement small.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from .build_inputs import BuildInputs, MarkerKey
from .joints import Constraint
from .system import ConstraintRows


def reverse_cuthill_mckee(
    owners: Sequence[tuple[int, ...]],
    counts: Sequence[int],
    coordinates: NDArray[np.int64],
) -> tuple[list[int], int]:
    """Order of constraints and the half bandwidth of their Schur complement.

    Two constraints couple when they act on a body with coordinates of its own.

    Parameters
    ----------
    owners
        Bodies of each constraint.
    counts
        Rows of each constraint.
    coordinates
        Velocity coordinates of each body.
    """
    n = len(owners)
    touching: dict[int, list[int]] = {}
    for i, pair in enumerate(owners):
        for b in set(pair):
            if coordinates[b] > 0:
                touching.setdefault(b, []).append(i)
    neighbours = [set().union(*(touching.get(b, []) for b in pair)) for pair in owners]
    order: list[int] = []
    visited: set[int] = set()
    for start in sorted(range(n), key=lambda i: (len(neighbours[i]), i)):
        if start in visited:
            continue
        queue = [start]
        visited.add(start)
        for i in queue:
            order.append(i)
            fresh = [k for k in neighbours[i] if k not in visited]
            fresh.sort(key=lambda k: (len(neighbours[k]), k))
            visited.update(fresh)
            queue.extend(fresh)
    order.reverse()
    return order, _bandwidth(order, neighbours, counts)


def _bandwidth(
    order: Sequence[int], neighbours: Sequence[set[int]], counts: Sequence[int]
) -> int:
    first = {}
    row = 0
    for i in order:
        first[i] = row
        row += counts[i]
    width = 0
    for i in order:
        for k in neighbours[i]:
            width = max(width, first[k] + counts[k] - 1 - first[i])
    return width


@dataclass(frozen=True, eq=False)
class ConstraintTables:
    """Constraints for the kernels.

    Attributes
    ----------
    constraint, segment
        Tables.
    rows
        Constraint rows of each joint and drive.
    bandwidth
        Of the Schur complement on the multipliers.
    set_at_start : (entry of the real data, constraint row)
        Constants that the assembled start decides.
    """

    constraint: IntTable
    segment: IntTable
    rows: tuple[ConstraintRows, ...]
    bandwidth: int
    set_at_start: tuple[tuple[int, int], ...]


def constraint_tables(
    parts: BuildInputs,
    constraints: list[Constraint],
    markers: dict[MarkerKey, int],
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
        table[i, at.C_DATA] = parts.real_data.add(c.primitive.data)
        table[i, [at.C_DRIVE, at.C_LAW]] = c.drive, c.law
    segment = _segments(table, counts, owners, body)
    rows = _constraint_rows(constraints, first, counts)
    return ConstraintTables(
        table, segment, rows, bandwidth, _set_at_start(constraints, table)
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
        if constraint.primitive.shares_row:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _segments(
    table: IntTable, counts: list[int], owners: list[tuple[int, ...]], body: IntTable
) -> IntTable:
    """Entries of the constraint Jacobian by body; fills the references to them."""
    segments = []
    for i, pair in enumerate(owners):
        for side, b in enumerate(pair):
            column = (at.SEG_A, at.SEG_B)[side]
            table[i, column] = -1
            if body[b, at.NV] > 0:
                segments += [(b, i, column, k) for k in range(counts[i])]
    segments.sort()
    segment = np.zeros((len(segments), at.N_SEGMENT), np.int64)
    offset = 0
    for s, (b, i, column, k) in enumerate(segments):
        segment[s] = table[i, at.ROW] + k, b, offset
        offset += body[b, at.NV]
        if k == 0:
            table[i, column] = s
    owner = segment[:, at.S_BODY]
    for b in range(len(body)):
        body[b, at.SEG0] = np.searchsorted(owner, b)
        body[b, at.SEG1] = np.searchsorted(owner, b, side="right")
    return segment


def _constraint_rows(
    constraints: list[Constraint], first: dict[int, int], counts: list[int]
) -> tuple[ConstraintRows, ...]:
    return tuple(
        ConstraintRows(c.owner, first[i], counts[i])
        for i, c in enumerate(constraints)
        if not c.primitive.shares_row
    )


def _set_at_start(
    constraints: list[Constraint], table: IntTable
) -> tuple[tuple[int, int], ...]:
    return tuple(
        (int(row[at.C_DATA]) + c.primitive.set_at_start, int(row[at.ROW]))
        for c, row in zip(constraints, table, strict=True)
        if c.primitive.set_at_start >= 0
    )
