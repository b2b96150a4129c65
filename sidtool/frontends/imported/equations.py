"""Equations and ties of a mesh file as equations of a body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.errors import InputError

from ...importers.imported import ImportedMesh
from ...importers.imported_ties import RawEquation, RawTie
from ..elimination import solved
from ..equations import Equations
from ..finite_element_model import FiniteElementModel
from ..mesh.data import Mesh
from ..ties import tie_equations

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: What equations may leave of a rigid motion, of coefficients and the body's size.
_RIGID = 1e-7


def body_equations(
    imported: ImportedMesh, whole: Mesh, mesh: Mesh, length: float
) -> tuple[Equations | None, list[str]]:
    """The equations between the displacements of a body, and sentences on them.

    Nodes that no element uses have displacements, too, which follow from those that the
    equations give them.

    Parameters
    ----------
    whole : the mesh with the nodes that no element uses [m]
    mesh : the mesh without them
    length : of one unit of the file [m]

    Raises
    ------
    InputError : an equation resists a rigid motion of the body.
    """
    ties, notes = tie_equations(mesh, imported.ties, length)
    found = _of_file(imported.equations, whole, mesh)
    if found is not None:
        count = len(imported.equations)
        held = np.unique(found.matrix.indices // mesh.dimension)
        notes.append(f"{count} equations of the file hold {len(held)} nodes")
    given = [part for part in (found, ties) if part is not None]
    if not given:
        return None, notes
    return Equations(
        sp.csr_matrix(sp.vstack([part.matrix for part in given])),
        np.concatenate([part.dependent for part in given]),
    ), notes


def held_nodes(
    equations: Equations | None, mesh: Mesh, ties: Sequence[RawTie]
) -> Indices:
    """The nodes that equations hold, and those of the surfaces of ties."""
    if equations is None:
        return np.zeros(0, np.int64)
    labels = {n for tie in ties for n in tie.slave_nodes}
    labels |= {n for tie in ties for face in (*tie.slave, *tie.master) for n in face}
    tied = np.flatnonzero(np.isin(mesh.labels, np.fromiter(labels, np.int64)))
    return np.union1d(tied, equations.matrix.indices // mesh.dimension)


def nodes_of(equations: Equations | None, dimension: int) -> list[Indices]:
    """The nodes that each equation holds together."""
    if equations is None:
        return []
    parts = np.split(equations.matrix.indices, equations.matrix.indptr[1:-1])
    return [np.unique(part.astype(np.int64) // dimension) for part in parts]


def _of_file(
    equations: Sequence[RawEquation], whole: Mesh, mesh: Mesh
) -> Equations | None:
    if not equations:
        return None
    d = mesh.dimension
    row = {int(label): i for i, label in enumerate(whole.labels)}
    known = {int(label): i for i, label in enumerate(mesh.labels)}
    index: list[tuple[int, int]] = []
    values: list[float] = []
    preferred = []
    for i, equation in enumerate(equations):
        first = -1
        for label, shares in equation.terms:
            for axis in range(d):
                if shares[axis]:
                    index.append((i, row[label] * d + axis))
                    values.append(shares[axis])
            if first < 0 and any(shares[:d]):
                first = row[label] * d + int(np.argmax(np.abs(shares[:d])))
        preferred.append(first)
    rows, columns = np.array(index).reshape(-1, 2).T
    shape = (len(equations), whole.positions.size)
    matrix = sp.csr_matrix((values, (rows, columns)), shape=shape)
    free = {row[n] * d + a for n in row if n not in known for a in range(d)}
    given = solved(matrix, np.array(preferred), free)
    given = {dof: found for dof, found in given.items() if dof not in free}
    number = np.full(whole.positions.size, -1)
    for label, i in known.items():
        number[row[label] * d : row[label] * d + d] = np.arange(i * d, i * d + d)
    return _checked(given, number, equations, mesh)


def _checked(
    given: dict[int, tuple[int, dict[int, float]]],
    number: Indices,
    equations: Sequence[RawEquation],
    mesh: Mesh,
) -> Equations | None:
    """The equations by the unknowns of the mesh that they give."""
    if not given:
        return None
    i, j, v = [], [], []
    for k, (dof, (_, row)) in enumerate(given.items()):
        i += [k] * (len(row) + 1)
        j += [dof, *row]
        v += [1.0, *(-share for share in row.values())]
    matrix = sp.csr_matrix((v, (i, number[j])), shape=(len(given), mesh.positions.size))
    size = float(np.ptp(mesh.positions, axis=0).max())
    bare = FiniteElementModel(
        mesh.positions, None, sp.csr_matrix((mesh.positions.size,) * 2), {}, ()
    )
    rigid = bare.rigid_body_modes(np.pad(mesh.positions.mean(axis=0), (0, 1))[:3])
    rigid[:, mesh.dimension :] /= size
    left = np.abs(matrix @ rigid).max(axis=1)
    worst = int(np.argmax(left / np.asarray(abs(matrix).sum(axis=1)).ravel()))
    if left[worst] > _RIGID * abs(matrix[worst]).sum():
        source = list(given.values())[worst][0]
        raise InputError(
            "an equation resists a rigid motion of the body: it is a support, or joins "
            "nodes that are apart without following their rotation",
            place=equations[source].place,
            expected="equations that a free body meets; geometry.ignore leaves them "
            'out: ["EQUATION"], ["MPC"], ["CE"] or ["CP"]',
        )
    dependent = number[np.fromiter(given, np.int64, len(given))]
    return Equations(matrix, dependent)
