"""All forces of a scene: a line for each kind of measure in each function."""

from __future__ import annotations

from ...compiler.compiling import inner
from ...space.algebra import zero
from ...space.layout import COORDINATE, FOLLOWING, PRESCRIBED, SLIDE, SPAN
from ..marker_rows import segment, vary_psi, vary_velocity
from .coordinate import evaluate as evaluate_coordinate
from .coordinate import linearise as linearise_coordinate
from .given import evaluate as evaluate_given
from .given import linearise as linearise_given
from .law import force_law, set_factor, set_slopes
from .measures import (
    measure_rotation,
    measure_slide,
    measure_span,
    rotation_derivatives,
    rotation_stiffness,
    slide_derivatives,
    slide_stiffness,
    span_derivatives,
    span_stiffness,
)


@inner()
def measure(system, work, k):
    """Measure g and its rate, and what a unit force on g does.

    That is a force on marker B and its reverse on A, a torque on A, and one on B.
    """
    row = system.force[k]
    if row.kind == SPAN:
        return measure_span(system, work, row)
    if row.kind == SLIDE:
        return measure_slide(system, work, row)
    return measure_rotation(system, work, row)


@inner()
def _push(system, work, m, force, torque):
    """Adds an inertial force and a torque at a marker to the generalised forces."""
    row = system.body[system.marker[m].body]
    if row.nv > 0:
        segment(system, work, work.f, row.vel, m, force, torque)


@inner()
def wrench(system, work, k):
    """Force on marker B, whose reverse acts on A, torque on A, and torque on B.

    Keeps what the force measures.
    """
    row = system.force[k]
    if row.kind <= FOLLOWING:
        force, torque = evaluate_given(system, work, k, work.factor[k])
        return force, zero(torque), torque
    g, rate, n, torque_a, torque_b = measure(system, work, k)
    work.measure[k, 0], work.measure[k, 1] = g, rate
    size, _, _ = force_law(system, work, k, g, rate)
    return size * n, size * torque_a, size * torque_b


@inner()
def evaluate_forces(system, work, t, z, v):
    """Adds to f; keeps what the forces measure, and what laws read before them."""
    for k in range(len(system.force)):
        row = system.force[k]
        set_factor(system, work, k, t)
        if row.kind == PRESCRIBED:
            continue
        if row.kind == COORDINATE:
            evaluate_coordinate(system, work, k, z, v)
            continue
        force, torque_a, torque_b = wrench(system, work, k)
        if row.owner >= 0:
            continue
        _push(system, work, row.b, force, torque_b)
        if row.a >= 0:
            _push(system, work, row.a, -force, torque_a)


@inner()
def _linearise(system, work, k, v):
    """The row of a force: its direction, its stiffness and its damping."""
    row = system.force[k]
    kind = row.kind
    g, rate, n, torque_a, torque_b = measure(system, work, k)
    force, stiffness, damping = force_law(system, work, k, g, rate)
    if kind == SPAN:
        by_x, turn_a, turn_b = span_derivatives(system, work, row, g, rate, n)
        span_stiffness(system, work, row, g, n, force)
    elif kind == SLIDE:
        by_x, turn_a, turn_b = slide_derivatives(system, work, row, g, rate, n)
        slide_stiffness(system, work, row, g, n, force)
    else:
        by_x, turn_a, turn_b = rotation_derivatives(system, work, row, torque_b)
        rotation_stiffness(system, work, row, torque_b, force)
    by_x = stiffness * n + damping * by_x
    turn_a = stiffness * torque_a + damping * turn_a
    turn_b = stiffness * torque_b + damping * turn_b
    for side in range(2):
        o = row.seg_a if side == 0 else row.seg_b
        if o < 0:
            continue
        m, sign = (row.a, -1.0) if side == 0 else (row.b, 1.0)
        torque, turn = (torque_a, turn_a) if side == 0 else (torque_b, turn_b)
        if row.owner < 0:
            segment(system, work, work.C, o, m, sign * n, torque)
        segment(system, work, work.Gp, o, m, sign * by_x, turn)
        segment(system, work, work.Gv, o, m, zero(n), damping * torque)
        vary_psi(system, work, work.Gp, o, m, damping * torque, v)
        if kind in (SPAN, SLIDE):
            vary_velocity(system, work, o, m, sign * damping * n, v)


@inner()
def linearise_forces(system, work, t, v):
    """Adds to Rp; writes the rows of the forces in C, Gp and Gv.

    Rp leaves out how the motion of one body turns the force on another and, in space,
    that elastic coordinates turn forces that follow their body.
    """
    for i in range(system.n_sliding, len(work.C)):
        work.C[i] = 0.0
    set_slopes(system, work, t)
    for k in range(len(system.force)):
        if system.force[k].kind <= FOLLOWING:
            linearise_given(system, work, k)
        elif system.force[k].kind == COORDINATE:
            linearise_coordinate(system, work, k)
        elif system.force[k].kind != PRESCRIBED:
            _linearise(system, work, k, v)
