"""Body for the modal joint of MBDyn: a `.fem` file.

The frame of the file is the body frame. Inertia invariants replace the lumped masses of
the nodes (record groups 14 to 18), so that the inertia is that of the whole body.

Source: P. Masarati, MBDyn theory and developer's manual, version 1.7, section Modal
element: invariants 3, 4, 5, 8 and 9.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.sid_mass import central_inertia, centre_of_mass

from .inertia_integrals import inertia_integrals


def mbdyn_text(sid: SID, nodes: Sequence[str], numbers: Sequence[int]) -> str:
    """Return the file of a body.

    Parameters
    ----------
    nodes : ids of the nodes of the SID
    numbers : of the nodes in the file

    Raises
    ------
    InputError : there is no such node, or the body has geometric stiffening.
    """
    points = [sid.node(node) for node in nodes]
    places = np.array([point.position for point in points])
    lines = [
        "** MBDyn MODAL DATA FILE",
        "** RECORD GROUP 1, HEADER",
        "**   REVISION, NODES, NORMAL, ATTACHMENT, CONSTRAINT, REJECTED MODES.",
        f"     REV0 {len(points)} {sid.nq} 0 0 0",
        "** RECORD GROUP 2, FINITE ELEMENT NODE LIST",
        " ".join(map(str, numbers)),
        "** RECORD GROUP 3, INITIAL MODAL DISPLACEMENTS",
        *_rows([np.zeros(sid.nq)]),
        "** RECORD GROUP 4, INITIAL MODAL VELOCITIES",
        *_rows([np.zeros(sid.nq)]),
    ]
    for group, (axis, column) in enumerate(zip("XYZ", places.T, strict=True), 5):
        lines += [f"** RECORD GROUP {group}, NODAL {axis} COORDINATES"]
        lines += _rows(column[:, None])
    lines.append("** RECORD GROUP 8, MODE SHAPES")
    motions = np.array([np.vstack([p.phi.m0, p.psi.m0]) for p in points])
    for k in range(sid.nq):
        lines.append(f"**    NORMAL MODE SHAPE # {k + 1}")
        lines += _rows(motions[:, :, k])
    for title, matrix in _records(sid):
        lines += [f"** RECORD GROUP {title}", *_rows(matrix)]
    return "\n".join(lines) + "\n"


def _records(sid: SID) -> Iterator[tuple[str, Iterable[Array]]]:
    """Record groups 9 to 18, except lumped masses."""
    integrals = inertia_integrals(sid)
    nq = sid.nq
    yield "9, MODAL MASS MATRIX", sid.Me.m0
    yield "10, MODAL STIFFNESS MATRIX", sid.Ke.m0
    body = [np.array([sid.mass]), centre_of_mass(sid), *central_inertia(sid)]
    yield "12, RIGID BODY INERTIA", body
    yield "13, MODAL DAMPING MATRIX", sid.De.m0
    yield "14, INVARIANT 3", integrals.translation
    yield "15, INVARIANT 4", integrals.rotation
    invariant8 = -integrals.position_shape
    yield "16, INVARIANT 8", invariant8.transpose(1, 0, 2).reshape(3, 3 * nq)
    cross = integrals.shape_cross
    yield "17, INVARIANT 5", cross.transpose(2, 0, 1).reshape(3, nq * nq)
    products = integrals.shape_shape
    yield "18, INVARIANT 9", products.transpose(2, 0, 1, 3).reshape(3, 3 * nq * nq)


def _rows(matrix: Iterable[Array]) -> Iterator[str]:
    for row in matrix:
        yield " ".join(f"{value:.16e}" for value in row)
