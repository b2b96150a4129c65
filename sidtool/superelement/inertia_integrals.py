"""Inertia integrals of a floating frame in the form of other programs.

A tilde is a cross product, x~ y = x x y, and phi_l the displacement field of shape
function l.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import OE_INDICES, SID, Array, by_mode
from sidtool.formats.geometric_stiffening import has_stiffening
from sidtool.formats.sid_mass import skew


@dataclass(frozen=True, eq=False)
class InertiaIntegrals:
    """Integrals over the mass of a body, from the blocks of its SID.

    Attributes
    ----------
    translation : (3, nq) int phi_l dm [kg m/[q]]
    rotation : (3, nq) int c~ phi_l dm, and the angular momentum of rotating sections
    position_shape : (nq, 3, 3) int c~ phi_l~ dm
    shape_cross : (nq, nq, 3) [l, i] int phi_l x phi_i dm
    shape_shape : (nq, nq, 3, 3) [l, i] int phi_l~ phi_i~ dm; zero if the SID has no
        second-order term of the inertia (Oe m1)
    """

    translation: Array
    rotation: Array
    position_shape: Array
    shape_cross: Array
    shape_shape: Array


def inertia_integrals(sid: SID) -> InertiaIntegrals:
    """Return the integrals of a SID.

    With int c~ phi_l~ dm = -Gr_l / 2, int phi_l x phi_i dm = Ge_l / 2 in row i, and the
    symmetric part of int phi_l phi_i^T dm from Oe m1 and Me; see `sidtool.SID`.

    Raises
    ------
    InputError : Oe m1 contains geometric stiffening, which is no inertia.
    """
    if sid.Oe.m1 is not None and has_stiffening(sid):
        raise InputError(
            "the body has geometric stiffening, which is no inertia of its shapes",
            place="Oe m1",
            expected="a body converted without the table [stiffening]",
        )
    cross = by_mode(sid.Ge.m0, sid.nq) / 2
    return InertiaIntegrals(
        translation=sid.Ct.m0.T,
        rotation=sid.Cr.m0.T,
        position_shape=-by_mode(sid.Gr.m0, sid.nq) / 2,
        shape_cross=cross,
        shape_shape=_shape_products(sid, cross),
    )


def _shape_products(sid: SID, cross: Array) -> Array:
    """(nq, nq, 3, 3) int phi_l~ phi_i~ dm.

    The integrand is phi_i phi_l^T - (phi_l . phi_i) 1.
    """
    nq = sid.nq
    products = np.zeros((nq, nq, 3, 3))
    if sid.Oe.m1 is None:
        return products
    for k, (a, b) in enumerate(OE_INDICES):
        values = sid.Oe.m1[:, :, k]
        products[:, :, a, b] = values if a == b else values / 2
        products[:, :, b, a] = products[:, :, a, b]
    # what is not symmetric in the axes: (phi_i phi_l^T - phi_l phi_i^T) / 2
    return products + skew(cross) / 2
