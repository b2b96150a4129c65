"""First-order terms of a SID as arrays, and checks of the terms beyond m0.

Geometric stiffening is the first-order term of Ct; K1 is the part of the first-order
term of Ke that has an energy. A body may keep the term q.Me.q of its moment of inertia
where the mass matrix of first order would not be positive.
"""

from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import BLOCK_SHAPES, NODE_SHAPES, SID, Array, Taylor
from sidtool.formats.result.accuracy_report import MAX_DEFLECTION
from sidtool.formats.scene import SidBody
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, body_size, coupled_mass_matrix
from sidtool.formats.storage.cache import cached_by_identity

#: A symmetric part of Cr m1 below this part of it, or of Me, which bounds it where
#: nothing stiffens (Cauchy and Schwarz), is rounding in a file.
SYMMETRIC_PART = 1e-9


def cr1(sid: SID) -> Array:
    """First-order term of Cr as (axis, k, l)."""
    return sid.Cr.first_order(sid.nq).transpose(2, 1, 0)


def ge(sid: SID) -> Array:
    """Ge as (axis, k, l), rebuilt as Cr1 - Cr1^T, the exact theory (I8)."""
    kinematic = cr1(sid)
    return kinematic - kinematic.transpose(0, 2, 1)


def oe1(sid: SID) -> Array:
    """First-order term of Oe as (column, k, l), symmetric in k and l (I11)."""
    term = sid.Oe.first_order(sid.nq).transpose(2, 1, 0)
    return 0.5 * (term + term.transpose(0, 2, 1))


def ct1(sid: SID) -> Array:
    """First-order term of Ct as (axis, k, l): geometric stiffening.

    Symmetric in k and l, as Ct(q) is the derivative of mdCM(q).
    """
    term = sid.Ct.first_order(sid.nq).transpose(2, 1, 0)
    return 0.5 * (term + term.transpose(0, 2, 1))


@cached_by_identity
def has_second_order(sid: SID) -> bool:
    """Do Ct and Cr have terms of a displacement field of second order?

    Those are Ct m1 and the part of Cr m1 that is symmetric in the coordinates.
    """
    if sid.nq == 0:
        return False
    cr1_term = cr1(sid)
    symmetric = np.abs(cr1_term + cr1_term.transpose(0, 2, 1)).max(initial=0.0)
    size = max(np.abs(cr1_term).max(initial=0.0), np.abs(sid.Me.m0).max())
    return bool(ct1(sid).any() or symmetric > SYMMETRIC_PART * size)


def without_rotation_blocks(sid: SID) -> SID:
    """A stiffened body without J, Cr and Oe, whose place the mean axes take."""
    if not has_second_order(sid):
        return sid
    J, Cr, Oe = (Taylor(np.zeros_like(b.m0)) for b in (sid.J, sid.Cr, sid.Oe))
    return replace(sid, J=J, Cr=Cr, Oe=Oe)


#: Relative difference of the entries of K1 that rounding in a file makes.
SYMMETRY_ROUNDING = 1e-9
_CONSTANT_BLOCKS = {
    "Me": "a constant Me; inertia that changes is in Ct, Cr, J and Oe",
    "ksigma": "a constant ksigma; what is linear in q belongs to Ke",
    "De": "a constant De",
}


def cubic_stiffness(sid: SID) -> Array:
    """K1 as (nq, nq, nq): the part of m1 of Ke that has an energy [N m/[q]^3]."""
    force = _quadratic_force(sid)
    return (force + np.moveaxis(force, 0, 1) + np.moveaxis(force, 0, 2)) / 3


def cubic_energies(sid: SID, q: Array) -> Array:
    """What m1 of Ke adds to the energy of deformation at q, coordinate by coordinate.

    q, result : (nt, nq); the energy is the sum [J]. A coordinate has q_k times its part
    of the force, as it has of the quadratic energy.
    """
    if sid.Ke.m1 is None:
        return np.zeros_like(q)
    force: Array = np.einsum("kil,ti,tl->tk", cubic_stiffness(sid), q, q)
    return q * force / 3


