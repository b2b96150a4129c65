"""Derivatives of functionals of a motion by its states: seeds of adjoint runs."""

from __future__ import annotations

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.solver.spatial.system_arrays import IntTable

from .functionals import Functional, History, Peak

#: Points and weights of a difference of fourth order.
POINTS, WEIGHTS = (-2.0, -1.0, 1.0, 2.0), (1 / 12, -8 / 12, 8 / 12, -1 / 12)
#: Coordinates that change an output by less than this part are not among its states.
NEGLIGIBLE = 1e-14
#: Times at which it is asked which coordinates an output depends on.
ASKED_TIMES = 7


def functional_seeds(
    functional: Functional, peak: Peak | None, history: History, steps: Array, nz: int
) -> Array:
    """Derivatives of a functional by the states at all points, (nt, nz + nv).

    Parameters
    ----------
    steps : (nz + nv,) of differences by the positions, without counted rotations, and
        by the velocities
    """
    states, points = history.motion.steps, history.points
    seeds = np.zeros((len(states.t), len(steps)))
    if functional.kind == "end_time":
        return seeds
    times, weights = functional.weights(history, peak)
    if times is None:
        own = _columns(functional.output, history, steps, nz)
        parts, name = (states.t, states.z, states.v), functional.output
        found = _output_derivatives(name, history, parts, steps, own, nz)
        seeds[:, own] = weights[:, None] * found
        return seeds
    times = np.clip(times, states.t[0], states.t[-1])
    rows = [points.interpolation(states.t, t) for t in times]
    z = np.array([w @ states.z[part] for part, w in rows])
    v = np.array([w @ states.v[part] for part, w in rows])
    columns = np.arange(len(steps))
    parts = times, z, v
    found = _output_derivatives(functional.output, history, parts, steps, columns, nz)
    for (part, share), weight, row in zip(rows, weights, found, strict=True):
        seeds[part] += weight * np.outer(share, row)
    return seeds


def _columns(output: str, history: History, steps: Array, nz: int) -> IntTable:
    """Coordinates that an output depends on."""
    states = history.motion.steps
    rows = np.unique(np.linspace(0, len(states.t) - 1, ASKED_TIMES).astype(int))
    parts = states.t[rows], states.z[rows], states.v[rows]
    every = np.arange(len(steps))
    found = _output_derivatives(output, history, parts, steps, every, nz)
    changes = np.abs(found * steps).max(axis=0)
    return np.flatnonzero(changes > NEGLIGIBLE * changes.max(initial=0.0))


def _output_derivatives(
    output: str,
    history: History,
    states: tuple[Array, Array, Array],
    steps: Array,
    columns: IntTable,
    nz: int,
) -> Array:
    """Derivatives of an output by some coordinates at states, (nt, columns)."""
    t, z, v = states
    found = np.zeros((len(t), len(columns)))
    for place, k in enumerate(columns):
        for point, weight in zip(POINTS, WEIGHTS, strict=True):
            moved_z, moved_v = z.copy(), v.copy()
            if k < nz:
                moved_z[:, k] += point * steps[k]
            else:
                moved_v[:, k - nz] += point * steps[k]
            values = history.motion.output(output, t, moved_z, moved_v)
            found[:, place] += weight / steps[k] * values
    return found
