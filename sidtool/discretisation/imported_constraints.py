"""Convert couplings, point masses, equations and ties of a mesh file to those of a
body.
"""

from collections.abc import Container, Iterable, Mapping, Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.model import ModelFile

from ..elements.faces import mesh_surface
from ..elements.finite_element_model import FiniteElementModel
from ..elements.mortar_ties import dependent_unknowns, tie_equations
from ..mesh.connections import Coupling, Equations, PointMass, RawEquation, RawTie
from ..mesh.imported_mesh import ImportedMesh, RawCoupling, RawMass
from ..mesh.mesh import Mesh
from ..mesh.unit_systems import UnitSystem
from .bar_nodes import BarNodes
from .structure_elements import node_motion

Indices = NDArray[np.int64]

#: Tolerance of equations for rigid motions, relative to coefficients and size.
_RIGID_MOTION_TOLERANCE = 1e-7


def body_couplings(
    imported: ImportedMesh, whole: Mesh, mesh: Mesh, model: ModelFile
) -> tuple[Coupling, ...]:
    """Return the couplings of a file in terms of the nodes of its elements.

    Rigid ones with one reference node are one piece. A reference node that elements
    use belongs to its rigid piece.

    Parameters
    ----------
    whole : the mesh with the nodes that no element uses
    mesh : the mesh without them

    Raises
    ------
    InputError : a coupling has no node of the body, an undefined node, a reference node
        of another coupling, or the mean motion of nodes without elements.
    """
    row = {int(label): i for i, label in enumerate(mesh.labels)}
    place = {int(label): i for i, label in enumerate(whole.labels)}
    references = {c.reference for c in imported.couplings}
    for coupling in imported.couplings:
        _check_members(coupling, place, row)
    result = []
    for group in _couplings_by_reference(imported.couplings):
        first = group[0]
        labels = dict.fromkeys(n for c in group for n in c.nodes)
        if first.rigid and first.reference in row:
            labels[first.reference] = None
        chained = [n for n in labels if n in references and n != first.reference]
        nodes = np.unique([row[n] for n in labels if n in row]).astype(np.int64)
        if chained or not nodes.size:
            raise InputError(
                f"{first.name} holds node {chained[0]}, the reference of another"
                if chained
                else f"{first.name} holds no node of an element",
                place=first.place,
                expected="couplings of nodes of elements",
            )
        where = None
        if first.reference is not None and first.reference in place:
            where = np.zeros(3, number_type(whole.positions))
            where[: whole.dimension] = whole.positions[place[first.reference]]
        markers = tuple(
            name
            for name, marker in model.markers.items()
            if marker.tie is None
            and marker.mesh_node is not None
            and marker.mesh_node == first.reference
            and marker.mesh_node not in row
        )
        weights = _node_weights(first, mesh, row)
        result.append(Coupling(first.name, first.rigid, nodes, where, markers, weights))
    return tuple(result)


def _check_members(
    coupling: RawCoupling, defined: Container[int], used: Container[int]
) -> None:
    if not {*"123"} <= set(coupling.directions):
        raise InputError(
            f"{coupling.name} holds the directions {coupling.directions}",
            place=coupling.place,
            expected="1, 2 and 3 with or without rotations",
        )
    named = (*coupling.nodes, coupling.reference)
    undefined = [n for n in named if n is not None and n not in defined]
    free = [] if coupling.rigid else [n for n in coupling.nodes if n not in used]
    if undefined or (free and len(free) < len(coupling.nodes)):
        node = (undefined or free)[0]
        what = "is not defined" if undefined else "no element of the body uses"
        raise InputError(
            f"{coupling.name} names node {node}, which {what}",
            place=coupling.place,
            expected="nodes of this file"
            if undefined
            else "a mean over nodes of elements alone",
        )


def _node_weights(
    coupling: RawCoupling, mesh: Mesh, row: Mapping[int, int]
) -> sp.csr_matrix | None:
    """Return the weights of the nodes of a mean, or the mass matrix of their
    surface.
    """
    n = len(mesh.positions)
    own = [(row[label], i) for i, label in enumerate(coupling.nodes) if label in row]
    nodes = np.array([place for place, _ in own], np.int64)
    if coupling.weights:
        values = [coupling.weights[i] for _, i in own]
        return sp.csr_matrix((values, (nodes, nodes)), shape=(n, n))
    surface = mesh_surface(mesh, nodes) if coupling.by_area else None
    return surface.mass if surface is not None and surface.mass.nnz else None


