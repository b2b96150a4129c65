"""The equations of elastic coordinates in prescribed frames, as the solver has them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.scene import SidBody
from sidtool.formats.sid import Array

if TYPE_CHECKING:
    from sidtool.solver.analyses.mechanics import Mechanics
    from sidtool.solver.system.scene import System

#: Equations are linear, and constant, up to this part.
LINEAR = 1e-7
#: Damping is not negative beyond this part of what is critical.
ROUNDING = 1e-12
#: Intervals between samples of the stiffness, unless it is constant; doubled until what
#: is seen between them, at so many times, may change an energy by `CHANGE` in the run.
FEWEST, MOST, PROBES, CHANGE = 32, 1024, 12, 0.01


@dataclass(frozen=True, eq=False)
class Samples:
    """K and D (nt, n, n) at times; off: largest error seen between them [1/s]."""

    times: Array
    K: Array
    D: Array
    off: float = 0.0

    @cached_property
    def symmetric(self) -> Array:
        return np.asarray(0.5 * (self.K + np.swapaxes(self.K, 1, 2)))

    def at(self, t: Array, values: Array) -> Array:
        """Values at other times, by straight lines."""
        times = self.times
        place = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        x = ((t - times[place]) / (times[place + 1] - times[place]))[:, None, None]
        return np.asarray((1.0 - x) * values[place] + x * values[place + 1])


@dataclass(frozen=True, eq=False)
class Elastic:
    """M q'' = f(t) - D(t) q' - K(t) q of all flexible bodies of a scene.

    names : of the elastic coordinates
    columns : where those of a body are
    nodes : of markers, by body
    """

    system: System
    mechanics: Mechanics
    M: Array
    names: tuple[str, ...]
    columns: dict[str, slice]
    nodes: dict[str, dict[str, str]]

    @property
    def n(self) -> int:
        return len(self.M)

    def force(self, t: float, q: Array, v: Array) -> Array:
        """f - D v - K q."""
        mechanics = self.mechanics
        mechanics.t = t
        mechanics.work.clock[0] = float(self.system.clocks(np.array([t]))[0])
        mechanics.evaluate(q, v)
        return mechanics.force.copy()

    def accelerations(self, t: Array, q: Array, v: Array) -> Array:
        """(nt, n)"""
        forces = [self.force(*state) for state in zip(t, q, v, strict=True)]
        return np.asarray(np.linalg.solve(self.M, np.array(forces).T).T)

    def residual(self, t: Array, q: Array, v: Array, a: Array) -> Array:
        """(nt, n) f - D v - K q - M a."""
        forces = [self.force(*state) for state in zip(t, q, v, strict=True)]
        return np.array(forces) - a @ self.M

    def size_of(self, residual: Array) -> Array:
        """(nt,) in the norm of the inverse mass matrix."""
        return np.sqrt((residual * np.linalg.solve(self.M, residual.T).T).sum(axis=1))

    def start(self) -> tuple[Array, Array]:
        """q and q' where a run begins."""
        from sidtool.solver.start.assembly import assemble

        state = assemble(self.system)[1]
        return state.z, state.v

    def linear_part(self, t: float) -> tuple[Array, Array]:
        """K and D (n, n) at a time."""
        zero = np.zeros(self.n)
        rest = self.force(t, zero, zero)
        steps = 1.0 / np.sqrt(self.M.diagonal())
        K, D = np.zeros((2, self.n, self.n))
        for k, step in enumerate(steps):
            one = zero.copy()
            one[k] = step
            K[:, k] = (rest - self.force(t, one, zero)) / step
            D[:, k] = (rest - self.force(t, zero, one)) / step
        return K, D

    @cached_property
    def samples(self) -> Samples:
        """K and D over time, at two times if they do not change."""
        time = self.system.scene.time
        count = 1
        while True:
            times = np.linspace(time.start, time.end, count + 1)
            parts = [self.linear_part(t) for t in times]
            K, D = (np.array([part[k] for part in parts]) for k in (0, 1))
            off = self._off(Samples(times, K, D))
            if off * (time.end - time.start) <= CHANGE or count >= MOST:
                return Samples(times, K, D, off)
            count = max(2 * count, FEWEST)

    def _off(self, samples: Samples) -> float:
        """The largest error of interpolated stiffnesses that is seen between them."""
        times = samples.times
        probes = np.random.default_rng(1).uniform(times[0], times[-1], PROBES)
        root = np.linalg.cholesky(samples.symmetric[0])
        there = [self.linear_part(t)[0] for t in probes]
        between = samples.at(probes, samples.K)
        return max(map(self.size_of_stiffness, there - between, [root] * PROBES))

    def size_of_stiffness(self, change: Array, root: Array) -> float:
        """Of a part of K (n, n), between the norms of both energies; K of the root."""
        mass = np.linalg.cholesky(self.M)
        scaled = np.linalg.solve(mass, np.linalg.solve(root, change.T).T)
        return float(np.linalg.norm(scaled, 2))

    def growths(self, t: Array) -> Array:
        """(nt - 1,) by which the norm of the energy may grow in each interval.

        The square root of the largest growth of the stiffness, and exp of half the
        part of K that is not symmetric, or not known between samples.
        """
        samples = self.samples
        K = samples.at(t, samples.symmetric)
        ratios = np.linalg.eigvals(np.linalg.solve(K[:-1], K[1:])).real.max(axis=1)
        roots = np.linalg.cholesky(samples.symmetric)
        skew = samples.K - samples.symmetric
        sizes = list(map(self.size_of_stiffness, skew, roots))
        parts = (np.interp(times, samples.times, sizes) for times in (t[:-1], t[1:]))
        most = np.maximum(*parts) + 2.0 * samples.off
        return np.asarray(
            np.sqrt(np.maximum(ratios, 1.0)) * np.exp(most * np.diff(t) / 2)
        )

    def holds(self) -> bool:
        """Whether the equations are linear, stiff, and damped or free of damping."""
        time = self.system.scene.time
        generator = np.random.default_rng(0)
        for t in np.linspace(time.start, time.end, 4):
            K, D = self.linear_part(t)
            q, v = generator.normal(size=(2, self.n)) / np.sqrt(self.M.diagonal())
            q = q * np.sqrt(self.M.diagonal() / np.abs(K.diagonal()))
            zero = np.zeros(self.n)
            rest = self.force(t, zero, zero)
            expected = rest - K @ q - D @ v
            off = np.abs(self.force(t, q, v) - expected).max()
            mass = self.mechanics.mass
            if off > LINEAR * (np.abs(expected).max() + np.abs(rest).max()):
                return False
            if np.abs(mass - self.M).max() > LINEAR * np.abs(self.M).max():
                return False
        parts = [self.linear_part(t) for t in np.linspace(time.start, time.end, 9)]
        K, D = (np.array([part[k] for part in parts]) for k in (0, 1))
        lowest = [np.linalg.eigvalsh(0.5 * (k + k.T))[0] for k in K]
        damping = [np.linalg.eigvalsh(0.5 * (d + d.T))[0] for d in D]
        rounding = ROUNDING * np.sqrt(np.abs(K).max() * np.abs(self.M).max())
        return bool(min(lowest) > 0.0 and min(damping) >= -rounding)


