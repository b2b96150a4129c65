"""Forces, energies and momenta evaluated at recorded states."""

from collections.abc import Container, Iterable
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import MOMENTA, SCENE_QUANTITIES, SceneFile, parse_output

from ..compiler.records import RowsType
from ..dynamics import output_quantities as kernels
from ..integrators.output_sampling import OUTPUT_FRICTION
from ..spatial import system_arrays as at
from ..spatial.dimension import BODY_OUTPUT, FORCE_OUTPUT, WRENCH
from ..spatial.system_arrays import WorkArrays
from ..system.rotations import to_3d
from ..system.system import RecordRows, System
from ..system.work_arrays import new_work_arrays
from .samples import Samples


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
