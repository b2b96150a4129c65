"""Inertia blocks of a SID from one Gram matrix."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import scipy.sparse as sp

from sidtool.formats.base.sid import J_INDICES, OE_INDICES, Array, Taylor, axis_major

from ..elements.finite_element_model import FiniteElementModel
from ..mesh.quadratic_fields import LEVI_CIVITA
from .rotary_inertia import blocks_of_full_mass, with_rotary_inertia


@dataclass(frozen=True, eq=False)
class MassMoments:
    """Integrals of position c and shape functions phi over the mass of a body.

    Attributes
    ----------
    mass : [kg]
    c : (3,) int c_a dm
    cc : (3, 3) int c_a c_b dm
    phi : (nq, 3) int phi_l(a) dm
    phi_c : (nq, 3, 3) int phi_l(a) c_b dm
    phi_phi : (nq, 3, nq, 3) int phi_i(a) phi_l(b) dm
    """

    mass: float
    c: Array
    cc: Array
    phi: Array
    phi_c: Array
    phi_phi: Array

    def __add__(self, other: MassMoments) -> MassMoments:
        names = [field.name for field in fields(self)]
        return MassMoments(*(getattr(self, n) + getattr(other, n) for n in names))


def _no_moments(nq: int) -> MassMoments:
    return MassMoments(
        mass=0.0,
        c=np.zeros(3),
        cc=np.zeros((3, 3)),
        phi=np.zeros((nq, 3)),
        phi_c=np.zeros((nq, 3, 3)),
        phi_phi=np.zeros((nq, 3, nq, 3)),
    )


def body_inertia(
    body: FiniteElementModel, origin: Array, shapes: Array
) -> tuple[float, dict[str, Taylor]]:
    """Mass and inertia blocks of a body of any kind.

    Parameters
    ----------
    origin : (3,) of the body frame, whose axes are those of the model [m]
    shapes : (ndof, nq)

    Returns
    -------
    mass [kg] and the blocks mdCM, J, Ct, Cr, Me, Gr, Ge, Oe
    """
    if body.full_mass is not None:
        return blocks_of_full_mass(body, origin, shapes)
    nq, d = shapes.shape[1], body.dimension
    total = _no_moments(nq)
    if body.scalar_mass is not None:
        mass, solid = body.scalar_mass, body.by_node(shapes)[:, :d]
        if body.internal_inertia is not None:
            mass = body.internal_inertia.scalar_mass(mass)
            inner = body.internal_inertia.fields(shapes, d)
            solid = np.concatenate([solid, inner])
        total += mass_moments(mass, body.positions - origin[:d], solid)
    points = body.inertia_points
    if points is None:
        return total.mass, inertia_blocks(total)
    moved = (points.displacement @ shapes).reshape(-1, 3, nq)
    weights = sp.csr_matrix(sp.diags_array(points.masses))
    total += mass_moments(weights, points.positions - origin, moved)
    return total.mass, with_rotary_inertia(inertia_blocks(total), points, shapes)


def mass_moments(mass: sp.csr_matrix, positions: Array, shapes: Array) -> MassMoments:
    """The moments of a body, exactly, from one product with its mass matrix.

    Parameters
    ----------
    mass : (n, n) integral of rho N_i N_j dV [kg]
    positions : (n', d) relative to the body frame, d = 2 or 3 [m]; functions behind
        the first n' are zero in rigid motion
    shapes : (n, d, nq) shape functions by node and component

    Returns
    -------
    In three dimensions always; what a plane body lacks is zero.
    """
    n, d, nq = shapes.shape
    by_mode = np.swapaxes(shapes, 1, 2).reshape(n, nq * d)
    rigid = np.zeros((n, 1 + d))
    rigid[: len(positions)] = np.column_stack([np.ones(len(positions)), positions])
    columns = np.hstack([rigid, by_mode])
    gram = columns.T @ (mass @ columns)
    gram = (gram + gram.T) / 2
    c = slice(1, 1 + d)
    phi = slice(1 + d, None)
    plane = slice(0, d)
    result = replace(_no_moments(nq), mass=float(gram[0, 0]))
    result.c[plane] = gram[0, c]
    result.cc[plane, plane] = gram[c, c]
    result.phi[:, plane] = gram[0, phi].reshape(nq, d)
    result.phi_c[:, plane, plane] = gram[phi, c].reshape(nq, d, d)
    result.phi_phi[:, plane, :, plane] = gram[phi, phi].reshape(nq, d, nq, d)
    return result


def inertia_blocks(m: MassMoments) -> dict[str, Taylor]:
    """mdCM, J, Ct, Cr, Me, Gr, Ge and Oe with their first-order terms."""
    c4 = m.phi_c - np.einsum("lcc,ab->lab", m.phi_c, np.eye(3))
    cross = np.einsum("abc,lbic->lia", LEVI_CIVITA, m.phi_phi)
    return {
        "mdCM": Taylor(m.c[:, None], m.phi[:, :, None]),
        "J": Taylor(
            _to_six(np.trace(m.cc) * np.eye(3) - m.cc)[:, None],
            -_to_six(c4 + np.swapaxes(c4, 1, 2))[..., None],
        ),
        "Ct": Taylor(m.phi),
        "Cr": Taylor(np.einsum("abc,lcb->la", LEVI_CIVITA, m.phi_c), cross),
        "Me": Taylor(np.einsum("iala->il", m.phi_phi)),
        "Gr": Taylor(axis_major(-2 * c4)),
        "Ge": Taylor(axis_major(2 * cross)),
        "Oe": Taylor(
            np.einsum("kab,iab->ik", _OMEGA, m.phi_c),
            np.einsum("kab,ialb->lik", _OMEGA, m.phi_phi),
        ),
    }


def _to_six(tensors: Array) -> Array:
    """(..., 3, 3) as (..., 6) in the order of J."""
    return np.stack([tensors[..., a, b] for a, b in J_INDICES], axis=-1)


def _omega_products() -> Array:
    """(6, 3, 3) coefficients of the products of omega in omega~ omega~."""
    products = np.zeros((6, 3, 3))
    for k, (a, b) in enumerate(OE_INDICES):
        products[k, a, b] += 1
        products[k, b, a] += a != b
        products[k] -= np.eye(3) * (a == b)
    return products


_OMEGA = _omega_products()
