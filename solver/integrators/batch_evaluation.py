"""The equations of motion at many states in one call, and their derivatives.

At each state the residual of eq. (3) with differentiated constraints is

    r = M a - f - C^T lambda,    g = C a - gamma

with accelerations a and multipliers lambda that are given. If it changes by (r, g),
they change by -K^-1 (r, g) with K = [M, -C^T; C, 0], see `solve_columns`.
"""

import math

from ..compiler.kernels import entry, inner
from ..compiler.types import float64, int64, void
from ..linear.accelerations import solve_with_constraints
from ..linear.factor_storage import KERNELS, MEMORY
from ..linear.newton_matrix import add_mass_product
from ..linear.saddle_point import REGULARISATION
from ..spatial.coordinates import frame_rate
from ..spatial.system_arrays import (
    C_GAMMA,
    C_RATE,
    C_VALUE,
    F1,
    F2,
    F3,
    SYSTEM,
    WORK,
)
from .loop_state import copy
from .projection import evaluate_accelerations


@inner(void(SYSTEM, F1, F1, F1, F2, F2, F2))
def _rate_derivatives(system, z, v, unit, Z, by_position, to_tangent):
    """Derivatives of z_I' = Z z_II at a state, see `position_rates`; `unit` is 0."""
    for b in range(len(system.body)):
        row = system.body[b]
        p, u, rd, first = row.pos, row.vel, row.rd, row.np - row.nq
        for k in range(row.nq):
            Z[u + rd + k, p + first + k] = to_tangent[u + rd + k, p + first + k] = 1.0
        if rd > 0 and system.planar == 1:
            angle = z[p + 2] if rd == 3 else system.real_data[row.frame]
            c, s = math.cos(angle), math.sin(angle)
            Z[u, p] = Z[u + 1, p + 1] = c
            Z[u, p + 1], Z[u + 1, p] = s, -s
            if rd == 3:
                Z[u + 2, p + 2] = 1.0
                by_position[p + 2, p] = -c * v[u + 1] - s * v[u]
                by_position[p + 2, p + 1] = c * v[u] - s * v[u + 1]
            for i in range(rd):
                for k in range(rd):
                    to_tangent[u + i, p + k] = Z[u + i, p + k]
            continue
        for i in range(rd):
            unit[u + i] = 1.0
            frame_rate(system, b, z, unit, Z[u + i])
            unit[u + i] = 0.0
            for k in range(row.np - row.nq):
                to_tangent[u + i, p + k] = Z[u + i, p + k]
        if rd < 6:
            continue
        size = 0.0
        for k in range(p + 3, p + 7):
            size += z[k] * z[k]
        w1, w2, w3 = 0.5 * v[u + 3], 0.5 * v[u + 4], 0.5 * v[u + 5]
        for k in range(p + 3, p + 7):
            for i in range(u + 3, u + 6):
                to_tangent[i, k] *= 4.0 / size
            t1, t2, t3 = (
                to_tangent[u + 3, k],
                to_tangent[u + 4, k],
                to_tangent[u + 5, k],
            )
            unit[u] = t2 * v[u + 2] - t3 * v[u + 1]
            unit[u + 1] = t3 * v[u] - t1 * v[u + 2]
            unit[u + 2] = t1 * v[u + 1] - t2 * v[u]
            frame_rate(system, b, z, unit, by_position[k])
            unit[u] = unit[u + 1] = unit[u + 2] = 0.0
        a, b1, c, d = p + 3, p + 4, p + 5, p + 6  # p (0, w) / 2 is linear in p
        by_position[a, b1], by_position[a, c], by_position[a, d] = w1, w2, w3
        by_position[b1, a], by_position[b1, c], by_position[b1, d] = -w1, -w3, w2
        by_position[c, a], by_position[c, b1], by_position[c, d] = -w2, w3, -w1
        by_position[d, a], by_position[d, b1], by_position[d, c] = -w3, -w2, w1


@entry(void(SYSTEM, F2, F2, F1, F3, F3, F3))
def rates_of_states(system, z, v, unit, Z, by_position, to_tangent):
    """Derivatives of z_I' = Z z_II of states, see `position_rates`.

    Parameters
    ----------
    unit : (velocities,) of 0
    Z : (states, velocities, positions) transposed, by velocities
    by_position : (states, positions, positions) transposed, by positions
    to_tangent : (states, velocities, positions)
    """
    for k in range(len(z)):
        _rate_derivatives(system, z[k], v[k], unit, Z[k], by_position[k], to_tangent[k])


