"""Frames, markers, accelerations and multipliers at the recorded states."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.sid import Array

from ..equations.pointers import kernels
from ..integrators import recording
from ..space import layout as at
from ..space.layout import Work
from ..start.minimum_norm import minimum_norm
from ..start.turn_counts import keep_turns
from ..system import kernel_calls
from ..system.forces.grips import Grips
from ..system.scene import System
from ..system.sizes import resting_rates
from ..system.storage import new_memory, new_work


@dataclass(frozen=True, eq=False)
class Samples:
    """States at nt times and what follows from them.

    z, v : (nt, .) states
    frames, points : (nt, bodies, .) and (nt, markers, .), as in `space.layout.Work`,
        with accelerations complete
    accelerations : (nt, .) z_II'
    multipliers : (nt, rows), see `with_smallest`
    factors : (nt, forces) functions of time and laws that scale forces
    undetermined : rows of multipliers that the motion does not determine
    friction : (nt, frictions, .) of joints with friction, see `recording.N_RUB`
    sticking : (nt, frictions) whether they stick
    """

    z: Array
    v: Array
    frames: Array
    points: Array
    accelerations: Array
    multipliers: Array
    factors: Array
    undetermined: tuple[int, ...] = ()
    friction: Array = field(default_factory=lambda: np.zeros((0, 0, recording.N_RUB)))
    sticking: Array = field(default_factory=lambda: np.zeros((0, 0), bool))


class Sampler:
    """Looks at states of a system, with kernels and storage for that.

    closed : (rows, 2) constraints are met when |c| and |dc/dt| are below
    """

    def __init__(self, system: System, closed: Array) -> None:
        self.system, self.closed = system, closed
        self.kernels = kernels(system.planar)
        self.work, self.memory = new_work(system), new_memory(system, 0)

    def sample(self, times: Array, z: Array, v: Array) -> Samples:
        """Projects every recorded state and solves eq. (3) there.

        Multipliers of redundant constraints are some that hold the mechanism.
        """
        system, work, nt = self.system, self.work, len(times)
        frames = np.zeros((nt, *work.frame.shape))
        points = np.zeros((nt, *work.point.shape))
        accelerations = np.zeros((nt, system.n_velocities))
        multipliers = np.zeros((nt, system.n_rows))
        factors = np.zeros((nt, len(system.forces)))
        friction = np.zeros((nt, len(system.rubbing), recording.N_RUB))
        sticking = np.zeros((nt, len(system.rubbing)), bool)
        edges = np.array([system.scene.time.start, *system.breaks])
        grips = system.grips or Grips(system.arrays.grip)
        with grips.parts(times) as parts:
            for part in parts:
                recording.sample(
                    self.kernels,
                    system.arrays,
                    work,
                    self.memory,
                    self.closed,
                    times[part],
                    edges,
                    z[part],
                    v[part],
                    np.zeros((1, system.n_positions)),
                    np.zeros((3, system.n_velocities)),
                    frames[part],
                    points[part],
                    accelerations[part],
                    multipliers[part],
                    factors[part],
                    friction[part],
                )
                sense, led = grips.now[:, at.SENSE], grips.now[:, at.LED]
                rests = np.abs(friction[part][:, :, recording.RUB_RATE]) <= led
                sticking[part] = np.where(led > 0.0, rests, sense == 0.0)
        kernel_calls.go_on(system)
        found = (z, v, frames, points, accelerations, multipliers, factors, ())
        return Samples(*found, friction, sticking)


def with_smallest(
    system: System, work: Work, times: Array, samples: Samples
) -> Samples:
    """The same with the smallest multipliers of redundant constraints."""
    if not system.redundant:
        return samples
    states = times, samples.z, samples.v
    found, rows = minimum_norm(system, work, *states, samples.multipliers)
    return replace(samples, multipliers=found, undetermined=rows)


def sample_known(
    system: System,
    work: Work,
    times: Array,
    z: Array,
    v: Array,
    accelerations: Array,
    multipliers: Array,
    rubbed: Array,
) -> Samples:
    """Recorded states of known accelerations, multipliers and forces of friction.

    rubbed : (nt, frictions) those forces
    """
    frames = np.zeros((len(times), *work.frame.shape))
    points = np.zeros((len(times), *work.point.shape))
    factors = np.zeros((len(times), len(system.forces)))
    friction = np.zeros((*rubbed.shape, recording.N_RUB))
    for k, (t, clock) in enumerate(zip(times, system.clocks(times), strict=True)):
        work.clock[0] = clock
        kernel_calls.evaluate(system, work, t, z[k], v[k])
        friction[k, :, recording.RUB_RATE] = work.sliding.row[:, at.C_RATE]
        kernel_calls.complete(system, work, accelerations[k])
        keep_turns(system, work, z[k])
        frames[k], points[k], factors[k] = work.frame, work.point, work.factor
    smallest, rows = minimum_norm(system, work, times, z, v, multipliers)
    friction[:, :, recording.RUB_FORCE] = rubbed
    for j, rub in enumerate(system.rubbing):
        across = np.einsum("pkr,tr->tpk", rub.weights, smallest[:, list(rub.rows)])
        loads = np.linalg.norm(across, axis=2).sum(axis=1)
        friction[:, j, recording.RUB_LOAD] = loads
    rates = friction[:, :, recording.RUB_RATE]
    rest = np.less_equal(np.abs(rates), resting_rates(system))
    found = (z, v, frames, points, accelerations, smallest, factors, rows)
    return Samples(*found, friction, rest)
