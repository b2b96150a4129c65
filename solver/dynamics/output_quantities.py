"""Output quantities of recorded states: wrenches, measures, energies and powers.

Energies and momenta of bodies follow from eq. (12) and (24).
"""

import math
from typing import Any

from ..compiler.kernels import Entry, entry, inner
from ..compiler.types import void
from ..spatial.algebra import (
    cross,
    dot,
    embed_in_space,
    from_rotated_axes,
    inertia_times,
    load,
    rotate,
    zero,
)
from ..spatial.dimension import as_planar, as_spatial
from ..spatial.system_arrays import (
    COORDINATE_MEASURE,
    F1,
    F2,
    F3,
    FOLLOWER_LOAD,
    GROUND,
    HAS_KE1,
    OUTPUT_ARRAYS,
    STIFFENED,
    SYSTEM,
    WORK,
)
from .body import De, Ke, Ke1_offset, body_state, cubic_energy, free_mass, ksigma, mass
from .constraints import constraint_wrench
from .equations_of_motion import update_rotation_counters
from .force_law import energy_and_powers, force_law
from .forces import force_wrench
from .geometric_stiffening import evaluate_centre_of_mass, evaluate_mean_axes


@inner()
def _unstiffened_inertia(system, work, b, z, v):
    """Kinetic energy, momentum, angular momentum about the origin of the frame, and
    mdCM.

    Vectors are resolved in the axes of the frame.
    """
    row, frame, M = system.body[b], work.frame[b], work.M
    nq, qd, corner = row.nq, row.vel + row.rd, row.block + row.rd * (row.nv + 1)
    V, omega, m = frame.v, frame.w, mass(frame.x, system.real_data, row.data)
    md, J, _, Ct_qdot, _ = body_state(system, work, row, omega, z, v)
    Cr_qdot, energy = zero(omega), 0.0
    for k in range(nq):
        Cr_qdot = Cr_qdot + v[qd + k] * work.modal_scratch[k].cr
        for i in range(nq):
            energy += 0.5 * v[qd + k] * M[corner + k * row.nv + i] * v[qd + i]
    p = m * V + cross(omega, md) + Ct_qdot
    angular_momentum = cross(md, V) + inertia_times(J, omega) + Cr_qdot
    energy += 0.5 * (dot(V, p + Ct_qdot) + dot(omega, angular_momentum + Cr_qdot))
    return energy, p, angular_momentum, md


@inner()
def _stiffened_inertia(system, work, b, z, v):
    """The same of a body with geometric stiffening; NaN if H is not positive."""
    row, frame, s = system.body[b], work.frame[b], work.rotation_scratch[0]
    nq, qd = row.nq, row.vel + row.rd
    V, omega, m = frame.v, frame.w, mass(frame.x, system.real_data, row.data)
    evaluate_centre_of_mass(system, work, b, z, v, v, 0.0)
    md, Ct_qdot = s.md, s.Ct_qdot
    p = m * V + cross(omega, md) + Ct_qdot
    angular_momentum, energy = (1.0 / m) * cross(md, p), 0.5 * dot(p, p) / m
    for k in range(nq):
        for i in range(nq):
            free = free_mass(md, system.real_data, row.data, nq, k, i)
            energy += 0.5 * v[qd + k] * free * v[qd + i]
    for part in range(2):
        if not evaluate_mean_axes(system, work, b, z, v, v, 0.0, part == 0):
            energy = math.nan
        sign = 1.0 if part == 0 else -1.0
        energy += 0.5 * sign * dot(s.Hu, s.u)
        if part == 0:
            angular_momentum = angular_momentum + from_rotated_axes(s.theta, s.Hu)
    return energy, p, angular_momentum, md


@inner()
def body_momentum_and_energy(system, work, b, z, v):
    """Kinetic energy of a body, its inertial momenta, and mass times centre of mass."""
    row, frame = system.body[b], work.frame[b]
    R, X, m = frame.R, frame.x, mass(frame.x, system.real_data, row.data)
    if row.flags & STIFFENED:
        energy, p, angular_momentum, md = _stiffened_inertia(system, work, b, z, v)
    else:
        energy, p, angular_momentum, md = _unstiffened_inertia(system, work, b, z, v)
    p = rotate(R, p)
    return energy, p, rotate(R, angular_momentum) + cross(X, p), m * X + rotate(R, md)


@inner()
def elastic_energy_and_dissipation(system, work, b, z, v):
    """Energy of deformation of a body, and the power that its damping takes."""
    row, x, real_data = system.body[b], work.frame[b].x, system.real_data
    nq, o, q, qd = row.nq, row.data, row.pos + row.np - row.nq, row.vel + row.rd
    energy, dissipated_power = 0.0, 0.0
    for k in range(nq):
        energy += ksigma(x, real_data, o, nq, k) * z[q + k]
        for i in range(nq):
            energy += 0.5 * z[q + k] * Ke(x, real_data, o, nq, k, i) * z[q + i]
            dissipated_power += v[qd + k] * De(x, real_data, o, nq, k, i) * v[qd + i]
    if row.flags & HAS_KE1:
        energy += cubic_energy(real_data, Ke1_offset(x, o, nq), nq, z, q)
    return energy, dissipated_power


