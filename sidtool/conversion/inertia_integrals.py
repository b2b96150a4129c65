"""Inertia blocks of a SID: one Gram matrix, rotary inertia, full mass matrices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from sidtool.formats.base.sid import J_INDICES, OE_INDICES, Array, Taylor, axis_major
from sidtool.formats.sid_mass import CENTRIFUGAL_PRODUCTS, skew

from ..elements.finite_element_model import FiniteElementModel
from ..elements.material_points import InertiaPoints
from ..mesh.quadratic_fields import LEVI_CIVITA


def with_rotary_inertia(
    blocks: Mapping[str, Taylor], points: InertiaPoints, shapes: Array
) -> dict[str, Taylor]:
    """The blocks of the particles as mass points with their rotary inertia added.

    A particle of inertia T turns by the rotation vector psi q: its inertia is A T A^T,
    its angular velocity relative to the frame psi q' + (psi q) x (psi q') / 2. The
    terms follow from its kinetic energy; of the first-order term of Cr the part
    antisymmetric in the modes is kept, as for solids.
    """
    nq = shapes.shape[1]
    t = points.inertias
    psi = np.swapaxes((points.rotation @ shapes).reshape(-1, 3, nq), 1, 2)
    turned = skew(psi) @ t[:, None]
    change = turned + np.swapaxes(turned, 2, 3)
    cr = np.einsum("pab,plb->la", t, psi)
    spin = np.einsum("bcd,plc,pid->plib", LEVI_CIVITA, psi, psi)
    cr1 = np.einsum("pib,plba->lia", psi, change)
    cr1 += np.einsum("plib,pba->lia", spin, t) / 2
    added = _rotary_blocks(
        inertia=t.sum(axis=0),
        inertia1=change.sum(axis=0),
        cr=cr,
        cr1=(cr1 - np.swapaxes(cr1, 0, 1)) / 2,
        oe1=-_second_derivative(psi, t) / 2,
    )
    added["Me"] = Taylor(np.einsum("pia,pab,plb->il", psi, t, psi))
    return dict(blocks) | {k: _add_blocks(blocks[k], added[k]) for k in added}


def centrifugal_loads(points: InertiaPoints, origin: Array) -> Array:
    """(ndof, 6) forces and moments of the particles in a frame that turns steadily.

    One column for each product of angular velocities in Oe's order: -m omega x (omega
    x c) and -omega x (T omega).
    """
    arms = points.positions - origin
    forces = -np.einsum("kab,pb,p->pak", CENTRIFUGAL_PRODUCTS, arms, points.masses)
    moments = np.einsum("abc,pbd->padc", LEVI_CIVITA, points.inertias)
    moments = (moments + np.swapaxes(moments, 2, 3)) / 2
    total: Array = points.displacement.T @ forces.reshape(-1, 6)
    return total + points.rotation.T @ _inertia_products(moments).reshape(-1, 6)


def blocks_of_full_mass(
    body: FiniteElementModel, origin: Array, shapes: Array
) -> tuple[float, dict[str, Taylor]]:
    """Mass and blocks of a spatial body from its mass matrix alone.

    Source: eq. (9), with Gr and Ge by the identities I10 and I8. Exact for solids, and
    for rigid bodies on nodes, which turn with them by a finite rotation. Lumped beams
    consist of such bodies and differ from beams: the inertia of a half element along
    its length rotates rigidly, whereas the axis of a beam bends. Of a rod of 6, 12 and
    24 lumped Timoshenko elements the entries of Oe m1 in bending have errors of 0.36,
    0.11 and 0.03 of the largest one, those in torsion do not. A consistent matrix of
    beams has rotary inertia in displacements as well: 36 / (30 h) rho I beside 156 h /
    420 rho A. Only the second part rotates with the section, but a matrix holds the
    sum. Therefore this part is missing in Oe m1 of torsion; `imported_matrices` notes
    this.
    """
    nq = shapes.shape[1]
    rigid = body.rigid_body_modes(origin)
    turned = _rotated_shapes(body, shapes)
    fields = np.hstack([rigid, shapes, turned.reshape(body.ndof, -1)])
    gram = fields.T @ (body.mass @ fields)
    gram = (gram + gram.T) / 2
    t, r, v = slice(0, 3), slice(3, 6), slice(6, 6 + nq)
    d = slice(6 + nq, None)
    gr = 2 * np.swapaxes(gram[r, d].reshape(3, nq, 3), 0, 1)
    x = gram[v, d].reshape(nq, nq, 3)
    dd = gram[d, d].reshape(nq, 3, nq, 3)
    oe1 = -np.einsum("ialb->liab", dd) - _second_order_rotations(body, shapes)
    blocks = _rotary_blocks(
        inertia=gram[r, r],
        inertia1=(gr + np.swapaxes(gr, 1, 2)) / 2,
        cr=gram[v, r],
        cr1=(np.swapaxes(x, 0, 1) - x) / 2,
        oe1=(oe1 + np.swapaxes(oe1, 2, 3)) / 2,
    )
    ct = gram[v, t]
    arm = gram[r, t]
    blocks["mdCM"] = Taylor(
        np.array([[arm[2, 1]], [arm[0, 2]], [arm[1, 0]]]), ct[:, :, None]
    )
    blocks["Ct"] = Taylor(ct)
    blocks["Me"] = Taylor(gram[v, v])
    return (np.trace(gram[t, t]) / 3).item(), blocks


def _rotated_shapes(body: FiniteElementModel, shapes: Array) -> Array:
    """(ndof, nq, 3): every shape turned about each axis, e_a x phi and e_a x psi."""
    by_node = body.by_node(shapes)
    motion = np.zeros((len(by_node), 6, shapes.shape[1], 3), by_node.dtype)
    for part in (slice(0, 3), slice(3, 6)):
        vectors = np.swapaxes(by_node[:, part], 1, 2)
        motion[:, part] = -np.moveaxis(skew(vectors), 2, 1)
    result = np.zeros((body.ndof, shapes.shape[1], 3), motion.dtype)
    there = body.table >= 0
    result[body.table[there]] = motion[there]
    return result


def _second_order_rotations(body: FiniteElementModel, shapes: Array) -> Array:
    """(nq, nq, 3, 3): what the second order of the nodes' rotations adds to J.

    In the axes of a node that turns by psi q, an angular velocity w has the second-
    order part psi~ psi~ w / 2, by which the rotary inertia of the matrix is multiplied.
    """
    there = body.table[:, 3:] >= 0
    dofs = body.table[:, 3:][there]
    unit = np.zeros((*there.shape, 3))
    unit[:] = np.eye(3)
    momentum = np.zeros(unit.shape, body.mass.dtype)
    momentum[there] = body.mass[dofs][:, dofs] @ unit[there]
    s = skew(np.swapaxes(body.by_node(shapes)[:, 3:], 1, 2))
    squares = np.einsum("piab,plbc,pcd->liad", s, s, momentum, optimize=True)
    squares = (squares + np.swapaxes(squares, 0, 1)) / 2
    return np.asarray((squares + np.swapaxes(squares, 2, 3)) / 2)


def _rotary_blocks(
    *, inertia: Array, inertia1: Array, cr: Array, cr1: Array, oe1: Array
) -> dict[str, Taylor]:
    """J, Cr, Gr, Ge, Oe from tensors.

    Parameters
    ----------
    inertia : (3, 3)
    inertia1 : (nq, 3, 3) its derivatives
    cr : (nq, 3)
    cr1 : (nq, nq, 3) [l, i, a], antisymmetric in l, i
    oe1 : (nq, nq, 3, 3) [l, i], symmetric in the axes
    """
    return {
        "J": Taylor(
            _six_components(inertia)[:, None], _six_components(inertia1)[..., None]
        ),
        "Cr": Taylor(cr, cr1),
        "Gr": Taylor(axis_major(inertia1 - skew(cr))),
        "Ge": Taylor(axis_major(cr1 - np.swapaxes(cr1, 0, 1))),
        "Oe": Taylor(_inertia_products(-inertia1 / 2), _inertia_products(oe1)),
    }


def _second_derivative(psi: Array, inertias: Array) -> Array:
    """(nq, nq, 3, 3) of A T A^T summed over particles, A the finite rotation."""
    s = skew(psi)
    weighted = s @ inertias[:, None]
    crossed = -np.tensordot(weighted, s, ((0, 3), (0, 2))).transpose(2, 0, 1, 3)
    squares = np.tensordot(s, weighted, ((0, 3), (0, 2))).transpose(2, 0, 1, 3)
    squares = (squares + np.swapaxes(squares, 0, 1)) / 2
    total = crossed + np.swapaxes(crossed, 0, 1)
    return total + squares + np.swapaxes(squares, 2, 3)


def _inertia_products(tensors: Array) -> Array:
    """(..., 3, 3) symmetric as (..., 6) coefficients of the products in Oe."""
    factors = [1 if a == b else 2 for a, b in OE_INDICES]
    columns = [f * tensors[..., *p] for f, p in zip(factors, OE_INDICES, strict=True)]
    return np.stack(columns, axis=-1)


def _six_components(tensors: Array) -> Array:
    return np.stack([tensors[..., a, b] for a, b in J_INDICES], axis=-1)


def _add_blocks(a: Taylor, b: Taylor) -> Taylor:
    m1 = b.m1 if a.m1 is None else a.m1 if b.m1 is None else a.m1 + b.m1
    return Taylor(a.m0 + b.m0, m1)


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


def _no_moments(nq: int, kind: Any = float) -> MassMoments:
    return MassMoments(
        mass=0.0,
        c=np.zeros(3, kind),
        cc=np.zeros((3, 3), kind),
        phi=np.zeros((nq, 3), kind),
        phi_c=np.zeros((nq, 3, 3), kind),
        phi_phi=np.zeros((nq, 3, nq, 3), kind),
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
    rigid = np.zeros((n, 1 + d), positions.dtype)
    rigid[: len(positions)] = np.column_stack([np.ones(len(positions)), positions])
    columns = np.hstack([rigid, by_mode])
    gram = columns.T @ (mass @ columns)
    gram = (gram + gram.T) / 2
    c = slice(1, 1 + d)
    phi = slice(1 + d, None)
    plane = slice(0, d)
    result = replace(_no_moments(nq, gram.dtype), mass=gram[0, 0].item())
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
