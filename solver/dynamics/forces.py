"""All forces of a scene, eq. (16): one branch per measure in each function."""

from ..compiler.kernels import inner
from ..spatial.algebra import zero
from ..spatial.system_arrays import (
    COMBINED_MEASURE,
    COORDINATE_MEASURE,
    DISPLACEMENT_MEASURE,
    DISTANCE_MEASURE,
    FOLLOWER_LOAD,
    PRESCRIBED_VALUE,
)
from .applied_forces import (
    applied_load as evaluate_given,
    evaluate_coordinate_force as evaluate_coordinate,
    linearise_applied_load as linearise_given,
    linearise_coordinate_force as linearise_coordinate,
)
from .force_law import force_law, set_force_scale, set_law_derivatives
from .force_measures import (
    displacement_derivatives,
    displacement_measure,
    displacement_stiffness,
    distance_derivatives,
    distance_measure,
    distance_stiffness,
    rotation_derivatives,
    rotation_measure,
    rotation_stiffness,
)
from .marker_forces import add_d_psi, add_d_velocity, add_generalised_force


@inner()
def _single_measure(system, work, row):
    if row.kind == DISTANCE_MEASURE:
        return distance_measure(system, work, row)
    if row.kind == DISPLACEMENT_MEASURE:
        return displacement_measure(system, work, row)
    return rotation_measure(system, work, row)


@inner()
def _combined_measure(system, work, k):
    """COMBINED: a weighted sum of the measures of the rows before row k."""
    row = system.force[k]
    count = int(system.real_data[row.data])
    g, rate, n, torque_a, torque_b = _single_measure(
        system, work, system.force[k - count]
    )
    w = system.real_data[row.data + 1]
    g, rate = w * g, w * rate
    n, torque_a, torque_b = w * n, w * torque_a, w * torque_b
    for i in range(1, count):
        gi, ri, ni, ai, bi = _single_measure(system, work, system.force[k - count + i])
        w = system.real_data[row.data + 1 + i]
        g, rate = g + w * gi, rate + w * ri
        n, torque_a, torque_b = n + w * ni, torque_a + w * ai, torque_b + w * bi
    return g, rate, n, torque_a, torque_b


@inner()
def measure(system, work, k):
    """Measure g, its rate, and the wrench of a unit force on g.

    The wrench is a force on marker B, whose reverse acts on A, a torque on A, and one
    on B.
    """
    if system.force[k].kind == COMBINED_MEASURE:
        return _combined_measure(system, work, k)
    return _single_measure(system, work, system.force[k])


@inner()
def _measure_derivatives(system, work, row, g, rate, n, torque_b, force):
    """Derivatives of the rate of a measure; adds Rp of a force on it."""
    if row.kind == DISTANCE_MEASURE:
        distance_stiffness(system, work, row, g, n, force)
        return distance_derivatives(system, work, row, g, rate, n)
    if row.kind == DISPLACEMENT_MEASURE:
        displacement_stiffness(system, work, row, g, n, force)
        return displacement_derivatives(system, work, row, g, rate, n)
    rotation_stiffness(system, work, row, torque_b, force)
    return rotation_derivatives(system, work, row, torque_b)


@inner()
def _combined_measure_derivatives(system, work, k, g, rate, n, torque_b, force):
    """The same of row k, which may be a sum."""
    row = system.force[k]
    if row.kind != COMBINED_MEASURE:
        return _measure_derivatives(system, work, row, g, rate, n, torque_b, force)
    count = int(system.real_data[row.data])
    d_position, d_rotation_a, d_rotation_b = zero(n), zero(torque_b), zero(torque_b)
    for i in range(count):
        term = system.force[k - count + i]
        gi, ri, ni, _, bi = _single_measure(system, work, term)
        w = system.real_data[row.data + 1 + i]
        x, a, b = _measure_derivatives(system, work, term, gi, ri, ni, bi, w * force)
        d_position, d_rotation_a, d_rotation_b = (
            d_position + w * x,
            d_rotation_a + w * a,
            d_rotation_b + w * b,
        )
    return d_position, d_rotation_a, d_rotation_b


