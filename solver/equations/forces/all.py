"""All forces of a scene: a line for each kind of measure in each function."""

from __future__ import annotations

from ...compiler.compiling import inner
from ...space.algebra import zero
from ...space.layout import COMBINED, COORDINATE, FOLLOWING, PRESCRIBED, SLIDE, SPAN
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
def _single_measure(system, work, row):
    if row.kind == SPAN:
        return measure_span(system, work, row)
    if row.kind == SLIDE:
        return measure_slide(system, work, row)
    return measure_rotation(system, work, row)


@inner()
def _sum_of_measures(system, work, k):
    """COMBINED: a weighted sum of the measures of the rows before row k."""
    row = system.force[k]
    count = int(system.pool[row.data])
    g, rate, n, torque_a, torque_b = _single_measure(
        system, work, system.force[k - count]
    )
    w = system.pool[row.data + 1]
    g, rate = w * g, w * rate
    n, torque_a, torque_b = w * n, w * torque_a, w * torque_b
    for i in range(1, count):
        gi, ri, ni, ai, bi = _single_measure(system, work, system.force[k - count + i])
        w = system.pool[row.data + 1 + i]
        g, rate = g + w * gi, rate + w * ri
        n, torque_a, torque_b = n + w * ni, torque_a + w * ai, torque_b + w * bi
    return g, rate, n, torque_a, torque_b


@inner()
def measure(system, work, k):
    """Measure g and its rate, and what a unit force on g does.

    That is a force on marker B and its reverse on A, a torque on A, and one on B.
    """
    if system.force[k].kind == COMBINED:
        return _sum_of_measures(system, work, k)
    return _single_measure(system, work, system.force[k])


@inner()
def _measure_derivatives(system, work, row, g, rate, n, torque_b, force):
    """Derivatives of the rate of a measure; adds Rp of a force on it."""
    if row.kind == SPAN:
        span_stiffness(system, work, row, g, n, force)
        return span_derivatives(system, work, row, g, rate, n)
    if row.kind == SLIDE:
        slide_stiffness(system, work, row, g, n, force)
        return slide_derivatives(system, work, row, g, rate, n)
    rotation_stiffness(system, work, row, torque_b, force)
    return rotation_derivatives(system, work, row, torque_b)


@inner()
def _derivatives(system, work, k, g, rate, n, torque_b, force):
    """The same of row k, which may be a sum."""
    row = system.force[k]
    if row.kind != COMBINED:
        return _measure_derivatives(system, work, row, g, rate, n, torque_b, force)
    count = int(system.pool[row.data])
    by_x, turn_a, turn_b = zero(n), zero(torque_b), zero(torque_b)
    for i in range(count):
        part = system.force[k - count + i]
        gi, ri, ni, _, bi = _single_measure(system, work, part)
        w = system.pool[row.data + 1 + i]
        x, a, b = _measure_derivatives(system, work, part, gi, ri, ni, bi, w * force)
        by_x, turn_a, turn_b = by_x + w * x, turn_a + w * a, turn_b + w * b
    return by_x, turn_a, turn_b


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
    by_x, turn_a, turn_b = _derivatives(system, work, k, g, rate, n, torque_b, force)
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
        if kind in (SPAN, SLIDE, COMBINED):
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
