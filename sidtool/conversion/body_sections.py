"""Parts of a body beyond its cross-sections, for section forces."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array, Node, Section, Taylor
from sidtool.formats.sid_mass import skew

from ..elements.finite_element_model import BodyCut, FiniteElementModel
from ..reduction.body_frames import Frame
from ..reduction.reduced_basis import ReducedBasis
from .inertia_integrals import body_inertia


def add_sections(
    sid: SID, body: FiniteElementModel, frame: Frame, basis: ReducedBasis
) -> SID:
    """Return the SID with the sections of the body, without geometric stiffening."""
    sections = tuple(_section(sid, body, frame, basis, cut) for cut in body.cuts)
    return replace(sid, sections=sections)


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
    nq, part = sid.nq, part_of_body(body, cut)
    if cut.points.any() or cut.scalar_mass is not None:
        mass, inertia = body_inertia(part, frame.origin, basis.shapes)
    else:
        mass, inertia = 0.0, {n: _zero(sid.blocks[n]) for n in _INERTIA}
    blocks: dict[str, Any] = dict(inertia)
    blocks["ksigma"] = Taylor(np.zeros((nq, 1)))
    blocks["Ke"] = blocks["De"] = Taylor(np.zeros((nq, nq)))
    numbers = {marker.name: str(marker.node) for marker in body.markers}
    return Section(
        name=cut.name,
        part=SID(mass, sid.labels, (_node(cut, frame.origin, basis),), **blocks),
        beyond=tuple(numbers[name] for name in cut.markers),
    )


_INERTIA = ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe")


def _zero(block: Taylor) -> Taylor:
    return Taylor(np.zeros_like(block.m0))


def _node(cut: BodyCut, origin: Array, basis: ReducedBasis) -> Node:
    phi = cut.section.displacement @ basis.shapes
    psi = cut.section.rotation @ basis.shapes
    axes, sigma = cut.axes.T, None
    if cut.resultants is not None:
        forces = cut.resultants @ basis.shapes
        sigma = Taylor(np.zeros((6, 1)), forces.T[:, :, None])
    return Node(
        id=cut.name,
        origin=Taylor((cut.section.position - origin)[:, None], phi.T[:, :, None]),
        phi=Taylor(phi),
        psi=Taylor(psi),
        AP=Taylor(axes, skew(psi.T) @ axes),
        sigma=sigma,
    )
