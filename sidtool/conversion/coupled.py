"""Couplings and point masses of a file: rigid pieces, and particles with inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..frontends.couplings import Coupling, PointMass
from ..frontends.elements.inertia_points import InertiaPoints
from ..frontends.finite_element_model import FiniteElementModel, MarkerRows, carried
from .interfaces import fitted_to

Array = NDArray[np.float64]


def coupled(body: FiniteElementModel) -> FiniteElementModel:
    """The body with the couplings and point masses of its file.

    Raises
    ------
    InputError : nodes of a coupling do not tell how its reference point turns.
    """
    if not body.couplings and not body.point_masses:
        return body
    points = {c.name: _reference(body, c) for c in body.couplings}
    markers = {name: points[c.name] for c in body.couplings for name in c.markers}
    moved = tuple(
        replace(markers[m.name], name=m.name, node=m.node) if m.name in markers else m
        for m in body.markers
    )
    result = replace(
        body,
        markers=moved,
        pieces=tuple(points[c.name] for c in body.couplings if c.rigid),
        rigid_sets={c.name: c.nodes for c in body.couplings if c.rigid},
    )
    if not body.point_masses:
        return result
    return replace(result, inertia_points=_particles(body, points))


def _reference(body: FiniteElementModel, coupling: Coupling) -> MarkerRows:
    rows = fitted_to(body, coupling.name, coupling.nodes, coupling.weights)
    return rows if coupling.position is None else carried(rows, coupling.position)


def _particles(
    body: FiniteElementModel, points: dict[str, MarkerRows]
) -> InertiaPoints:
    rows = [_motion(body, mass, points) for mass in body.point_masses]
    return InertiaPoints(
        positions=np.array([row.position for row in rows]),
        masses=np.array([mass.mass for mass in body.point_masses]),
        inertias=np.array([mass.inertia for mass in body.point_masses]),
        displacement=sp.csr_matrix(sp.vstack([row.displacement for row in rows])),
        rotation=sp.csr_matrix(sp.vstack([row.rotation for row in rows])),
    )


def _motion(
    body: FiniteElementModel, mass: PointMass, points: dict[str, MarkerRows]
) -> MarkerRows:
    """Rows of the motion of the centre of a mass."""
    if mass.coupling is not None:
        point = points[mass.coupling]
        return carried(point, point.position + mass.offset)
    assert mass.node is not None
    d = body.dimension
    dofs = body.table[mass.node, :d]
    shape = (3, body.ndof)
    rows = sp.csr_matrix((np.ones(d), (np.arange(d), dofs)), shape=shape)
    position = np.pad(body.positions[mass.node], (0, 3 - d))
    return MarkerRows("mass", 0, position, rows, sp.csr_matrix(shape))
