"""Geometric stiffness of a body from the stress states of unit loads.

Every load that a moving body feels causes a stress state; its geometric stiffness
enters the SID as a first-order term that multiplies the load (theory, section 6). For
forces and moments at markers it is the second derivative of the marker's motion, see
`second_order_rows`.

Source: O. Wallrapp, R. Schwertassek, "Representation of geometric stiffening in
multibody system simulation", Int. J. Numer. Methods Eng. 32, 1991.

A point (y, z) of a cross-section moves with the gradient g_x = a + y b + z c along the
beam, and with g_y and g_z across it:

    a = (u', v', w'),   b = (-kz, 0, theta'),   c = (ky, -theta', 0),
    g_y = (-psi_z, 0, theta),   g_z = (psi_y, -theta, 0),

with the rotation (theta, psi_y, psi_z) of the cross-section and its curvatures ky, kz.
The integral of sigma_xx g_x . g_x + 2 sigma_xy g_x . g_y + 2 sigma_xz g_x . g_z over
the section, with the stresses of its resultants N, My, Mz, Qy, Qz and T, is the
quadratic form below. The torsional moment acts through
integral (y sigma_xz) = -integral (z sigma_xy) = T / 2.

Third moments of the section (of T, C and L) add P_yy b . b + 2 P_yz b . c + P_zz c . c
with P_yy = integral (sigma_xx y y), P_yz and P_zz, linear in My and Mz. Their shear
stress does no work: by the equilibrium along x, 2 integral (y sigma_xy) is the
derivative of P_yy, so that its work on g_x . g_y is the opposite of its work on the
displacements of second order by which a section that turns stays plane and rigid.

In a beam that is bent at rest by ky0 and kz0 a fibre has the length 1 + z ky0 - y kz0:
what strains it is divided by that, (0, psi_z, -psi_y) of a is not, and volumes are
multiplied by it. To first order this adds (ky0 My + kz0 Mz) (psi_y^2 + psi_z^2) and
T theta (ky0 psi_y + kz0 psi_z).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import number_type
from sidtool.formats.base.sid import SID, Array, Node, Taylor
from sidtool.formats.model.reduction import Stiffening
from sidtool.formats.sid_mass import CENTRIFUGAL_PRODUCTS, skew

from ..beams.element import translate_motion
from ..discretisation.marker_couplings import (
    second_order_rows,
    second_order_work_of_ties,
)
from ..elements.finite_element_model import FiniteElementModel, MarkerRows
from ..elements.material_points import (
    BarEnds,
    BeamMaterial,
    stress_from_gradient,
)
from ..mesh.quadratic_fields import LEVI_CIVITA
from ..reduction.admissible_space import AdmissibleSpace, constrained_space
from ..reduction.body_frames import Frame
from ..reduction.reduced_basis import ReducedBasis
from .body_sections import part_of_body
from .inertia_integrals import centrifugal_loads
from .quadrature import quadrature_parts


def add_geometric_stiffening(
    sid: SID,
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    settings: Stiffening,
    loaded: AdmissibleSpace | None = None,
) -> SID:
    """Return the SID with the geometric stiffening of the settings.

    Parameters
    ----------
    loaded : space in which the loads deform the body, by default that of its frame

    Raises
    ------
    InputError : the body has no elements, so its stress is not known.
    """
    loads = _InertiaLoads(body, frame)
    marked = stiffening_markers(body, settings)
    centrifugal = loads.centrifugal() if settings.centrifugal else None
    parts = [*_frame_loads(loads, settings), centrifugal]
    for marker in marked:
        parts += _marker_loads(marker)
    for cut in body.cuts:
        if cut.resultants is not None:
            continue
        beyond = _InertiaLoads(part_of_body(body, cut), frame, cut.points)
        parts += _frame_loads(beyond, settings)
        parts += _marker_loads(cut.section)
    results = iter(geometric_stiffness(body, frame, basis.shapes, parts, loaded))
    blocks: dict[str, Taylor] = {}
    for name in ("Ct", "Cr", "Oe"):
        blocks[name] = _add_stiffness(getattr(sid, name), next(results))
    by_node = {}
    for marker in marked:
        excess = second_order_rows(body, marker, basis.shapes)
        by_node[marker.node] = (next(results), next(results)), excess
    nodes = tuple(_loaded_node(node, by_node.get(int(node.id))) for node in sid.nodes)
    sections = []
    for cut, section in zip(body.cuts, sid.sections, strict=True):
        part = section.part
        if cut.resultants is not None:
            sections.append(section)
            continue
        Ct, Cr = (_add_stiffness(block, next(results)) for block in (part.Ct, part.Cr))
        excess = second_order_rows(body, cut.section, basis.shapes)
        stiffness = (next(results), next(results)), excess
        node = _loaded_node(
            section.node, stiffness if settings.markers is None else None
        )
        part = replace(part, Ct=Ct, Cr=Cr, nodes=(node,))
        sections.append(replace(section, part=part))
    changes: dict[str, Any] = {**blocks, "nodes": nodes, "sections": tuple(sections)}
    return replace(sid, **changes)


class LoadGroup(NamedTuple):
    """Loads that belong together.

    Attributes
    ----------
    nodal : (ndof, n)
    forces : (p, 3, n) of them on the inertia points of the body; None for zero
    """

    nodal: Array
    forces: Array | None = None


def _frame_loads(loads: _InertiaLoads, settings: Stiffening) -> list[LoadGroup | None]:
    """Loads of the acceleration and of the angular acceleration of the frame."""
    return [
        loads.acceleration() if settings.acceleration else None,
        loads.angular_acceleration() if settings.angular_acceleration else None,
    ]


def _marker_loads(marker: MarkerRows) -> list[LoadGroup | None]:
    """Unit forces and unit moments at a marker."""
    rows = marker.displacement, marker.rotation
    return [LoadGroup(part.T.toarray()) for part in rows]


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
    groups: list[LoadGroup | None],
    loaded: AdmissibleSpace | None = None,
) -> list[Array | None]:
    """Phi^T Kg Phi for the stress states of loads that the frame supports.

    Parameters
    ----------
    shapes : (ndof, nq)
    groups : None stays None
    loaded : space in which the loads deform the body, by default that of its frame

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
    nodal = np.hstack([group.nodal for group in given])
    loads = balanced_loads(body, frame, nodal)
    states = (loaded or constrained_space(body, frame)).static(loads)
    total = projected_stiffness(body, states, shapes)
    total += piece_stiffness(body, loads, states, shapes)
    total += _arm_stiffness(body, frame, given, nodal, shapes)
    results: list[Array | None] = []
    start = 0
    for group in groups:
        count = 0 if group is None else group.nodal.shape[1]
        results.append(None if group is None else total[start : start + count])
        start += count
    return results


