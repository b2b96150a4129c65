"""Energies of a scene at recorded states, eq. (12), and powers that change their sum.

Dissipated and supplied energies are integrals of powers along the run.
"""

from functools import cached_property

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.scene import SceneFile, parse_output

from ..integrators.output_sampling import OUTPUT_FRICTION, OUTPUT_RATE
from ..spatial import system_arrays as at
from ..system.sid_packing import symmetrise
from ..system.sid_terms import cubic_energies
from ..system.system import System
from .dense_output import STEPS_PER_BATCH, StepPoints, StepStates
from .reactions import restore_eliminated_joints
from .samples import EvaluatedForces, Samples, StateSampler, interpolate_states

INTEGRATED = frozenset(["dissipated", "supplied", "balance"])


def kinetic_energy(evaluated: EvaluatedForces) -> Array:
    """Kinetic energy of all bodies, (nt,) [J]."""
    return np.asarray(evaluated.bodies["kinetic"].sum(axis=1))


def elastic_energy(evaluated: EvaluatedForces) -> Array:
    """Energy of deformation of all bodies, (nt,) [J]."""
    return np.asarray(evaluated.bodies["elastic"].sum(axis=1))


def potential_energy(evaluated: EvaluatedForces) -> Array:
    """Energy of gravity (zero at the origin) and of springs, (nt,) [J]."""
    springs = evaluated.forces["stored_energy"].sum(axis=1)
    return np.asarray(evaluated.bodies["gravity_energy"].sum(axis=1) + springs)


def dissipated_power(evaluated: EvaluatedForces) -> Array:
    """Power lost in the damping of bodies, in dampers and by friction, (nt,) [W]."""
    friction = evaluated.samples.friction
    friction_power = np.sum(
        friction[:, :, OUTPUT_FRICTION] * friction[:, :, OUTPUT_RATE], axis=1
    )
    damping_power = evaluated.bodies["dissipated_power"].sum(axis=1)
    damping_power = damping_power + evaluated.forces["dissipated_power"].sum(axis=1)
    return np.asarray(damping_power - friction_power)


def supplied_power(evaluated: EvaluatedForces) -> Array:
    """Power of drives, and of forces that are functions of time or laws, (nt,) [W]."""
    return np.asarray(
        evaluated.forces["supplied_power"].sum(axis=1) + evaluated.drive_power
    )


def deformation_energies(sid: SID, x: Array, size: float = 1.0) -> Array:
    """Energy of deformation at q = size x over size^2, by coordinates, (nt, nq) [J].

    Without the energy of the reference stress (ksigma), which is not due to
    deformation.
    """
    return 0.5 * x * (x @ symmetrise(sid.Ke.m0)) + size * cubic_energies(sid, x)


def elastic_coordinates(
    system: System, samples: Samples, b: int
) -> tuple[Array, Array]:
    """Elastic coordinates and their velocities of a body, (nt, nq)."""
    row = system.arrays.body[b]
    p, u = int(row[at.POS] + row[at.NP]), int(row[at.VEL] + row[at.NV])
    nq = int(row[at.NQ])
    return samples.z[:, p - nq : p], samples.v[:, u - nq : u]


class EnergyIntegrals:
    """Energies dissipated and supplied since the start; of the last steps in detail."""

    def __init__(
        self, sampler: StateSampler, points: StepPoints, before: Array | None = None
    ) -> None:
        """Parameters
        ----------
        before
            Both energies at the start, zero by default [J].
        """
        self._sampler, self.points = sampler, points
        self._steps: list[StepStates] = []
        self._before = np.zeros(2) if before is None else before

    def add(self, steps: StepStates) -> None:
        if len(steps.t):
            self._steps.append(steps)

    @property
    def is_long(self) -> bool:
        """True if so many steps are stored that they should be integrated now."""
        return sum(len(s.t) for s in self._steps) > STEPS_PER_BATCH * self.points.count

    def integrals_until(self, times: Array) -> tuple[Array, Array]:
        """Energies dissipated and supplied until times since the last `drop_before`,
        (nt,) each [J].
        """
        if not self._steps:
            nothing = np.zeros(len(times))
            return nothing + self._before[0], nothing + self._before[1]
        t, powers = self._powers
        lost, given = (
            before + self.points.integral(t, power, times)
            for before, power in zip(self._before, powers, strict=True)
        )
        return lost, given

    def drop_before(self) -> None:
        """Continue from the end of the steps so far."""
        if self._steps:
            self._before = np.ravel(self.integrals_until(self._steps[-1].t[-1:]))
        self._steps = []
        self.__dict__.pop("_powers", None)

    @cached_property
    def _powers(self) -> tuple[Array, list[Array]]:
        """Times of all points, and both powers there [W]."""
        t, powers = [], []
        for steps in self.points.batches(self._steps):
            samples = self._sampler.sample(steps.t, steps.z.copy(), steps.v.copy())
            full, motion = restore_eliminated_joints(
                self._sampler.system, steps.t, samples
            )
            evaluated = EvaluatedForces(full, motion, steps.t)
            powers.append((dissipated_power(evaluated), supplied_power(evaluated)))
            t.append(steps.t)
        return np.concatenate(t), [np.concatenate(p) for p in zip(*powers, strict=True)]


def is_energy_integral(output: str) -> bool:
    """True if an output is an integral of powers along the run."""
    name = parse_output(output)
    return name.owner == "energy" and name.quantity in INTEGRATED


def needs_energy_integrals(scene: SceneFile) -> bool:
    """True when an output needs the powers along the run."""
    return any(map(is_energy_integral, scene.outputs.record))


def integrals_between(
    sampler: StateSampler, times: Array, z: Array, v: Array
) -> EnergyIntegrals:
    """A history of motion that is known at some times only.

    Between them it is interpolated by cubic Hermite polynomials of positions and of
    velocities. Of fewer than two times the integrals are zero.
    """
    history = EnergyIntegrals(sampler, StepPoints(3))
    if len(times) < 2:
        return history
    lengths = np.diff(times)[:, None]
    nodes = times[:-1, None] + lengths * history.points.fractions
    nodes[:, 0], nodes[:, -1] = np.nextafter(times[:-1], np.inf), times[1:]
    nodes[:, -1] = np.nextafter(nodes[:, -1], -np.inf)
    states = interpolate_states(sampler, (times, z, v), nodes.ravel())
    history.add(StepStates(nodes.ravel(), *states))
    return history