@inner()
def gravity_energy(system, centre_of_mass):
    """Potential of gravity, zero at the origin; of a centre of mass times mass."""
    return -dot(load(centre_of_mass, system.gravity, 0), centre_of_mass)


@inner()
def _write_wrench(output, i, force, torque_a, torque_b):
    row = output.wrench[i]
    row.force = embed_in_space(force)
    row.torque_a, row.torque_b = embed_in_space(torque_a), embed_in_space(torque_b)


@inner()
def _write_force(system, work, target, k, force, torque):
    """Write the measure of a force and its contributions to the energies."""
    row = system.force[k]
    if row.kind <= FOLLOWER_LOAD:
        point = work.point[row.b]
        target.supplied_power = dot(force, point.v) + dot(torque, point.w)
        return
    g, rate = work.measure[k, 0], work.measure[k, 1]
    target.measure, target.rate = g, rate
    if row.owner < 0:
        target.force, _, _ = force_law(system, work, k, g, rate)
        target.stored_energy, target.dissipated_power, target.supplied_power = (
            energy_and_powers(system, work, k, g, rate)
        )


@inner()
def _write_forces(system, work, output, state, t, z, lambda_, friction):
    update_rotation_counters(system, work, z)
    constraints, forces = len(system.constraint), len(system.force)
    frictions = len(system.friction)
    first = state * (constraints + frictions + forces)
    for k in range(constraints):
        force, torque_a, torque_b = constraint_wrench(system, work, k, t, lambda_)
        _write_wrench(output, first + k, force, torque_a, torque_b)
    for k in range(frictions):
        force, torque_a, torque_b = constraint_wrench(
            system.friction_subsystem, work.friction_subsystem, k, t, friction
        )
        _write_wrench(output, first + constraints + k, force, torque_a, torque_b)
    for k in range(forces):
        if system.force[k].kind < COORDINATE_MEASURE:
            force, torque_a, torque_b = force_wrench(system, work, k)
            at = first + constraints + frictions + k
            _write_wrench(output, at, force, torque_a, torque_b)
            target = output.force[state * forces + k]
            _write_force(system, work, target, k, force, torque_b)


@inner()
def _write_bodies(system, work, output, state, z, v):
    bodies = len(system.body)
    for b in range(bodies):
        if system.body[b].motion != GROUND:
            target = output.body[state * bodies + b]
            target.kinetic, p, angular_momentum, centre_of_mass = (
                body_momentum_and_energy(system, work, b, z, v)
            )
            target.momentum, target.angular = (
                embed_in_space(p),
                embed_in_space(angular_momentum),
            )
            target.elastic, target.dissipated_power = elastic_energy_and_dissipation(
                system, work, b, z, v
            )
            target.gravity_energy = gravity_energy(system, centre_of_mass)


@inner()
def _copy_rows(rows, stored):
    for i in range(stored.shape[0]):
        for k in range(stored.shape[1]):
            rows[i, k] = stored[i, k]


@inner()
def _set_state(work, k, interval_times, points, factors):
    work.interval_time[0] = interval_times[k]
    _copy_rows(work.point, points[k])
    for i in range(factors.shape[1]):
        work.force_scale[i] = factors[k, i]


WRITE_FORCES = void(SYSTEM, WORK, OUTPUT_ARRAYS, F1, F1, F2, F3, F2, F2, F2)
WRITE_BODIES = void(SYSTEM, WORK, OUTPUT_ARRAYS, F2, F2, F3)


def _output_entry_kernels(view: Any, space: str) -> tuple[Entry, Entry]:
    """The kernels of plane or space, see `equations_of_motion`."""

    def write_forces(
        system,
        work,
        output,
        times,
        interval_times,
        z,
        points,
        factors,
        lambda_,
        friction,
    ):
        """What constraints and forces do in some states; factors scale forces."""
        for k in range(len(times)):
            _set_state(work, k, interval_times, points, factors)
            at, target = view(work), view(output)
            _write_forces(
                system, at, target, k, times[k], z[k], lambda_[k], friction[k]
            )

    def write_bodies(system, work, output, z, v, frames):
        """Energies and momenta of bodies in some states."""
        for k in range(len(z)):
            _copy_rows(work.frame, frames[k])
            _write_bodies(system, view(work), view(output), k, z[k], v[k])

    for kernel in (write_forces, write_bodies):
        kernel.__qualname__ = f"{kernel.__name__}_in_{space}"
    return entry(WRITE_FORCES)(write_forces), entry(WRITE_BODIES)(write_bodies)


write_forces_in_plane, write_bodies_in_plane = _output_entry_kernels(as_planar, "plane")
write_forces_in_space, write_bodies_in_space = _output_entry_kernels(
    as_spatial, "space"
)
