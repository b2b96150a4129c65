"""Energy dissipated and supplied: powers integrated along the steps of a run.

Between the states at the ends of a step the motion is interpolated by cubic Hermite
polynomials of positions and of velocities, and the power integrated by Gauss points.
The error is of fourth order in the step, as that of the error estimate which chooses
it; the balance of energies tells its size.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from formats.scene import SceneFile, parse_output
from formats.sid import Array

from . import kernel_calls
from .energies import dissipation, supply
from .kernels import layout as at
from .kernels.coordinates import rate
from .kernels.layout import Work
from .kernels.newton import Kernels, Memory
from .sampling import sample
from .scene import System

INTEGRATED = frozenset(["dissipated", "supplied", "balance"])
#: Gauss points on [0, 1] and their weights.
GAUSS = 0.5 + 0.5 * np.polynomial.legendre.leggauss(3)[0]
WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(3)[1]


@dataclass
class History:
    """States at the ends of all steps; a break appears as two states at one time."""

    t: list[float] = field(default_factory=list)
    z: list[Array] = field(default_factory=list)
    v: list[Array] = field(default_factory=list)

    def add(self, t: float, z: Array, v: Array) -> None:
        self.t.append(t)
        self.z.append(z.copy())
        self.v.append(v.copy())


def is_wanted(scene: SceneFile) -> bool:
    """True when an output needs the powers along the run."""
    names = [parse_output(text) for text in scene.outputs.record]
    return any(n.owner == "energy" and n.quantity in INTEGRATED for n in names)


def integrated_energies(
    system: System,
    kernels: Kernels,
    work: Work,
    memory: Memory,
    history: History,
    closed: Array,
    times: Array,
) -> tuple[Array, Array]:
    """Energies dissipated and supplied until `times`, (nt,) each [J]."""
    t = np.array(history.t)
    keep = np.diff(t, prepend=-np.inf) > 0.0
    t, z, v = t[keep], np.array(history.z)[keep], np.array(history.v)[keep]
    cuts = np.union1d(t, times[(times >= t[0]) & (times <= t[-1])])
    lengths = np.diff(cuts)
    nodes = (cuts[:-1, None] + lengths[:, None] * GAUSS).ravel()
    z, v = _interpolated(system, kernels, work, memory, (t, z, v), closed, nodes)
    samples = sample(system, kernels, work, memory, nodes, z, v, closed)
    drift = _drift(system, work, nodes, z)
    powers = dissipation(system, samples), supply(system, samples, nodes, drift)
    sums = []
    for power in powers:
        parts = lengths * (power.reshape(-1, len(GAUSS)) @ WEIGHTS)
        total = np.concatenate([[0.0], np.cumsum(parts)])
        sums.append(np.interp(times, cuts, total))
    return sums[0], sums[1]


def _interpolated(
    system: System,
    kernels: Kernels,
    work: Work,
    memory: Memory,
    states: tuple[Array, Array, Array],
    closed: Array,
    nodes: Array,
) -> tuple[Array, Array]:
    """Positions and velocities at the nodes, by Hermite polynomials."""
    t, z, v = states
    k = np.clip(np.searchsorted(t, nodes) - 1, 0, len(t) - 2)
    h = t[k + 1] - t[k]
    x = ((nodes - t[k]) / h)[:, None]
    after, before = np.nextafter(t[:-1], np.inf), t[1:]
    accelerations = [
        sample(
            system, kernels, work, memory, when, a.copy(), b.copy(), closed
        ).accelerations
        for when, a, b in ((after, z[:-1], v[:-1]), (before, z[1:], v[1:]))
    ]
    ends = []
    for y, slopes in (
        (z, [_rates(system, z[:-1], v[:-1]), _rates(system, z[1:], v[1:])]),
        (v, accelerations),
    ):
        a = (1.0 + 2.0 * x) * (1.0 - x) ** 2 * y[k]
        b = x * x * (3.0 - 2.0 * x) * y[k + 1]
        c = x * (1.0 - x) ** 2 * h[:, None] * slopes[0][k]
        d = -x * x * (1.0 - x) * h[:, None] * slopes[1][k]
        ends.append(a + b + c + d)
    return ends[0], ends[1]


def _rates(system: System, z: Array, v: Array) -> Array:
    rates = np.zeros_like(z)
    for i in range(len(z)):
        rate(system.arrays, z[i], v[i], rates[i])
    return rates


def _drift(system: System, work: Work, times: Array, z: Array) -> Array:
    """What time alone changes in the constraints: their rates at zero velocity."""
    drift = np.zeros((len(times), system.n_rows))
    if not (system.arrays.constraint[:, at.C_DRIVE] >= 0).any():
        return drift
    rest = np.zeros(system.n_velocities)
    edges = np.array([system.scene.time.start, *system.breaks])
    part = np.clip(np.searchsorted(edges, times) - 1, 0, len(edges) - 2)
    for i, t in enumerate(times):
        work.clock[0] = 0.5 * (edges[part[i]] + edges[part[i] + 1])
        kernel_calls.evaluate(system, work, t, z[i], rest)
        drift[i] = work.row[:, at.C_RATE]
    return drift
