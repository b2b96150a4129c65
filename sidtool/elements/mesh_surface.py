"""Faces of a mesh whose nodes belong to a set."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.taylor import Array

from ..mesh.mesh import ElementBlock, Mesh
from ..mesh.quadrature_rules import quadrature_rule
from ..mesh.reference_elements import (
    element_edges,
    element_faces,
    reference_element,
    shape_of,
)
from .faces import Surface, area_elements, products_of_normals

Indices = NDArray[np.int64]

#: Degree to which the quadrature of N_i N_j is exact: quadratic, on curved faces.
_DEGREE = 7


@dataclass(frozen=True, eq=False)
class _FacePieces:
    """The same face, or edge, of several elements of one block.

    Attributes
    ----------
    local : nodes within the element, corners first
    corners : number of the corners among them
    rows : (k,) elements
    """

    block: ElementBlock
    local: tuple[int, ...]
    corners: int
    rows: Indices

    @property
    def nodes(self) -> Indices:
        """(k, m) rows of the mesh's positions."""
        return self.block.nodes[self.rows][:, self.local]


def named_surface(
    mesh: Mesh, sets: Mapping[str, Indices]
) -> Callable[[tuple[str, ...]], Surface | None]:
    """Return a function that computes the surface of named node sets on demand."""

    def surface(names: tuple[str, ...]) -> Surface | None:
        return mesh_surface(mesh, np.concatenate([sets[name] for name in names]))

    return surface


def mesh_surface(mesh: Mesh, nodes: Indices) -> Surface | None:
    """The outer faces all of whose nodes are in a set; in the plane the outer edges.

    If there are none, inner faces and then edges are used: the first of these that
    contains more than half of the nodes. The result is None if there is no such
    surface.
    """
    nodes = np.unique(nodes)
    member = np.zeros(len(mesh.positions), bool)
    member[nodes] = True
    for solid_faces, outer in ((True, True), (True, False), (False, False)):
        pieces = list(
            _count_once(list(_pieces_in_set(mesh, member, solid_faces)), outer)
        )
        held = {node for piece in pieces for node in piece.nodes.ravel().tolist()}
        if 2 * len(held) > len(nodes):
            return _integrate_surface(mesh, pieces)
    return None


def _pieces_in_set(
    mesh: Mesh, member: NDArray[np.bool_], of_faces: bool
) -> Iterator[_FacePieces]:
    """Faces, or edges, whose corners are in the set, with its nodes in their middle.

    A face with mid-side nodes outside the set is determined by its corners.
    """
    for block in mesh.blocks:
        middles = {
            frozenset((a, b)): m for a, b, m in element_edges(block.kind) if m >= 0
        }
        pieces: list[tuple[int, ...]] = [edge[:2] for edge in element_edges(block.kind)]
        if of_faces and mesh.dimension == 3:
            pieces = [*element_faces(block.kind, 3), *element_faces(block.kind, 4)]
        inside = member[block.nodes]
        for corners in pieces:
            around = zip(corners, (*corners[1:], corners[0]), strict=True)
            pairs = dict.fromkeys(frozenset(pair) for pair in around)
            whole = (*corners, *(middles[pair] for pair in pairs if pair in middles))
            there = inside[:, corners].all(axis=1)
            full = inside[:, whole].all(axis=1)
            yield _FacePieces(block, whole, len(corners), np.flatnonzero(full))
            if whole != corners:
                rows = np.flatnonzero(there & ~full)
                yield _FacePieces(block, corners, len(corners), rows)


def _count_once(pieces: list[_FacePieces], outer: bool) -> Iterator[_FacePieces]:
    """Return shared pieces once, or only the pieces of a single element."""
    keys = [np.full((len(p.rows), 4), -1) for p in pieces]
    for key, piece in zip(keys, pieces, strict=True):
        key[:, : piece.corners] = piece.nodes[:, : piece.corners]
    _, first, counts = np.unique(
        np.sort(np.concatenate(keys), axis=1),
        axis=0,
        return_index=True,
        return_counts=True,
    )
    is_selected = np.zeros(sum(map(len, keys)), bool)
    is_selected[first[counts == 1] if outer else first] = True
    ends = np.cumsum([len(key) for key in keys])[:-1]
    for piece, chosen in zip(pieces, np.split(is_selected, ends), strict=True):
        if chosen.any():
            yield _FacePieces(
                piece.block, piece.local, piece.corners, piece.rows[chosen]
            )


def _integrate_surface(mesh: Mesh, pieces: list[_FacePieces]) -> Surface:
    n = len(mesh.positions)
    mass, normals = sp.csr_matrix((n, n)), np.zeros((3, 3))
    for piece in pieces:
        values, tangents, weights = _piece_at_points(mesh, piece)
        depth = (piece.block.thickness or 1.0) if mesh.dimension == 2 else 1.0
        sizes = depth * weights * area_elements(tangents)
        entries = np.einsum("eg,gi,gj->eij", sizes, values, values).ravel()
        nodes, m = piece.nodes, len(piece.local)
        index = (np.repeat(nodes, m, axis=1).ravel(), np.tile(nodes, (1, m)).ravel())
        mass = mass + sp.csr_matrix((entries, index), shape=(n, n))
        flat = tangents.reshape(-1, *tangents.shape[2:])
        normals += products_of_normals(flat.real, np.tile(weights, len(nodes)))
    corners = [piece.nodes[:, : piece.corners].ravel() for piece in pieces]
    points = mesh.positions[np.unique(np.concatenate(corners))]
    return Surface(sp.csr_matrix(mass), points, normals)


def _piece_at_points(mesh: Mesh, piece: _FacePieces) -> tuple[Array, Array, Array]:
    """Values (g, m) at the points of a piece, tangents (k, g, d, t), weights (g,)."""
    kind = piece.block.kind
    if len(piece.local) == piece.corners:
        kind = shape_of(kind) + str(reference_element(kind).corners)
    element = reference_element(kind)
    ends = element.nodes[list(piece.local[: piece.corners])]
    directions = ends[[1] if piece.corners == 2 else [1, -1]] - ends[0]
    shape = {2: "line", 3: "tri", 4: "quad"}[piece.corners]
    points, weights = quadrature_rule(shape, _DEGREE)
    values, gradients = element.at(ends[0] + points @ directions)
    local = list(piece.local)
    slopes = gradients[:, local] @ directions.T
    tangents = np.einsum("kmd,gmt->kgdt", mesh.positions[piece.nodes], slopes)
    return values[:, local], tangents, weights
