"""What outputs tell of recorded states: wrenches, measures, energies and powers."""

from __future__ import annotations

from numba import types

from ..compiler.compiling import entry, inner
from ..space.algebra import dot, embedded
from ..space.layout import COORDINATE, F1, F2, F3, FOLLOWING, GROUND, SYSTEM, TOLD, WORK
from ..space.spaces import in_plane, in_space
from .constraints.all import wrench as constraint_wrench
from .energies import elasticity_of, inertia_of, weight_of
from .equations import count_turns
from .forces.all import wrench as force_wrench
from .forces.law import energies


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


@entry(TELL_FORCES)
def tell_forces_in_plane(
    system, work, told, times, clocks, z, points, factors, lam, rub
):
    """What constraints and forces do in some states; factors scale forces."""
    for k in range(len(times)):
        _set_state(work, k, clocks, points, factors)
        near, at, to = in_plane(system), in_plane(work), in_plane(told)
        _tell_forces(near, at, to, k, times[k], z[k], lam[k], rub[k])


@entry(TELL_FORCES)
def tell_forces_in_space(
    system, work, told, times, clocks, z, points, factors, lam, rub
):
    """What constraints and forces do in some states; factors scale forces."""
    for k in range(len(times)):
        _set_state(work, k, clocks, points, factors)
        near, at, to = in_space(system), in_space(work), in_space(told)
        _tell_forces(near, at, to, k, times[k], z[k], lam[k], rub[k])


@entry(TELL_BODIES)
def tell_bodies_in_plane(system, work, told, z, v, frames):
    """Energies and momenta of bodies in some states."""
    for k in range(len(z)):
        _recall(work.frame, frames[k])
        _tell_bodies(in_plane(system), in_plane(work), in_plane(told), k, z[k], v[k])


@entry(TELL_BODIES)
def tell_bodies_in_space(system, work, told, z, v, frames):
    """Energies and momenta of bodies in some states."""
    for k in range(len(z)):
        _recall(work.frame, frames[k])
        _tell_bodies(in_space(system), in_space(work), in_space(told), k, z[k], v[k])
