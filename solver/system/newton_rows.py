"""The rows of Newton matrices: constraints, and forces between two markers.

Their order keeps the Schur complement a narrow band, as that of the constraints alone
does for accelerations. Constraints between prescribed frames have no row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..space.layout import IntTable
from .ordering import reverse_cuthill_mckee


class NewtonRows(NamedTuple):
    """What replaces fields of `space.layout.System`."""

    body: IntTable
    segment: IntTable
    n_rows: int
    bandwidth: int
    slack: Array


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

    sliding : segments of joints with friction
    count : constraint rows
    offset : of the first segment of a force
    """
    pieces = _force_pieces(body, marker, count, offset, force, constraint)
    found = [(int(r), int(b), int(o)) for r, b, o in segment]
    found += pieces
    last = count + len(force)
    found += [(last + int(j), int(b), int(o)) for j, b, o in sliding]
    owners: dict[int, set[int]] = {}
    for row, b, _ in found:
        owners.setdefault(row, set()).add(b)
    rows = sorted(owners)
    order, bandwidth = reverse_cuthill_mckee(
        [tuple(sorted(owners[row])) for row in rows], [1] * len(rows), body[:, at.NV]
    )
    place = {rows[i]: new for new, i in enumerate(order)}
    table = np.array(
        sorted(((place[row], b, o) for row, b, o in found), key=lambda s: (s[1], s[2])),
        np.int64,
    ).reshape(-1, at.N_SEGMENT)
    new_body = body.copy()
    bodies, owner = np.arange(len(body)), table[:, at.S_BODY]
    new_body[:, at.SEG0] = np.searchsorted(owner, bodies)
    new_body[:, at.SEG1] = np.searchsorted(owner, bodies, side="right")
    slack = np.zeros(len(rows))
    slack[[place[row] for row in rows if count <= row < last]] = 1.0
    return NewtonRows(new_body, table, len(rows), bandwidth, slack)


def _force_pieces(
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
    row_of |= dict.fromkeys(np.flatnonzero(force[:, at.F_KIND] == at.PRESCRIBED), -1)
    for led in constraint[constraint[:, at.C_LAW] >= 0]:
        row_of[int(force[led[at.C_LAW], at.F_B])] = int(led[at.ROW])
    pieces = []
    for k, row in enumerate(force):
        owner = k if row[at.F_OWNER] < 0 else int(row[at.F_OWNER])
        if force[owner, at.F_SAMPLED] or row_of[owner] < 0:
            continue
        for column, b in _ends(row, marker):
            if body[b, at.NV] > 0:
                row[column] = offset
                pieces.append((row_of[owner], b, offset))
                offset += int(body[b, at.NV])
    return pieces


def _ends(row: Array, marker: IntTable) -> list[tuple[int, int]]:
    """Columns of the segments of a force, or of a measure of a law, and the bodies."""
    if row[at.F_KIND] == at.PRESCRIBED:
        return []
    if row[at.F_KIND] == at.COORDINATE:
        return [(at.F_SEG_B, int(row[at.F_B]))]
    end = (at.F_SEG_B, int(marker[row[at.F_B], at.M_BODY]))
    if row[at.F_KIND] <= at.FOLLOWING:
        return [end] if row[at.F_CODE] >= 0 else []
    return [(at.F_SEG_A, int(marker[row[at.F_A], at.M_BODY])), end]


def with_slack(arrays: at.System, slack: Array) -> at.System:
    """The tables with other slacks of the constraint rows."""
    places = dict(arrays.newton.segment[:, [at.S_OFFSET, at.S_ROW]])
    new = arrays.newton.slack.copy()
    for row, _, offset in arrays.segment:
        new[places[offset]] = slack[row]
    return arrays.replaced(slack=slack, newton=arrays.newton.replaced(slack=new))
