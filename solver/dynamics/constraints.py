"""All constraints of a scene, eq. (14): one branch per primitive in each function."""

from ..compiler.kernels import inner
from ..spatial.dimension import BySpace
from ..spatial.system_arrays import (
    COINCIDENT,
    COUPLED_ANGLE,
    COUPLED_DISPLACEMENT,
    DISPLACEMENT,
    DISTANCE,
    W_WEIGHT,
)
from .constraint_rows import add_jacobian, add_term, is_coupled, term_at, write_row
from .direction_constraints import (
    angle_jacobian as linearise_angle,
    angle_residual as evaluate_angle,
    direction_jacobian as linearise_directions,
    direction_residual as evaluate_directions,
)
from .drives import prescribed_value
from .point_constraints import (
    coincident_jacobian as linearise_coincident,
    coincident_residual as evaluate_coincident,
    coincident_wrench,
    displacement_jacobian as linearise_along,
    displacement_residual as evaluate_along,
    distance_jacobian as linearise_distance,
    distance_residual as evaluate_distance,
)


@inner()
def _linearise_planar_angle(system, work, con, t, v, acc, lambda_):
    linearise_angle(system, work, con, 1.0, v, acc, lambda_)


#: ANGLE, and PERPENDICULAR in space.
_evaluate_angle_constraint = BySpace(plane=evaluate_angle, space=evaluate_directions)
_linearise_angle_constraint = BySpace(
    plane=_linearise_planar_angle, space=linearise_directions
)


@inner()
def _evaluate_row(system, work, con, t):
    """Of a primitive of one row: value, rate, right-hand side and wrench."""
    kind = con.kind
    s, sd, sdd = prescribed_value(system, work, con, t)
    if kind in (DISPLACEMENT, COUPLED_DISPLACEMENT):
        return evaluate_along(system, work, con, s, sd, sdd)
    if kind == DISTANCE:
        return evaluate_distance(system, work, con, s, sd, sdd)
    if kind == COUPLED_ANGLE:
        return evaluate_angle(system, work, con, s, sd, sdd)
    return _evaluate_angle_constraint(system, work, con, s, sd, sdd)


@inner()
def constraint_wrench(system, work, k, t, lambda_):
    """Force on marker B, torque on A, and torque on B; the reversed force acts on A."""
    con = system.constraint[k]
    if con.kind == COINCIDENT:
        return coincident_wrench(system, work, con, lambda_)
    _, _, _, force, torque_a, torque_b = _evaluate_row(system, work, con, t)
    size = lambda_[con.row]
    if is_coupled(con.kind):
        size *= system.real_data[term_at(force, con.data) + W_WEIGHT]
    return size * force, size * torque_a, size * torque_b


@inner()
def _evaluate_constraint(system, work, k, t):
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
    weight = system.real_data[term + W_WEIGHT]
    force, torque_a, torque_b = weight * force, weight * torque_a, weight * torque_b
    add_jacobian(system, work, con, 0, force, torque_a, torque_b)


@inner()
def evaluate_constraints(system, work, t):
    """C, c, dc/dt and gamma at the state of `work`.

    Coordinates with friction are included, as if their joints were sticking.
    """
    for i in range(len(work.C)):
        work.C[i] = 0.0
    count = len(system.constraint)
    for k in range(count + len(system.friction)):
        if k < count:
            rows, to, i = system, work, k
        else:
            rows, to, i = system.friction_subsystem, work.friction_subsystem, k - count
        _evaluate_constraint(rows, to, i, t)


@inner()
def _linearise_constraint(system, work, k, t, v, acc, lambda_):
    con = system.constraint[k]
    kind, weight = con.kind, 1.0
    if is_coupled(kind):
        term = term_at(work.point[con.a].x, con.data)
        weight = system.real_data[term + W_WEIGHT]
    if kind == COINCIDENT:
        linearise_coincident(system, work, con, v, acc, lambda_)
    elif kind in (DISPLACEMENT, COUPLED_DISPLACEMENT):
        linearise_along(system, work, con, weight, v, acc, lambda_)
    elif kind == DISTANCE:
        linearise_distance(system, work, con, v, acc, lambda_)
    elif kind == COUPLED_ANGLE:
        linearise_angle(system, work, con, weight, v, acc, lambda_)
    else:
        _linearise_angle_constraint(system, work, con, t, v, acc, lambda_)


@inner()
def linearise_constraints(system, work, t, v, acc, lambda_):
    """Gp and Gv at a state that was just evaluated; adds to Rp.

    Rp omits the change of the constraint force on one body by the motion of another
    and, in space, the rotation of directions by elastic coordinates. A Newton matrix
    may omit both.
    """
    for i in range(len(work.Gp)):
        work.Gp[i] = 0.0
        work.Gv[i] = 0.0
    count = len(system.constraint)
    for k in range(count + len(system.friction)):
        if k < count:
            rows, to, i, forces = system, work, k, lambda_
        else:
            rows, to, i, forces = (
                system.friction_subsystem,
                work.friction_subsystem,
                k - count,
                work.friction_force,
            )
        _linearise_constraint(rows, to, i, t, v, acc, forces)
