"""Energies and momenta of bodies, from what moves them: theory, eq. (12) and (24)."""

from __future__ import annotations

import math

from ..compiler.compiling import inner
from ..space.algebra import cross, dot, inertia_times, load, rotate, zero
from ..space.layout import HAS_KE1, STIFFENED
from ..space.tilted import meant
from .blocks import De, Ke, cube_at, free_mass, ksigma, mass
from .bodies import body_state
from .centre import centre
from .cubic import cubic_energy
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
