"""Shells, springs and solids of structures whose nodes have six degrees of freedom."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import analytic_norm, number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ..beams.element import translate_motion
from ..elements.finite_element_model import BeamOutline
from ..elements.material_points import InertiaPoints
from ..elements.solid_mesh import element_batches, mesh_matrices
from ..mesh.connections import RawShell, RawSpring
from ..mesh.materials import ElasticMaterial
from ..mesh.mesh import Mesh
from ..mesh.unit_systems import UnitSystem
from .bar_nodes import BarNodes
from .shell_elements import ShellBatch, ShellLaws, shell_batch

Indices = NDArray[np.int64]

#: Relative area below which elements have none; relative moment above which the force
#: of a spring rotates a rigid body.
_FLAT, _TURNING = 1e-9, 1e-6
#: Number of elements of a batch.
_AT_ONCE = 4000


@dataclass(frozen=True, eq=False)
class NodeMotion:
    """Motion of nodes by the degrees of freedom.

    Attributes
    ----------
    matrix : (6 n, ndof) displacement and rotation of every node of the mesh
    """

    matrix: sp.csr_matrix

    def by_dofs(self, stiffness: sp.spmatrix) -> sp.csr_matrix:
        """A matrix (6 n, 6 n) as (ndof, ndof)."""
        return sp.csr_matrix(self.matrix.T @ stiffness @ self.matrix)


def node_motion(nodes: BarNodes) -> NodeMotion:
    """The motion of all nodes."""
    n, ndof = len(nodes.row), int(nodes.table.max()) + 1
    rows, columns = np.nonzero(nodes.table >= 0)
    parts = [(np.ones(len(rows)), 6 * rows + columns, nodes.table[rows, columns])]
    for label in {*nodes.owner, *nodes.partly_dependent, *nodes.means}:
        matrix, dofs = nodes.motion(label, nodes.place(label))
        row = nodes.row[label]
        own = nodes.table[row]
        follow = ~np.isin(dofs, own[own >= 0]) if label not in nodes.owner else None
        if follow is not None:
            matrix, dofs = matrix[:, follow], dofs[follow]
        index = 6 * row + np.repeat(np.arange(6), len(dofs))
        parts.append((matrix.ravel(), index, np.tile(dofs, 6)))
    values, i, j = (np.concatenate(x) for x in zip(*parts, strict=True))
    return NodeMotion(sp.csr_matrix((values, (i, j)), shape=(6 * n, ndof)))


def _batches(
    shells: tuple[RawShell, ...], nodes: BarNodes, units: UnitSystem
) -> Iterator[tuple[Indices, ShellBatch]]:
    """Shell elements of one kind with the rows of their nodes.

    Raises
    ------
    InputError : an element has no area or no axis.
    """
    stress = units.mass / units.length / units.time**2
    density = units.mass / units.length**3
    kinds = dict.fromkeys(shell.kind for shell in shells)
    for kind in kinds:
        own = [shell for shell in shells if shell.kind == kind]
        for start in range(0, len(own), _AT_ONCE):
            some = own[start : start + _AT_ONCE]
            rows = np.array([[nodes.row[n] for n in s.nodes] for s in some], np.int64)
            corners = nodes.mesh.positions[rows]
            _check_area(some, corners.real)
            laws = _laws(some, corners, stress, units.length, density)
            yield rows, shell_batch(kind, corners, laws)


def _check_area(shells: list[RawShell], corners: Array) -> None:
    first, second = corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0]
    areas = [np.cross(first, second)]
    for k in range(1, corners.shape[1] if corners.shape[1] > 3 else 1):
        following = np.roll(corners, -k, axis=1)
        areas.append(
            np.cross(
                following[:, 1] - following[:, 0], following[:, -1] - following[:, 0]
            )
        )
    size = np.ptp(corners, axis=1).max(axis=1) ** 2
    corner = np.array([np.einsum("ea,ea->e", a, sum(areas)) for a in areas])
    whole = np.linalg.norm(sum(areas), axis=1)
    # no shear flow of finite energy balances at a straight corner of a panel
    least = _FLAT if shells[0].kind == "panel" else -_FLAT
    bad = (whole <= _FLAT * size) | (corner < least * size * whole).any(axis=0)
    if bad.any():
        shell = shells[int(np.flatnonzero(bad)[0])]
        raise InputError(
            f"shell {shell.label} has no area or is not convex",
            place=shell.place,
            expected="corners in order around a convex element",
        )


def _laws(
    shells: list[RawShell],
    corners: Array,
    stress: float,
    length: float,
    density: float,
) -> ShellLaws:
    scaled = {id(s.section): s.section.scaled(stress, length, density) for s in shells}
    sections = [scaled[id(s.section)] for s in shells]
    edges = corners[:, 1] - corners[:, 0]
    normals = np.cross(edges, corners[:, -1] - corners[:, 0])
    if corners.shape[1] == 4:
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals = normals / analytic_norm(normals, axis=1, keepdims=True)
    edges = edges - np.einsum("ea,ea->e", edges, normals)[:, None] * normals
    angles = np.array([s.angle for s in shells])[:, None]
    axis = np.cos(angles) * edges + np.sin(angles) * np.cross(normals, edges)
    for k, shell in enumerate(shells):
        if shell.axis is None:
            continue
        given = np.array(shell.axis)
        given = given - (given @ normals[k]) * normals[k]
        if not np.linalg.norm(given.real) > 1e-6 * np.linalg.norm(shell.axis):
            raise InputError(
                f"the material axis of shell {shell.label} is perpendicular to it",
                place=shell.place,
                expected="a system whose x axis has a projection on the element",
            )
        axis[k] = given
    return ShellLaws(
        membrane=np.array([s.membrane for s in sections]),
        coupling=np.array([s.coupling for s in sections]),
        bending=np.array([s.bending for s in sections]),
        shear=np.array([s.shear for s in sections]),
        masses=np.array([s.masses for s in sections]),
        thickness=np.array([s.thickness for s in sections]),
        axis=axis,
        flexural=np.array([s.flexural for s in sections]),
    )


def shell_matrices(
    shells: tuple[RawShell, ...], nodes: BarNodes, motion: NodeMotion, units: UnitSystem
) -> tuple[sp.csr_matrix, list[InertiaPoints]]:
    """Stiffness of the shells, and the particles that carry their mass."""
    size = 6 * len(nodes.row)
    total = sp.csr_matrix((size, size))
    points = []
    for rows, batch in _batches(shells, nodes, units):
        dofs = (6 * rows[:, :, None] + np.arange(6)).reshape(len(rows), -1)
        width = dofs.shape[1]
        i, j = np.repeat(dofs, width, axis=1), np.tile(dofs, (1, width))
        entries = (batch.stiffness.ravel(), (i.ravel(), j.ravel()))
        total = total + sp.csr_matrix(entries, shape=(size, size))
        count = batch.masses.shape[1]
        columns = np.repeat(np.repeat(dofs, count, axis=0), 3, axis=0)
        starts = np.arange(0, columns.size + 1, width)
        moves = [
            sp.csr_matrix(
                (part.ravel(), columns.ravel(), starts), shape=(len(columns), size)
            )
            @ motion.matrix
            for part in (batch.displacement, batch.rotation)
        ]
        points.append(
            InertiaPoints(
                batch.positions.reshape(-1, 3),
                batch.masses.ravel(),
                batch.inertias.reshape(-1, 3, 3),
                *moves,
            )
        )
    return motion.by_dofs(total), points


def shell_outlines(
    shells: tuple[RawShell, ...], nodes: BarNodes, motion: NodeMotion, length: float
) -> Iterator[BeamOutline]:
    """Return every shell as a plate between two of its edges, for pictures."""
    ends_of = np.array(
        [
            [[nodes.row[s.nodes[k]] for k in end] for end in _plate_ends(s)]
            for s in shells
        ],
        np.int64,
    ).reshape(-1, 2)
    rows_of = 6 * ends_of[:, None, :] + np.arange(6)[:, None]
    mean = sp.csr_matrix(
        (
            np.full(rows_of.size, 0.5),
            rows_of.ravel(),
            np.arange(0, rows_of.size + 1, 2),
        ),
        shape=(rows_of.size // 2, motion.matrix.shape[0]),
    )
    moves = sp.csr_matrix(mean @ motion.matrix)
    for number, shell in enumerate(shells):
        rows = np.array([nodes.row[n] for n in shell.nodes])
        corners = nodes.mesh.positions[rows]
        normal = np.cross(corners[1] - corners[0], corners[-1] - corners[0])
        normal /= np.linalg.norm(normal)
        across = corners[1] - corners[0]
        axes, halves, places = [], [], []
        for a, b in _plate_ends(shell):
            edge = corners[b] - corners[a]
            size = float(np.linalg.norm(edge))
            axes.append(
                [(edge if size else across) / (size or np.linalg.norm(across)), normal]
            )
            halves.append([size / 2, shell.section.thickness * length / 2])
            places.append((corners[a] + corners[b]) / 2)
        yield BeamOutline(
            np.array(places),
            np.array(axes),
            np.array(halves),
            sp.csr_matrix(moves[12 * number : 12 * number + 12]),
        )


def _plate_ends(shell: RawShell) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the corners of two edges that face each other; one may be a point."""
    return ((0, 1), (3, 2)) if len(shell.nodes) == 4 else ((0, 1), (2, 2))