def balanced_loads(body: FiniteElementModel, frame: Frame, loads: Array) -> Array:
    """Loads (ndof, n) with the reactions of a frame that is defined by conditions.

    It reacts with the forces that do no work on admissible displacements.
    """
    if frame.rows is None:
        return loads
    rigid = body.rigid_body_modes(frame.origin)
    reactions = np.linalg.solve((frame.rows @ rigid).T, rigid.T @ loads)
    balanced: Array = loads - frame.rows.T @ reactions
    return balanced


def _end_stiffness(ends: BarEnds, states: Array, shapes: Array) -> Array:
    """(n, nq, nq) stiffness of forces F and moments M on the ends of bars at nodes.

    A node turns by a rotation vector w. The form of a bar of direction t lacks what M
    does then, -(w . t) (w x M) . t, which ends that continue each other share (J. H.
    Argyris et al., Comput. Methods Appl. Mech. Eng. 20, 1979: semitangential moments).
    """
    count = len(ends.arms)
    forces, moments = (
        (rows @ states).reshape(count, 3, -1) for rows in (ends.forces, ends.moments)
    )
    turns = (ends.rotation @ shapes).reshape(count, 3, -1)
    along = np.einsum("pa,pak->pk", ends.tangents, turns)
    crossed = np.einsum(
        "abc,pbk,pcn,pa->pnk", LEVI_CIVITA, turns, moments, ends.tangents
    )
    mixed = np.einsum("pk,pnl->nkl", along, crossed)
    total: Array = -(mixed + np.swapaxes(mixed, 1, 2)) / 2
    return total - _work_at_arms(ends.arms, ends.node_rotation, forces, shapes)


