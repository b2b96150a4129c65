"""Tolerated errors: relative to the motion so far, as the step goes on with it.

Nothing is compared with coordinates themselves, so that moving the origin changes
nothing, nor with the sizes of bodies, so that small vibrations of large bodies are
resolved as well as large motions. A motion that has hardly begun is as large as
velocities and accelerations make it within the step.
"""

from __future__ import annotations

import math

from numba import float64, types

from ..compiler.compiling import inner
from ..linear.memory import MEMORY
from ..space.layout import F1, STATE, SYSTEM
from .stepping import CONTROL

#: Relative to the motion of the mechanism: the elastic displacement below which the
#: error of a deformation is not resolved any further.
SMALLEST_DEFORMATION = 1e-7
#: Rounding in a step, relative to positions; so many times as much may be asked for,
#: the second one of steps whose errors add up. Deformations are small numbers.
ROUNDED, RESOLVED, RESOLVED_PART = 1e-15, 10.0, 3.0
ROUNDED_DEFORMATION = 1e-17
#: The same of states of laws, relative to the mechanism or, if that is less, to one.
SMALLEST_STATE, ROUNDED_STATE = 1e-9, 1e-14
#: An error of velocities goes on to displace for so much of the run where motions are
#: as large as bodies: free ones, and those whose period depends on their amplitude.
LASTING = 0.1
#: Radians (or sizes of the mechanism) in a run from which on such errors add up: there
#: are as many of them as of turns. Methods of long steps begin with fewer of them.
MANY = 200.0
TINY = 1e-300


@inner(types.void(SYSTEM, MEMORY, CONTROL))
def note_motion(system, memory, control):
    """Keeps the largest motion so far, and how fast it changes now."""
    z, v, a = control.z, control.v, memory.acceleration
    motion_rate = motion_push = turn_rate = turn_push = 0.0
    for b in range(len(system.body)):
        row = system.body[b]
        rd, nq, u, p = row.rd, row.nq, row.vel, row.pos
        rigid = row.np - nq
        axes = 2 if rd == 2 or (rd == 3 and rigid == 3) else 3
        way = _distance(z, control.start, p, p + min(axes, rigid))
        pace, push = _size(v, u, u + min(axes, rd)), _size(a, u, u + min(axes, rd))
        control.speed = max(control.speed, pace)
        if rd > axes:
            angle = _distance(z, control.start, p + axes, p + rigid)
            if rigid == 7:
                angle *= 2.0
            spin, jerk = _size(v, u + axes, u + rd), _size(a, u + axes, u + rd)
            control.rotation = max(control.rotation, angle)
            control.spin = max(control.spin, spin)
            turn_rate, turn_push = max(turn_rate, spin), max(turn_push, jerk)
            extent = control.extent[b]
            way, pace = max(way, extent * angle), max(pace, extent * spin)
            push = max(push, extent * jerk)
        motion_rate, motion_push = max(motion_rate, pace), max(motion_push, push)
        deformation = _note_deformation(system, memory, control, b)
        control.motion = max(control.motion, way, deformation)
    control.motion_rate, control.motion_push = motion_rate, motion_push
    control.rotation_rate, control.rotation_push = turn_rate, turn_push


@inner(float64(SYSTEM, MEMORY, CONTROL, types.int64))
def _note_deformation(system, memory, control, b):
    """The same of elastic coordinates; the largest displacement so far.

    They go no further in a step than their static deflection and a vibration do.
    """
    row, coming = system.body[b], control.coming[b]
    first, q = row.vel + row.rd, row.pos + row.np - row.nq
    for i in range(len(coming)):
        coming[i] = 0.0
    for k in range(row.nq):
        i = first + k
        if row.flags & STATE:
            control.elastic[b] = max(control.elastic[b], abs(control.v[i]))
            coming[1] = abs(memory.acceleration[i])
            return 0.0
        size, omega = control.amplitude[i], max(control.frequency[i], TINY)
        pace, push = size * abs(control.v[i]), size * abs(memory.acceleration[i])
        shape = size * abs(control.z[q + k] - control.start[q + k])
        control.elastic[b] = max(control.elastic[b], shape)
        control.elastic[b] = max(control.elastic[b], size * abs(control.z[q + k]))
        coming[0], coming[1] = max(coming[0], pace), max(coming[1], push)
        coming[2] = max(coming[2], pace / omega)
        coming[3] = max(coming[3], 2.0 * push / (omega * omega))
    return control.elastic[b]