@inner(void(SYSTEM, WORK, F1, F1, float64, F1))
def _add_residual(system, work, a, lambda_, weight, out):
    """out += weight (r, g) at the state that was just evaluated."""
    n = len(work.f)
    for i in range(n):
        out[i] -= weight * work.f[i]
    add_mass_product(system, work.M, a, weight, out)
    for i in range(system.n_rows):
        out[n + i] -= weight * work.row[i, C_GAMMA]
    for k in range(len(system.segment)):
        row, at = system.segment[k].row, system.segment[k].offset
        first = system.body[system.segment[k].body].vel
        for i in range(system.body[system.segment[k].body].nv):
            out[first + i] -= weight * work.C[at + i] * lambda_[row]
            out[n + row] += weight * work.C[at + i] * a[first + i]


@entry(int64(KERNELS, SYSTEM, WORK, MEMORY, F1, F1, F2, F2, F2, F2))
def accelerations_of_states(
    kernels, system, work, memory, clocks, times, z, v, a, lambda_
):
    """Accelerations and multipliers of states; 0, or the code of a singular one."""
    for k in range(len(times)):
        work.interval_time[0] = clocks[k]
        status = evaluate_accelerations(
            kernels, system, work, memory, times[k], z[k], v[k]
        )
        if status != 0:
            return status
        copy(memory.acceleration, a[k])
        copy(memory.multiplier, lambda_[k])
    return 0


@entry(void(KERNELS, SYSTEM, WORK, F1, F1, F2, F2, F2, F2, F2))
def residuals_of_states(kernels, system, work, clocks, times, z, v, a, lambda_, out):
    """(r, g) of states, in the rows of `out`."""
    for k in range(len(times)):
        work.interval_time[0] = clocks[k]
        kernels.evaluate(system, work, times[k], z[k], v[k])
        for i in range(out.shape[1]):
            out[k, i] = 0.0
        _add_residual(system, work, a[k], lambda_[k], 1.0, out[k])


@entry(void(KERNELS, SYSTEM, WORK, F1, F1, F2, F2, F2))
def constraints_of_states(kernels, system, work, clocks, times, z, v, out):
    """Values of the constraints, then their rates, in the rows of `out`."""
    for k in range(len(times)):
        work.interval_time[0] = clocks[k]
        kernels.evaluate(system, work, times[k], z[k], v[k])
        for i in range(system.n_rows):
            out[k, i] = work.row[i, C_VALUE]
            out[k, system.n_rows + i] = work.row[i, C_RATE]


@inner(void(SYSTEM, WORK, F2))
def _write_derivatives(system, work, out):
    """Derivatives of (r, g) that `linearise` knows, a row of `out` per coordinate.

    Positions are tangent, velocities follow.
    """
    n = len(work.f)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 0.0
    for b in range(len(system.body)):
        nv, o, first = system.body[b].nv, system.body[b].block, system.body[b].vel
        for i in range(nv):
            for k in range(nv):
                out[first + k, first + i] += work.Rp[o + i * nv + k]
                out[n + first + k, first + i] += work.Rv[o + i * nv + k]
    for s in range(len(system.segment)):
        row, at = system.segment[s].row, system.segment[s].offset
        first = system.body[system.segment[s].body].vel
        for k in range(system.body[system.segment[s].body].nv):
            out[first + k, n + row] += work.Gp[at + k]
            out[n + first + k, n + row] += work.Gv[at + k]
    forces = system.newton_subsystem.segment
    for p in range(len(forces)):
        if forces[p].offset < system.n_entries:
            continue
        to, u = forces[p].offset, system.body[forces[p].body].vel
        for q in range(len(forces)):
            if forces[q].row != forces[p].row or forces[q].offset < system.n_entries:
                continue
            at, w = forces[q].offset, system.body[forces[q].body].vel
            for i in range(system.body[forces[p].body].nv):
                for k in range(system.body[forces[q].body].nv):
                    out[w + k, u + i] += work.C[to + i] * work.Gp[at + k]
                    out[n + w + k, u + i] += work.C[to + i] * work.Gv[at + k]