def _arm_stiffness(
    body: FiniteElementModel,
    frame: Frame,
    groups: list[LoadGroup],
    nodal: Array,
    shapes: Array,
) -> Array:
    """(n, nq, nq) stiffness of inertia forces on particles at arms and couplings.

    Parameters
    ----------
    nodal : (ndof, n) loads of all groups, of which mean axes take away their inertia
    """
    points, nq = body.inertia_points, shapes.shape[1]
    if points is None or body.full_mass is not None:
        return np.zeros((nodal.shape[1], nq, nq))
    none = np.zeros((len(points.masses), 3, 1))
    forces = np.concatenate(
        [
            np.tile(none, group.nodal.shape[1])
            if group.forces is None
            else group.forces
            for group in groups
        ],
        axis=2,
    )
    rigid = body.rigid_body_modes(frame.origin)
    inertia, rows = (body.mass @ rigid).T, frame.rows
    if rows is not None and rows.shape == inertia.shape and _same(rows, inertia):
        spatial = [0, 1, 2, 3, 4, 5] if body.dimension == 3 else [0, 1, 5]
        motion = np.linalg.solve(inertia @ rigid, rigid.T @ nodal)
        moved = translate_motion(points.positions - frame.origin)[:, :3, spatial]
        forces = forces - points.masses[:, None, None] * (moved @ motion)
    if body.beam_material is not None:
        if points.arms is None or points.tangents is None:
            return np.zeros((nodal.shape[1], nq, nq))
        along = np.einsum("pa,pan->pn", points.tangents, forces)
        forces = forces - points.tangents[:, :, None] * along[:, None]
        return _work_at_arms(points.arms, points.rotation, forces, shapes)
    total = np.zeros((nodal.shape[1], nq, nq), number_type(shapes, forces))
    for k in np.flatnonzero(np.diff(points.rotation.indptr[::3])):
        rows_of = (
            part[3 * k : 3 * k + 3] for part in (points.displacement, points.rotation)
        )
        marker = MarkerRows("mass", 0, points.positions[k], *rows_of)
        shift, _ = second_order_rows(body, marker, shapes)
        total += np.einsum("an,akl->nkl", forces[k], shift)
    return total


def _same(first: Array, second: Array) -> bool:
    return bool(np.abs(first - second).max() <= 1e-9 * np.abs(second).max())


def _work_at_arms(
    arms: Array, rotation: sp.csr_matrix, forces: Array, shapes: Array
) -> Array:
    """(n, nq, nq) stiffness of forces f (p, 3, n) at the ends of rigid arms r (p, 3).

    They turn by w, (3 p, ndof) rows, and move to second order by
    (w (w . r) - r (w . w)) / 2.
    """
    turns = (rotation @ shapes).reshape(len(arms), 3, shapes.shape[1])
    by_force = np.einsum("pan,pak->pnk", forces, turns)
    by_arm = np.einsum("pa,pak->pk", arms, turns)
    mixed = np.einsum("pnk,pl->nkl", by_force, by_arm)
    lengths = np.einsum("pan,pa->pn", forces, arms)
    total: Array = np.einsum("pn,pkl->nkl", lengths, _field_products(turns, turns))
    return total - (mixed + np.swapaxes(mixed, 1, 2)) / 2


