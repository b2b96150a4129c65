"""States between times at which they are known."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ..space.coordinates import rate
from ..system.scene import System
from .sampling import Sampler


def interpolated(
    sampler: Sampler,
    states: tuple[Array, Array, Array],
    nodes: Array,
    forces_known: bool = True,
) -> tuple[Array, Array]:
    """Positions and velocities at other times, by cubic Hermite polynomials.

    states : times (nt,), of at least two, with positions and velocities (nt, .)
    nodes : times between the first and the last of these
    forces_known : whether the system has all forces of the motion; else accelerations
        are those of a parabola through three velocities

    The error of both grows with the fourth power of the distance of times, that of
    velocities with the third where forces are not known.
    """
    system, (t, z, v) = sampler.system, states
    k = np.clip(np.searchsorted(t, nodes) - 1, 0, len(t) - 2)
    if 4 * len(nodes) < len(t):  # the states around the nodes are enough
        near = np.unique(np.clip(np.add.outer(k, (-1, 0, 1, 2)), 0, len(t) - 1))
        t, z, v = t[near], z[near], v[near]
        k = np.searchsorted(near, k)
    h = t[k + 1] - t[k]
    x = ((nodes - t[k]) / h)[:, None]
    after, before = np.nextafter(t[:-1], np.inf), t[1:]
    if forces_known:
        accelerations = [
            sampler.sample(when, a.copy(), b.copy()).accelerations
            for when, a, b in ((after, z[:-1], v[:-1]), (before, z[1:], v[1:]))
        ]
    else:
        slopes = np.gradient(v, t, axis=0, edge_order=2 if len(t) > 2 else 1)
        accelerations = [slopes[:-1], slopes[1:]]
    ends = []
    for y, rates in (
        (z, [_rates(system, z[:-1], v[:-1]), _rates(system, z[1:], v[1:])]),
        (v, accelerations),
    ):
        a = (1.0 + 2.0 * x) * (1.0 - x) ** 2 * y[k]
        b = x * x * (3.0 - 2.0 * x) * y[k + 1]
        c = x * (1.0 - x) ** 2 * h[:, None] * rates[0][k]
        d = -x * x * (1.0 - x) * h[:, None] * rates[1][k]
        ends.append(a + b + c + d)
    return ends[0], ends[1]


def _rates(system: System, z: Array, v: Array) -> Array:
    rates = np.zeros_like(z)
    for i in range(len(z)):
        rate(system.arrays, z[i], v[i], rates[i])
    return rates