def spring_matrix(
    springs: tuple[RawSpring, ...],
    nodes: BarNodes,
    units: UnitSystem,
    ndof: int,
) -> sp.csr_matrix:
    """Stiffness of springs between nodes.

    Raises
    ------
    InputError : the force of a spring would turn a free body.
    """
    total = sp.csr_matrix((ndof, ndof))
    force = units.mass / units.time**2
    for spring in springs:
        first, last = spring.nodes
        assert last is not None
        moved = []
        for node in (first, last):
            place = nodes.place(node)
            if spring.location is not None:
                place = units.length * spring.location
            matrix, dofs = nodes.motion(node, place)
            moved.append((matrix, dofs))
        if spring.components is None:
            turned = np.kron(np.eye(2), spring.axes[0])
            rows = [(turned @ matrix, dofs) for matrix, dofs in moved]
            scale = np.repeat([force, force * units.length**2], 3)
            stiffness = np.array(spring.stiffness) * scale
        else:
            rows, ways = [], []
            for axes, k, (matrix, dofs) in zip(
                spring.axes, spring.components, moved, strict=True
            ):
                row = np.zeros(6, number_type(axes))
                row[3 * (k // 3) : 3 * (k // 3) + 3] = axes[k % 3]
                ways.append(row)
                rows.append((row[None] @ matrix, dofs))
            kinds = {k // 3 for k in spring.components}
            stiffness = np.array(spring.stiffness) * force
            if kinds == {1}:
                stiffness = stiffness * units.length**2
            _check_free(spring, ways, nodes)
        relative = np.hstack([rows[0][0], -rows[1][0]])
        dofs = np.concatenate([rows[0][1], rows[1][1]])
        k = relative.T @ (stiffness[:, None] * relative)
        i, j = np.repeat(dofs, len(dofs)), np.tile(dofs, len(dofs))
        total = total + sp.csr_matrix((k.ravel(), (i, j)), shape=total.shape)
    return total


def _check_free(spring: RawSpring, ways: list[Array], nodes: BarNodes) -> None:
    """Check that a spring of components has no force in rigid motion."""
    first, last = (nodes.place(n) for n in spring.nodes if n is not None)
    rigid = ways[0] - ways[1] @ translate_motion(last - first)
    size = np.ptp(nodes.mesh.positions.real, axis=0).max()
    scale = np.array([1.0] * 3 + [size if any(w[:3].any() for w in ways) else 1.0] * 3)
    if (np.abs(rigid) > _TURNING * scale).any():
        raise InputError(
            f"the spring {spring.label} joins components of apart nodes, so that its "
            "forces would turn or move a free body",
            place=spring.place,
            expected="nodes at one place, the direction of their line, or CBUSH",
        )


def solid_matrices(
    mesh: Mesh,
    materials: Mapping[str | None, ElasticMaterial],
    motion: NodeMotion,
) -> tuple[sp.csr_matrix, list[InertiaPoints]]:
    """Stiffness of solid elements, and the particles that carry their mass."""
    n = len(mesh.positions)
    _, stiffness = mesh_matrices(mesh, materials, "solid", incompatible_modes=True)
    entries = stiffness.tocoo()
    i, j = (6 * (x // 3) + x % 3 for x in (entries.row, entries.col))
    total = sp.csr_matrix((entries.data, (i, j)), shape=(6 * n, 6 * n))
    points = []
    for block in mesh.blocks:
        density = materials[block.material].density
        for batch in element_batches(mesh, block, "mass"):
            ne, m = batch.nodes.shape
            count = batch.measures.shape[1]
            values = np.broadcast_to(batch.values, (ne, count, m))
            places = values @ mesh.positions[batch.nodes]
            shares = np.repeat(values.reshape(-1, m), 3, axis=0)
            nodes = np.repeat(np.repeat(batch.nodes, count, axis=0), 3, axis=0)
            columns = 6 * nodes + np.tile(np.arange(3), ne * count)[:, None]
            starts = np.arange(0, columns.size + 1, m)
            shape = (len(columns), 6 * n)
            rows = sp.csr_matrix((shares.ravel(), columns.ravel(), starts), shape=shape)
            points.append(
                InertiaPoints(
                    places.reshape(-1, 3),
                    density * batch.measures.ravel(),
                    np.zeros((ne * count, 3, 3)),
                    sp.csr_matrix(rows @ motion.matrix),
                    sp.csr_matrix((len(columns), motion.matrix.shape[1])),
                )
            )
    return motion.by_dofs(total), points


def merge_particles(points: list[InertiaPoints]) -> InertiaPoints:
    """Merge the particles of several kinds of elements."""
    return InertiaPoints(
        np.concatenate([p.positions for p in points]),
        np.concatenate([p.masses for p in points]),
        np.concatenate([p.inertias for p in points]),
        sp.csr_matrix(sp.vstack([p.displacement for p in points])),
        sp.csr_matrix(sp.vstack([p.rotation for p in points])),
        *(
            np.concatenate([_given_or_zero(getattr(p, name), p) for p in points])
            for name in ("arms", "tangents")
        ),
    )


def _given_or_zero(vectors: Array | None, points: InertiaPoints) -> Array:
    return np.zeros_like(points.positions) if vectors is None else vectors
