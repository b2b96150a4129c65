"""Changes of the shape of an imported mesh.

Each node moves along its direction. Directions come from a second file with the same
elements, or from vectors of node sets, between which every coordinate satisfies
Laplace's equation: the mesh between two sets that move apart is stretched evenly.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sidtool.formats.base.complex_step import Numbers
from sidtool.formats.base.errors import InputError, errors_inside
from sidtool.formats.base.sid import Array
from sidtool.formats.model.geometry import MeshGeometry, Morph

from ..eigensolvers.factorisation import symmetric_factors
from ..elements.matrix_sums import MatrixSum
from ..elements.solid_mesh import element_batches
from ..mesh.connections import NamedSets
from ..mesh.imported_mesh import ImportedMesh
from ..mesh.mesh import Mesh

Flags = NDArray[np.bool_]

#: Vectors of two sets at a common node may differ by this share.
_SAME = 1e-12


def with_morphs(
    imported: ImportedMesh,
    geometry: MeshGeometry,
    length: float,
    read: Callable[[str], ImportedMesh],
) -> ImportedMesh:
    """Return the mesh in the shape that the morphs of a model file give it.

    Parameters
    ----------
    length : of one unit of the mesh [m]
    read : function that reads another mesh file in the same way

    Raises
    ------
    InputError : a file has other elements, there is no such node set, or a part of the
        mesh has no set with a vector.
    """
    positions: Numbers = imported.mesh.positions
    for name, morph in geometry.morphs.items():
        with errors_inside(f"geometry.morphs.{name}"):
            if morph.file is not None:
                moves = _moves_to(imported, read(morph.file), morph.file)
            else:
                moves, given = _moved_nodes(imported, morph)
                if morph.amount != 0.0:
                    moves = _moves_between_sets(imported, moves, given) / length
            if not moves.any():
                raise InputError("moves no node", expected="nodes at other places")
        positions = positions + morph.amount * moves
    return replace(imported, mesh=replace(imported.mesh, positions=positions))


def _moves_to(imported: ImportedMesh, other: ImportedMesh, file: str) -> Array:
    """Return the displacement (n, d) of each node to its place in another file."""
    dimensions = imported.mesh.dimension, other.mesh.dimension
    if dimensions[0] != dimensions[1] or _elements(imported) != _elements(other):
        problem = "has other elements"
        if dimensions[0] != dimensions[1]:
            problem = f"has {dimensions[1]} dimensions, and the mesh {dimensions[0]}"
        raise InputError(
            f"{file} {problem}",
            place="file",
            expected="the same elements and node numbers, with nodes at other places",
        )
    moves: Array = other.mesh.positions - imported.mesh.positions
    return moves


def _elements(imported: ImportedMesh) -> tuple[object, ...]:
    """Return the numbers of all nodes, and of elements with their nodes."""
    mesh = imported.mesh
    blocks = [
        (b.kind, b.labels.tolist(), mesh.labels[b.nodes].tolist()) for b in mesh.blocks
    ]
    bars = [(bar.label, tuple(bar.nodes)) for bar in imported.bars]
    shells = [(shell.label, tuple(shell.nodes)) for shell in imported.shells]
    return mesh.positions.shape, mesh.labels.tolist(), blocks, bars, shells


def _moves_between_sets(imported: ImportedMesh, moves: Array, given: Flags) -> Array:
    """Return the direction (n, d) of each node from those of the given ones [m]."""
    mesh, moves = imported.mesh, moves.copy()
    laplacian = _laplacian(mesh)
    used = laplacian.diagonal() > 0
    _check_parts(mesh, laplacian, used, given)
    free = np.flatnonzero(used & ~given)
    if free.size:
        inner = sp.csr_matrix(laplacian[free][:, free])
        load = laplacian[free][:, np.flatnonzero(given)] @ moves[given]
        factors = symmetric_factors(inner, mesh.positions[free])
        moves[free] = -factors.solve(np.asarray(load))
    row = {int(label): i for i, label in enumerate(mesh.labels)}
    for coupling in imported.couplings:
        centre = row.get(coupling.reference or 0)
        if centre is not None and not used[centre] and not given[centre]:
            joined = [row[n] for n in coupling.nodes if n in row and used[row[n]]]
            if joined:
                moves[centre] = moves[joined].mean(axis=0)
    return moves


def _moved_nodes(imported: ImportedMesh, morph: Morph) -> tuple[Array, Flags]:
    """Return the directions (n, d) of the nodes of sets, and which nodes these are."""
    mesh = imported.mesh
    if imported.is_structure:
        raise InputError(
            "is for solids and plane elements, and the mesh has others",
            place="moves",
            expected="`file`, the same elements with nodes at other places",
        )
    sets = NamedSets(mesh.node_sets, imported.undefined)
    moves, given = np.zeros(mesh.positions.shape), np.zeros(len(mesh.positions), bool)
    for name, vector in morph.moves.items():
        place = f"moves.{name}"
        if len(vector) != mesh.dimension:
            raise InputError(
                f"has {len(vector)} components",
                place=place,
                expected=f"{mesh.dimension}",
            )
        with errors_inside("moves"):
            nodes = sets[name]
        again = nodes[given[nodes]]
        if np.abs(moves[again] - vector).max(initial=0) > _SAME * np.abs(vector).max():
            raise InputError(
                f"moves {again.size} nodes that another set moves differently",
                place=place,
                expected="sets without common nodes",
            )
        moves[nodes], given[nodes] = vector, True
    return moves, given


def _laplacian(mesh: Mesh) -> sp.csr_matrix:
    """Return the integrals (n, n) of the products of gradients of shape functions."""
    total = MatrixSum(len(mesh.positions), 1)
    for block in mesh.blocks:
        for batch in element_batches(mesh, block):
            slopes = batch.gradients
            products = np.einsum("eg,egid,egjd->eij", batch.measures, slopes, slopes)
            total.add(batch.nodes, products)
    return total.total()[0]


def _check_parts(
    mesh: Mesh, laplacian: sp.csr_matrix, used: Flags, given: Flags
) -> None:
    """Refuse a mesh with a part, joined to others by ties, without a moved set."""
    count, part = connected_components(laplacian, directed=False)
    held = np.zeros(count, bool)
    held[part[given]] = True
    alone = np.flatnonzero(used & ~held[part])
    if alone.size:
        raise InputError(
            f"holds no set of the part of the mesh with node {mesh.labels[alone[0]]}",
            place="moves",
            expected="a vector for a node set of each part, [0, 0, 0] where it stays",
        )
