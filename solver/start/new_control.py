"""The state that a step loop begins with."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ..functions.table import features
from ..integrators import INTEGRATORS, bifurcations, stepping
from ..space import layout as at
from ..space.layout import IntTable
from ..system.bodies.vibration import amplitudes, frequencies
from ..system.scene import System
from ..system.sizes import extents, row_sizes, sliding_sizes
from .assembly import Start
from .settings import Settings

#: Constraints are met when they are open by less than this part of the size: at least
#: what rounding allows, at most what keeps the drift invisible.
CLOSED = (1e-13, 1e-11)
#: Tolerance of a step in units of the requested relative error, for methods of high
#: order: the estimate is that of a lower one. Those of order 2 share it among steps.
STEP_TOLERANCE = 0.3


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
    real, whole = np.zeros(stepping.N_REAL), np.zeros(stepping.N_WHOLE, np.int64)
    adding = INTEGRATORS[settings.integrator].order == 2 and settings.step is None
    real[stepping.TOLERANCE] = settings.rtol * (1.0 if adding else STEP_TOLERANCE)
    real[stepping.TIME] = real[stepping.BEGIN] = scene.time.start
    real[stepping.LENGTH] = system.length
    real[stepping.PERIOD] = duration
    real[stepping.RADIUS] = settings.radius
    real[stepping.SINGULAR] = np.inf
    real[stepping.LARGEST] = 0.1 * duration
    real[stepping.UNTURNED] = np.inf
    real[stepping.STEP] = 1e-4 * duration * settings.rtol**0.25
    whole[stepping.FIXED_STEP] = int(settings.step is not None)
    whole[stepping.ADDING] = int(adding)
    n, m = system.n_positions, system.n_velocities
    count = times + len(shares)
    amplitude, frequency = np.ones(m), np.ones(m)
    axes = 2 if system.planar else 3
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        elastic = slice(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
        amplitude[elastic] = amplitudes(data.sid, axes)
        frequency[elastic] = frequencies(data.sid)
    return stepping.Control(
        real,
        whole,
        start.z.copy(),
        start.v.copy(),
        start.z.copy(),
        extents(system),
        np.zeros(len(system.bodies)),
        np.zeros((len(system.bodies), 4)),
        amplitude,
        frequency,
        np.ones(m),
        np.ones(n - system.n_turns),
        np.ones(m),
        closed,
        np.full(times, np.inf),
        shares,
        np.zeros(len(shares)),
        np.zeros((count, n)),
        np.zeros((count, m)),
        *_features(system, settings),
        _measured(system),
        np.zeros((2 * len(system.forces), 2)),
        np.zeros((bifurcations.MOST, bifurcations.STATES + 2 * (n + m))),
    )


def _features(system: System, settings: Settings) -> tuple[IntTable, Array, Array]:
    """`Control.features`, starts and reaches."""
    laws = [force.law for force in system.forces]
    parts = [features.together(list(system.features.values()))]
    parts += [axis for law in laws for axis in (law.features(), law.rate_features())]
    ends = np.cumsum([0, *(len(part.starts) for part in parts)])
    starts = np.concatenate([part.starts for part in parts])
    reaches = share_followed(settings) * np.concatenate(
        [part.lengths for part in parts]
    )
    return ends.astype(np.int64), starts, reaches


def _measured(system: System) -> Array:
    """`Control.measured`, which knows no measures yet."""
    table = np.zeros((len(system.forces), 5))
    for row, force in zip(table, system.forces, strict=True):
        if force.kind == at.TWIST and force.turn >= system.n_turns:
            row[-1] = 2.0 * np.pi
    return table


def share_followed(settings: Settings) -> float:
    """The part of a piece that a step may go: a method of low order needs more steps
    for what a polynomial of high degree follows."""
    return min(1.0, INTEGRATORS[settings.integrator].order / features.DEGREE)