@inner(
    void(
        *(KERNELS, SYSTEM, WORK, float64, F1, F1, F1, F1),
        *(F2, F2, F1, F1, F2, F2),
    )
)
def _complete_derivatives(
    kernels,
    system,
    work,
    t,
    z,
    v,
    a,
    lambda_,
    directions,
    duals,
    points,
    weights,
    scratch,
    out,
):
    """Make derivatives along some directions those of differences, see
    `linearise_states`; `work` is then that of another state."""
    n = len(work.f)
    change, moved_z, moved_v, dz = scratch[0], scratch[1], scratch[2], scratch[3]
    for k in range(len(directions)):
        kernels.rate(system, z, directions[k], dz)
        for j in range(out.shape[1]):
            change[j] = 0.0
        for point in range(len(points)):
            distance = points[point]
            for i in range(len(z)):
                moved_z[i] = z[i] + distance * dz[i]
            for i in range(n):
                moved_v[i] = v[i] + distance * directions[k, n + i]
            kernels.evaluate(system, work, t, moved_z, moved_v)
            _add_residual(system, work, a, lambda_, weights[point], change)
        for i in range(2 * n):
            if directions[k, i] != 0.0:
                for j in range(out.shape[1]):
                    change[j] -= directions[k, i] * out[i, j]
        for i in range(2 * n):
            if duals[k, i] != 0.0:
                for j in range(out.shape[1]):
                    out[i, j] += duals[k, i] * change[j]


@entry(
    void(
        *(KERNELS, SYSTEM, WORK, F1, F1, F2, F2, F2, F2),
        *(F2, F2, F1, F1, F2, F3),
    )
)
def linearise_states(
    kernels,
    system,
    work,
    clocks,
    times,
    z,
    v,
    a,
    lambda_,
    directions,
    duals,
    points,
    weights,
    scratch,
    out,
):
    """Derivatives of (r, g) of states by tangent positions and velocities,
    (states, 2 velocities, rows): those of `linearise`, along some directions
    differences.

    Parameters
    ----------
    directions : (., 2 velocities) changes of the state along which `linearise` is not
        complete
    duals : (., 2 velocities) whose product with their own direction is 1, with others 0
    points, weights : of the differences, in directions
    scratch : (4, .) of the positions or the rows, whichever are more, 0
    """
    for k in range(len(times)):
        work.interval_time[0] = clocks[k]
        kernels.evaluate(system, work, times[k], z[k], v[k])
        kernels.linearise(system, work, times[k], z[k], v[k], a[k], lambda_[k])
        _write_derivatives(system, work, out[k])
        _complete_derivatives(
            *(kernels, system, work, times[k], z[k], v[k], a[k], lambda_[k]),
            *(directions, duals, points, weights, scratch, out[k]),
        )


@inner(int64(F1))
def _is_zero(x):
    for i in range(len(x)):
        if x[i] != 0.0:
            return 0
    return 1


@inner(void(SYSTEM, WORK, MEMORY, F2))
def _solve(system, work, memory, columns):
    """K^-1 (r, g) in place at the state whose accelerations were just evaluated."""
    n = len(work.f)
    for j in range(columns.shape[0]):
        x = columns[j]
        if _is_zero(x) == 1:
            continue
        for i in range(n):
            memory.acceleration[i] = x[i]
        for i in range(system.n_rows):
            work.row[i, C_GAMMA] = x[n + i]
        solve_with_constraints(
            system, work, memory, memory.acceleration, memory.multiplier, 1.0
        )
        for i in range(n):
            x[i] = memory.acceleration[i]
        for i in range(system.n_rows):
            x[n + i] = memory.multiplier[i]


@entry(int64(KERNELS, SYSTEM, WORK, MEMORY, F1, F1, F2, F2, F3))
def solve_columns(kernels, system, work, memory, clocks, times, z, v, columns):
    """K^-1 (r, g) of states in place: (states, columns, rows).

    With the sign of the second part changed before and after it is K^-T (r, g).
    Returns 0, or the code of a singular state.
    """
    for k in range(len(times)):
        work.interval_time[0] = clocks[k]
        status = evaluate_accelerations(
            kernels, system, work, memory, times[k], z[k], v[k]
        )
        if status != 0:
            return status
        _solve(system, work, memory, columns[k])
    return 0


