"""Meshes of solid elements, and checks before they are integrated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from .jacobians import jacobian_columns, jacobian_determinants
from .reference_elements import reference_element

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ElementBlock:
    """Elements of one kind.

    Attributes
    ----------
    kind : one of `ELEMENT_KINDS`
    nodes : (ne, m) rows of the mesh's positions
    labels : (ne,) element numbers in the file they came from
    material : name of their material, if the mesh names materials
    thickness : of plane elements in the unit of length of the mesh, if it is specified
    formulation : "full_integration" or "incompatible_modes", if it is specified
    """

    kind: str
    nodes: Indices
    labels: Indices
    material: str | None = None
    thickness: float | None = None
    formulation: str | None = None


@dataclass(frozen=True, eq=False)
class Mesh:
    """Nodes, blocks of elements and named node sets.

    Attributes
    ----------
    positions : (n, d) [m]
    labels : (n,) node numbers in the file the mesh came from
    """

    positions: Array
    blocks: tuple[ElementBlock, ...]
    node_sets: Mapping[str, Indices] = field(default_factory=dict)
    labels: Indices = field(default_factory=lambda: np.zeros(0, np.int64))

    @property
    def dimension(self) -> int:
        """Dimension of the space."""
        return self.positions.shape[1]


def check_mesh(
    mesh: Mesh,
    place: str = "geometry",
    joined: Sequence[Indices] = (),
    *,
    collapsed: bool = False,
) -> None:
    """Check that a mesh is one connected body of valid elements.

    Parameters
    ----------
    joined : groups of nodes that are connected by other means than elements
    collapsed : whether elements may use a node several times, at edges of zero length

    Raises
    ------
    InputError : there are free nodes, unconnected parts, elements that use a node
        twice or duplicate another, or elements that are inverted, folded or have no
        volume.
    """
    for block in mesh.blocks:
        if not collapsed:
            _check_distinct(block, place)
        _check_shape(mesh, block, place)
    _check_once(mesh, place)
    used = np.zeros(len(mesh.positions), bool)
    for block in mesh.blocks:
        used[block.nodes] = True
    free = np.flatnonzero(~used)
    if free.size:
        raise InputError(
            f"{free.size} nodes belong to no element, the first is node "
            f"{_node_label(mesh, free[0])}",
            place=place,
            expected="a mesh without free nodes",
        )
    _check_connected(mesh, place, joined)


def counter_clockwise(mesh: Mesh) -> Mesh:
    """Return a plane mesh with clockwise elements reversed; others as they are.

    An element counts as clockwise if the Jacobian determinant is negative at all of its
    quadrature points.
    """
    if mesh.dimension != 2:
        return mesh
    blocks = []
    for block in mesh.blocks:
        element = reference_element(block.kind)
        jacobians = np.einsum(
            "emd,gmk->egdk", mesh.positions[block.nodes], element.gradients
        )
        clockwise = (np.linalg.det(jacobians) < 0).all(axis=1)
        corners = np.arange(element.corners)
        middles = np.arange(element.corners, len(element.nodes))
        order = np.concatenate([corners[:1], corners[:0:-1], middles[::-1]])
        nodes = block.nodes.copy()
        nodes[clockwise] = nodes[clockwise][:, order]
        blocks.append(replace(block, nodes=nodes))
    return replace(mesh, blocks=tuple(blocks))


def without_free_nodes(mesh: Mesh) -> Mesh:
    """The mesh with only the nodes that elements use."""
    used = np.zeros(len(mesh.positions), bool)
    for block in mesh.blocks:
        used[block.nodes] = True
    number = np.cumsum(used) - 1
    return Mesh(
        positions=mesh.positions[used],
        blocks=tuple(
            replace(block, nodes=number[block.nodes]) for block in mesh.blocks
        ),
        node_sets={k: number[s[used[s]]] for k, s in mesh.node_sets.items()},
        labels=mesh.labels[used] if mesh.labels.size else mesh.labels,
    )


def _node_label(mesh: Mesh, node: int) -> int:
    return int(mesh.labels[node]) if mesh.labels.size else int(node) + 1


def _check_distinct(block: ElementBlock, place: str) -> None:
    ordered = np.sort(block.nodes, axis=1)
    bad = np.flatnonzero((np.diff(ordered, axis=1) == 0).any(axis=1))
    if bad.size:
        raise InputError(
            f"element {block.labels[bad[0]]} ({block.kind}) uses a node twice "
            f"(in {bad.size} of {len(block.nodes)} elements)",
            place=place,
            expected="distinct nodes in every element",
        )


def _check_once(mesh: Mesh, place: str) -> None:
    """Check that no two elements of a kind have the same nodes."""
    for kind in dict.fromkeys(block.kind for block in mesh.blocks):
        same = [block for block in mesh.blocks if block.kind == kind]
        rows = np.sort(np.concatenate([block.nodes for block in same]), axis=1)
        labels = np.concatenate([block.labels for block in same])
        order = np.lexsort(rows.T)
        equal = (rows[order[1:]] == rows[order[:-1]]).all(axis=1)
        twice = np.flatnonzero(equal)
        if twice.size:
            first, second = labels[order[[twice[0], twice[0] + 1]]]
            raise InputError(
                f"elements {first} and {second} ({kind}) have the same nodes",
                place=place,
                expected="every element once",
            )


def _check_shape(mesh: Mesh, block: ElementBlock, place: str) -> None:
    element = reference_element(block.kind)
    points = np.vstack([element.points, element.nodes[: element.corners]])
    _, gradients = element.at(points)
    inner = len(element.points)
    for start in range(0, len(block.nodes), 2_000):
        part = block.nodes[start : start + 2_000]
        jacobians = jacobian_columns(mesh.positions.real[part], gradients[None])
        determinants = jacobian_determinants(jacobians)
        lengths = np.sqrt((jacobians**2).sum(axis=1)).prod(axis=0)
        ratio = determinants / np.maximum(lengths, np.finfo(float).tiny)
        folded = (ratio[:, :inner] <= 1e-10).any(axis=1)
        if block.kind != "tet10":  # as in Abaqus and CalculiX
            folded |= (ratio[:, inner:] < -1e-6).any(axis=1)
        bad = np.flatnonzero(folded)
        if bad.size:
            _raise_distorted(mesh, block, start + int(bad[0]), ratio[bad[0]], place)


def _raise_distorted(
    mesh: Mesh, block: ElementBlock, row: int, ratio: Array, place: str
) -> None:
    where = mesh.positions[block.nodes[row]].mean(axis=0)
    element = reference_element(block.kind)
    near, instead = ", ".join(f"{x:.4g}" for x in where), ""
    if (ratio <= 1e-10).all():
        flat = np.abs(ratio).max() <= 1e-10
        what = "has no volume" if flat else "is inverted"
    else:
        what = "is folded"
        if len(element.nodes) > element.corners:
            instead = ", or straight edges there (Gmsh: Mesh.HighOrderOptimize)"
    raise InputError(
        f"element {block.labels[row]} ({block.kind}) near ({near}) {what}",
        place=place,
        expected=f"elements whose Jacobian determinant is positive everywhere{instead}",
    )


def _check_connected(mesh: Mesh, place: str, joined: Sequence[Indices]) -> None:
    n = len(mesh.positions)
    groups = [*(b.nodes for b in mesh.blocks), *(g[None] for g in joined if g.size)]
    first = [np.repeat(g[:, 0], g.shape[1] - 1) for g in groups]
    others = [g[:, 1:].ravel() for g in groups]
    i, j = np.concatenate(first), np.concatenate(others)
    graph = sp.csr_matrix((np.ones(len(i), np.int8), (i, j)), shape=(n, n))
    count, part = connected_components(graph, directed=False)
    if count > 1:
        row = int(np.flatnonzero(part == np.argmin(np.bincount(part)))[0])
        raise InputError(
            f"the mesh falls into {count} unconnected parts; the smallest holds node "
            f"{_node_label(mesh, row)}",
            place=place,
            expected="one connected body (are nodes at the same place merged?); "
            "geometry.part chooses an instance, a set of elements or a property",
        )