@cached_by_identity
def non_potential_fraction(sid: SID) -> float:
    """The part of the force of m1 of Ke that has no energy, relative to the largest."""
    force = _quadratic_force(sid)
    gap = np.abs(force - cubic_stiffness(sid)).max(initial=0.0)
    return float(gap / (np.abs(force).max(initial=0.0) or 1.0))


def check_first_order(sid: SID, source: str, place: str) -> None:
    """True if the equations have all terms of a SID beyond its m0.

    Raises
    ------
    InputError
        A term would be left out, or makes elastic forces without an energy.
    """
    for name, expected in _CONSTANT_BLOCKS.items():
        if getattr(sid, name).first_order(sid.nq).any():
            problem = f"{name} in {source} has a first-order term (m1)"
            raise InputError(problem, place=place, expected=expected)
    terms = [(name, getattr(sid, name)) for name in BLOCK_SHAPES]
    terms += [
        (f"{name} of node {node.id}", getattr(node, name))
        for node in sid.nodes
        for name in NODE_SHAPES
    ]
    for name, term in terms:
        if term is not None and term.mn is not None and term.mn.any():
            raise InputError(
                f"{name} in {source} has terms above the first order (mn)",
                place=place,
                expected="m0 and m1, for the meaning of others is not defined",
            )
    if non_potential_fraction(sid) > SYMMETRY_ROUNDING:
        raise InputError(
            f"the elastic force Ke(q) q of {source} has no energy (m1 of Ke)",
            place=place,
            expected="a term K1_kil q_i q_l that is the same under all exchanges of "
            "k, i and l once it is symmetric in i and l",
        )


def _quadratic_force(sid: SID) -> Array:
    """(k, i, l) coefficient of q_i q_l in row k of the force, symmetric in i and l."""
    term = np.moveaxis(sid.Ke.first_order(sid.nq), 0, 2)
    return (term + np.swapaxes(term, 1, 2)) / 2


def has_quadratic_inertia(body: SidBody, sid: SID, planar: bool) -> bool:
    """True if a body of a scene keeps the term q.Me.q: as the scene says, else where it
    would lose its inertia without.
    """
    if body.quadratic_inertia is not None:
        return body.quadratic_inertia
    return body.frame != "held" and not body.rigid and loses_inertia(sid, planar)


@cached_by_identity
def loses_inertia(sid: SID, planar: bool) -> bool:
    """True if the mass matrix of first order is not positive at some deformation in one
    shape function that linear theory of deformation describes.
    """
    if has_second_order(sid) or not sid.Oe.first_order(sid.nq).any():
        return False
    axes = list(IN_PLANE[2] if planar else SPATIAL)
    scale = np.sqrt(np.abs(sid.Me.m0.diagonal()) / (sid.mass or 1.0))
    for node in sid.nodes:
        scale = np.maximum(scale, np.abs(node.phi.m0).max(axis=0))
    largest = MAX_DEFLECTION * body_size(sid) / np.where(scale > 0.0, scale, np.inf)
    return any(
        _least_remaining_inertia(coupled_mass_matrix(sid, q), axes) <= 0.0
        for way in (1.0, -1.0)
        for q in np.diag(way * largest)
    )


def _least_remaining_inertia(M: Array, axes: list[int]) -> float:
    """Smallest eigenvalue of what the shape functions leave of the inertia of the
    frame, in units of all of it."""
    frame, both, elastic = M[np.ix_(axes, axes)], M[6:, axes], M[6:, 6:]
    size = np.sqrt(np.abs(frame.diagonal()))
    size = np.where(size > 0.0, size, 1.0)
    remaining = (
        frame - both.T @ np.linalg.lstsq(elastic, both, rcond=None)[0]
    ) / np.outer(size, size)
    return float(np.linalg.eigvalsh(0.5 * (remaining + remaining.T))[0])
