"""Full field of a reduced body."""

from __future__ import annotations

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.formats.field import Field, field_of

from ..conversion.prestress import InitialStress
from ..elements.finite_element_model import FiniteElementModel
from ..elements.material_points import stress_components
from ..reduction.body_frames import Frame
from ..reduction.reduced_basis import ReducedBasis
from .mesh_field import mesh_field, patch_field
from .sampled_points import SampledPoints, beam_field, concatenate_points


def body_field(
    sid: SID,
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    initial: InitialStress | None = None,
) -> Field:
    """Mesh, surface, shape functions and stresses of a body, in its body frame.

    sid : SID of the body
    initial : the stress of the undeformed body
    """
    sampled = sample_body(body)
    shapes = sampled.displacement(basis.shapes)
    stress, initial_stress = None, np.zeros((len(shapes), 6))
    if sampled.stress is not None:
        stress = sampled.stress(basis.shapes)
    if sampled.stress is not None and initial is not None:
        initial_stress = sampled.stress(initial.displacement)[..., 0]
        initial_stress = initial_stress + stress_components(initial.uniform)
        if body.dimension == 2:
            initial_stress[:, 2] += sampled.transverse * np.trace(initial.uniform)
    content = Field(
        title=sid.title,
        positions=sampled.positions - frame.origin,
        shapes=shapes,
        triangles=sampled.triangles,
        cells=sampled.cells,
        thickness=sampled.thickness,
        stress=stress,
        initial_stress=initial_stress,
    )
    return field_of(sid, content)


def sample_body(body: FiniteElementModel) -> SampledPoints:
    """Return the points of a body and the rows of their motion.

    A body from matrices has points and no surface.
    """
    if body.patches:
        parts = zip(body.patches, body.continua, strict=True)
        return concatenate_points(
            patch_field(body, *p, continuum) for p, continuum in parts
        )
    mesh = body.drawing_mesh if body.solids is None else body.solids.mesh
    if mesh is not None:
        return mesh_field(body, mesh)
    if body.outlines:
        return concatenate_points(map(beam_field, body.outlines))
    there = body.place_table[:, :3].max(axis=1) >= 0
    places = np.pad(body.positions, ((0, 0), (0, 3 - body.dimension)))[there]
    return SampledPoints(
        positions=places,
        triangles=np.zeros((0, 3), np.int64),
        displacement=lambda fields: body.by_node(fields)[there, :3],
        transverse=np.zeros(len(places)),
    )
