"""The mass and the centre of a mesh from the faces of its elements."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..anisotropic import ElasticMaterial
from ..elements.quadrature_rules import quadrature_rule
from ..elements.reference import all_edges, faces, reference_element
from .data import Mesh

Array = NDArray[np.float64]

#: Degree of the rule on faces: that of x^2 n on faces with bowed edges.
_DEGREE = 7


def mesh_moments(
    mesh: Mesh, materials: Mapping[str | None, ElasticMaterial], thickness: float = 1.0
) -> tuple[float, Array]:
    """Mass and first moments (d,) by the divergence theorem.

    Parameters are those of `mesh_matrices`. The integrals are those of x . n / d and
    x_a^2 n_a / 2 over all faces: those between two elements cancel.
    """
    d = mesh.dimension
    mass, first = 0.0, np.zeros(d)
    for block in mesh.blocks:
        depth = block.thickness or thickness
        density = materials[block.material].density * depth
        for values, slopes, weights in _face_points(block.kind):
            for start in range(0, len(block.nodes), 2_000):
                corners = mesh.positions[block.nodes[start : start + 2_000]]
                points = values @ corners
                tangents = np.einsum("gmk,emd->kegd", slopes, corners)
                normals = _normals(tangents) * weights[:, None]
                mass += density * float(np.einsum("ega,ega->", points, normals)) / d
                first += density * np.einsum("ega,ega->a", points**2, normals) / 2
    return mass, first


@cache
def _face_points(kind: str) -> list[tuple[Array, Array, Array]]:
    """Per face: functions (g, m), slopes along the face (g, m, d - 1), weights (g,)."""
    element = reference_element(kind)
    plane = element.dimension == 2
    sides: list[tuple[int, ...]] = [*faces(kind, 3), *faces(kind, 4)]
    if plane:
        sides = [(a, b) for a, b, _ in all_edges(kind)]
    result = []
    for side in sides:
        corners = element.nodes[list(side)]
        points, weights = _rule(len(side))
        edges = [corners[1] - corners[0], corners[-1] - corners[0]][: len(corners) - 1]
        directions = np.array(edges[:1] if plane else edges)
        values, gradients = element.at(corners[0] + points @ directions)
        slopes = np.einsum("gmd,kd->gmk", gradients, directions)
        result.append((values, slopes, weights))
    return result


def _rule(corners: int) -> tuple[Array, Array]:
    """On the unit line, triangle or square."""
    if corners > 2:
        return quadrature_rule("tri" if corners == 3 else "quad", _DEGREE)
    points, weights = np.polynomial.legendre.leggauss(_DEGREE // 2 + 1)
    return (points[:, None] + 1) / 2, weights / 2


def _normals(tangents: Array) -> Array:
    """(ne, g, d) from tangents (d - 1, ne, g, d), counter-clockwise from outside."""
    if len(tangents) == 1:
        return np.stack([tangents[0, ..., 1], -tangents[0, ..., 0]], axis=-1)
    return np.asarray(np.cross(tangents[0], tangents[1]), float)
