"""Frames, markers, accelerations and multipliers at the recorded states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.sid import Array

from ..integrators import recording
from ..kernels.layout import Work
from ..kernels.newton import Kernels, Memory
from ..start.minimum_norm import minimum_norm
from ..start.turn_counts import keep_turns
from ..system import kernel_calls
from ..system.scene import System


@dataclass(frozen=True, eq=False)
class Samples:
    """States at nt times and what follows from them.

    z, v : (nt, .) states
    frames, points : (nt, bodies, .) and (nt, markers, .), as in `kernels.layout.Work`,
        with accelerations complete
    accelerations : (nt, .) z_II'
    multipliers : (nt, rows), of redundant constraints the smallest, see `minimum_norm`
    factors : (nt, forces) functions of time and laws that scale forces
    undetermined : rows of multipliers that the motion does not determine
    """

    z: Array
    v: Array
    frames: Array
    points: Array
    accelerations: Array
    multipliers: Array
    factors: Array
    undetermined: tuple[int, ...] = ()


def sample(
    system: System,
    kernels: Kernels,
    work: Work,
    memory: Memory,
    times: Array,
    z: Array,
    v: Array,
    closed: Array,
) -> Samples:
    """Projects every recorded state and solves eq. (3) there.

    closed : (rows, 2) constraints are met when |c| and |dc/dt| are below
    """
    nt = len(times)
    frames = np.zeros((nt, *work.frame.shape))
    points = np.zeros((nt, *work.point.shape))
    accelerations = np.zeros((nt, system.n_velocities))
    multipliers = np.zeros((nt, system.n_rows))
    factors = np.zeros((nt, len(system.forces)))
    edges = np.array([system.scene.time.start, *system.breaks])
    recording.sample(
        kernels,
        system.arrays,
        work,
        memory,
        closed,
        times,
        edges,
        z,
        v,
        np.zeros((1, system.n_positions)),
        np.zeros((3, system.n_velocities)),
        frames,
        points,
        accelerations,
        multipliers,
        factors,
    )
    kernel_calls.go_on(system)
    rows: tuple[int, ...] = ()
    if system.redundant:
        multipliers, rows = minimum_norm(system, work, times, z, v, multipliers)
    return Samples(z, v, frames, points, accelerations, multipliers, factors, rows)


def sample_known(
    system: System,
    work: Work,
    times: Array,
    z: Array,
    v: Array,
    accelerations: Array,
    multipliers: Array,
) -> Samples:
    """Recorded states whose accelerations and multipliers are known."""
    frames = np.zeros((len(times), *work.frame.shape))
    points = np.zeros((len(times), *work.point.shape))
    factors = np.zeros((len(times), len(system.forces)))
    for k, (t, clock) in enumerate(zip(times, system.clocks(times), strict=True)):
        work.clock[0] = clock
        kernel_calls.evaluate(system, work, t, z[k], v[k])
        kernel_calls.complete(system, work, accelerations[k])
        keep_turns(system, work, z[k])
        frames[k], points[k], factors[k] = work.frame, work.point, work.factor
    smallest, rows = minimum_norm(system, work, times, z, v, multipliers)
    return Samples(z, v, frames, points, accelerations, smallest, factors, rows)
