"""The complete equations of a scene in plane or space, and their derivatives."""

from __future__ import annotations

from typing import Any

from numba import float64, int64

from ..compiler.compiling import Entry, entry, inner
from ..linear.friction import hold_rows, linearise_friction
from ..linear.memory import COMPLETE, EVALUATE, LINEARISE
from ..space.algebra import load, size
from ..space.layout import FREE, STIFFENED, SYSTEM, WORK
from ..space.spaces import BySpace, in_plane, in_space
from .bodies import evaluate_body
from .bodies_linear import linearise_body
from .constraints.all import evaluate_constraints, linearise_constraints
from .forces.all import evaluate_forces, linearise_forces
from .forces.programs import law_value
from .forces.turns import keep_turns
from .frames import free_frame, prescribed_frame
from .marker_rows import marker_acceleration
from .markers import evaluate_marker
from .rows import drop_derivatives, drop_rows
from .stiffened import add_stiffened
from .stiffened_linear import linearise_stiffened


@inner()
def _no_turns(system, work, z):
    pass


count_turns = BySpace(plane=_no_turns, space=keep_turns)


@inner()
def _evaluate_bodies(system, work, t, z, v):
    """Frames, markers, mass matrices and forces of all bodies.

    Bodies are sorted so that a prescribed frame comes after its base; markers are
    sorted by body.
    """
    m, markers = 0, len(system.marker)
    for b in range(len(system.body)):
        if system.body[b].motion == FREE:
            free_frame(system, work, b, z, v)
        else:
            prescribed_frame(system, work, b, t)
        while m < markers and system.marker[m].body == b:
            evaluate_marker(system, work, m, z, v)
            m += 1
        evaluate_body(system, work, b, z, v)
        if system.body[b].flags & STIFFENED:
            add_stiffened(system, work, b, z, v)


@inner()
def _evaluate(system, work, t, z, v):
    _evaluate_bodies(system, work, t, z, v)
    count_turns(system, work, z)
    evaluate_forces(system, work, t, z, v)
    evaluate_constraints(system, work, t)


@entry(float64(SYSTEM, WORK, int64, float64))
def law_at(system, work, k, t):
    """What the law of row k yields at the state that was just evaluated."""
    return law_value(system, in_plane(work), k, t, False)


@inner()
def _linearise(system, work, t, z, v, acc, lam):
    for b in range(len(system.body)):
        linearise_body(system, work, b, z, v, acc)
        if system.body[b].flags & STIFFENED:
            linearise_stiffened(system, work, b, z, v, acc)
    linearise_constraints(system, work, t, v, acc, lam)
    linearise_forces(system, work, t, v)


@inner()
def _complete(system, work, acc):
    for m in range(len(system.marker)):
        point = work.point[m]
        a, al = marker_acceleration(system, work, m, acc)
        point.a, point.al = a, al
    for b in range(len(system.body)):
        row, frame, n = system.body[b], work.frame[b], size(work.frame[b].x)
        if row.rd >= n:
            frame.a = frame.a + load(frame.a, acc, row.vel)
        if row.rd > n:
            frame.al = frame.al + load(frame.al, acc, row.vel + n)


def _entries(seen: Any, place: str) -> tuple[Entry, Entry, Entry]:
    """The kernels of plane or space.

    seen : how they see works
    """

    def evaluate(system, work, t, z, v):
        """Everything that eq. (11) needs at one state: M, f, C, c, dc/dt and gamma."""
        _evaluate(system, seen(work), t, z, v)
        drop_rows(system, work)
        hold_rows(system, work)

    def linearise(system, work, t, z, v, acc, lam):
        """Rp, Rv, Gp, Gv at a state just evaluated, see constraints and forces."""
        _linearise(system, seen(work), t, z, v, acc, lam)
        drop_derivatives(system, work)
        linearise_friction(system, work)

    def complete(system, work, acc):
        """Adds what z_II' contributes to the accelerations of frames and markers."""
        _complete(system, seen(work), acc)

    for kernel in (evaluate, linearise, complete):
        kernel.__qualname__ = f"{kernel.__name__}_in_{place}"
    return (
        entry(EVALUATE)(evaluate),
        entry(LINEARISE)(linearise),
        entry(COMPLETE)(complete),
    )


evaluate_in_plane, linearise_in_plane, complete_in_plane = _entries(in_plane, "plane")
evaluate_in_space, linearise_in_space, complete_in_space = _entries(in_space, "space")
