"""Ties between surfaces of a mesh by the mortar method, as linear equations.

The displacement of the slave equals that of the master in the mean over every function
of the slave,

    integral of N_s (u_s - u_m) dA = 0,

which is solved for the nodes of the slave. Where both meshes match they move as one;
elsewhere a uniform stress passes. At a point off the master its displacement includes
the rotation of the surface, so that the body can rotate rigidly if the surfaces have a
gap.

Dependent unknowns are eliminated by Gaussian elimination row by row, for equations
each of which holds few unknowns.

Source: C. Bernardi, Y. Maday, A. T. Patera, "A new nonconforming approach to domain
decomposition: the mortar element method", 1994; M. A. Puso, "A 3D mortar method for
solid mechanics", Int. J. Numer. Methods Eng. 59, 2004 (integrals over common parts).
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from sidtool.formats.base.complex_step import number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..mesh.connections import Equations, RawTie
from ..mesh.mesh import Mesh
from ..mesh.reference_elements import quadrature_rule
from .faces import (
    FACE_KINDS,
    FaceGroup,
    area_elements,
    common_simplices,
    face_functions,
    nearest_faces,
    simplex_quadrature,
)

Indices = NDArray[np.int64]

#: Nodes are tied if this share of their mean square lies on the master.
_MIN_COVERED_SHARE = 0.02
#: Default distance of tied surfaces, relative to the size of a face.
_DEFAULT_TIE_DISTANCE = 0.05
#: Shares of nodes below this are rounding.
_SHARE_ROUNDING = 1e-11
#: Movement of the nodes for differences of ties, relative to the size of the mesh, and
#: weights of the central difference of fourth order by multiples of it.
_DIFFERENCE_STEP = 1e-5
_DIFFERENCE = {1: 2 / 3, -1: -2 / 3, 2: -1 / 12, -2: 1 / 12}

#: Coefficients by unknown; complex if they carry a step.
Row = dict[int, Any]
#: Coefficients below this fraction of the largest are rounding.
_ROUNDING_OF_ELIMINATION = 1e-11
#: The preferred unknown is used if its coefficient has this fraction of the largest.
_PIVOT_SHARE = 0.1


class _TieSide:
    """Faces of a tie by their kinds.

    Raises
    ------
    InputError : a face belongs to no element.
    """

    def __init__(self, mesh: Mesh, faces: Iterable[tuple[int, ...]], tie: RawTie):
        row = {int(label): i for i, label in enumerate(mesh.labels)}
        groups: dict[int, list[list[int]]] = {}
        for face in faces:
            groups.setdefault(len(face), []).append([row[n] for n in face])
        self.groups = [
            FaceGroup(
                FACE_KINDS[mesh.dimension, count],
                np.array(nodes, np.int64),
                mesh.positions[np.array(nodes)],
            )
            for count, nodes in groups.items()
        ]
        self.nodes = (
            np.unique(np.concatenate([g.nodes.ravel() for g in self.groups]))
            if self.groups
            else np.zeros(0, np.int64)
        )


def tie_equations(
    mesh: Mesh, ties: Sequence[RawTie], length: float
) -> tuple[Equations | None, list[Diagnostic]]:
    """Return the equations of all ties, and their diagnostics.

    A node is the slave of the first tie that contains it. If positions carry an
    imaginary step, that of the equations is a difference: common parts of faces are
    found by comparisons.

    Parameters
    ----------
    mesh : [m], without free nodes
    length : of one unit of the file [m]

    Raises
    ------
    InputError : a tie has no nodes, or other ones as soon as the mesh moves.
    """
    places, step = mesh.positions.real, mesh.positions.imag
    equations, found = _equations_of(replace(mesh, positions=places), ties, length)
    if equations is None or not step.any():
        return equations, found
    factor = _DIFFERENCE_STEP * np.ptp(places, axis=0).max() / np.abs(step).max()
    matrix = equations.matrix.astype(complex)
    for multiple, weight in _DIFFERENCE.items():
        moved = replace(mesh, positions=places + multiple * factor * step)
        near, _ = _equations_of(moved, ties, length)
        if near is None or not np.array_equal(near.dependent, equations.dependent):
            raise InputError(
                f"the ties {', '.join(tie.name for tie in ties)} hold other nodes as "
                "soon as the mesh moves",
                expected="surfaces whose ends do not cross, for derivatives",
            )
        matrix = matrix + (1j * weight / factor) * near.matrix
    return replace(equations, matrix=sp.csr_matrix(matrix)), found


def _equations_of(
    mesh: Mesh, ties: Sequence[RawTie], length: float
) -> tuple[Equations | None, list[Diagnostic]]:
    """Return the equations of all ties of a mesh without a step, see
    `tie_equations`.
    """
    found: list[Diagnostic] = []
    matrices, dependent = [], []
    taken = np.zeros(len(mesh.positions), bool)
    for tie in ties:
        try:
            tied, rows, of_tie = _tie_matrix(mesh, tie, length, taken)
        except InputError as error:
            raise InputError(
                error.problem, place=tie.place, expected=error.expected
            ) from None
        taken[tied] = True
        found += of_tie
        matrices.append(rows)
        dependent.append(_dof_numbers(tied, mesh.dimension))
    if not matrices:
        return None, found
    matrix = sp.csr_matrix(sp.vstack(matrices))
    return Equations(matrix, np.concatenate(dependent)), found


def _dof_numbers(nodes: Indices, dimension: int) -> Indices:
    """Component by component."""
    return (nodes[None] * dimension + np.arange(dimension)[:, None]).ravel()


def _tie_matrix(
    mesh: Mesh, tie: RawTie, length: float, taken: NDArray[np.bool_]
) -> tuple[Indices, sp.csr_matrix, list[Diagnostic]]:
    slave, master = _TieSide(mesh, tie.slave, tie), _TieSide(mesh, tie.master, tie)
    reach = _search_distance(master, tie, length)
    free = ~taken
    free[master.nodes] = False
    if slave.groups:
        tied, rows, gap = _mortar_tie(mesh, slave, master, reach, free)
        every = slave.nodes
    else:
        row = {int(label): i for i, label in enumerate(mesh.labels)}
        every = np.array(sorted({row[n] for n in tie.slave_nodes if n in row}))
        tied, rows, gap = _nodewise_tie(mesh, every, master, reach, free)
    if not tied.size:
        raise InputError(
            f"the tie {tie.name} holds no node: no slave within {reach:.3g} m of its "
            "master",
            expected="surfaces that touch, or a larger POSITION TOLERANCE",
        )
    left = np.count_nonzero(free[every]) - tied.size
    name, faces = f"tie {tie.name}", len(tie.master)
    found = [diagnose("N122", name, nodes=int(tied.size), faces=faces, gap=float(gap))]
    if left:
        found.append(diagnose("N124", name, count=int(left)))
    return tied, rows, found


def _search_distance(master: _TieSide, tie: RawTie, length: float) -> float:
    if tie.tolerance is not None:
        return tie.tolerance * length
    return (
        _DEFAULT_TIE_DISTANCE
        * 2
        * float(np.mean(np.concatenate([g.radii for g in master.groups])))
    )


def _nodewise_tie(
    mesh: Mesh, nodes: Indices, master: _TieSide, reach: float, free: NDArray[np.bool_]
) -> tuple[Indices, sp.csr_matrix, float]:
    """Tie every node to the nearest point of the master."""
    nodes = nodes[free[nodes]]
    group, row, parameters = nearest_faces(master.groups, mesh.positions[nodes])
    master_rows = _master_rows(
        mesh, master, group, row, parameters, mesh.positions[nodes]
    )
    rows, gaps = master_rows
    near = gaps <= reach
    tied, d = nodes[near], mesh.dimension
    own = _selection_matrix(_dof_numbers(tied, d), mesh.positions.size)
    chosen = sp.vstack([part[near] for part in rows])
    return tied, sp.csr_matrix(own - chosen), float(gaps[near].max(initial=0.0))


def _mortar_tie(
    mesh: Mesh, slave: _TieSide, master: _TieSide, reach: float, free: NDArray[np.bool_]
) -> tuple[Indices, sp.csr_matrix, float]:
    n, d = mesh.positions.shape
    whole, square = np.zeros(n), sp.csr_matrix((n, n))
    across = [sp.csr_matrix((n, n * d)) for _ in range(d)]
    widest = 0.0
    for own in slave.groups:
        whole += _squared_function_integrals(own, n)
        for number, other in enumerate(master.groups):
            parts = list(common_simplices(own, other))
            if not parts:
                continue
            quadratures = [simplex_quadrature(simplices) for _, _, simplices in parts]
            counts = [len(weights) for _, weights in quadratures]
            i = np.repeat([pair[0] for pair in parts], counts)
            j = np.repeat([pair[1] for pair in parts], counts)
            place = np.concatenate([points for points, _ in quadratures])
            points, values, tangents = own.at(i, place)
            weights = np.concatenate([w for _, w in quadratures]) * area_elements(
                tangents
            )
            projected = other.nearest(j, points)
            group = np.full(len(j), number)
            rows, gaps = _master_rows(mesh, master, group, j, projected, points)
            near = gaps <= reach
            widest = max(widest, float(gaps[near].max(initial=0.0)))
            p = np.arange(len(i))[:, None] + np.zeros_like(own.nodes[i])
            at = (values.ravel(), (p.ravel(), own.nodes[i].ravel()))
            functions_ = sp.csr_matrix(at, shape=(len(i), n))
            test = sp.csr_matrix(functions_.T @ sp.diags_array(weights * near))
            square = square + test @ functions_
            across = [a + test @ r for a, r in zip(across, rows, strict=True)]
    covered = square.diagonal() > _MIN_COVERED_SHARE * np.maximum(whole, 1e-300)
    tied = np.flatnonzero(covered & free)
    if not tied.size:
        return tied, sp.csr_matrix((0, n * d)), widest
    return tied, _solve_for_tied(square, across, tied), widest


def _solve_for_tied(
    square: sp.csr_matrix, across: list[sp.csr_matrix], tied: Indices
) -> sp.csr_matrix:
    """u_t = D_tt^-1 (M u_m - D_tf u_f), component by component."""
    n, d = square.shape[0], len(across)
    others = np.setdiff1d(np.unique(square[tied].indices), tied)
    factors = splu(sp.csc_matrix(square[tied][:, tied]))
    rows = []
    for axis, part in enumerate(across):
        free = square[tied][:, others] @ _selection_matrix(others * d + axis, n * d)
        loads = sp.csc_matrix(part[tied] - free)
        used = np.unique(loads.nonzero()[1])
        shares = factors.solve(loads[:, used].toarray())
        shares[np.abs(shares) < _SHARE_ROUNDING * np.abs(shares).max(initial=1.0)] = 0.0
        spread = sp.csr_matrix(shares) @ _selection_matrix(used, n * d)
        rows.append(_selection_matrix(tied * d + axis, n * d) - spread)
    return sp.csr_matrix(sp.vstack(rows))


def _squared_function_integrals(faces: FaceGroup, n: int) -> Array:
    """(n,) integral of the squares of the functions of nodes over all faces."""
    shape = {"l": "line", "t": "tri", "q": "quad"}[faces.kind[0]]
    points, weights = quadrature_rule(shape, 5)
    values, slopes = face_functions(faces.kind, points)
    tangents = np.einsum("kmd,gmt->kgdt", faces.points, slopes)
    squares = np.einsum("kg,gm->km", weights * area_elements(tangents), values**2)
    total = np.zeros(n)
    np.add.at(total, faces.nodes, squares)
    return total


def _selection_matrix(columns: Indices, size: int) -> sp.csr_matrix:
    """Rows that pick some unknowns."""
    index = np.arange(len(columns)), columns
    return sp.csr_matrix((np.ones(len(columns)), index), shape=(len(columns), size))


def _master_rows(
    mesh: Mesh,
    master: _TieSide,
    group: Indices,
    row: Indices,
    parameters: Array,
    points: Array,
) -> tuple[list[sp.csr_matrix], Array]:
    """Return rows of the master's motion at points (p, d) beside it, and their
    distances.

    With the surface gradient G of the displacement, the arm r from the surface and the
    normal n, it is u + G r_t - r_n G^T n, which is exact for a rigid motion.

    Returns
    -------
    d matrices (p, ndof), one for every component, and (p,)
    """
    n, d = mesh.positions.shape
    count = len(points)
    rows: list[list[Array]] = [[] for _ in range(d)]
    index: list[tuple[Indices, Indices]] = []
    gaps = np.zeros(count)
    for number, faces in enumerate(master.groups):
        own = np.flatnonzero(group == number)
        at, values, tangents = faces.at(row[own], parameters[own])
        arm = points[own] - at
        gaps[own] = np.linalg.norm(arm, axis=1)
        arm[gaps[own] <= 1e-9 * faces.radii[row[own]]] = 0.0
        gram = np.einsum("pda,pdb->pab", tangents, tangents)
        dual = np.einsum("pda,pab->pdb", tangents, np.linalg.inv(gram))
        slopes = face_functions(faces.kind, parameters[own])[1]
        gradients = np.einsum("pdk,pmk->pmd", dual, slopes)
        flat = np.einsum("pda,pea->pde", tangents, dual)
        along = np.einsum("pde,pe->pd", flat, arm)
        normal = arm - along
        spread = values + np.einsum("pmd,pd->pm", gradients, along)
        nodes = faces.nodes[row[own]]
        where = np.broadcast_to(own[:, None], nodes.shape)
        for a in range(d):
            for b in range(d):
                share = -np.einsum("pm,p->pm", gradients[:, :, a], normal[:, b])
                rows[a].append((share + spread if a == b else share).ravel())
        for b in range(d):
            index.append((where.ravel(), (nodes * d + b).ravel()))
    i = np.concatenate([pair[0] for pair in index])
    j = np.concatenate([pair[1] for pair in index])
    result = []
    for values_ in rows:
        part = sp.csr_matrix((np.concatenate(values_), (i, j)), shape=(count, n * d))
        part.eliminate_zeros()
        result.append(part)
    return result, gaps


def dependent_unknowns(
    matrix: sp.csr_matrix, preferred: Indices, first: Collection[int] = ()
) -> dict[int, tuple[int, Row]]:
    """Return the unknowns that follow from rows (k, n) of ``matrix @ u = 0``.

    Parameters
    ----------
    preferred : (k,) preferred dependent unknown of each row; -1 for none
    first : unknowns that are eliminated before all others

    Returns
    -------
    number of the unknown -> its row, and {other unknown: coefficient}
    """
    matrix = sp.csr_matrix(matrix)
    dependent: dict[int, tuple[int, Row]] = {}
    for i in range(matrix.shape[0]):
        part = slice(matrix.indptr[i], matrix.indptr[i + 1])
        columns, values = matrix.indices[part].tolist(), matrix.data[part].tolist()
        row = dict(zip(columns, values, strict=True))
        size = max(map(abs, row.values()), default=0.0)
        small = _ROUNDING_OF_ELIMINATION * size
        row = _substitute_known(row, dependent, small)
        if not any(abs(share) > small for share in row.values()):
            continue
        pivot = _choose_pivot(row, int(preferred[i]), first)
        scale = -row.pop(pivot)
        dependent[pivot] = i, {c: v / scale for c, v in row.items()}
    for pivot in reversed(dependent):
        i, row = dependent[pivot]
        dependent[pivot] = i, _substitute_known(row, dependent, 0.0)
    return dependent


def _choose_pivot(row: Row, preferred: int, first: Collection[int]) -> int:
    early = {c: v for c, v in row.items() if c in first}
    if early:
        row, preferred = early, -1
    largest = max(row, key=lambda c: abs(row[c]))
    if abs(row.get(preferred, 0.0)) >= _PIVOT_SHARE * abs(row[largest]):
        return preferred
    return largest


def _substitute_known(
    row: Row, dependent: dict[int, tuple[int, Row]], small: float
) -> Row:
    """Return the row after substitution of the dependent unknowns."""
    known = [c for c in row if c in dependent]
    while known:
        for column in known:
            share = row.pop(column)
            for c, v in dependent[column][1].items():
                row[c] = row.get(c, 0.0) + share * v
        known = [c for c in row if c in dependent]
    return {c: v for c, v in row.items() if abs(v) > small or v.imag != 0.0}


def elimination_matrix(matrix: sp.csr_matrix, preferred: Indices) -> sp.csr_matrix:
    """(n, n - r) sparse T: the solutions of ``matrix @ u = 0`` are u = T y."""
    n = matrix.shape[1]
    dependent = dependent_unknowns(matrix, preferred)
    independent = np.setdiff1d(
        np.arange(n), np.fromiter(dependent, np.int64, len(dependent))
    )
    number, kind = np.full(n, -1), number_type(matrix)
    number[independent] = np.arange(independent.size)
    rows, columns = [independent], [np.arange(independent.size)]
    values = [np.ones(independent.size)]
    for pivot, (_, row) in dependent.items():
        rows.append(np.full(len(row), pivot))
        columns.append(number[np.fromiter(row, np.int64, len(row))])
        values.append(np.fromiter(row.values(), kind, len(row)))
    index = np.concatenate(rows), np.concatenate(columns)
    return sp.csr_matrix((np.concatenate(values), index), shape=(n, independent.size))
