"""The full field of a reduced body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.field import Field, field_of
from sidtool.formats.sid import SID

from ..conversion.prestress import InitialStress
from ..frontends.elements.continuum import stress_six
from ..frontends.finite_element_model import FiniteElementModel
from ..reduction.basis import ReducedBasis
from ..reduction.frames import Frame
from .beam_field import beam_field
from .mesh_field import mesh_field
from .patch_field import patch_field
from .sampled import Sampled, together

Array = NDArray[np.float64]


def body_field(
    sid: SID,
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    initial: InitialStress | None = None,
) -> Field:
    """Mesh, surface, shape functions and stresses of a body, in its body frame.

    sid : what became of it
    initial : the stress of the undeformed body
    """
    sampled = sample_body(body)
    shapes = sampled.displacement(basis.shapes)
    stress, still = None, np.zeros((len(shapes), 6))
    if sampled.stress is not None:
        stress = sampled.stress(basis.shapes)
    if sampled.stress is not None and initial is not None:
        still = sampled.stress(initial.displacement)[..., 0]
        still = still + stress_six(initial.uniform)
        if body.dimension == 2:
            still[:, 2] += sampled.transverse * np.trace(initial.uniform)
    content = Field(
        title=sid.title,
        positions=sampled.positions - frame.origin,
        shapes=shapes,
        triangles=sampled.triangles,
        cells=sampled.cells,
        thickness=sampled.thickness,
        stress=stress,
        initial_stress=still,
    )
    return field_of(sid, content)


def sample_body(body: FiniteElementModel) -> Sampled:
    """Where the points of a body are, and how they move.

    A body that came as matrices has points and no surface.
    """
    if body.patches:
        parts = zip(body.patches, body.continua, strict=True)
        return together(patch_field(body, *p, continuum) for p, continuum in parts)
    mesh = body.drawn if body.solids is None else body.solids.mesh
    if mesh is not None:
        return mesh_field(body, mesh)
    if body.outlines:
        return together(map(beam_field, body.outlines))
    there = body.place_table[:, :3].max(axis=1) >= 0
    places = np.pad(body.positions, ((0, 0), (0, 3 - body.dimension)))[there]
    return Sampled(
        positions=places,
        triangles=np.zeros((0, 3), np.int64),
        displacement=lambda fields: body.by_node(fields)[there, :3],
        transverse=np.zeros(len(places)),
    )