@inner()
def _add_marker_load(system, work, m, force, torque):
    """Adds an inertial force and a torque at a marker to the generalised forces."""
    row = system.body[system.marker[m].body]
    if row.nv > 0:
        add_generalised_force(system, work, work.f, row.vel, m, force, torque)


@inner()
def force_wrench(system, work, k):
    """Force on marker B, whose reverse acts on A, torque on A, and torque on B.

    Stores what the force measures.
    """
    row = system.force[k]
    if row.kind <= FOLLOWER_LOAD:
        force, torque = evaluate_given(system, work, k, work.force_scale[k])
        return force, zero(torque), torque
    g, rate, n, torque_a, torque_b = measure(system, work, k)
    work.measure[k, 0], work.measure[k, 1] = g, rate
    size, _, _ = force_law(system, work, k, g, rate)
    return size * n, size * torque_a, size * torque_b


@inner()
def evaluate_forces(system, work, t, z, v):
    """Add the forces to f; store their measures, and before them those that
    laws read.
    """
    for k in range(len(system.force)):
        row = system.force[k]
        set_force_scale(system, work, k, t)
        if row.kind == PRESCRIBED_VALUE:
            continue
        if row.kind == COORDINATE_MEASURE:
            evaluate_coordinate(system, work, k, z, v)
            continue
        force, torque_a, torque_b = force_wrench(system, work, k)
        if row.owner >= 0:
            continue
        _add_marker_load(system, work, row.b, force, torque_b)
        if row.a >= 0:
            _add_marker_load(system, work, row.a, -force, torque_a)


@inner()
def _linearise_force(system, work, k, v):
    """The row of a force: its direction, its stiffness and its damping."""
    row = system.force[k]
    kind = row.kind
    g, rate, n, torque_a, torque_b = measure(system, work, k)
    force, stiffness, damping = force_law(system, work, k, g, rate)
    d_position, d_rotation_a, d_rotation_b = _combined_measure_derivatives(
        system, work, k, g, rate, n, torque_b, force
    )
    d_position = stiffness * n + damping * d_position
    d_rotation_a = stiffness * torque_a + damping * d_rotation_a
    d_rotation_b = stiffness * torque_b + damping * d_rotation_b
    for side in range(2):
        o = row.seg_a if side == 0 else row.seg_b
        if o < 0:
            continue
        m, sign = (row.a, -1.0) if side == 0 else (row.b, 1.0)
        torque, d_rotation = (
            (torque_a, d_rotation_a) if side == 0 else (torque_b, d_rotation_b)
        )
        if row.owner < 0:
            add_generalised_force(system, work, work.C, o, m, sign * n, torque)
        add_generalised_force(
            system, work, work.Gp, o, m, sign * d_position, d_rotation
        )
        add_generalised_force(system, work, work.Gv, o, m, zero(n), damping * torque)
        add_d_psi(system, work, work.Gp, o, m, damping * torque, v)
        if kind in (DISTANCE_MEASURE, DISPLACEMENT_MEASURE, COMBINED_MEASURE):
            add_d_velocity(system, work, o, m, sign * damping * n, v)


@inner()
def linearise_forces(system, work, t, v):
    """Add to Rp; write the rows of the forces in C, Gp and Gv.

    Rp omits the rotation of the force on one body by the motion of another and, in
    space, the rotation of follower forces by elastic coordinates.
    """
    for i in range(system.n_sliding, len(work.C)):
        work.C[i] = 0.0
    set_law_derivatives(system, work, t)
    for k in range(len(system.force)):
        if system.force[k].kind <= FOLLOWER_LOAD:
            linearise_given(system, work, k)
        elif system.force[k].kind == COORDINATE_MEASURE:
            linearise_coordinate(system, work, k)
        elif system.force[k].kind != PRESCRIBED_VALUE:
            _linearise_force(system, work, k, v)
