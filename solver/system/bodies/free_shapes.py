"""Deformations of a body as seen from its mean axes, in SID quantities.

A shape function less the rigid motion that has its momentum and angular momentum,
Phi_k - t_k - theta_k x c, does not depend on the body frame: the inertia of a stiffened
body is made of these: theory, section 12.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.sid import SID, Array, symmetric_3x3
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, coupled_mass_matrix, skew


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
