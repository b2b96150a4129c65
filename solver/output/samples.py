"""Frames, markers, accelerations and multipliers at recorded states.

Forces, energies and momenta evaluated at recorded states.
"""

from collections.abc import Container, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import MOMENTA, SCENE_QUANTITIES, SceneFile, parse_output

from ..compiler.records import RowsType
from ..dynamics import output_quantities as kernels
from ..dynamics.equations_of_motion import kernel_pointers
from ..initial_state.given_state import store_rotations
from ..initial_state.redundant_constraints import minimum_norm_multipliers
from ..integrators import output_sampling
from ..integrators.output_sampling import OUTPUT_FRICTION
from ..spatial import system_arrays as at
from ..spatial.coordinates import rate
from ..spatial.dimension import BODY_OUTPUT, FORCE_OUTPUT, WRENCH
from ..spatial.system_arrays import WorkArrays
from ..system import work_arrays
from ..system.characteristic_sizes import resting_rates
from ..system.joint_friction import FrictionStateHistory
from ..system.rotated_markers import to_3d
from ..system.system import RecordRows, System
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

    def sample(self, times: Array, z: Array, v: Array, known: float = 0.0) -> Samples:
        """Project every recorded state and solve eq. (3) there.

        The multipliers of redundant constraints are one of their solutions. `known` is
        the acceleration by the largest one, as far as it is known.
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
        largest, sizes = np.full(1, known), set[float]()
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
                    np.zeros((2, system.n_rows), np.int64),
                    np.zeros(system.n_rows),
                    np.full(len(times[part]), -1.0),
                    largest,
                )
                sizes.add(float(largest[0]))
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
        if len(sizes) > 1 and np.isnan(multipliers).any():  # before the load began
            return self.sample(times, z, v, max(sizes))
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


def needs_body_quantities(scene: SceneFile) -> bool:
    """True if outputs ask for energies or momenta of bodies."""
    names = [parse_output(text) for text in scene.outputs.record]
    owners = SCENE_QUANTITIES.keys() - {"constraint"}
    return any(name.owner in owners or name.quantity in MOMENTA for name in names)


class EvaluatedForces:
    """Of a system in some states; found where it is requested, all at once.

    Attributes
    ----------
    work
        Of this system, or of none yet.
    """

    def __init__(
        self,
        system: System,
        samples: Samples,
        times: Array,
        work: WorkArrays | None = None,
    ) -> None:
        self.system, self.samples, self.times = system, samples, times
        self._given_work = work
        #: Section forces (nt, 6) by body and section, as far as they were evaluated.
        self.section_forces: dict[tuple[str, str], Array] = {}

    def wrench(self, marker: int, owner: str = "") -> Array:
        """Force and torque on a marker in inertial axes, (nt, 6).

        Of a joint or a drive, of a force by the name ``forces.NAME``, or of all of
        them.
        """
        total = np.zeros((len(self.times), 6))
        for k, name, is_second in self.system.forces_by_marker.get(marker, ()):
            if owner in ("", name):
                row = self._forces[0][:, k]
                total[:, :3] += row["force"] if is_second else -row["force"]
                total[:, 3:] += row["torque_b" if is_second else "torque_a"]
        return total

    @classmethod
    def of_arrays(
        cls, system: System, samples: Samples, wrench: Array, force: Array, body: Array
    ) -> Self:
        """Evaluated forces of known output arrays, (nt, rows, numbers) each."""
        nt = len(samples.z)
        evaluated = cls(system, samples, np.zeros(nt))
        records = [
            rows.record.as_records(values)
            for values, rows in (
                (wrench, WRENCH),
                (force, FORCE_OUTPUT),
                (body, BODY_OUTPUT),
            )
        ]
        evaluated.__dict__["_forces"] = records[0], records[1]
        evaluated.__dict__["bodies"] = records[2]
        return evaluated

    @property
    def forces(self) -> RecordRows:
        """`FORCE_OUTPUT` of all forces, (nt, forces); nothing of what is none."""
        return self._forces[1][:, : len(self.system.forces)]

    @property
    def drive_power(self) -> Array:
        """Power of the forces by which drives meet their constraints, (nt,) [W].

        The power of several drives is their sum, which does not depend on the solution
        for the multipliers of redundant constraints.
        """
        return self._power(np.flatnonzero(self._is_driven))

    def power(self, names: Container[str]) -> Array:
        """What bodies are given by drives, forces and frictions of joints, (nt,) [W].

        Parameters
        ----------
        names
            As in `System.acting`; the constraint of a joint gives no power.
        """
        n_constraints, rows_of_names = len(self._is_driven), set[int]()
        for rows in self.system.forces_by_marker.values():
            for k, name, _ in rows:
                if name in names and (k >= n_constraints or self._is_driven[k]):
                    rows_of_names.add(k)
        return self._power(sorted(rows_of_names))

    @cached_property
    def _is_driven(self) -> NDArray[np.bool_]:
        """Which constraints a drive moves."""
        constraints = self.system.arrays.constraint
        return np.asarray((constraints[:, [at.C_DRIVE, at.C_LAW]] >= 0).any(axis=1))

    def _power(self, rows: Iterable[int]) -> Array:
        """Power of rows of `System.acting`, (nt,) [W]."""
        system, total = self.system, np.zeros(len(self.times))
        for k in rows:
            row = self._forces[0][:, k]
            for marker, force, torque in zip(
                system.ends[k],
                (-row["force"], row["force"]),
                (row["torque_a"], row["torque_b"]),
                strict=True,
            ):
                if marker >= 0:
                    point = system.points(self.samples.points[:, marker])
                    total += np.einsum("ij,ij->i", force, to_3d(point["v"]))
                    total += np.einsum("ij,ij->i", torque, to_3d(point["w"]))
        return total

    def coordinate(self, joint: str, name: str) -> RecordRows:
        """`FORCE_OUTPUT` of a coordinate of a joint that the system measures, (nt,)."""
        k = list(self.system.coordinates).index((joint, name))
        return self._forces[1][:, len(self.system.forces) + k]

    @cached_property
    def bodies(self) -> RecordRows:
        """`BODY_OUTPUT` of all bodies, (nt, n_bodies); zero for the ground."""
        system, samples = self.system, self.samples
        output = new_output_arrays(system, len(self.times), forces=False)
        planar = system.planar
        kernel = (
            kernels.write_bodies_in_plane if planar else kernels.write_bodies_in_space
        )
        kernel(system.arrays, self._work, output, samples.z, samples.v, samples.frames)
        return self._as_records(output.body, BODY_OUTPUT, output_rows(system).body)

    @cached_property
    def _forces(self) -> tuple[RecordRows, RecordRows]:
        """`WRENCH` of all that acts, and `FORCE_OUTPUT` of all forces and
        coordinates.
        """
        system, samples = self.system, self.samples
        output = new_output_arrays(system, len(self.times), bodies=False)
        planar = system.planar
        kernel = (
            kernels.write_forces_in_plane if planar else kernels.write_forces_in_space
        )
        kernel(
            system.output_rows,
            self._work,
            output,
            self.times,
            system.clocks(self.times),
            samples.z,
            samples.points,
            samples.factors,
            samples.multipliers,
            np.ascontiguousarray(samples.friction[:, :, OUTPUT_FRICTION]),
        )
        count = output_rows(system)
        wrenches = self._as_records(output.wrench, WRENCH, count.wrench)
        return wrenches, self._as_records(output.force, FORCE_OUTPUT, count.force)

    @cached_property
    def _work(self) -> WorkArrays:
        work = self._given_work
        return output_work(
            self.system, new_work_arrays(self.system) if work is None else work
        )

    def _as_records(self, values: Array, rows: RowsType, count: int) -> RecordRows:
        return rows.record.as_records(values).reshape(len(self.times), count)


def output_work(system: System, work: WorkArrays) -> WorkArrays:
    """Work arrays with the measures of joint coordinates behind those of forces."""
    if not len(system.measures):
        return work
    return work.replaced(measure=np.zeros((len(system.output_rows.force), 2)))


class OutputRows(NamedTuple):
    """Rows of `OutputArrays` for one state."""

    wrench: int
    force: int
    body: int


def output_rows(system: System) -> OutputRows:
    """Rows of the output arrays of a system."""
    forces = len(system.output_rows.force)
    constraints = len(system.arrays.constraint) + len(system.friction_joints)
    return OutputRows(constraints + forces, forces, len(system.bodies))


def new_output_arrays(
    system: System, nt: int, forces: bool = True, bodies: bool = True
) -> at.OutputArrays:
    """What the kernels of `output_quantities` write, of nt states.

    Parameters
    ----------
    forces, bodies
        Whether each of the two kernels is to write.
    """
    count = output_rows(system)
    return at.OutputArrays.zeros(
        wrench=(nt * count.wrench if forces else 0, WRENCH.record.size),
        force=(nt * count.force if forces else 0, FORCE_OUTPUT.record.size),
        body=(nt * count.body if bodies else 0, BODY_OUTPUT.record.size),
    )
