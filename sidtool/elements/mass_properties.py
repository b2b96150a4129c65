"""Mass and centre of a mesh from its faces, compared with those of the geometry."""

from collections.abc import Mapping
from functools import cache

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..geometry.nurbs_patch import NurbsPatch
from ..geometry.patch_evaluation import patch_moments
from ..mesh.materials import ElasticMaterial
from ..mesh.mesh import Mesh
from ..mesh.reference_elements import (
    element_edges,
    element_faces,
    quadrature_rule,
    reference_element,
)
from .finite_element_model import FiniteElementModel, GeometryMass

#: Degree of the rule on faces: that of x^2 n on faces with bowed edges.
_DEGREE = 7

#: Differences of mass, and of the centre relative to the size, above which exact
#: discretisations are refused and sampled ones get a note.
_EXACT_TOLERANCE, _NOTED_DIFFERENCE = 1e-6, 1e-3


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
                by_node = corners.transpose(1, 2, 0).reshape(corners.shape[1], -1)
                points, *tangents = (
                    (rows @ by_node).reshape(len(rows), d, -1).swapaxes(0, 1)
                    for rows in (values, *slopes)
                )
                normals = _area_normals(tangents) * weights[:, None]
                mass += density * float(np.vdot(points, normals)) / d
                first += density * np.einsum("age,age->a", points**2, normals) / 2
    return mass, first


@cache
def _face_points(kind: str) -> list[tuple[Array, Array, Array]]:
    """Per face: functions (g, m), slopes along the face (d - 1, g, m), weights (g,)."""
    element = reference_element(kind)
    plane = element.dimension == 2
    sides: list[tuple[int, ...]] = [*element_faces(kind, 3), *element_faces(kind, 4)]
    if plane:
        sides = [(a, b) for a, b, _ in element_edges(kind)]
    result = []
    for side in sides:
        corners = element.nodes[list(side)]
        points, weights = _face_rule(len(side))
        edges = [corners[1] - corners[0], corners[-1] - corners[0]][: len(corners) - 1]
        directions = np.array(edges[:1] if plane else edges)
        values, gradients = element.at(corners[0] + points @ directions)
        slopes = np.einsum("gmd,kd->kgm", gradients, directions)
        result.append((values, slopes, weights))
    return result


def _face_rule(corners: int) -> tuple[Array, Array]:
    """Return the rule on the unit line, triangle or square."""
    return quadrature_rule({2: "line", 3: "tri", 4: "quad"}[corners], _DEGREE)


def _area_normals(tangents: list[Array]) -> Array:
    """(d, g, ne) from d - 1 tangents (d, g, ne), counter-clockwise from outside."""
    if len(tangents) == 1:
        return np.stack([tangents[0][1], -tangents[0][0]])
    (a, b, c), (x, y, z) = tangents
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x])


def patch_mass(
    patches: list[NurbsPatch], density: float, *, sampled: bool = False
) -> GeometryMass:
    """Return mass and first moments of patches, with mass per volume or, in the plane,
    area.
    """
    moments = [patch_moments(patch) for patch in patches]
    mass = density * sum(volume for volume, _ in moments)
    first = density * np.sum([first for _, first in moments], axis=0)
    return GeometryMass(mass, first, sampled)


def geometry_mass_notes(body: FiniteElementModel) -> tuple[Diagnostic, ...]:
    """Return N150 if mass and centre deviate from those of the geometry.

    Raises
    ------
    InputError : the discretisation is exact, and they differ.
    """
    if body.geometry_mass is None:
        return ()
    expected = body.geometry_mass()
    mass, centre = _mass_and_centre(body)
    size = np.ptp(body.positions, axis=0).max()
    off = mass / expected.mass - 1
    moved = float(np.linalg.norm(centre - expected.first / expected.mass))
    worst = max(abs(off), moved / size)
    text = f"mass {100 * off:+.3g} %, centre {moved:.3g} m away"
    if expected.sampled:
        if worst <= _NOTED_DIFFERENCE:
            return ()
        return (diagnose("N150", mass=float(off), centre=moved),)
    if worst > _EXACT_TOLERANCE:
        raise InputError(
            f"the discretised body does not have the mass of its geometry ({text})",
            place="discretisation",
            expected="more elements where weights differ much, or weights of like size",
        )
    return ()


def _mass_and_centre(body: FiniteElementModel) -> tuple[float, Array]:
    """Return mass and centre; for beams from the momenta of rigid motions."""
    if body.scalar_mass is not None:
        weights = np.asarray(body.scalar_mass.sum(axis=0)).ravel()
        return float(weights.sum()), weights @ body.positions / weights.sum()
    rigid = body.rigid_body_modes()
    momenta = rigid[:, :3].T @ (body.mass @ rigid)
    mass = float(np.trace(momenta[:, :3])) / 3.0
    # a rotation about e moves the centre c by e x c
    arms = momenta[:, 3:] / mass
    return mass, np.array([arms[1, 2], arms[2, 0], arms[0, 1]])
