"""The orientation AP of a node: what is wrong with it, and what it must have been."""

from __future__ import annotations

import numpy as np

from sidtool.formats.orientation import fault
from sidtool.formats.sid import Array, Node, Taylor
from sidtool.formats.sid_mass import skew

from .measures import largest

#: A rotation to this, and its first order: what single precision prints.
SAME = 1e-6


def contradiction(m0: Array, m1: Array, psi: Array) -> float:
    """How far m1 (nq, 3, 3) is from (psi_l)~ m0, relative to psi (3, nq)."""
    size = largest(psi)
    difference = m1 - skew(psi.T) @ m0
    return largest(difference) / size if size else largest(difference)


def mended(node: Node, nq: int) -> tuple[Taylor, str] | None:
    """The orientation that the rest of the node implies, and why; None if all is well.

    Where AP m1 is there it tells with psi what AP m0 was, since AP m1_l = (psi_l)~ AP0;
    so transposed, reflected and lost orientations come back.
    """
    m0, m1, psi = node.AP.m0, node.AP.first_order(nq), node.psi.m0
    if not fault(m0) and contradiction(m0, m1, psi) <= SAME:
        return None
    candidates = (
        (m0.T, np.swapaxes(m1, 1, 2), "AP was written as its transpose"),
        (m0.T, m1, "AP m0 was written as its transpose"),
    )
    for found, rate, why in candidates:
        if not fault(found) and contradiction(found, rate, psi) <= SAME:
            return Taylor(found, rate), why
    found, why = m0, "AP m1_l = (psi_l)~ AP0"
    implied = _implied(m1, psi)
    if implied is not None:
        found, why = implied, "AP0 follows from AP m1_l = (psi_l)~ AP0"
    elif not m0.any():
        found, why = np.eye(3), "AP was empty: the axes of the body frame"
    if fault(found):
        return None
    return Taylor(found, skew(psi.T) @ found if nq else None), why


def _implied(m1: Array, psi: Array) -> Array | None:
    """AP0 from its first order by least squares; None if that tells no rotation."""
    if not m1.any():
        return None
    turns = skew(psi.T).reshape(-1, 3)
    solved, _, rank, _ = np.linalg.lstsq(turns, m1.reshape(-1, 3), rcond=1e-9)
    found = np.asarray(solved, np.float64)
    if rank < 3 or fault(found) or contradiction(found, m1, psi) > SAME:
        return None
    left, _, right = np.linalg.svd(found)
    return np.asarray(left @ right)