def elastic_equations(system: System) -> Elastic | None:
    """Those of a scene in which joints and drives prescribe all frames; else None.

    None also where a law measures the motion, or the equations are not linear.
    """
    from sidtool.solver.analyses.mechanics import Mechanics
    from sidtool.solver.space import layout as at

    scene, time = system.scene, system.scene.time
    tables = zip(system.bodies, system.arrays.body, strict=True)
    moving = [(data, row) for data, row in tables if row[at.NV]]
    free = any(data.sid.nq != row[at.NV] for data, row in moving)
    if system.n_rows or system.n_turns or free or system.rubbing or not moving:
        return None
    if system.n_positions != system.n_velocities or any(
        e.programmed for e in system.forces
    ):
        return None
    clock = float(system.clocks(np.array([time.start]))[0])
    mechanics = Mechanics(system, time.start, clock)
    n = system.n_velocities
    mechanics.evaluate(np.zeros(n), np.zeros(n))
    names, columns, nodes = [], {}, {}
    for data, row in moving:
        columns[data.name] = slice(row[at.VEL], row[at.VEL] + data.sid.nq)
        body = scene.bodies[data.name]
        assert isinstance(body, SidBody)
        nodes[data.name] = dict(body.markers)
        names += [f"{data.name}.q{k}" for k in data.numbers]
    found = Elastic(system, mechanics, mechanics.mass, tuple(names), columns, nodes)
    return found if found.holds() else None
