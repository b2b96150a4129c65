"""Identities I18 to I21: orientations, empty blocks, signs, higher orders."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    SID,
    Array,
    Node,
    Taylor,
    orientation_deviation,
    orientation_fault,
)
from sidtool.formats.sid_mass import skew
from sidtool.solver.system.sid_terms import (
    SYMMETRY_ROUNDING,
    check_first_order,
    non_potential_fraction,
)

from .frequencies import sign_correlation
from .identity import Finding, identity, max_magnitude, modal_blocks, transpose_modes

#: A rotation to this, and its first order: what single precision prints.
ROTATION_TOLERANCE = 1e-6


def orientation_error(m0: Array, m1: Array, psi: Array) -> float:
    """How far m1 (nq, 3, 3) is from (psi_l)~ m0, relative to psi (3, nq)."""
    size = max_magnitude(psi)
    difference = m1 - skew(psi.T) @ m0
    return max_magnitude(difference) / size if size else max_magnitude(difference)


def corrected_orientation(node: Node, nq: int) -> tuple[Taylor, str] | None:
    """Return the orientation that the rest of the node implies, and why; None if
    correct.

    If AP m1 is given, it and psi determine AP m0, since AP m1_l = (psi_l)~ AP0;
    so transposed, reflected and lost orientations are recovered.
    """
    m0, m1, psi = node.AP.m0, node.AP.first_order(nq), node.psi.m0
    if (
        not orientation_fault(m0)
        and orientation_error(m0, m1, psi) <= ROTATION_TOLERANCE
    ):
        return None
    candidates = (
        (m0.T, np.swapaxes(m1, 1, 2), "AP was written as its transpose"),
        (m0.T, m1, "AP m0 was written as its transpose"),
    )
    for candidate, rate, why in candidates:
        if (
            not orientation_fault(candidate)
            and orientation_error(candidate, rate, psi) <= ROTATION_TOLERANCE
        ):
            return Taylor(candidate, rate), why
    candidate, why = m0, "AP m1_l = (psi_l)~ AP0"
    implied = _implied_orientation(m1, psi)
    if implied is not None:
        candidate, why = implied, "AP0 follows from AP m1_l = (psi_l)~ AP0"
    elif not m0.any():
        candidate, why = np.eye(3), "AP was empty: the axes of the body frame"
    if orientation_fault(candidate):
        return None
    return Taylor(candidate, skew(psi.T) @ candidate if nq else None), why


def _implied_orientation(m1: Array, psi: Array) -> Array | None:
    """Return AP0 from its first order by least squares; None if that is no rotation."""
    if not m1.any():
        return None
    turns = skew(psi.T).reshape(-1, 3)
    solved, _, rank, _ = np.linalg.lstsq(turns, m1.reshape(-1, 3), rcond=1e-9)
    orientation = np.asarray(solved, np.float64)
    if (
        rank < 3
        or orientation_fault(orientation)
        or orientation_error(orientation, m1, psi) > ROTATION_TOLERANCE
    ):
        return None
    left, _, right = np.linalg.svd(orientation)
    return np.asarray(left @ right)


@identity("I18", bound=1e-5)
def node_orientation_deviation(sid: SID) -> Finding:
    """Return the largest entry of AP^T AP - I; a reflected or empty AP always fails."""
    if not sid.nodes:
        return Finding(None, "no nodes")
    wrong = [(node.id, orientation_fault(node.AP.m0)) for node in sid.nodes]
    wrong = [(name, text) for name, text in wrong if text]
    worst = max(orientation_deviation(node.AP.m0) for node in sid.nodes)
    if not wrong:
        return Finding(worst, size=1.0, terms=6)
    name, text = wrong[0]
    more = f" and at {len(wrong) - 1} more" if len(wrong) > 1 else ""
    return Finding(worst, f"{text} at node {name}{more}", broken=True)


@identity("I19", bound=0.0)
def placeholder_count(sid: SID) -> Finding:
    """Return the number of blocks that are zero although others imply non-zero
    values.
    """
    if sid.nq == 0:
        return Finding(None, "rigid body")
    empty = list(_empty_blocks(sid))
    return Finding(float(len(empty)), "empty: " + ", ".join(empty) if empty else "")


def _empty_blocks(sid: SID) -> Iterator[str]:
    modes = modal_blocks(sid)
    static = sid.mdCM.first_order(sid.nq)
    moved = any(node.phi.m0.any() for node in sid.nodes)
    no_inertia = sid.mass > 0.0 and sid.J.is_zero
    if no_inertia:
        yield "J"
    elif not modes.J1.any() and sid.Oe.m0.any():
        yield "J m1"
    if not static.any() and sid.Ct.m0.any():
        yield "mdCM m1"
    if not sid.Ct.m0.any() and static.any():
        yield "Ct m0"
    if sid.Gr.is_zero and (modes.J1.any() or sid.Cr.m0.any()):
        yield "Gr"
    if sid.Ge.is_zero and (modes.Cr1 - transpose_modes(modes.Cr1)).any():
        yield "Ge"
    if (sid.Oe.is_zero and no_inertia and moved) or (
        not sid.Oe.m0.any() and modes.J1.any()
    ):
        yield "Oe"
    if no_inertia and moved and sid.Ct.is_zero and sid.Cr.is_zero:
        yield "perhaps Ct, Cr, Gr and Ge, unless the axes are mean ones"


@identity("I20", bound=0.5)
def stiffening_sign_deviation(sid: SID) -> Finding:
    """Return minus the correlation with the centrifugal stiffening, if it is
    determined.
    """
    correlations = sign_correlation(sid)
    if not correlations:
        return Finding(None, "no such terms, or mass on all sides of the origin")
    texts = [f"{name} m1 {value:+.2f}" for name, value in correlations.items()]
    worst = max(0.0, -min(correlations.values()))
    return Finding(worst, "correlation " + ", ".join(texts))


@identity("I21", bound=SYMMETRY_ROUNDING)
def energy_free_part(sid: SID) -> Finding:
    """The part of the elastic force of first order that has no energy."""
    if sid.nq == 0:
        return Finding(None, "rigid body")
    measured = non_potential_fraction(sid)
    try:
        check_first_order(sid, "the SID", "")
    except InputError as refused:
        return Finding(measured, refused.problem, broken=True)
    if sid.Ke.first_order(sid.nq).any():
        detail = "elastic forces are quadratic in q (Ke m1), with an energy"
        return Finding(measured, detail)
    return Finding(measured, "elastic forces are linear")
