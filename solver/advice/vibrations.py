"""Small fast vibrations that decide how many steps a run takes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sidtool.formats.kinds_of_motion import kinds_of

from ..recording.energies import deformation_energies, elastic_state
from ..recording.sampling import Samples
from ..space import layout as at
from ..system.bodies.data import BodyData
from ..system.scene import System

#: Runs of fewer steps or rows are not spoken of.
_STEPS, _ROWS = 500, 20
#: Steps in a period of what they follow.
_FEWEST, _MOST = 1.5, 60.0
#: A vibration is small below this part of the mean elastic energy of all bodies, and
#: decides the steps if the next one lets them be so many times as long.
_SMALL, _LONGER = 1e-2, 2.0
#: Steps of a method grow with this root of the allowed error, about.
_ORDER = 6


class Vibration(NamedTuple):
    """The motion of an elastic coordinate of a body, as a harmonic one.

    body : the body; row : the coordinate, counted from 0
    omega : its angular frequency [rad/s]
    energy : of the vibration, meant over time [J]
    """

    body: BodyData
    row: int
    omega: float
    energy: float

    @property
    def demand(self) -> float:
        """How short steps have to be that follow it, in any unit."""
        amplitude = np.sqrt(self.energy) / self.omega
        return float(self.omega * amplitude ** (1.0 / _ORDER))


class Vibrations:
    """Means over recorded rows: of the squares of elastic velocities and accelerations,
    whose ratio is the square of a frequency, and of the elastic energies."""

    def __init__(self, system: System) -> None:
        self.system, self.rows = system, 0
        flexible = [(b, d) for b, d in enumerate(system.bodies) if d.of_scene]
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
            q, _ = elastic_state(self.system, samples, b)
            self._stored += float(deformation_energies(data.sid, q[sound]).sum())

    def sentences(self, steps: int, span: float) -> Iterator[str]:
        """Of a run of so many steps over a span [s]."""
        if steps < _STEPS or self.rows < _ROWS:
            return
        found = sorted(self._found(), key=lambda each: -each.demand)
        if not found:
            return
        worst, others = found[0], [each.demand for each in found[1:2]]
        period = 2.0 * np.pi / worst.omega
        # Half of the energy of a vibration is elastic, in the mean.
        elastic = 0.5 * worst.energy
        share = elastic * self.rows / self._stored if self._stored else 1.0
        follows = _FEWEST <= period * steps / span <= _MOST
        alone = not others or worst.demand > _LONGER * others[0]
        if not (follows and alone and share < _SMALL):
            return
        data, number = worst.body, worst.body.numbers[worst.row]
        kind = kinds_of(data.sid)[worst.row]
        yield (
            f"most of the {steps} steps follow a small vibration: q{number} of "
            f"{data.name} ({kind}) at about {1.0 / period:.3g} Hz, "
            f"{period * steps / span:.2g} steps a period, with "
            f"{worst.energy:.1e} J, {100.0 * share:.1g} % of the elastic energy. If it "
            f"does not matter, [bodies.{data.name}.damping] lets it die out and "
            f"shape_functions without {number} leave it out; if nothing should excite "
            f"it, look where the markers of {data.name} are (`sidtool info MODEL`)"
        )

    def _found(self) -> Iterator[Vibration]:
        for b, (velocity, change) in self._rates.items():
            data = self._bodies[b]
            masses = np.diag(data.sid.Me.m0)
            for k in np.flatnonzero((velocity > 0.0) & (change > 0.0)):
                omega = float(np.sqrt(change[k] / velocity[k]))
                energy = float(masses[k] * velocity[k] / self.rows)
                yield Vibration(data, int(k), omega, energy)
