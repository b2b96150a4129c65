"""Vibration of the elastic coordinates, and the energy of each of them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.motion_kinds import motion_kinds

from ..output.energies import deformation_energies, elastic_coordinates
from ..output.samples import Samples
from ..spatial import system_arrays as at
from ..system.body_data import BodyData
from ..system.system import System

#: Runs of fewer steps or rows are not spoken of.
_MIN_STEPS, _MIN_ROWS = 500, 20
#: Steps in a period of what they follow.
_MIN_STEPS_PER_PERIOD, _MAX_STEPS_PER_PERIOD = 1.5, 60.0
#: A vibration is small below this part of the mean elastic energy of all bodies, and
#: decides the steps if the next one lets them be so many times as long.
_SMALL_ENERGY, _STEP_RATIO = 1e-2, 2.0
#: Steps of a method grow with this root of the allowed error, about.
_ERROR_ORDER = 6


class Vibration(NamedTuple):
    """The motion of an elastic coordinate of a body, as a harmonic one.

    Attributes
    ----------
    body
        The body; row : the coordinate, counted from 0.
    omega
        Its angular frequency [rad/s].
    energy
        Of the vibration, meant over time [J].
    """

    body: BodyData
    row: int
    omega: float
    energy: float

    @property
    def step_demand(self) -> float:
        """How short steps have to be that follow it, in any unit."""
        amplitude = np.sqrt(self.energy) / self.omega
        return float(self.omega * amplitude ** (1.0 / _ERROR_ORDER))


class Vibrations:
    """Means over recorded rows: of the squares of elastic velocities and accelerations,
    whose ratio is the square of a frequency, and of the elastic energies."""

    def __init__(self, system: System) -> None:
        self.system, self.rows = system, 0
        flexible = [(b, d) for b, d in enumerate(system.bodies) if d.is_scene_body]
        self._bodies = {b: data for b, data in flexible if data.sid.nq}
        self._rates = {b: np.zeros((2, d.sid.nq)) for b, d in self._bodies.items()}
        self._stored = 0.0

    def add(self, samples: Samples) -> None:
        """More recorded rows."""
        sound = np.isfinite(samples.accelerations).all(axis=1)
        self.rows += int(sound.sum())
        for b, data in self._bodies.items():
            row = self.system.arrays.body[b]
            last = row[at.VEL] + row[at.NV]
            those = slice(last - row[at.NQ], last)
            for k, rates in enumerate((samples.v, samples.accelerations)):
                self._rates[b][k] += np.square(rates[sound, those]).sum(axis=0)
            q, _ = elastic_coordinates(self.system, samples, b)
            self._stored += float(deformation_energies(data.sid, q[sound]).sum())

    def diagnostics(self, steps: int, span: float) -> Iterator[Diagnostic]:
        """The coordinate that decides the steps of a run over a span [s] (N322)."""
        if steps < _MIN_STEPS or self.rows < _MIN_ROWS:
            return
        modes = sorted(self._found(), key=lambda each: -each.step_demand)
        if not modes:
            return
        fastest, others = modes[0], [each.step_demand for each in modes[1:2]]
        period = 2.0 * np.pi / fastest.omega
        # Half of the energy of a vibration is elastic, in the mean.
        elastic = 0.5 * fastest.energy
        share = elastic * self.rows / self._stored if self._stored else 1.0
        follows = (
            _MIN_STEPS_PER_PERIOD <= period * steps / span <= _MAX_STEPS_PER_PERIOD
        )
        is_single = not others or fastest.step_demand > _STEP_RATIO * others[0]
        if not (follows and is_single and share < _SMALL_ENERGY):
            return
        data, number = fastest.body, fastest.body.coordinate_numbers[fastest.row]
        kind = motion_kinds(data.sid)[fastest.row]
        yield diagnose(
            "N322",
            data.name,
            number=number,
            steps_per_period=period * steps / span,
            kind=kind,
            frequency=1.0 / period,
            energy=fastest.energy,
            share=share,
        )

    def _found(self) -> Iterator[Vibration]:
        for b, (velocity, change) in self._rates.items():
            data = self._bodies[b]
            masses = np.diag(data.sid.Me.m0)
            for k in np.flatnonzero((velocity > 0.0) & (change > 0.0)):
                omega = float(np.sqrt(change[k] / velocity[k]))
                energy = float(masses[k] * velocity[k] / self.rows)
                yield Vibration(data, int(k), omega, energy)


class EnergyShares:
    """Parts of the elastic energy by coordinates, meant over the time so far.

    Between two states they go from one value to the other in a straight line.
    Coordinates count relative to the largest one so far, whose square may be no number.
    """

    def __init__(self, sid: SID) -> None:
        self._sid = sid
        self._sums = np.zeros(sid.nq)
        self._last: tuple[Array, Array] = np.zeros(0), np.zeros((0, sid.nq))
        self._largest = 0.0

    def add(self, times: Array, q: Array) -> None:
        """States (nt, nq) after those of the last call, in the order of time."""
        if not len(times):
            return
        self._rescale(float(np.abs(q[np.isfinite(q)]).max(initial=0.0)))
        size = self._largest or 1.0
        energies = deformation_energies(self._sid, q / size, size)
        energies = np.where(np.isfinite(energies), energies, 0.0)
        times = np.concatenate([self._last[0], times])
        energies = np.concatenate([self._last[1], energies])
        self._sums += 0.5 * np.diff(times) @ (energies[1:] + energies[:-1])
        self._last = times[-1:].copy(), energies[-1:].copy()

    def shares(self) -> Array:
        """(nq,), their sum is one; of the last state if there is no other time."""
        sums = self._sums if self._sums.any() else self._last[1].sum(axis=0)
        return np.asarray(sums / (sums.sum() or 1.0))

    def _rescale(self, largest: float) -> None:
        if largest > self._largest:
            factor = (self._largest / largest) ** 2
            self._sums, self._largest = factor * self._sums, largest
            self._last = self._last[0], factor * self._last[1]
