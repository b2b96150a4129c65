"""The field of a mesh: its nodes, its outer faces, stresses from quadrature points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..conversion.nodal import NodalMeans
from ..conversion.quadrature import quadrature
from ..frontends.elements.continuum import stress_from_gradient, stress_six
from ..frontends.elements.reference import all_edges, faces
from ..frontends.finite_element_model import FiniteElementModel
from ..frontends.mesh.data import ElementBlock, Mesh
from .sampled import Sampled

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def mesh_field(body: FiniteElementModel, mesh: Mesh) -> Sampled:
    """The nodes of a mesh; at the border of two materials, one for each.

    Stresses are those of `NodalMeans`.
    """
    names = list(dict.fromkeys(block.material for block in mesh.blocks))
    n = len(mesh.positions)
    keys = [block.nodes + n * names.index(block.material) for block in mesh.blocks]
    used, rows = np.unique(
        np.concatenate([k.ravel() for k in keys]), return_inverse=True
    )
    ends = np.cumsum([k.size for k in keys])[:-1]
    local = [
        part.reshape(key.shape)
        for part, key in zip(np.split(rows, ends), keys, strict=True)
    ]
    node, kinds = used % n, [block.kind for block in mesh.blocks]
    table = body.table[node, :3]

    def displacement(fields: Array) -> Array:
        padded = np.concatenate([fields, np.zeros((1, fields.shape[1]))])
        return padded[table]

    plane = mesh.dimension == 2
    return Sampled(
        positions=np.pad(mesh.positions, ((0, 0), (0, 3 - mesh.dimension)))[node],
        triangles=surface(list(zip(kinds, local, strict=True)), node, plane),
        displacement=displacement,
        cells=_cells(mesh.blocks, local),
        thickness=_thickness(body, mesh) if plane else 0.0,
        stress=(lambda fields: _stress(body, mesh, fields)) if body.continua else None,
        transverse=_transverse(body, used // n, names, mesh),
    )


def _thickness(body: FiniteElementModel, mesh: Mesh) -> float:
    known = [block.thickness for block in mesh.blocks if block.thickness]
    if known:
        return float(known[0])
    return body.continua[0].thickness if body.continua else 0.0


def _transverse(
    body: FiniteElementModel, materials: Indices, names: list[str | None], mesh: Mesh
) -> Array:
    values = np.zeros(len(names))
    for block, continuum in zip(mesh.blocks, body.continua, strict=False):
        values[names.index(block.material)] = continuum.transverse
    return values[materials]


def _cells(
    blocks: tuple[ElementBlock, ...], local: list[Indices]
) -> dict[str, Indices]:
    found: dict[str, list[Indices]] = {}
    for block, nodes in zip(blocks, local, strict=True):
        found.setdefault(block.kind, []).append(nodes)
    return {kind: np.concatenate(parts) for kind, parts in found.items()}


def surface(cells: list[tuple[str, Indices]], node: Indices, plane: bool) -> Indices:
    """Triangles of the faces that belong to one element; in the plane of all.

    cells : kinds of elements, and their points
    node : node of each point; at borders of materials several points are one node
    """
    rings, keys = [], []
    for kind, points in cells:
        for ring, corners in _rings(kind, plane):
            rings.append((points[:, ring], corners))
            key = np.full((len(points), 4), -1, np.int64)
            key[:, :corners] = np.sort(node[points[:, ring[:corners]]], axis=1)
            keys.append(key)
    _, inverse, counts = np.unique(
        np.concatenate(keys), axis=0, return_inverse=True, return_counts=True
    )
    outer = np.ones(len(inverse), bool) if plane else (counts == 1)[inverse.ravel()]
    ends = np.cumsum([len(key) for key in keys])[:-1]
    found = [
        _triangles(ring[kept], corners)
        for (ring, corners), kept in zip(rings, np.split(outer, ends), strict=True)
    ]
    return np.concatenate(found)


def _rings(kind: str, plane: bool) -> list[tuple[list[int], int]]:
    """Faces of an element: corners, then the middles of the edges between them."""
    middles = {frozenset((a, b)): m for a, b, m in all_edges(kind) if m >= 0}
    if plane:
        corners = [tuple(range(3 if kind.startswith("tri") else 4))]
    else:
        corners = [*faces(kind, 3), *faces(kind, 4)]
    found = []
    for face in corners:
        pairs = zip(face, (*face[1:], face[0]), strict=True)
        own = [middles[frozenset(pair)] for pair in pairs] if middles else []
        found.append(([*face, *own], len(face)))
    return found


def _triangles(ring: Indices, corners: int) -> Indices:
    """(k, corners [+ middles]) as triangles."""
    if ring.shape[1] == corners:
        fans = [(0, i, i + 1) for i in range(1, corners - 1)]
    else:
        middle = range(corners, 2 * corners)
        fans = [
            (i, middle[i], middle[i - 1 if i else corners - 1]) for i in range(corners)
        ]
        fans += [(middle[0], middle[i], middle[i + 1]) for i in range(1, corners - 1)]
    return np.concatenate([ring[:, list(fan)] for fan in fans])


def _stress(body: FiniteElementModel, mesh: Mesh, fields: Array) -> Array:
    """(points, 6, k)."""
    k = fields.shape[1]
    means = NodalMeans(body, mesh, 6 * k)
    for part in quadrature(body):
        tensor = stress_from_gradient(part.gradients(fields), part.law)
        six = stress_six(tensor, part.transverse)
        means.add(part, np.swapaxes(six, 1, 2).reshape(len(six), 6 * k))
    return means.values().reshape(-1, 6, k)
