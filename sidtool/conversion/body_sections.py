"""Parts of a body beyond its cross-sections, for section forces."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from sidtool.formats.base.sid import JUMPS, SID, Array, Node, Section, Taylor
from sidtool.formats.sid_mass import skew

from ..elements.finite_element_model import BodyCut, FiniteElementModel, MarkerRows
from ..elements.material_points import InertiaPoints
from ..reduction.admissible_space import constrained_space
from ..reduction.body_frames import Frame
from ..reduction.reduced_basis import ReducedBasis
from .inertia_integrals import body_inertia

_INERTIA = ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe")


def add_sections(
    sid: SID, body: FiniteElementModel, frame: Frame, basis: ReducedBasis
) -> SID:
    """Return the SID with the sections of the body, without geometric stiffening."""
    rings = [cut for cut in body.cuts if cut.resultants is not None]
    jumps = iter(_displacements_by_jumps(body, frame, rings))
    sections = tuple(
        _section(sid, body, frame, basis, cut)
        if cut.resultants is None
        else _ring_section(sid, body, frame, basis, cut, next(jumps))
        for cut in body.cuts
    )
    return replace(sid, sections=sections)


def _displacements_by_jumps(
    body: FiniteElementModel, frame: Frame, rings: list[BodyCut]
) -> list[Array]:
    """(ndof, 6) for each section that leaves the body connected: displacements by
    unit jumps at the section, in the directions of the section forces.

    Their work with all loads is the section forces (H. Müller-Breslau's influence
    lines): R u = R K^-1 f for section forces R u of displacements u = K^-1 f.
    """
    if not rings:
        return []
    rows = sp.vstack([cut.resultants for cut in rings]).toarray()
    states = constrained_space(body, frame).static(rows.T)
    return np.split(states, len(rings), axis=1)


def _ring_section(
    sid: SID,
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    cut: BodyCut,
    jumps: Array,
) -> Section:
    both = replace(basis, shapes=np.hstack([basis.shapes, jumps]))
    mass, inertia = _inertia_with_jumps(body, frame, both, cut)
    node = _node(cut, frame.origin, both)
    assert node.sigma is not None and node.sigma.m1 is not None
    rows = np.pad(node.sigma.m1[: sid.nq], ((0, JUMPS), (0, 0), (0, 0)))
    sigma = Taylor(node.sigma.m0, rows)
    nodes = [
        replace(_motion_node(marker, frame.origin, both), id=str(marker.node))
        for marker in body.markers
    ]
    part = SID(
        mass,
        (*sid.labels, *(f"jump of {cut.name}, {k}" for k in range(1, JUMPS + 1))),
        (replace(node, sigma=sigma), *nodes),
        **_blocks(inertia, sid.nq + JUMPS),
    )
    return Section(cut.name, part, ())


def part_of_body(body: FiniteElementModel, cut: BodyCut) -> FiniteElementModel:
    """Return the body with the mass beyond a section only."""
    points = body.inertia_points
    return replace(
        body,
        scalar_mass=cut.scalar_mass,
        internal_inertia=cut.internal_inertia,
        inertia_points=None if points is None else points.selected(cut.points),
    )


def _section(
    sid: SID,
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    cut: BodyCut,
) -> Section:
    part = part_of_body(body, cut)
    if cut.points.any() or cut.scalar_mass is not None:
        mass, inertia = body_inertia(part, frame.origin, basis.shapes)
    else:
        mass, inertia = 0.0, {n: _zero(sid.blocks[n]) for n in _INERTIA}
    blocks = _blocks(inertia, sid.nq)
    numbers = {marker.name: str(marker.node) for marker in body.markers}
    return Section(
        name=cut.name,
        part=SID(mass, sid.labels, (_node(cut, frame.origin, basis),), **blocks),
        beyond=tuple(numbers[name] for name in cut.markers),
    )


def _inertia_with_jumps(
    body: FiniteElementModel, frame: Frame, both: ReducedBasis, cut: BodyCut
) -> tuple[float, dict[str, Taylor]]:
    """Mass and inertia blocks of a body whose element at a cut moves by a jump less
    than the node there, in the last six shape functions.
    """
    points = body.inertia_points
    assert points is not None
    own = sp.diags_array(np.repeat(cut.points, 3).astype(float))
    rows = (
        sp.csr_matrix(sp.hstack([part, -own @ part @ cut.jump]))
        for part in (points.displacement, points.rotation)
    )
    split = InertiaPoints(points.positions, points.masses, points.inertias, *rows)
    units = np.eye(JUMPS, both.shapes.shape[1], both.shapes.shape[1] - JUMPS)
    shapes = np.vstack([both.shapes, units])
    return body_inertia(replace(body, inertia_points=split), frame.origin, shapes)


def _blocks(inertia: Mapping[str, Taylor], nq: int) -> dict[str, Any]:
    """All blocks of a part, which has no stiffness."""
    none = Taylor(np.zeros((nq, nq)))
    ksigma = Taylor(np.zeros((nq, 1)))
    return {**inertia, "ksigma": ksigma, "Ke": none, "De": none}


def _zero(block: Taylor) -> Taylor:
    return Taylor(np.zeros_like(block.m0))


def _node(cut: BodyCut, origin: Array, basis: ReducedBasis) -> Node:
    moved = _motion_node(cut.section, origin, basis)
    axes, sigma = cut.axes.T, None
    if cut.resultants is not None:
        forces = cut.resultants @ basis.shapes
        sigma = Taylor(np.zeros((6, 1)), forces.T[:, :, None])
    AP = Taylor(axes, skew(moved.psi.m0.T) @ axes)
    return replace(moved, id=cut.name, AP=AP, sigma=sigma)


def _motion_node(marker: MarkerRows, origin: Array, basis: ReducedBasis) -> Node:
    phi = marker.displacement @ basis.shapes
    psi = marker.rotation @ basis.shapes
    return Node(
        id=marker.name,
        origin=Taylor((marker.position - origin)[:, None], phi.T[:, :, None]),
        phi=Taylor(phi),
        psi=Taylor(psi),
        AP=Taylor(np.eye(3), skew(psi.T)),
    )