def piece_stiffness(
    body: FiniteElementModel, loads: Array, states: Array, shapes: Array
) -> Array:
    """(n, nq, nq) stiffness of the forces that hold rigid ties together.

    They are what the static displacements (ndof, n) of loads leave open.
    """
    if not body.rigid_sets:
        return np.zeros((loads.shape[1], shapes.shape[1], shapes.shape[1]))
    return second_order_work_of_ties(body, body.stiffness @ states - loads, shapes)


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
        total = beam_stiffness(body.beam_material, states, shapes)
        if body.bar_ends is not None:
            total = total + _end_stiffness(body.bar_ends, states, shapes)
        return total
    nq = shapes.shape[1]
    total = np.zeros((states.shape[1], nq, nq), number_type(states, shapes))
    for part in quadrature_parts(body):
        stress = stress_from_gradient(part.gradients(states), part.law)
        slopes = part.gradients(shapes)
        total += contract_stress(stress * part.weights[:, None, None, None], slopes)
    return (total + np.swapaxes(total, 1, 2)) / 2


def contract_stress(stress: Array, slopes: Array) -> Array:
    """sum over points of stress (p, n, d, d) with slopes (p, nq, c, d) twice."""
    p, n, d, _ = stress.shape
    nq = slopes.shape[1]
    result = np.zeros((n, nq, nq), number_type(stress, slopes))
    for a in range(d):
        for b in range(d):
            for k in range(nq):
                pairs = np.einsum("pc,plc->pl", slopes[:, k, :, a], slopes[..., b])
                result[:, k] += stress[..., a, b].T @ pairs
    return result


class _InertiaLoads:
    """D'Alembert loads of a unit motion of the frame.

    Parameters
    ----------
    chosen : (p,) particles of the whole body that the body holds; all by default
    """

    def __init__(
        self,
        body: FiniteElementModel,
        frame: Frame,
        chosen: NDArray[np.bool_] | None = None,
    ) -> None:
        self._body, self._origin, self._chosen = body, frame.origin, chosen

    def acceleration(self) -> LoadGroup:
        """-rho e_a; in the plane the third one is zero."""
        nodal = -self._body.mass @ self._rigid()[:, :3]
        return LoadGroup(nodal, self._forces(lambda arms: np.eye(3)[None]))

    def angular_acceleration(self) -> LoadGroup:
        """-rho e_a x c."""
        nodal = -self._body.mass @ self._rigid()[:, 3:]
        return LoadGroup(nodal, self._forces(lambda arms: -skew(arms)))

    def centrifugal(self) -> LoadGroup:
        """-rho W_k c; of particles with rotary inertia their moments, too."""
        forces = self._forces(
            lambda arms: np.einsum("kab,pb->pak", CENTRIFUGAL_PRODUCTS, arms)
        )
        return LoadGroup(self._centrifugal_nodal(), forces)

    def _forces(self, field: Callable[[Array], Array]) -> Array | None:
        """(p, 3, n) on all particles, by the acceleration (p, 3, n) at arms (p, 3)."""
        points = self._body.inertia_points
        if points is None:
            return None
        own = -points.masses[:, None, None] * field(points.positions - self._origin)
        if self._chosen is None:
            return own
        forces = np.zeros((len(self._chosen), *own.shape[1:]), own.dtype)
        forces[self._chosen] = own
        return forces

    def _centrifugal_nodal(self) -> Array:
        d = self._body.dimension
        arms = self._body.positions - self._origin[:d]
        fields = np.zeros((self._body.ndof, 6), arms.dtype)
        for k, products in enumerate(CENTRIFUGAL_PRODUCTS):
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
        full = np.zeros((len(rigid), 6), rigid.dtype)
        full[:, [0, 1, 5]] = rigid
        return full


def _add_stiffness(block: Taylor, stiffness: Array | None) -> Taylor:
    """First-order terms plus stiffness (columns, nq, nq): m1[l, k, column]."""
    if stiffness is None:
        return block
    first = block.first_order(stiffness.shape[1])
    return replace(block, m1=first + np.moveaxis(stiffness, 0, -1), order=1)


