"""What outputs tell of recorded states: wrenches, measures, energies and powers.

Energies and momenta of bodies follow from what moves them: theory, eq. (12) and (24).
"""

from __future__ import annotations

import math
from typing import Any

from numba import types

from ..compiler.compiling import Entry, entry, inner
from ..space.algebra import cross, dot, embedded, inertia_times, load, rotate, zero
from ..space.layout import (
    COORDINATE,
    F1,
    F2,
    F3,
    FOLLOWING,
    GROUND,
    HAS_KE1,
    STIFFENED,
    SYSTEM,
    TOLD,
    WORK,
)
from ..space.spaces import in_plane, in_space
from ..space.tilted import meant
from .blocks import De, Ke, cube_at, free_mass, ksigma, mass
from .bodies import body_state
from .centre import centre
from .constraints.all import wrench as constraint_wrench
from .cubic import cubic_energy
from .equations import count_turns
from .forces.all import wrench as force_wrench
from .forces.law import energies, force_law
from .stiffened import rotate_axes


@inner()
def _plain_inertia(system, work, b, z, v):
    """Kinetic energy; momentum, angular momentum about the frame's origin, and mdCM, in
    the axes of the frame."""
    row, frame, M = system.body[b], work.frame[b], work.M
    nq, qd, corner = row.nq, row.vel + row.rd, row.block + row.rd * (row.nv + 1)
    V, w, m = frame.v, frame.w, mass(frame.x, system.pool, row.data)
    md, J, _, flow, _ = body_state(system, work, row, w, z, v)
    spin, energy = zero(w), 0.0
    for k in range(nq):
        spin = spin + v[qd + k] * work.modal[k].cr
        for i in range(nq):
            energy += 0.5 * v[qd + k] * M[corner + k * row.nv + i] * v[qd + i]
    p = m * V + cross(w, md) + flow
    turn = cross(md, V) + inertia_times(J, w) + spin
    energy += 0.5 * (dot(V, p + flow) + dot(w, turn + spin))
    return energy, p, turn, md


@inner()
def _stiffened_inertia(system, work, b, z, v):
    """The same of a body with geometric stiffening; NaN if H is not positive."""
    row, frame, s = system.body[b], work.frame[b], work.turning[0]
    nq, qd = row.nq, row.vel + row.rd
    V, w, m = frame.v, frame.w, mass(frame.x, system.pool, row.data)
    centre(system, work, b, z, v, v, 0.0)
    md, flow = s.md, s.flow
    p = m * V + cross(w, md) + flow
    turn, energy = (1.0 / m) * cross(md, p), 0.5 * dot(p, p) / m
    for k in range(nq):
        for i in range(nq):
            free = free_mass(md, system.pool, row.data, nq, k, i)
            energy += 0.5 * v[qd + k] * free * v[qd + i]
    for part in range(2):
        if not rotate_axes(system, work, b, z, v, v, 0.0, part == 0):
            energy = math.nan
        sign = 1.0 if part == 0 else -1.0
        energy += 0.5 * sign * dot(s.momentum, s.u)
        if part == 0:
            turn = turn + meant(s.theta, s.momentum)
    return energy, p, turn, md


@inner()
def inertia_of(system, work, b, z, v):
    """Kinetic energy of a body; its momentum, that about the origin, and the centre of
    mass times mass, inertial."""
    row, frame = system.body[b], work.frame[b]
    R, X, m = frame.R, frame.x, mass(frame.x, system.pool, row.data)
    if row.flags & STIFFENED:
        energy, p, turn, md = _stiffened_inertia(system, work, b, z, v)
    else:
        energy, p, turn, md = _plain_inertia(system, work, b, z, v)
    p = rotate(R, p)
    return energy, p, rotate(R, turn) + cross(X, p), m * X + rotate(R, md)


@inner()
def elasticity_of(system, work, b, z, v):
    """Energy of deformation of a body, and the power that its damping takes."""
    row, x, pool = system.body[b], work.frame[b].x, system.pool
    nq, o, q, qd = row.nq, row.data, row.pos + row.np - row.nq, row.vel + row.rd
    energy, lost = 0.0, 0.0
    for k in range(nq):
        energy += ksigma(x, pool, o, nq, k) * z[q + k]
        for i in range(nq):
            energy += 0.5 * z[q + k] * Ke(x, pool, o, nq, k, i) * z[q + i]
            lost += v[qd + k] * De(x, pool, o, nq, k, i) * v[qd + i]
    if row.flags & HAS_KE1:
        energy += cubic_energy(pool, cube_at(x, o, nq), nq, z, q)
    return energy, lost


