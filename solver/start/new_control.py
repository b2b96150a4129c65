"""The state that a step loop begins with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sidtool.formats.sid import Array

from ..functions.table import features
from ..integrators import INTEGRATORS, bifurcations, stepping
from ..space import layout as at
from ..space.layout import IntTable
from ..system.bodies.vibration import frequencies
from ..system.kernel_calls import evaluate
from ..system.scene import System
from ..system.sizes import (
    coordinate_amplitudes,
    extents,
    row_sizes,
    sliding_sizes,
)
from ..system.storage import new_work
from .assembly import Start, dense_jacobian
from .consistent import of_length_one
from .settings import Settings

#: Constraints are met when they are open by less than this part of the size: at least
#: what rounding allows, at most what keeps the drift invisible.
CLOSED = (1e-13, 1e-11)
#: Tolerance of a step in units of the requested relative error, for methods of high
#: order: the estimate is that of a lower one. Those of order 2 share it among steps.
STEP_TOLERANCE = 0.3
#: Radians (or sizes of the mechanism) in a run from which on errors of free motions add
#: up, and how many times at most, by the order of the method: the longer the steps are
#: the less such errors cancel. Measured with heavy tops of 25 to 300 turns.
ADDING_UP, NOT_ADDING_UP = (
    {5: (60.0, 3.0), 9: (10.0, 30.0), 13: (4.0, 150.0)},
    (np.inf, 1.0),
)
#: Steps are not held to less than this part, near which rounding adds up instead.
ROUNDING_ADDS_UP = 1e-11
#: Velocity coordinates up to which it is asked whether drives prescribe all motions.
FEW = 300


def closed_below(system: System, settings: Settings) -> Array:
    """(rows, 2) |c| and |dc/dt| below which constraints are met, then joints stick."""
    scene = system.scene
    near = min(max(CLOSED[0], 1e-6 * settings.rtol), CLOSED[1])
    still = CLOSED[0] / (scene.time.end - scene.time.start)
    sizes = [system.once(row_sizes), sliding_sizes(system)]
    return np.outer(np.concatenate(sizes), [near, still])


def new_control(
    system: System,
    settings: Settings,
    start: Start,
    times: int,
    shares: Array,
    closed: Array,
) -> stepping.Control:
    """times : output times that it holds, see `Window`"""
    scene = system.scene
    duration = scene.time.end - scene.time.start
    ends, starts, lengths, corners = system.once(_features)
    counts = times, len(shares), len(starts)
    control = system.lasting(_control, *counts)()
    adding = INTEGRATORS[settings.integrator].order == 2 and settings.step is None
    control.tolerance = settings.rtol * (1.0 if adding else STEP_TOLERANCE)
    control.time = control.begin = scene.time.start
    control.length = system.length
    control.period = duration
    control.radius = settings.radius
    control.singular = np.inf
    control.largest_step = 0.1 * duration
    control.unturned = np.inf
    control.retry = stepping.RETRY
    control.step = 1e-4 * duration * settings.rtol**0.25
    control.fixed_step = int(settings.step is not None)
    control.adding = int(adding)
    order = INTEGRATORS[settings.integrator].order
    control.many, most = ADDING_UP.get(order, NOT_ADDING_UP)
    control.most = min(most, max(1.0, settings.rtol / ROUNDING_ADDS_UP))
    control.accumulates = int(_moves_freely(system, start))
    control.z[:] = control.start[:] = start.z
    control.v[:] = start.v
    control.extent[:] = extents(system)
    control.pace[:] = control.scale_z[:] = control.scale_v[:] = 1.0
    control.closed[:] = closed
    control.times[:] = np.inf
    control.shares[:] = shares
    control.features[:] = ends
    control.starts[:] = starts
    control.corners[:] = corners
    control.reaches[:] = share_followed(settings) * lengths
    for k, force in enumerate(system.forces):
        if force.kind == at.TWIST and force.turn >= system.n_turns:
            control.measured[k, -1] = 2.0 * np.pi
    return control


def _moves_freely(system: System, start: Start) -> bool:
    """Whether joints and drives leave a rigid motion of a body open at the start."""
    if not system.scene.drives or system.n_velocities > FEW:
        return True
    rigid = np.ones(system.n_velocities, bool)
    for row in system.arrays.body:
        rigid[row[at.VEL] + row[at.RD] : row[at.VEL] + row[at.NV]] = False
    work = new_work(system)
    work.clock[0] = 0.5 * (system.scene.time.start + system.breaks[0])
    evaluate(system, work, system.scene.time.start, start.z, start.v)
    C = of_length_one(dense_jacobian(system, work.C)[:, rigid])
    return int(np.linalg.matrix_rank(C, tol=1e-6)) < int(rigid.sum())


def _control(
    system: System, times: int, shares: int, starts: int
) -> Callable[[], stepping.Control]:
    """Makes controls of so many output times, shares and starts of features."""
    n, m, bodies = system.n_positions, system.n_velocities, len(system.bodies)
    forces, scaled = len(system.forces), n - system.n_turns
    return stepping.Control.maker(
        z=(n,),
        v=(m,),
        start=(n,),
        extent=(bodies,),
        elastic=(bodies,),
        coming=(bodies, 4),
        amplitude=system.lasting(coordinate_amplitudes),
        frequency=_frequencies(system),
        pace=(m,),
        scale_z=(scaled,),
        scale_v=(m,),
        closed=(system.n_rows + len(system.rubbing), 2),
        times=(times,),
        shares=(shares,),
        moments=(shares,),
        out_z=(times + shares, n),
        out_v=(times + shares, m),
        features=(2 * forces + 2,),
        starts=(starts,),
        reaches=(starts,),
        corners=(starts,),
        measured=(forces, 5),
        passed=(2 * forces, 2),
        crossed=(bifurcations.MOST, bifurcations.STATES + 2 * (n + m)),
    )


def _frequencies(system: System) -> Array:
    """Of elastic coordinates [rad/s], and 1 of others, (n velocities,)."""
    found = np.ones(system.n_velocities)
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        elastic = slice(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
        found[elastic] = frequencies(data.sid)
    return found


def _features(system: System) -> tuple[IntTable, Array, Array, Array]:
    """`Control.features`, starts, lengths and corners."""
    laws = [force.law for force in system.forces]
    parts = [features.together(list(system.features.values()))]
    parts += [axis for law in laws for axis in (law.features(), law.rate_features())]
    ends = np.cumsum([0, *(len(part.starts) for part in parts)])
    starts, lengths = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("starts", "lengths")
    )
    corners = np.concatenate([np.isin(part.starts, part.corners) for part in parts])
    return ends.astype(np.int64), starts, lengths, corners.astype(float)


def share_followed(settings: Settings) -> float:
    """The part of a piece that a step may go: a method of low order needs more steps
    for what a polynomial of high degree follows."""
    return min(1.0, INTEGRATORS[settings.integrator].order / features.DEGREE)
