"""First-order terms of a SID: that of Ke, and those that the equations do not have.

Ke(q) = m0 + sum_l m1_l q_l makes the elastic force Ke(q) q. It has an energy, which a
motion then keeps, only if what m1 adds, K1_kil q_i q_l summed, has a K1 that is the
same under all exchanges of its three indices; the energy is a third of
K1_kil q_k q_i q_l. Of i and l only the symmetric part acts, so that a file may share
it out between m1_l and m1_i as it likes.

Source of such a term (stretching by bending): B. Simeon, "Modelling a flexible slider
crank mechanism by a mixed system of DAEs and PDEs", Math. Modelling of Systems 2, 1996.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import BLOCK_SHAPES, NODE_SHAPES, SID, Array
from sidtool.formats.storage.kept import kept

#: Relative difference of the entries of K1 that rounding in a file makes.
ROUNDING = 1e-9
_WITHOUT = {
    "Me": "a constant Me; inertia that changes stands in Ct, Cr, J and Oe",
    "ksigma": "a constant ksigma; what is linear in q belongs to Ke",
    "De": "a constant De",
}


def cubic_stiffness(sid: SID) -> Array:
    """K1 as (nq, nq, nq): the part of m1 of Ke that has an energy [N m/[q]^3]."""
    force = _force(sid)
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


@kept
def missing_energy(sid: SID) -> float:
    """The part of the force of m1 of Ke that has no energy, relative to the largest."""
    force = _force(sid)
    gap = np.abs(force - cubic_stiffness(sid)).max(initial=0.0)
    return float(gap / (np.abs(force).max(initial=0.0) or 1.0))


def check_first_order(sid: SID, source: str, place: str) -> None:
    """Whether the equations have all terms of a SID beyond its m0.

    Raises
    ------
    InputError : a term would be left out, or makes elastic forces without an energy.
    """
    for name, expected in _WITHOUT.items():
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
    if missing_energy(sid) > ROUNDING:
        raise InputError(
            f"the elastic force Ke(q) q of {source} has no energy (m1 of Ke)",
            place=place,
            expected="a term K1_kil q_i q_l that is the same under all exchanges of "
            "k, i and l once it is symmetric in i and l",
        )


def _force(sid: SID) -> Array:
    """(k, i, l) coefficient of q_i q_l in row k of the force, symmetric in i and l."""
    term = np.moveaxis(sid.Ke.first_order(sid.nq), 0, 2)
    return (term + np.swapaxes(term, 1, 2)) / 2
