"""Blocks that hold what they should: I18 orientations, I19 contents, I20 signs, I21
terms of higher order."""

from __future__ import annotations

from collections.abc import Iterator

from sidtool.formats.errors import InputError
from sidtool.formats.orientation import deviation, fault
from sidtool.formats.sid import SID
from sidtool.solver.system.bodies.first_order import (
    ROUNDING,
    check_first_order,
    missing_energy,
)

from ..gravity_sign import agreement
from ..measures import modes_of, swapped
from ..registry import Finding, identity


@identity(
    "I18",
    "AP m0 is a rotation at every node",
    severity="error",
    bound=1e-5,
    meaning="a marker has no orientation, or a left-handed one: joints and forces on "
    "it act along wrong axes",
)
def orientations(sid: SID) -> Finding:
    """Largest entry of AP^T AP - I; a reflected or empty AP fails whatever that is."""
    if not sid.nodes:
        return Finding(None, "no nodes")
    wrong = [(node.id, fault(node.AP.m0)) for node in sid.nodes]
    wrong = [(name, text) for name, text in wrong if text]
    worst = max(deviation(node.AP.m0) for node in sid.nodes)
    if not wrong:
        return Finding(worst, size=1.0, terms=6)
    name, text = wrong[0]
    more = f" and at {len(wrong) - 1} more" if len(wrong) > 1 else ""
    return Finding(worst, f"{text} at node {name}{more}", broken=True)


@identity(
    "I19",
    "no block is an empty placeholder",
    severity="error",
    bound=0.0,
    meaning="blocks were left empty by the writer: the body does not resist turning, "
    "or misses forces when it turns and vibrates",
)
def placeholders(sid: SID) -> Finding:
    """Number of blocks that are zero although others say that they are not."""
    if sid.nq == 0:
        return Finding(None, "rigid body")
    empty = list(_empty(sid))
    return Finding(float(len(empty)), "empty: " + ", ".join(empty) if empty else "")


def _empty(sid: SID) -> Iterator[str]:
    modes = modes_of(sid)
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
    if sid.Ge.is_zero and (modes.Cr1 - swapped(modes.Cr1)).any():
        yield "Ge"
    if (sid.Oe.is_zero and no_inertia and moved) or (
        not sid.Oe.m0.any() and modes.J1.any()
    ):
        yield "Oe"
    if no_inertia and moved and sid.Ct.is_zero and sid.Cr.is_zero:
        yield "perhaps Ct, Cr, Gr and Ge, unless the axes are mean ones"


@identity(
    "I20",
    "Ct m1 and phi m1 stiffen as Oe m1 does",
    severity="error",
    bound=0.5,
    meaning="the stiffening by acceleration, gravity or forces has the wrong sign: "
    "weight would stiffen a standing tower instead of softening it",
)
def stiffening_signs(sid: SID) -> Finding:
    """Minus the correlation with the centrifugal stiffening, where that is told."""
    found = agreement(sid)
    if not found:
        return Finding(None, "no such terms, or mass on all sides of the origin")
    texts = [f"{name} m1 {value:+.2f}" for name, value in found.items()]
    worst = max(0.0, -min(found.values()))
    return Finding(worst, "correlation " + ", ".join(texts))


@identity(
    "I21",
    "terms of higher order act, and Ke m1 has an energy",
    severity="error",
    bound=ROUNDING,
    meaning="a simulation refuses the body: its equations have no such terms, or "
    "elastic forces without an energy would drive it",
)
def higher_orders(sid: SID) -> Finding:
    """The part of the elastic force of first order that has no energy."""
    if sid.nq == 0:
        return Finding(None, "rigid body")
    measured = missing_energy(sid)
    try:
        check_first_order(sid, "the SID", "")
    except InputError as refused:
        return Finding(measured, refused.problem, broken=True)
    if sid.Ke.first_order(sid.nq).any():
        detail = "elastic forces are quadratic in q (Ke m1), with an energy"
        return Finding(measured, detail)
    return Finding(measured, "elastic forces are linear")