@inner(float64(F1, types.int64, types.int64))
def _size(x, first, end):
    total = 0.0
    for i in range(first, end):
        total += x[i] * x[i]
    return math.sqrt(total)


@inner(float64(F1, F1, types.int64, types.int64))
def _distance(x, y, first, end):
    total = 0.0
    for i in range(first, end):
        total += (x[i] - y[i]) ** 2
    return math.sqrt(total)


@inner(types.void(SYSTEM, CONTROL, float64))
def set_scales(system, control, h):
    """Tolerated errors of a step.

    An error of elastic velocities may be as large as the frequency times that of the
    deformation; of others as large as what it moves until it is forgotten.
    """
    length, period = control.length, control.period
    control.part, floor = 1.0, RESOLVED * ROUNDED
    if control.adding == 1:
        control.part, floor = h / period, RESOLVED_PART * ROUNDED
    tolerance = control.tolerance * control.part
    resolved = max(tolerance, floor)
    motion = h * (control.motion_rate + 0.5 * h * control.motion_push)
    motion = min(max(motion, control.motion), length)
    turn = h * (control.rotation_rate + 0.5 * h * control.rotation_push)
    turn = min(max(turn, control.rotation, motion / length), 1.0)
    speed = max(
        control.motion_rate + h * control.motion_push, ROUNDED * length / period
    )
    speed = max(control.speed, speed)
    spin = control.rotation_rate + h * control.rotation_push
    spin = max(control.spin, spin, speed / length)
    lasting, tolerated = 0.0, tolerance
    if control.accumulates == 1:
        lasting = LASTING * turn * period
    if control.adding == 0 and control.accumulates == 1:
        turned = spin * period
        few = min(turned / control.many, control.most)
        tolerated /= max(1.0, few, turned / MANY)
    control.noise, least = 0.0, min(length, 1.0)
    for b in range(len(system.body)):
        row = system.body[b]
        rd, nq, u, p = row.rd, row.nq, row.vel, row.pos
        rigid = row.np - nq
        axes = 2 if rd == 2 or (rd == 3 and rigid == 3) else 3
        for k in range(rigid):
            size, whole = (motion, length) if k < axes else (turn, 1.0)
            extent = max(whole, abs(control.z[p + k]))
            control.scale_z[p + k] = max(tolerance * size, floor * extent)
            noise = ROUNDED * extent / control.scale_z[p + k]
            control.noise = max(control.noise, noise)
        for k in range(rd):
            size, rate, whole = motion, speed, length
            if k >= axes:
                size, rate, whole = turn, spin, 1.0
            control.pace[u + k] = rate
            lasts = min(max(size / rate + lasting, TINY), period)
            wanted = max(tolerated * size, floor * whole) / lasts
            control.scale_v[u + k] = max(wanted, floor * rate)
            noise = ROUNDED * rate / control.scale_v[u + k]
            control.noise = max(control.noise, noise)
        coming = control.coming[b]
        if row.flags & STATE:
            size = max(control.elastic[b], h * coming[1], SMALLEST_STATE * least)
            control.pace[u] = size
            control.scale_v[u] = max(resolved * size, ROUNDED_STATE * least)
            control.scale_z[p] = control.scale_v[u] * period
            continue
        size = min(h * coming[0], coming[2]) + min(0.5 * h * h * coming[1], coming[3])
        size = max(size, control.elastic[b], SMALLEST_DEFORMATION * motion)
        size = max(size, ROUNDED_DEFORMATION / control.tolerance * length)
        for k in range(nq):
            i = u + rd + k
            control.pace[i] = size / control.amplitude[i]
            control.scale_z[p + rigid + k] = resolved * control.pace[i]
            control.pace[i] *= max(control.frequency[i], 1.0 / period)
            control.scale_v[i] = resolved * control.pace[i]