def _couplings_by_reference(
    couplings: Sequence[RawCoupling],
) -> Iterable[list[RawCoupling]]:
    groups: dict[object, list[RawCoupling]] = {}
    for i, coupling in enumerate(couplings):
        shared = coupling.rigid and coupling.reference is not None
        groups.setdefault(coupling.reference if shared else -1 - i, []).append(coupling)
    return groups.values()


def body_masses(
    imported: ImportedMesh,
    couplings: Sequence[Coupling],
    mesh: Mesh,
    units: UnitSystem,
) -> tuple[PointMass, ...]:
    """The point masses of a file in SI units.

    Raises
    ------
    InputError : a mass is at a node without elements and couplings, or has inertia at a
        node without rotation.
    """
    row = {int(label): i for i, label in enumerate(mesh.labels)}
    held = {c.reference: c.name for c in reversed(imported.couplings)}
    known = {c.name for c in couplings}
    first = {
        c.reference: c.name for c in reversed(imported.couplings) if c.name in known
    }
    result = []
    for mass in imported.masses:
        coupling = first.get(mass.node) if mass.node in held else None
        _check_point_mass(mass, coupling is not None, mass.node in row)
        xx, yy, zz, xy, yz, zx = mass.inertia
        tensor = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
        result.append(
            PointMass(
                None if coupling is not None else row[mass.node],
                coupling,
                mass.mass * units.mass,
                np.array(mass.offset) * units.length,
                tensor * (units.mass * units.length**2),
            )
        )
    return tuple(result)


def _check_point_mass(mass: RawMass, coupled: bool, on_element: bool) -> None:
    if not coupled and not on_element:
        raise InputError(
            f"the mass at node {mass.node} is held by no element and no coupling",
            place=mass.place,
            expected="a node of an element, or the reference node of a coupling",
        )
    if not coupled and (any(mass.offset) or any(mass.inertia)):
        raise InputError(
            f"the mass at node {mass.node} has inertia or an offset, and the node of a "
            "solid does not turn",
            place=mass.place,
            expected="a plain mass, or one at the reference node of a coupling",
        )