@inner()
def weight_of(system, centre_of_mass):
    """Potential of gravity, zero at the origin; of a centre of mass times mass."""
    return -dot(load(centre_of_mass, system.gravity, 0), centre_of_mass)


@inner()
def _tell_wrench(told, i, force, torque_a, torque_b):
    row = told.wrench[i]
    row.force = embedded(force)
    row.torque_a, row.torque_b = embedded(torque_a), embedded(torque_b)


@inner()
def _tell_force(system, work, to, k, force, torque):
    """What a force measures, and what it does to energies."""
    row = system.force[k]
    if row.kind <= FOLLOWING:
        point = work.point[row.b]
        to.given = dot(force, point.v) + dot(torque, point.w)
        return
    g, rate = work.measure[k, 0], work.measure[k, 1]
    to.measure, to.rate = g, rate
    if row.owner < 0:
        to.size, _, _ = force_law(system, work, k, g, rate)
        to.stored, to.lost, to.given = energies(system, work, k, g, rate)


@inner()
def _tell_forces(system, work, told, state, t, z, lam, rub):
    count_turns(system, work, z)
    held, forces = len(system.constraint), len(system.force)
    rubbing = len(system.friction)
    first = state * (held + rubbing + forces)
    for k in range(held):
        force, torque_a, torque_b = constraint_wrench(system, work, k, t, lam)
        _tell_wrench(told, first + k, force, torque_a, torque_b)
    for k in range(rubbing):
        force, torque_a, torque_b = constraint_wrench(
            system.sliding, work.sliding, k, t, rub
        )
        _tell_wrench(told, first + held + k, force, torque_a, torque_b)
    for k in range(forces):
        if system.force[k].kind < COORDINATE:
            force, torque_a, torque_b = force_wrench(system, work, k)
            at = first + held + rubbing + k
            _tell_wrench(told, at, force, torque_a, torque_b)
            to = told.force[state * forces + k]
            _tell_force(system, work, to, k, force, torque_b)


@inner()
def _tell_bodies(system, work, told, state, z, v):
    bodies = len(system.body)
    for b in range(bodies):
        if system.body[b].motion != GROUND:
            to = told.body[state * bodies + b]
            to.kinetic, p, turn, place = inertia_of(system, work, b, z, v)
            to.momentum, to.angular = embedded(p), embedded(turn)
            to.elastic, to.lost = elasticity_of(system, work, b, z, v)
            to.weight = weight_of(system, place)


@inner()
def _recall(rows, kept):
    for i in range(kept.shape[0]):
        for k in range(kept.shape[1]):
            rows[i, k] = kept[i, k]


@inner()
def _set_state(work, k, clocks, points, factors):
    work.clock[0] = clocks[k]
    _recall(work.point, points[k])
    for i in range(factors.shape[1]):
        work.factor[i] = factors[k, i]


TELL_FORCES = types.void(SYSTEM, WORK, TOLD, F1, F1, F2, F3, F2, F2, F2)
TELL_BODIES = types.void(SYSTEM, WORK, TOLD, F2, F2, F3)


def _entries(seen: Any, place: str) -> tuple[Entry, Entry]:
    """The kernels of plane or space, see `equations`."""

    def tell_forces(system, work, told, times, clocks, z, points, factors, lam, rub):
        """What constraints and forces do in some states; factors scale forces."""
        for k in range(len(times)):
            _set_state(work, k, clocks, points, factors)
            at, to = seen(work), seen(told)
            _tell_forces(system, at, to, k, times[k], z[k], lam[k], rub[k])

    def tell_bodies(system, work, told, z, v, frames):
        """Energies and momenta of bodies in some states."""
        for k in range(len(z)):
            _recall(work.frame, frames[k])
            _tell_bodies(system, seen(work), seen(told), k, z[k], v[k])

    for kernel in (tell_forces, tell_bodies):
        kernel.__qualname__ = f"{kernel.__name__}_in_{place}"
    return entry(TELL_FORCES)(tell_forces), entry(TELL_BODIES)(tell_bodies)


tell_forces_in_plane, tell_bodies_in_plane = _entries(in_plane, "plane")
tell_forces_in_space, tell_bodies_in_space = _entries(in_space, "space")
