"""Derivatives of forces and torques at markers by the motion of their own body."""

import math

from ..compiler.kernels import inner
from ..spatial.algebra import (
    add_column,
    add_cross,
    add_double_cross,
    add_row,
    column,
    cross,
    dot,
    rotate_inverse,
    size,
    unit,
    zero,
)
from ..spatial.dimension import BySpace
from .marker_forces import add_generalised_force, marker_torque


@inner()
def shape_function_stiffness(system, work, m, force, torque):
    """Add to Rp the change of inertial loads at a marker as Phi and Psi depend on q."""
    if system.marker[m].phi1 >= 0 or system.marker[m].psi1 >= 0:
        _add_shape_function_stiffness(system, work, m, force, torque)


@inner()
def _add_shape_function_stiffness(system, work, m, force, torque):
    marker = system.marker[m]
    phi1, psi1 = marker.phi1, marker.psi1
    row, frame = system.body[marker.body], work.frame[marker.body]
    nv, nq, rd, block, real_data = row.nv, row.nq, row.rd, row.block, system.real_data
    f = rotate_inverse(frame.R, force)
    t = marker_torque(work, m, rotate_inverse(frame.R, torque))
    for k in range(nq):
        row_start = block + (rd + k) * nv + rd
        for i in range(nq):
            if phi1 >= 0:
                phi1_ki = column(f, real_data, phi1 + k * nq, nq * nq, i)
                work.Rp[row_start + i] -= dot(phi1_ki, f)
            if psi1 >= 0:
                psi1_ki = column(t, real_data, psi1 + k * nq, nq * nq, i)
                work.Rp[row_start + i] -= dot(psi1_ki, t)


@inner()
def force_stiffness(system, work, m, force):
    """Add to Rp the derivative of an inertial force at a marker by the motion of its
    body.
    """
    marker, point = system.marker[m], work.point[m]
    shape_function_stiffness(system, work, m, force, zero(point.w))
    row, frame = system.body[marker.body], work.frame[marker.body]
    nv, nq, rd, block, n, P = row.nv, row.nq, row.rd, row.block, size(force), work.Rp
    if rd <= n:
        return
    f, rotation_rows = rotate_inverse(frame.R, -force), block + n * nv
    add_cross(P, block + n, nv, f, frame.w)
    add_double_cross(P, rotation_rows + n, nv, point.d, f, frame.w)
    for k in range(nq):
        moment = cross(column(f, work.phi, marker.phi, nq, k), f)
        add_column(P, rotation_rows + rd + k, nv, moment)
        add_row(P, block + (rd + k) * nv + n, moment)


@inner()
def torque_stiffness(system, work, m, torque):
    """Add to Rp the derivative of an inertial torque at a marker by the motion of its
    body.
    """
    marker = system.marker[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    shape_function_stiffness(system, work, m, zero(work.point[m].x), torque)
    nv, nq, rd, block, n = row.nv, row.nq, row.rd, row.block, size(frame.x)
    if rd <= n:
        return
    t = rotate_inverse(frame.R, -torque)
    add_cross(work.Rp, block + n * nv + n, nv, t, t)
    psi = marker.phi + n * nq
    for k in range(nq):
        moment = cross(column(t, work.phi, psi, nq, k), t)
        add_row(work.Rp, block + (rd + k) * nv + n, moment)


@inner()
def add_outer(system, work, b, left, right, weight):
    """Rp of a body += weight * scratch[left] scratch[right]^T."""
    nv, block = system.body[b].nv, system.body[b].block
    for i in range(nv):
        for j in range(nv):
            product = work.scratch[left + i] * work.scratch[right + j]
            work.Rp[block + i * nv + j] += weight * product


@inner()
def scratch_row(system, work, at, m, force, torque):
    """The row of a force and a torque at a marker, into scratch[at:]."""
    for i in range(system.body[system.marker[m].body].nv):
        work.scratch[at + i] = 0.0
    add_generalised_force(system, work, work.scratch, at, m, force, torque)


@inner()
def _planar_transverse_direction(work, n, i):
    return cross(unit(work.point[0].w, 0), n)


@inner()
def _spatial_transverse_direction(work, n, i):
    first = cross(n, unit(n, 0 if abs(dot(n, unit(n, 0))) < 0.6 else 1))
    first = (1.0 / math.sqrt(dot(first, first))) * first
    return first if i == 0 else cross(n, first)


#: The i-th of the directions across n.
transverse_direction = BySpace(
    plane=_planar_transverse_direction, space=_spatial_transverse_direction
)


@inner()
def transverse_stiffness(system, work, m, n, weight):
    """Rp += weight * sum of p p^T over the directions across n."""
    b = system.marker[m].body
    for i in range(size(n) - 1):
        e = transverse_direction(work, n, i)
        scratch_row(system, work, 0, m, e, zero(work.point[m].w))
        add_outer(system, work, b, 0, 0, weight)


@inner()
def _planar_rotating_force_stiffness(system, work, m, n, x, force):
    b, half = system.marker[m].body, len(work.scratch) // 2
    force_stiffness(system, work, m, -force * n)
    e_z = unit(work.point[m].w, 0)
    scratch_row(system, work, 0, m, cross(e_z, n), zero(e_z))
    scratch_row(system, work, half, m, zero(n), e_z)
    add_outer(system, work, b, 0, half, force)
    add_outer(system, work, b, half, 0, force)
    add_outer(system, work, b, half, half, force * dot(n, x))


@inner()
def _spatial_rotating_force_stiffness(system, work, m, n, x, force):
    """Rotating-force stiffness in space, without rotations by elastic coordinates."""
    marker = system.marker[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    shape_function_stiffness(system, work, m, -force * n, zero(n))
    if row.rd != 6:
        return
    nv, rotation_rows = row.nv, row.block + 3 * row.nv
    h = -force * rotate_inverse(frame.R, n)
    y = rotate_inverse(frame.R, x) + work.point[m].d
    add_double_cross(work.Rp, rotation_rows + 3, nv, h, y, y)
    add_cross(work.Rp, rotation_rows, nv, -h, y)


_rotating_force_stiffness = BySpace(
    plane=_planar_rotating_force_stiffness, space=_spatial_rotating_force_stiffness
)


@inner()
def rotating_force_stiffness(system, work, a, b, n, x, force):
    """Rp of a force along a direction n that rotates with marker A, x from A to B."""
    force_stiffness(system, work, b, force * n)
    shape_function_stiffness(system, work, a, zero(n), force * cross(n, x))
    _rotating_force_stiffness(system, work, a, n, x, force)