def _loaded_node(node: Node, stiffness: Any) -> Node:
    """Add the stiffness of forces and moments to a node, and second-order terms of its
    rows.

    A marker without rotation has no second-order terms; if it is fixed, the frame takes
    its moments.
    """
    if stiffness is None:
        return node
    (force, moment), (shift, turn) = stiffness
    if not node.psi.m0.any():
        return replace(node, phi=_with_load_stiffness(node.phi, force))
    phi, psi = (
        _with_load_stiffness(node.phi, force + shift),
        _with_load_stiffness(node.psi, moment + turn),
    )
    return replace(node, phi=phi, psi=psi)


def _with_load_stiffness(block: Taylor, stiffness: Array) -> Taylor:
    """phi or psi on the side of the load: m1[l, axis, k] = -Kg."""
    if not stiffness.any():
        return block
    return replace(block, m1=-np.moveaxis(stiffness, 0, 1), order=1)


def beam_stiffness(material: BeamMaterial, states: Array, shapes: Array) -> Array:
    """(n, nq, nq) geometric stiffness of the stresses of displacements (ndof, n).

    Parameters
    ----------
    states : (ndof, n) displacements whose stress acts
    shapes : (ndof, nq)
    """
    a, b, c, across_y, across_z = _gradients(material, shapes)
    resultants = np.moveaxis(material.resultants_of(states), 1, 0)
    normal_force, shear_y, shear_z, twisting, bending_y, bending_z = resultants
    squares = np.einsum("pab,apn->bpn", material.stress_moments, resultants[[0, 4, 5]])
    terms = (
        (normal_force, _field_products(a, a)),
        (bending_y, 2 * _field_products(a, c)),
        (-bending_z, 2 * _field_products(a, b)),
        (shear_y, 2 * _field_products(a, across_y)),
        (shear_z, 2 * _field_products(a, across_z)),
        (twisting, _field_products(b, across_z) - _field_products(c, across_y)),
        *zip(
            squares,
            (_field_products(b, b), 2 * _field_products(b, c), _field_products(c, c)),
            strict=True,
        ),
        *_initial_curvature_terms(material, resultants, shapes),
    )
    total: Array = sum(
        np.einsum("p,pn,pkl->nkl", material.weights, force, form)
        for force, form in terms
    )
    return (total + np.swapaxes(total, 1, 2)) / 2


def _gradients(material: BeamMaterial, shapes: Array) -> tuple[Array, ...]:
    """a, b, c, g_y and g_z at the points, (p, 3, nq) each."""
    strain = np.moveaxis(material.strains_of(shapes), 1, 0)
    turn = np.moveaxis(material.turns_of(shapes), 1, 0)
    stretch, shear_y, shear_z, twist, curved_y, curved_z = strain
    theta, psi_y, psi_z = turn
    zero = np.zeros_like(theta)
    vectors = (
        (stretch, psi_z + shear_y, shear_z - psi_y),
        (-curved_z, zero, twist),
        (curved_y, -twist, zero),
        (-psi_z, zero, theta),
        (psi_y, -theta, zero),
    )
    return tuple(np.stack(vector, axis=1) for vector in vectors)


def _initial_curvature_terms(
    material: BeamMaterial, resultants: Array, shapes: Array
) -> tuple[tuple[Array, Array], ...]:
    """Forces (p, n) and forms (p, nq, nq) that curvature at rest adds."""
    _, ky, kz = material.curvatures.T[:, :, None]
    if not (ky.any() or kz.any()):
        return ()
    *_, twisting, bending_y, bending_z = resultants
    turns = material.turns_of(shapes)
    across = turns[:, 1:]
    along = (ky * turns[:, 1] + kz * turns[:, 2])[:, None]
    return (
        (ky * bending_y + kz * bending_z, _field_products(across, across)),
        (twisting, _field_products(turns[:, :1], along)),
    )


def _field_products(first: Array, second: Array) -> Array:
    """(p, nq, nq) scalar products of two vector fields (p, 3, nq)."""
    return np.einsum("pck,pcl->pkl", first, second)
