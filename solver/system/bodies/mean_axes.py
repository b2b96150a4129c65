"""The inertia of a stiffened body as its mean axes see it, in SID quantities.

Deformations q turn the body, on the mean, by theta = tilt q about its centre of mass.
Axes turned so see moments of inertia H(q) and the angular momentum H W + coupling q',
of which the tilt that the body frame adds is taken off. Shape functions less the rigid
motion that has their momentum and angular momentum, Phi_k - t_k - theta_k x c, do not
depend on the body frame: theory, section 12.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.sid import OE_INDICES, SID, Array, symmetric_3x3
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, coupled_mass_matrix, skew

#: Axes of rotation that do not exist in the plane.
ACROSS = (0, 1)


@dataclass(frozen=True, eq=False)
class MeanAxes:
    """Expansion in the elastic coordinates of the rotation about the centre of mass.

    tilt : (nq, 3) mean rotation of each shape function
    inertia, slopes, bows : (3, 3), (nq, 3, 3) and (nq, nq, 3, 3), of H(q) =
        inertia + slopes q + q bows q / 2
    coupling : (3, nq, nq) as (axis, k, l): angular momentum of a rate of q_k per q_l
    """

    tilt: Array
    inertia: Array
    slopes: Array
    bows: Array
    coupling: Array


def mean_axes(sid: SID, ct1: Array, cr1: Array, oe1: Array, planar: bool) -> MeanAxes:
    """Of a SID; a planar body turns about z only.

    ct1, cr1 : (3, nq, nq) first-order terms of Ct and Cr, (axis, k, l)
    oe1 : (6, nq, nq) first-order term of Oe, symmetric in k and l
    """
    Ct, md = sid.Ct.m0, sid.mdCM.m0[:, 0]
    J, J1, J2 = _about_centre(sid, ct1, oe1)
    spin = sid.Cr.m0 - np.cross(md, Ct) / sid.mass
    spin1 = np.moveaxis(cr1, 0, 2) - np.cross(md, np.moveaxis(ct1, 0, 2)) / sid.mass
    spin1 = spin1 - np.cross(Ct[None], Ct[:, None]) / sid.mass
    if planar:
        spin, J = spin.copy(), J.copy()
        spin[:, ACROSS], J[ACROSS, :], J[:, ACROSS] = 0.0, 0.0, 0.0
    tilt = spin @ np.linalg.pinv(J, hermitian=True)
    turn = skew(tilt)
    slopes = J1 + _sheared(J, turn)
    twice = np.einsum("kab,lbc->klac", turn, turn)
    twice = 0.5 * (twice + twice.transpose(1, 0, 2, 3))
    rolled = np.einsum("kab,bc,lcd->klad", turn, J, turn)
    shear = np.array([_sheared(matrix, turn) for matrix in J1]).reshape(J2.shape)
    bows = J2 + shear + shear.transpose(1, 0, 2, 3) + twice @ J + J @ twice
    bows = bows - rolled - rolled.transpose(1, 0, 2, 3)
    coupling = spin1 - np.cross(tilt[None], spin[:, None])
    coupling = coupling - np.einsum("lab,kb->kla", slopes, tilt)
    return MeanAxes(tilt, J, slopes, bows, np.moveaxis(coupling, 2, 0))


def _sheared(J: Array, turn: Array) -> Array:
    """J turn - turn J for each rotation: what axes turned so add to J, (nq, 3, 3)."""
    return J @ turn - turn @ J


def _about_centre(sid: SID, ct1: Array, oe1: Array) -> tuple[Array, Array, Array]:
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

    mass : (nq, nq) of their products
    turning : (3, nq, nq) of the products Phi_l x Phi_k
    """

    mass: Array
    turning: Array


def free_shapes(sid: SID, me: Array, cr1: Array, planar: bool) -> FreeShapes:
    """The shape functions of a SID; a planar body has rigid motions in its plane only.

    me : (nq, nq) mass of the elastic coordinates
    cr1 : (3, nq, nq) first-order term of Cr, (axis, k, l)
    """
    axes = list(IN_PLANE[2] if planar else SPATIAL)
    matrix = coupled_mass_matrix(sid)
    coupling, rigid = matrix[6:, axes], np.zeros((sid.nq, 6))
    inverse = np.linalg.pinv(matrix[np.ix_(axes, axes)], hermitian=True)
    rigid[:, axes] = coupling @ inverse
    shift, turn = rigid[:, :3], rigid[:, 3:]
    J, md = symmetric_3x3(sid.J.m0[:, 0]), sid.mdCM.m0[:, 0]
    second = 0.5 * np.trace(J) * np.eye(3) - J
    whole = _first_moments(sid)
    left = whole - shift[:, :, None] * md - skew(turn) @ second
    turning = 0.5 * (cr1 - cr1.transpose(0, 2, 1))
    swept = np.cross(shift[:, None], sid.Ct.m0[None]) + _swept(turn, whole)
    turning = turning + np.moveaxis(swept, 2, 0)
    turning = turning - np.moveaxis(_swept(turn, left), 2, 0).transpose(0, 2, 1)
    return FreeShapes(
        me - coupling @ inverse @ coupling.T,
        0.5 * (turning - turning.transpose(0, 2, 1)),
    )


def _first_moments(sid: SID) -> Array:
    """(nq, 3, 3) integrals of Phi_k(a) c(b), from J m1 and Cr m0."""
    J1 = np.array([symmetric_3x3(row) for row in sid.J.first_order(sid.nq)[:, :, 0]])
    J1 = J1.reshape(-1, 3, 3)
    trace = np.trace(J1, axis1=1, axis2=2)[:, None, None]
    return -0.5 * J1 + 0.25 * trace * np.eye(3) + 0.5 * skew(sid.Cr.m0)


def _swept(turn: Array, moments: Array) -> Array:
    """(k, l, 3): integral of (theta_k x c) x Phi_l, for the first moments of Phi_l."""
    trace = np.trace(moments, axis1=1, axis2=2)
    pulled = np.einsum("kb,lba->kla", turn, moments)
    return pulled - turn[:, None] * trace[None, :, None]
