"""Frames, markers, accelerations and multipliers at recorded states."""

from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.base.sid import Array

from ..dynamics.equations_of_motion import kernel_pointers
from ..initial_state.given_state import store_rotations
from ..initial_state.redundant_constraints import minimum_norm_multipliers
from ..integrators import output_sampling
from ..spatial import system_arrays as at
from ..spatial.coordinates import rate
from ..spatial.system_arrays import WorkArrays
from ..system import work_arrays
from ..system.characteristic_sizes import resting_rates
from ..system.joint_friction import FrictionStateHistory
from ..system.system import System
from ..system.work_arrays import new_memory, new_work_arrays


@dataclass(frozen=True, eq=False)
class Samples:
    """States at nt times and what follows from them.

    Attributes
    ----------
    z, v : (nt, .)
        States.
    frames, points : (nt, bodies, .)
        And (nt, markers, .), as in `WorkArrays`, with accelerations complete.
    accelerations : (nt, .)
        z_II'.
    multipliers : (nt, rows)
        See `with_minimum_norm_multipliers`.
    factors : (nt, forces)
        Functions of time and laws that scale forces.
    undetermined
        Rows of multipliers that the motion does not determine.
    friction : (nt, frictions, .)
        Joints with friction, see `output_sampling.N_FRICTION_OUTPUT`.
    sticking : (nt, frictions)
        Whether they stick.
    """

    z: Array
    v: Array
    frames: Array
    points: Array
    accelerations: Array
    multipliers: Array
    factors: Array
    undetermined: tuple[int, ...] = ()
    friction: Array = field(
        default_factory=lambda: np.zeros((0, 0, output_sampling.N_FRICTION_OUTPUT))
    )
    sticking: Array = field(default_factory=lambda: np.zeros((0, 0), bool))


class StateSampler:
    """Looks at states of a system, with kernels and storage for that.

    Attributes
    ----------
    closed : (rows, 2)
        Constraints are met when |c| and |dc/dt| are below.
    """

    def __init__(self, system: System, closed: Array) -> None:
        self.system, self.closed = system, closed
        self.kernels = kernel_pointers(system.planar)
        self.work, self.memory = new_work_arrays(system), new_memory(system, 0)

    def sample(self, times: Array, z: Array, v: Array) -> Samples:
        """Project every recorded state and solve eq. (3) there.

        The multipliers of redundant constraints are one of their solutions.
        """
        system, work, nt = self.system, self.work, len(times)
        frames = np.zeros((nt, *work.frame.shape))
        points = np.zeros((nt, *work.point.shape))
        accelerations = np.zeros((nt, system.n_velocities))
        multipliers = np.zeros((nt, system.n_rows))
        factors = np.zeros((nt, len(system.forces)))
        friction = np.zeros(
            (nt, len(system.friction_joints), output_sampling.N_FRICTION_OUTPUT)
        )
        sticking = np.zeros((nt, len(system.friction_joints)), bool)
        edges = np.array([system.scene.time.start, *system.breaks])
        history = system.friction_history or FrictionStateHistory(
            system.arrays.friction_state
        )
        with history.intervals(times) as parts:
            for part in parts:
                output_sampling.sample(
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
                slip_direction, rest_rates = (
                    history.current_states[:, at.SLIP_DIRECTION],
                    history.current_states[:, at.REST_RATE],
                )
                slow = (
                    np.abs(friction[part][:, :, output_sampling.OUTPUT_RATE])
                    <= rest_rates
                )
                sticking[part] = np.where(rest_rates > 0.0, slow, slip_direction == 0.0)
        work_arrays.raise_pending(system)
        fields = (z, v, frames, points, accelerations, multipliers, factors, ())
        return Samples(*fields, friction, sticking)


def with_minimum_norm_multipliers(
    system: System, work: WorkArrays, times: Array, samples: Samples
) -> Samples:
    """The same with the smallest multipliers of redundant constraints."""
    if not system.redundant:
        return samples
    states = times, samples.z, samples.v
    multipliers, rows = minimum_norm_multipliers(
        system, work, *states, samples.multipliers
    )
    return replace(samples, multipliers=multipliers, undetermined=rows)


def sample_known_motion(
    system: System,
    work: WorkArrays,
    times: Array,
    z: Array,
    v: Array,
    accelerations: Array,
    multipliers: Array,
    friction_forces: Array,
) -> Samples:
    """Recorded states of known accelerations, multipliers and friction forces.

    Parameters
    ----------
    friction_forces : (nt, frictions)
        Those forces.
    """
    frames = np.zeros((len(times), *work.frame.shape))
    points = np.zeros((len(times), *work.point.shape))
    factors = np.zeros((len(times), len(system.forces)))
    friction = np.zeros((*friction_forces.shape, output_sampling.N_FRICTION_OUTPUT))
    for k, (t, clock) in enumerate(zip(times, system.clocks(times), strict=True)):
        work.interval_time[0] = clock
        work_arrays.evaluate(system, work, t, z[k], v[k])
        friction[k, :, output_sampling.OUTPUT_RATE] = work.friction_subsystem.row[
            :, at.C_RATE
        ]
        work_arrays.complete_accelerations(system, work, accelerations[k])
        store_rotations(system, work, z[k])
        frames[k], points[k], factors[k] = work.frame, work.point, work.force_scale
    smallest, rows = minimum_norm_multipliers(system, work, times, z, v, multipliers)
    friction[:, :, output_sampling.OUTPUT_FRICTION] = friction_forces
    for j, friction_joint in enumerate(system.friction_joints):
        contact_forces = np.einsum(
            "pkr,tr->tpk",
            friction_joint.weights,
            smallest[:, list(friction_joint.rows)],
        )
        loads = np.linalg.norm(contact_forces, axis=2).sum(axis=1)
        friction[:, j, output_sampling.OUTPUT_LOAD] = loads
    rates = friction[:, :, output_sampling.OUTPUT_RATE]
    at_rest = np.less_equal(np.abs(rates), resting_rates(system))
    fields = (z, v, frames, points, accelerations, smallest, factors, rows)
    return Samples(*fields, friction, at_rest)


def interpolate_states(
    sampler: StateSampler,
    states: tuple[Array, Array, Array],
    nodes: Array,
    forces_known: bool = True,
) -> tuple[Array, Array]:
    """Positions and velocities at other times, by cubic Hermite polynomials.

    The error of both grows with the fourth power of the distance of times, that of
    velocities with the third where forces are not known.

    Parameters
    ----------
    states
        Times (nt,), of at least two, with positions and velocities (nt, .).
    nodes
        Times between the first and the last of these.
    forces_known
        Whether the system has all forces of the motion; else accelerations are those of
        a parabola through three velocities.
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
            sampler.sample(times_, a.copy(), b.copy()).accelerations
            for times_, a, b in ((after, z[:-1], v[:-1]), (before, z[1:], v[1:]))
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
