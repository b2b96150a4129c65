"""Inertia of a stiffened body in its mean axes, and its removal, theory, section 12.

Deformations q rotate a body on average by theta about its centre of mass. The module
computes theta, the moment of inertia in the mean axes and its derivatives from the
quantities of a SID.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    OE_INDICES,
    SID,
    Array,
    Node,
    Section,
    Taylor,
    symmetric_3x3,
)
from sidtool.formats.geometric_stiffening import has_stiffening
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, coupled_mass_matrix, skew

#: Axes of rotation that do not exist in the plane.
OUT_OF_PLANE_AXES = (0, 1)

#: A shape function does not move along an axis when it does by less than this part.
NO_MOTION = 1e-9
#: Oe's column that multiplies wz wz.
_ZZ = 2


@dataclass(frozen=True, eq=False)
class MeanAxes:
    """Expansion in the elastic coordinates of the rotation about the centre of mass.

    Attributes
    ----------
    theta : (nq, 3)
        Mean rotation of each shape function.
    inertia, d_inertia, d2_inertia : (3, 3)
        (nq, 3, 3) and (nq, nq, 3, 3), of H(q) = inertia + slopes q + q bows q / 2.
    coupling : (3, nq, nq)
        As (axis, k, l): angular momentum of a rate of q_k per q_l.
    """

    theta: Array
    inertia: Array
    d_inertia: Array
    d2_inertia: Array
    coupling: Array


def mean_axes(sid: SID, ct1: Array, cr1: Array, oe1: Array, planar: bool) -> MeanAxes:
    """Of a SID; a planar body rotates about z only.

    Parameters
    ----------
    ct1, cr1 : (3, nq, nq)
        First-order terms of Ct and Cr, (axis, k, l).
    oe1 : (6, nq, nq)
        First-order term of Oe, symmetric in k and l.
    """
    Ct, md = sid.Ct.m0, sid.mdCM.m0[:, 0]
    J, J1, J2 = _central_inertia(sid, ct1, oe1)
    spin = sid.Cr.m0 - np.cross(md, Ct) / sid.mass
    spin1 = np.moveaxis(cr1, 0, 2) - np.cross(md, np.moveaxis(ct1, 0, 2)) / sid.mass
    spin1 = spin1 - np.cross(Ct[None], Ct[:, None]) / sid.mass
    if planar:
        spin, J = spin.copy(), J.copy()
        spin[:, OUT_OF_PLANE_AXES], J[OUT_OF_PLANE_AXES, :], J[:, OUT_OF_PLANE_AXES] = (
            0.0,
            0.0,
            0.0,
        )
    theta = spin @ np.linalg.pinv(J, hermitian=True)
    theta_tilde = skew(theta)
    d_inertia = J1 + _commutator(J, theta_tilde)
    theta_theta = np.einsum("kab,lbc->klac", theta_tilde, theta_tilde)
    theta_theta = 0.5 * (theta_theta + theta_theta.transpose(1, 0, 2, 3))
    theta_J_theta = np.einsum("kab,bc,lcd->klad", theta_tilde, J, theta_tilde)
    J1_commutator = np.array(
        [_commutator(matrix, theta_tilde) for matrix in J1]
    ).reshape(J2.shape)
    d2_inertia = (
        J2
        + J1_commutator
        + J1_commutator.transpose(1, 0, 2, 3)
        + theta_theta @ J
        + J @ theta_theta
    )
    d2_inertia = d2_inertia - theta_J_theta - theta_J_theta.transpose(1, 0, 2, 3)
    coupling = spin1 - np.cross(theta[None], spin[:, None])
    coupling = coupling - np.einsum("lab,kb->kla", d_inertia, theta)
    return MeanAxes(theta, J, d_inertia, d2_inertia, np.moveaxis(coupling, 2, 0))


def _commutator(J: Array, generator: Array) -> Array:
    """J turn - turn J for each rotation: what axes turned so add to J, (nq, 3, 3)."""
    return J @ generator - generator @ J


def _central_inertia(sid: SID, ct1: Array, oe1: Array) -> tuple[Array, Array, Array]:
    """Moments of inertia about the centre of mass and their first two derivatives."""
    nq, mass = sid.nq, sid.mass
    J = symmetric_3x3(sid.J.m0[:, 0])
    J1 = np.array([symmetric_3x3(row) for row in sid.J.first_order(nq)[:, :, 0]])
    J2 = np.zeros((nq, nq, 3, 3))
    for (a, b), column in zip(OE_INDICES, oe1, strict=True):
        J2[:, :, a, b] -= column
        J2[:, :, b, a] -= column
    m, m1, m2 = skew(sid.mdCM.m0[:, 0]), skew(sid.Ct.m0), skew(np.moveaxis(ct1, 0, 2))
    mixed = np.einsum("kab,lbc->klac", m1, m1)
    second = m @ m2 + m2 @ m + mixed + mixed.transpose(1, 0, 2, 3)
    first = J1.reshape(nq, 3, 3) + (m @ m1 + m1 @ m) / mass
    return J + m @ m / mass, first, J2 + second / mass


@dataclass(frozen=True, eq=False)
class FreeShapes:
    """Integrals of the shape functions less their rigid motions.

    Attributes
    ----------
    mass : (nq, nq)
        Their products.
    rotation_coupling : (3, nq, nq)
        The products Phi_l x Phi_k.
    """

    mass: Array
    rotation_coupling: Array


def free_shapes(sid: SID, me: Array, cr1: Array, planar: bool) -> FreeShapes:
    """The shape functions of a SID; a planar body has rigid motions in its plane only.

    Parameters
    ----------
    me : (nq, nq)
        Mass of the elastic coordinates.
    cr1 : (3, nq, nq)
        First-order term of Cr, (axis, k, l).
    """
    axes = list(IN_PLANE[2] if planar else SPATIAL)
    matrix = coupled_mass_matrix(sid)
    coupling, rigid = matrix[6:, axes], np.zeros((sid.nq, 6))
    inverse = np.linalg.pinv(matrix[np.ix_(axes, axes)], hermitian=True)
    rigid[:, axes] = coupling @ inverse
    translation, rotation = rigid[:, :3], rigid[:, 3:]
    J, md = symmetric_3x3(sid.J.m0[:, 0]), sid.mdCM.m0[:, 0]
    second = 0.5 * np.trace(J) * np.eye(3) - J
    first_moments = _first_moments(sid)
    remaining_moments = (
        first_moments - translation[:, :, None] * md - skew(rotation) @ second
    )
    coupling_moments = 0.5 * (cr1 - cr1.transpose(0, 2, 1))
    rigid_moments = np.cross(translation[:, None], sid.Ct.m0[None]) + _rotation_moments(
        rotation, first_moments
    )
    coupling_moments = coupling_moments + np.moveaxis(rigid_moments, 2, 0)
    coupling_moments = coupling_moments - np.moveaxis(
        _rotation_moments(rotation, remaining_moments), 2, 0
    ).transpose(0, 2, 1)
    return FreeShapes(
        me - coupling @ inverse @ coupling.T,
        0.5 * (coupling_moments - coupling_moments.transpose(0, 2, 1)),
    )


def _first_moments(sid: SID) -> Array:
    """(nq, 3, 3) integrals of Phi_k(a) c(b), from J m1 and Cr m0."""
    J1 = np.array([symmetric_3x3(row) for row in sid.J.first_order(sid.nq)[:, :, 0]])
    J1 = J1.reshape(-1, 3, 3)
    trace = np.trace(J1, axis1=1, axis2=2)[:, None, None]
    return -0.5 * J1 + 0.25 * trace * np.eye(3) + 0.5 * skew(sid.Cr.m0)


def _rotation_moments(rotation: Array, moments: Array) -> Array:
    """(k, l, 3): integral of (theta_k x c) x Phi_l, for the first moments of Phi_l."""
    trace = np.trace(moments, axis1=1, axis2=2)
    product = np.einsum("kb,lba->kla", rotation, moments)
    return product - rotation[:, None] * trace[None, :, None]


def can_remove_stiffening(sid: SID, planar: bool) -> bool:
    """True if the blocks determine what is left without geometric stiffening.

    The kinematic part of Oe m1 is made of the integrals of phi_a phi_b. In the plane
    that for wz wz is -Me. In space Me and Cr m1 determine them all where each shape
    function moves every node along one axis, as in a beam that bends in its principal
    planes;
    else they are another mixture.
    """
    if planar:
        phi, _ = sid.shapes
        out, largest = np.abs(phi[:, 2]).max(initial=0.0), np.abs(phi).max(initial=0.0)
        return bool(out <= NO_MOTION * largest)
    return _motion_axes(sid) is not None


def without_stiffening(sid: SID, planar: bool, place: str) -> SID:
    """The SID without Ct m1, phi m1, psi m1 and what of Cr m1, Oe m1 goes with them.

    What is left of Oe m1 holds the rotary inertia that Me holds. In the plane only its
    column for wz wz counts, and the others are zero.

    Raises
    ------
    InputError
        The blocks do not determine what is left, see `can_remove_stiffening`.
    """
    if not has_stiffening(sid):
        return sid
    if not can_remove_stiffening(sid, planar):
        raise InputError(
            "what Oe m1 would be without geometric stiffening does not follow from the "
            "blocks of a body that leaves the plane, unless each of its shape "
            "functions moves along one axis alone",
            place=place,
            expected="true, or a SID that was converted without [stiffening]",
        )
    cr1_term = sid.Cr.first_order(sid.nq)
    antisymmetric = 0.5 * (cr1_term - np.swapaxes(cr1_term, 0, 1))
    return replace(
        sid,
        Ct=Taylor(sid.Ct.m0),
        Cr=Taylor(sid.Cr.m0, antisymmetric),
        Oe=Taylor(
            sid.Oe.m0, _planar_oe1(sid) if planar else _spatial_oe1(sid, antisymmetric)
        ),
        nodes=tuple(map(_without_first_order, sid.nodes)),
        sections=tuple(map(_unstiffened_section, sid.sections)),
    )


def _unstiffened_section(section: Section) -> Section:
    """The section without terms of second order; Oe of parts holds none."""
    part = section.part
    cr1_term = part.Cr.first_order(part.nq)
    part = replace(
        part,
        Ct=Taylor(part.Ct.m0),
        Cr=Taylor(part.Cr.m0, 0.5 * (cr1_term - np.swapaxes(cr1_term, 0, 1))),
        nodes=tuple(map(_without_first_order, part.nodes)),
    )
    return replace(section, part=part)


def _planar_oe1(sid: SID) -> Array:
    centrifugal = np.zeros((sid.nq, sid.nq, 6))
    centrifugal[:, :, _ZZ] = -0.5 * (sid.Me.m0 + sid.Me.m0.T)
    return centrifugal


def _spatial_oe1(sid: SID, antisymmetric: Array) -> Array:
    """Oe m1 as (nq, nq, 6): W_s[a, b] int phi_k phi_i, along the axes a and b.

    The integral is Me's where the axes are the same; else that of their cross product,
    phi_k x phi_i, determines it.
    """
    axes = _motion_axes(sid)
    assert axes is not None
    me = 0.5 * (sid.Me.m0 + sid.Me.m0.T)
    columns = [frozenset(pair) for pair in OE_INDICES]
    oe1 = np.zeros((sid.nq, sid.nq, 6))
    for (k, a), (i, b) in product(enumerate(axes), repeat=2):
        if a == b:
            oe1[k, i, :3] = -me[k, i]
            oe1[k, i, a] = 0.0
        else:
            sign = 1.0 if (b - a) % 3 == 1 else -1.0
            crossed = sign * antisymmetric[k, i, 3 - a - b]
            oe1[k, i, columns.index(frozenset((a, b)))] = crossed
    return oe1


def _motion_axes(sid: SID) -> list[int] | None:
    """The axis 0 to 2 along which each shape function moves all nodes, if it does."""
    phi, _ = sid.shapes
    largest = np.abs(phi).max(axis=0, initial=0.0)
    is_moving = largest > NO_MOTION * largest.max(axis=0, initial=0.0)
    if not (is_moving.sum(axis=0) == 1).all():
        return None
    axes = is_moving.argmax(axis=0)
    transverse = np.abs(sid.Ct.m0) * ~is_moving.T
    if transverse.max(initial=0.0) > NO_MOTION * np.abs(sid.Ct.m0).max(initial=0.0):
        return None
    return [int(axis) for axis in axes]


def _without_first_order(node: Node) -> Node:
    return replace(node, phi=Taylor(node.phi.m0), psi=Taylor(node.psi.m0))