@entry(
    int64(
        *(KERNELS, SYSTEM, WORK, MEMORY, F1, F1, F2, F2, F2, F2),
        *(F2, F2, F1, F1, F2, int64, F1, F2, F2, F2, F2, F2, F3),
    )
)
def slope_derivatives(
    kernels,
    system,
    work,
    memory,
    clocks,
    times,
    z,
    v,
    a,
    lambda_,
    directions,
    duals,
    points,
    weights,
    scratch,
    transposed,
    unit,
    solved,
    Z,
    by_position,
    to_tangent,
    found,
    out,
):
    """Derivatives of the slopes (Z z_II, z_II') of states by positions and velocities,
    (states, N, N); returns as `solve_columns`.

    Parameters
    ----------
    directions, duals, points, weights, scratch : as of `linearise_states`
    transposed : 1 for a row of `out` for each coordinate, 0 for each slope
    unit, Z, by_position, to_tangent : as of `rates_of_states`, of one state, 0
    solved, found : (2 velocities, rows), (N, N)
    """
    nz, nv = Z.shape[1], Z.shape[0]
    for k in range(len(times)):
        work.interval_time[0] = clocks[k]
        status = evaluate_accelerations(
            kernels, system, work, memory, times[k], z[k], v[k]
        )
        if status != 0:
            return status
        kernels.linearise(system, work, times[k], z[k], v[k], a[k], lambda_[k])
        _write_derivatives(system, work, solved)
        if len(directions) > 0:
            _complete_derivatives(
                *(kernels, system, work, times[k], z[k], v[k], a[k], lambda_[k]),
                *(directions, duals, points, weights, scratch, solved),
            )
            evaluate_accelerations(kernels, system, work, memory, times[k], z[k], v[k])
        _solve(system, work, memory, solved)
        _rate_derivatives(system, z[k], v[k], unit, Z, by_position, to_tangent)
        for i in range(nz):
            copy(by_position[i], found[i])
            for j in range(nv):
                found[i, nz + j] = 0.0
        for i in range(nv):
            copy(Z[i], found[nz + i])
            for j in range(nv):
                found[nz + i, nz + j] = -solved[nv + i, j]
        for b in range(len(system.body)):
            row = system.body[b]
            for t in range(row.vel, row.vel + row.nv):
                for i in range(row.pos, row.pos + row.np):
                    factor = to_tangent[t, i]
                    if factor != 0.0:
                        for j in range(nv):
                            found[i, nz + j] -= factor * solved[t, j]
        for i in range(nz + nv):
            if transposed == 1:
                copy(found[i], out[k, i])
            else:
                for j in range(nz + nv):
                    out[k, j, i] = found[i, j]
    return 0


@inner(void(SYSTEM, WORK, float64, F2))
def _add_jacobian(system, work, weight, out):
    """out += weight C at the state that was just evaluated, (rows, n_velocities)."""
    for s in range(len(system.segment)):
        row, at = system.segment[s].row, system.segment[s].offset
        first = system.body[system.segment[s].body].vel
        for j in range(system.body[system.segment[s].body].nv):
            out[row, first + j] += weight * work.C[at + j]


@entry(int64(KERNELS, SYSTEM, WORK, MEMORY, F1, F1, F2, F2, F2, F1, F1, F1, F3, F3, F3))
def linearise_projections(
    kernels,
    system,
    work,
    memory,
    clocks,
    times,
    z,
    v,
    z_dot,
    steps,
    points,
    weights,
    C,
    G,
    C_dot,
):
    """Derivatives of the projection (18) at states that meet the constraints.

    Parameters
    ----------
    z_dot : rates of the positions
    steps : of differences along the motion [s]
    points, weights : of these differences, in steps
    C, C_dot : (states, rows, n_velocities) constraint Jacobian and its rate
    G : (states, rows, n_velocities) correction that a residual of 1 is removed by
    """
    dz, dv = memory.dx, memory.real.x
    for k in range(len(times)):
        work.interval_time[0] = clocks[k]
        for i in range(system.n_rows):
            for j in range(C.shape[2]):
                C[k, i, j] = C_dot[k, i, j] = 0.0
        for point in range(len(points)):
            distance = points[point] * steps[k]
            for j in range(z_dot.shape[1]):
                z[k, j] += distance * z_dot[k, j]
            kernels.evaluate(system, work, times[k] + distance, z[k], v[k])
            _add_jacobian(system, work, weights[point] / steps[k], C_dot[k])
            for j in range(z_dot.shape[1]):
                z[k, j] -= distance * z_dot[k, j]
        kernels.evaluate(system, work, times[k], z[k], v[k])
        for i in range(system.n_rows):
            for j in range(system.n_rows):
                work.row[j, C_VALUE] = work.row[j, C_RATE] = -1.0 if i == j else 0.0
            status = kernels.project_once(system, work, memory, REGULARISATION, dz, dv)
            if status != 0:
                return status
            copy(dv, G[k, i])
        _add_jacobian(system, work, 1.0, C[k])
    return 0
