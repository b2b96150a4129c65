"""Rows of the Newton matrix: constraints, and forces between two markers.

Their order keeps the Schur complement a narrow band, as that of the constraints alone
does for accelerations. Constraints between prescribed frames have no row.
"""

from typing import NamedTuple

import numpy as np

from sidtool.formats.base.sid import Array

from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from .constraint_table import reverse_cuthill_mckee


class NewtonRows(NamedTuple):
    """What replaces fields of `SystemArrays`."""

    body: IntTable
    segment: IntTable
    n_rows: int
    bandwidth: int
    regularisation: Array


def newton_rows(
    body: IntTable,
    marker: IntTable,
    segment: IntTable,
    sliding: IntTable,
    count: int,
    offset: int,
    force: IntTable,
    constraint: IntTable,
) -> NewtonRows:
    """Rows of constraints, forces and friction; fills the segments of the force table.

    What the law of a drive reads belongs to the row of its constraint.

    Parameters
    ----------
    sliding
        Segments of joints with friction.
    count
        Constraint rows.
    offset
        Of the first segment of a force.
    """
    force_segments = _force_segments(body, marker, count, offset, force, constraint)
    segments = [(int(r), int(b), int(o)) for r, b, o in segment]
    segments += force_segments
    last = count + len(force)
    segments += [(last + int(j), int(b), int(o)) for j, b, o in sliding]
    owners: dict[int, set[int]] = {}
    for row, b, _ in segments:
        owners.setdefault(row, set()).add(b)
    rows = sorted(owners)
    order, bandwidth = reverse_cuthill_mckee(
        [tuple(sorted(owners[row])) for row in rows], [1] * len(rows), body[:, at.NV]
    )
    new_row = {rows[i]: new for new, i in enumerate(order)}
    table = np.array(
        sorted(
            ((new_row[row], b, o) for row, b, o in segments), key=lambda s: (s[1], s[2])
        ),
        np.int64,
    ).reshape(-1, at.N_SEGMENT)
    new_body = body.copy()
    bodies, owner = np.arange(len(body)), table[:, at.S_BODY]
    new_body[:, at.SEG0] = np.searchsorted(owner, bodies)
    new_body[:, at.SEG1] = np.searchsorted(owner, bodies, side="right")
    regularisation = np.zeros(len(rows))
    regularisation[[new_row[row] for row in rows if count <= row < last]] = 1.0
    return NewtonRows(new_body, table, len(rows), bandwidth, regularisation)


def _force_segments(
    body: IntTable,
    marker: IntTable,
    count: int,
    offset: int,
    force: IntTable,
    constraint: IntTable,
) -> list[tuple[int, int, int]]:
    """Row, body and offset of each segment of a force; rows of constraints come first.

    What a law reads belongs to the row of its force, or of the constraint whose second
    derivative it gives.
    """
    row_of = {k: count + k for k in range(len(force))}
    row_of |= dict.fromkeys(
        np.flatnonzero(force[:, at.F_KIND] == at.PRESCRIBED_VALUE), -1
    )
    for law_constraint in constraint[constraint[:, at.C_LAW] >= 0]:
        row_of[int(force[law_constraint[at.C_LAW], at.F_B])] = int(
            law_constraint[at.ROW]
        )
    force_segments = []
    for k, row in enumerate(force):
        owner = k if row[at.F_OWNER] < 0 else int(row[at.F_OWNER])
        if force[owner, at.F_SAMPLED] or row_of[owner] < 0:
            continue
        for column, b in _ends(row, marker):
            if body[b, at.NV] > 0:
                row[column] = offset
                force_segments.append((row_of[owner], b, offset))
                offset += int(body[b, at.NV])
    return force_segments


def _ends(row: Array, marker: IntTable) -> list[tuple[int, int]]:
    """Columns of the segments of a force, or of a measure of a law, and the bodies."""
    if row[at.F_KIND] == at.PRESCRIBED_VALUE:
        return []
    if row[at.F_KIND] == at.COORDINATE_MEASURE:
        return [(at.F_SEG_B, int(row[at.F_B]))]
    end = (at.F_SEG_B, int(marker[row[at.F_B], at.M_BODY]))
    if row[at.F_KIND] <= at.FOLLOWER_LOAD:
        return [end] if row[at.F_CODE] >= 0 else []
    return [(at.F_SEG_A, int(marker[row[at.F_A], at.M_BODY])), end]


def with_regularisation(
    arrays: at.SystemArrays, regularisation: Array
) -> at.SystemArrays:
    """The tables with other slacks of the constraint rows."""
    newton_row_at = dict(arrays.newton_subsystem.segment[:, [at.S_OFFSET, at.S_ROW]])
    new = arrays.newton_subsystem.regularisation.copy()
    for row, _, offset in arrays.segment:
        new[newton_row_at[offset]] = regularisation[row]
    return arrays.replaced(
        regularisation=regularisation,
        newton_subsystem=arrays.newton_subsystem.replaced(regularisation=new),
    )
