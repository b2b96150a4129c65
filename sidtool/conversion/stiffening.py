"""Geometric stiffening from the stress states of unit loads.

Every load that a moving body feels makes a stress state; its geometric stiffness enters
the SID as a first-order term that multiplies the load (theory, section 6). Of
forces and moments at markers that is the second derivative of the marker's motion,
which a stress state tells of the rows of the marker: see `marker_motion`.

Source: O. Wallrapp, R. Schwertassek, "Representation of geometric stiffening in
multibody system simulation", Int. J. Numer. Methods Eng. 32, 1991.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.model.reduction import Stiffening
from sidtool.formats.sid import SID, Node, Taylor

from ..frontends.elements.continuum import stress_from_gradient
from ..frontends.finite_element_model import FiniteElementModel, MarkerRows
from ..reduction.basis import ReducedBasis
from ..reduction.frames import Frame
from ..reduction.space import admissible
from .beam_stiffening import beam_stiffness
from .marker_motion import excess_of_rows, work_in_rigid_pieces
from .quadrature import quadrature
from .rotary import CENTRIFUGAL, centrifugal_loads

Array = NDArray[np.float64]


def stiffened(
    sid: SID,
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    settings: Stiffening,
) -> SID:
    """The SID with the geometric stiffening that the settings ask for.

    Raises
    ------
    InputError : the body came without elements, so that no stress is known.
    """
    loads = _Loads(body, frame)
    marked = stiffening_markers(body, settings)
    acceleration = loads.acceleration() if settings.acceleration else None
    angular = loads.angular_acceleration() if settings.angular_acceleration else None
    centrifugal = loads.centrifugal() if settings.centrifugal else None
    rows = [part for m in marked for part in (m.displacement, m.rotation)]
    parts = [acceleration, angular, centrifugal, *(part.T.toarray() for part in rows)]
    results = iter(geometric_stiffness(body, frame, basis.shapes, parts))
    blocks: dict[str, Taylor] = {}
    for name in ("Ct", "Cr", "Oe"):
        blocks[name] = _added(getattr(sid, name), next(results))
    loaded = {}
    for marker in marked:
        excess = excess_of_rows(body, marker, basis.shapes)
        loaded[marker.node] = (next(results), next(results)), excess
    nodes = tuple(_loaded_node(node, loaded.get(int(node.id))) for node in sid.nodes)
    changes: dict[str, Any] = {**blocks, "nodes": nodes}
    return replace(sid, **changes)


def stiffening_markers(
    body: FiniteElementModel, settings: Stiffening
) -> list[MarkerRows]:
    """Markers at which forces and moments stiffen."""
    names = settings.markers
    return [m for m in body.markers if names is None or m.name in names]


def geometric_stiffness(
    body: FiniteElementModel,
    frame: Frame,
    shapes: Array,
    groups: list[Array | None],
) -> list[Array | None]:
    """Phi^T Kg Phi for the stress states of loads that the frame supports.

    Parameters
    ----------
    shapes : (ndof, nq)
    groups : load vectors (ndof, n) in groups; None stays None

    Returns
    -------
    (n, nq, nq) per group, symmetric in the modes; positive for tension

    Raises
    ------
    InputError : the body came without elements.
    """
    given = [group for group in groups if group is not None]
    if not given:
        return [None for _ in groups]
    loads = balanced(body, frame, np.hstack(given))
    states = admissible(body, frame).static(loads)
    total = projected_stiffness(body, states, shapes)
    total += piece_stiffness(body, loads, states, shapes)
    results: list[Array | None] = []
    start = 0
    for group in groups:
        count = 0 if group is None else group.shape[1]
        results.append(None if group is None else total[start : start + count])
        start += count
    return results


def balanced(body: FiniteElementModel, frame: Frame, loads: Array) -> Array:
    """Loads (ndof, n) with the reactions of a frame that is defined by conditions.

    It reacts with the forces that do no work on admissible displacements.
    """
    if frame.rows is None:
        return loads
    rigid = body.rigid_body_modes(frame.origin)
    reactions = np.linalg.solve((frame.rows @ rigid).T, rigid.T @ loads)
    balanced: Array = loads - frame.rows.T @ reactions
    return balanced


def piece_stiffness(
    body: FiniteElementModel, loads: Array, states: Array, shapes: Array
) -> Array:
    """(n, nq, nq) stiffness of the forces that hold rigid ties together.

    They are what the static displacements (ndof, n) of loads leave open.
    """
    if not body.rigid_sets:
        return np.zeros((loads.shape[1], shapes.shape[1], shapes.shape[1]))
    return work_in_rigid_pieces(body, body.stiffness @ states - loads, shapes)


def projected_stiffness(
    body: FiniteElementModel, states: Array, shapes: Array
) -> Array:
    """(n, nq, nq) geometric stiffness of the stresses of displacements (ndof, n).

    The integral of sigma_ab d(phi_k)_c/dx_a d(phi_l)_c/dx_b over the body.

    Raises
    ------
    InputError : the body came without elements.
    """
    if body.beam_material is not None:
        return beam_stiffness(body.beam_material, states, shapes)
    nq = shapes.shape[1]
    total = np.zeros((states.shape[1], nq, nq))
    for part in quadrature(body):
        stress = stress_from_gradient(part.gradients(states), part.law)
        slopes = part.gradients(shapes)
        total += contracted(stress * part.weights[:, None, None, None], slopes)
    return (total + np.swapaxes(total, 1, 2)) / 2


def contracted(stress: Array, slopes: Array) -> Array:
    """sum over points of stress (p, n, d, d) with slopes (p, nq, c, d) twice."""
    p, n, d, _ = stress.shape
    nq = slopes.shape[1]
    result = np.zeros((n, nq, nq))
    for a in range(d):
        for b in range(d):
            for k in range(nq):
                pairs = np.einsum("pc,plc->pl", slopes[:, k, :, a], slopes[..., b])
                result[:, k] += stress[..., a, b].T @ pairs
    return result


class _Loads:
    """D'Alembert loads of a unit motion of the frame, (ndof, n) each."""

    def __init__(self, body: FiniteElementModel, frame: Frame) -> None:
        self._body, self._origin = body, frame.origin

    def acceleration(self) -> Array:
        """-rho e_a; in the plane the third one is zero."""
        return -self._body.mass @ self._rigid()[:, :3]

    def angular_acceleration(self) -> Array:
        """-rho e_a x c."""
        return -self._body.mass @ self._rigid()[:, 3:]

    def centrifugal(self) -> Array:
        """-rho W_k c; of particles with rotary inertia their moments, too."""
        d = self._body.dimension
        arms = self._body.positions - self._origin[:d]
        fields = np.zeros((self._body.ndof, 6))
        for k, products in enumerate(CENTRIFUGAL):
            for axis in range(d):
                numbers = self._body.table[:, axis]
                there = numbers >= 0
                fields[numbers[there], k] = (arms @ products[axis, :d])[there]
        loads: Array = -self._body.field_mass @ fields
        points = self._body.inertia_points
        if points is None or self._body.full_mass is not None:
            return loads
        return loads + centrifugal_loads(points, self._origin)

    def _rigid(self) -> Array:
        rigid = self._body.rigid_body_modes(self._origin)
        if self._body.dimension == 3:
            return rigid
        full = np.zeros((len(rigid), 6))
        full[:, [0, 1, 5]] = rigid
        return full


def _added(block: Taylor, stiffness: Array | None) -> Taylor:
    """First-order terms plus stiffness (columns, nq, nq): m1[l, k, column]."""
    if stiffness is None:
        return block
    first = block.first_order(stiffness.shape[1])
    return replace(block, m1=first + np.moveaxis(stiffness, 0, -1), order=1)


def _loaded_node(node: Node, stiffness: Any) -> Node:
    """With the stiffness of forces and moments, and the excess of their rows.

    A marker that does not turn has no excess; if it is held, the frame takes its
    moments.
    """
    if stiffness is None:
        return node
    (force, moment), (shift, turn) = stiffness
    if not node.psi.m0.any():
        return replace(node, phi=_loaded(node.phi, force))
    phi, psi = _loaded(node.phi, force + shift), _loaded(node.psi, moment + turn)
    return replace(node, phi=phi, psi=psi)


def _loaded(block: Taylor, stiffness: Array) -> Taylor:
    """phi or psi on the side of the load: m1[l, axis, k] = -Kg."""
    if not stiffness.any():
        return block
    return replace(block, m1=-np.moveaxis(stiffness, 0, 1), order=1)