def body_equations(
    imported: ImportedMesh, whole: Mesh, mesh: Mesh, length: float
) -> tuple[Equations | None, list[Diagnostic]]:
    """Return the equations between displacements of a body, and their diagnostics.
    Displacements of nodes without elements follow from the equations.

    Parameters
    ----------
    whole : the mesh with the nodes that no element uses [m]
    mesh : the mesh without them
    length : of one unit of the file [m]

    Raises
    ------
    InputError : an equation resists a rigid motion of the body.
    """
    ties, found = tie_equations(mesh, imported.ties, length)
    equations = _file_equations(imported.equations, whole, mesh)
    if equations is not None:
        count = len(imported.equations)
        held = np.unique(equations.matrix.indices // mesh.dimension)
        found.append(diagnose("N133", count=count, nodes=len(held)))
    given = [part for part in (equations, ties) if part is not None]
    if not given:
        return None, found
    return Equations(
        sp.csr_matrix(sp.vstack([part.matrix for part in given])),
        np.concatenate([part.dependent for part in given]),
    ), found


def nodes_in_equations(
    equations: Equations | None, mesh: Mesh, ties: Sequence[RawTie]
) -> Indices:
    """Return the nodes in equations, and those of the surfaces of ties."""
    if equations is None:
        return np.zeros(0, np.int64)
    labels = {n for tie in ties for n in tie.slave_nodes}
    labels |= {n for tie in ties for face in (*tie.slave, *tie.master) for n in face}
    tied = np.flatnonzero(np.isin(mesh.labels, np.fromiter(labels, np.int64)))
    return np.union1d(tied, equations.matrix.indices // mesh.dimension)


def nodes_of_equations(equations: Equations | None, dimension: int) -> list[Indices]:
    """Return the nodes that each equation connects."""
    if equations is None:
        return []
    parts = np.split(equations.matrix.indices, equations.matrix.indptr[1:-1])
    return [np.unique(part.astype(np.int64) // dimension) for part in parts]


def _file_equations(
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
    given = dependent_unknowns(matrix, np.array(preferred), free)
    given = {dof: found for dof, found in given.items() if dof not in free}
    number = np.full(whole.positions.size, -1)
    for label, i in known.items():
        number[row[label] * d : row[label] * d + d] = np.arange(i * d, i * d + d)
    unmarked = FiniteElementModel(
        mesh.positions, None, sp.csr_matrix((mesh.positions.size,) * 2), {}, ()
    )
    return _check_equations(given, number, equations, unmarked)


def _check_equations(
    given: dict[int, tuple[int, dict[int, float]]],
    number: Indices,
    equations: Sequence[RawEquation],
    body: FiniteElementModel,
) -> Equations | None:
    """Return the equations by the unknowns of the body that they give.

    Parameters
    ----------
    given : unknown -> the equation that gives it, and its row of the other unknowns
    number : degrees of freedom of the unknowns

    Raises
    ------
    InputError : an equation resists a rigid motion.
    """
    if not given:
        return None
    i, j, v = [], [], []
    for k, (dof, (_, row)) in enumerate(given.items()):
        i += [k] * (len(row) + 1)
        j += [dof, *row]
        v += [1.0, *(-share for share in row.values())]
    matrix = sp.csr_matrix((v, (i, number[j])), shape=(len(given), body.ndof))
    size = float(np.ptp(body.positions.real, axis=0).max())
    rigid = body.rigid_body_modes(np.pad(body.positions.mean(axis=0), (0, 1))[:3])
    rigid[:, body.dimension :] /= size
    left = np.abs(matrix @ rigid).max(axis=1)
    worst = int(np.argmax(left / np.asarray(abs(matrix).sum(axis=1)).ravel()))
    if left[worst] > _RIGID_MOTION_TOLERANCE * abs(matrix[worst]).sum():
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


def structure_equations(
    equations: Sequence[RawEquation],
    nodes: BarNodes,
    body: FiniteElementModel,
    length: float,
) -> tuple[Equations | None, list[Diagnostic]]:
    """Return the equations between displacements and rotations of a structure.

    What no element resists, as the motion of nodes without elements, follows from the
    equations.

    Parameters
    ----------
    body : without equations
    length : of one unit of the file [m]

    Raises
    ------
    InputError : an equation resists a rigid motion of the body, or names an unknown
        node.
    """
    if not equations:
        return None, []
    motion = node_motion(nodes).matrix
    index: list[tuple[int, int]] = []
    values: list[float] = []
    for i, equation in enumerate(equations):
        for terms, first, factor in (
            (equation.terms, 0, 1.0),
            (equation.rotations, 3, length),
        ):
            for label, shares in terms:
                if label not in nodes.row:
                    raise InputError(
                        f"an equation names node {label}, which is not defined",
                        place=equation.place,
                        expected="nodes of this file",
                    )
                row = 6 * nodes.row[label] + first
                index += [(i, row + axis) for axis in range(3) if shares[axis]]
                values += [factor * share for share in shares if share]
    rows, columns = np.array(index, np.int64).reshape(-1, 2).T
    shape = (len(equations), motion.shape[0])
    named = sp.csr_matrix((values, (rows, columns)), shape=shape)
    free = np.diff(motion.indptr) == 0
    matrix = sp.csr_matrix(sp.hstack([named @ motion, named[:, free]]))
    matrix.eliminate_zeros()
    unresisted = range(body.ndof, matrix.shape[1])
    none = np.full(len(equations), -1)
    given = dependent_unknowns(matrix, none, unresisted)
    given = {dof: found for dof, found in given.items() if dof not in unresisted}
    held = {n for e in equations for n, _ in (*e.terms, *e.rotations)}
    note = diagnose("N133", count=len(equations), nodes=len(held))
    number = np.arange(body.ndof)
    return _check_equations(given, number, equations, body), [note]
