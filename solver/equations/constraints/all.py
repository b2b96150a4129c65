"""All constraints of a scene: one line for each primitive in each function."""

from __future__ import annotations

from ...compiler.compiling import inner
from ...space.layout import (
    ALONG,
    COINCIDENT,
    COUPLED_ALONG,
    COUPLED_ANGLE,
    DISTANCE,
    W_WEIGHT,
)
from ...space.spaces import BySpace
from ..drives import prescribed
from ..rows import add_jacobian, add_term, is_coupled, term_at, write_row
from .along import evaluate as evaluate_along
from .along import linearise as linearise_along
from .angle import evaluate as evaluate_angle
from .angle import linearise as linearise_angle
from .coincident import evaluate as evaluate_coincident
from .coincident import linearise as linearise_coincident
from .coincident import wrench as coincident_wrench
from .directions import evaluate as evaluate_directions
from .directions import linearise as linearise_directions
from .distance import evaluate as evaluate_distance
from .distance import linearise as linearise_distance


@inner()
def _linearise_angle(system, work, con, t, v, acc, lam):
    linearise_angle(system, work, con, 1.0, v, acc, lam)


#: ANGLE, and PERPENDICULAR in space.
_evaluate_turned = BySpace(plane=evaluate_angle, space=evaluate_directions)
_linearise_turned = BySpace(plane=_linearise_angle, space=linearise_directions)


@inner()
def _evaluate_row(system, work, con, t):
    """Of a primitive of one row: value, rate, right-hand side and wrench."""
    kind = con.kind
    s, sd, sdd = prescribed(system, work, con, t)
    if kind in (ALONG, COUPLED_ALONG):
        return evaluate_along(system, work, con, s, sd, sdd)
    if kind == DISTANCE:
        return evaluate_distance(system, work, con, s, sd, sdd)
    if kind == COUPLED_ANGLE:
        return evaluate_angle(system, work, con, s, sd, sdd)
    return _evaluate_turned(system, work, con, s, sd, sdd)


@inner()
def wrench(system, work, k, t, lam):
    """Force on marker B, whose reverse acts on A, torque on A, and torque on B."""
    con = system.constraint[k]
    if con.kind == COINCIDENT:
        return coincident_wrench(system, work, con, lam)
    _, _, _, force, torque_a, torque_b = _evaluate_row(system, work, con, t)
    size = lam[con.row]
    if is_coupled(con.kind):
        size *= system.pool[term_at(force, con.data) + W_WEIGHT]
    return size * force, size * torque_a, size * torque_b


@inner()
def _evaluate(system, work, k, t):
    con = system.constraint[k]
    kind = con.kind
    if kind == COINCIDENT:
        evaluate_coincident(system, work, con)
        return
    row = _evaluate_row(system, work, con, t)
    value, rate, gamma, force, torque_a, torque_b = row
    if not is_coupled(kind):
        write_row(work, con.row, value, rate, gamma)
        add_jacobian(system, work, con, 0, force, torque_a, torque_b)
        return
    term = term_at(force, con.data)
    add_term(system, work, con.row, term, value, rate, gamma)
    weight = system.pool[term + W_WEIGHT]
    force, torque_a, torque_b = weight * force, weight * torque_a, weight * torque_b
    add_jacobian(system, work, con, 0, force, torque_a, torque_b)


@inner()
def evaluate_constraints(system, work, t):
    """C, c, dc/dt and gamma at the state of `work`; also of coordinates with friction,
    as if they were held."""
    for i in range(len(work.C)):
        work.C[i] = 0.0
    count = len(system.constraint)
    for k in range(count + len(system.friction)):
        if k < count:
            rows, to, i = system, work, k
        else:
            rows, to, i = system.sliding, work.sliding, k - count
        _evaluate(rows, to, i, t)


@inner()
def _linearise(system, work, k, t, v, acc, lam):
    con = system.constraint[k]
    kind, weight = con.kind, 1.0
    if is_coupled(kind):
        term = term_at(work.point[con.a].x, con.data)
        weight = system.pool[term + W_WEIGHT]
    if kind == COINCIDENT:
        linearise_coincident(system, work, con, v, acc, lam)
    elif kind in (ALONG, COUPLED_ALONG):
        linearise_along(system, work, con, weight, v, acc, lam)
    elif kind == DISTANCE:
        linearise_distance(system, work, con, v, acc, lam)
    elif kind == COUPLED_ANGLE:
        linearise_angle(system, work, con, weight, v, acc, lam)
    else:
        _linearise_turned(system, work, con, t, v, acc, lam)


@inner()
def linearise_constraints(system, work, t, v, acc, lam):
    """Gp, Gv at a state that was just evaluated; adds to Rp.

    Rp leaves out what the motion of one body changes in the constraint force on another
    and, in space, that elastic coordinates turn a direction. A Newton matrix may do
    without.
    """
    for i in range(len(work.Gp)):
        work.Gp[i] = 0.0
        work.Gv[i] = 0.0
    count = len(system.constraint)
    for k in range(count + len(system.friction)):
        if k < count:
            rows, to, i, forces = system, work, k, lam
        else:
            rows, to, i, forces = system.sliding, work.sliding, k - count, work.rub
        _linearise(rows, to, i, t, v, acc, forces)
