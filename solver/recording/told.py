"""What constraints, forces and bodies do in recorded states, from their equations."""

from __future__ import annotations

from collections.abc import Container, Iterable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.scene import MOMENTA, SCENE_QUANTITIES, SceneFile, parse_output
from sidtool.formats.sid import Array

from ..compiler.records import RowsType
from ..equations import told as kernels
from ..integrators.recording import RUB_FORCE
from ..space import layout as at
from ..space.layout import Work
from ..space.spaces import MEASURED, MOVED, WRENCH
from ..system.bodies.embedded import embedded
from ..system.scene import Rows, System
from ..system.storage import new_work
from .sampling import Samples


def tells_of_bodies(scene: SceneFile) -> bool:
    """Whether outputs ask for energies or momenta of bodies."""
    names = [parse_output(text) for text in scene.outputs.record]
    owners = SCENE_QUANTITIES.keys() - {"constraint"}
    return any(name.owner in owners or name.quantity in MOMENTA for name in names)


class Told:
    """Of a system in some states; found where it is asked for, all at once.

    work : of this system, or of none yet
    """

    def __init__(
        self, system: System, samples: Samples, times: Array, work: Work | None = None
    ) -> None:
        self.system, self.samples, self.times = system, samples, times
        self._given = work

    def wrench(self, marker: int, owner: str = "") -> Array:
        """Force and torque on a marker, inertial, (nt, 6): of a joint or a drive, of a
        force by the name forces.NAME, or of all of them."""
        total = np.zeros((len(self.times), 6))
        for k, name, is_second in self.system.acting.get(marker, ()):
            if owner in ("", name):
                row = self._forces[0][:, k]
                total[:, :3] += row["force"] if is_second else -row["force"]
                total[:, 3:] += row["torque_b" if is_second else "torque_a"]
        return total

    @property
    def forces(self) -> Rows:
        """`MEASURED` of all forces, (nt, forces); nothing of what is none."""
        return self._forces[1][:, : len(self.system.forces)]

    @property
    def driven(self) -> Array:
        """Power of the forces by which drives hold their constraints, (nt,) [W].

        That of several drives is theirs together, whichever of multipliers that hold
        the mechanism they have.
        """
        return self._power(np.flatnonzero(self._is_driven))

    def power(self, names: Container[str]) -> Array:
        """What bodies are given by drives, forces and frictions of joints, (nt,) [W].

        names : as in `System.acting`; the constraint of a joint gives no power
        """
        held, giving = len(self._is_driven), set[int]()
        for rows in self.system.acting.values():
            for k, name, _ in rows:
                if name in names and (k >= held or self._is_driven[k]):
                    giving.add(k)
        return self._power(sorted(giving))

    @cached_property
    def _is_driven(self) -> NDArray[np.bool_]:
        """Which constraints a drive moves."""
        held = self.system.arrays.constraint
        return np.asarray((held[:, [at.C_DRIVE, at.C_LAW]] >= 0).any(axis=1))

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
                    total += np.einsum("ij,ij->i", force, embedded(point["v"]))
                    total += np.einsum("ij,ij->i", torque, embedded(point["w"]))
        return total

    def coordinate(self, joint: str, name: str) -> Rows:
        """`MEASURED` of a coordinate of a joint that the system measures, (nt,)."""
        k = list(self.system.coordinates).index((joint, name))
        return self._forces[1][:, len(self.system.forces) + k]

    @cached_property
    def bodies(self) -> Rows:
        """`MOVED` of all bodies, (nt, bodies); nothing of the ground."""
        system, samples = self.system, self.samples
        told = self._empty(0, 0, len(system.bodies))
        planar = system.planar
        tell = kernels.tell_bodies_in_plane if planar else kernels.tell_bodies_in_space
        tell(system.arrays, self._work, told, samples.z, samples.v, samples.frames)
        return self._rows(told.body, MOVED, len(system.bodies))

    @cached_property
    def _forces(self) -> tuple[Rows, Rows]:
        """`WRENCH` of all that acts, and `MEASURED` of all forces and coordinates."""
        system, samples = self.system, self.samples
        forces = len(system.telling.force)
        acting = len(system.arrays.constraint) + len(system.rubbing) + forces
        told = self._empty(acting, forces, 0)
        planar = system.planar
        tell = kernels.tell_forces_in_plane if planar else kernels.tell_forces_in_space
        tell(
            system.telling,
            self._work,
            told,
            self.times,
            system.clocks(self.times),
            samples.z,
            samples.points,
            samples.factors,
            samples.multipliers,
            np.ascontiguousarray(samples.friction[:, :, RUB_FORCE]),
        )
        wrenches = self._rows(told.wrench, WRENCH, acting)
        return wrenches, self._rows(told.force, MEASURED, forces)

    @cached_property
    def _work(self) -> Work:
        work = new_work(self.system) if self._given is None else self._given
        if not len(self.system.measures):
            return work
        return work.replaced(measure=np.zeros((len(self.system.telling.force), 2)))

    def _empty(self, wrenches: int, forces: int, bodies: int) -> at.Told:
        nt = len(self.times)
        return at.Told.zeros(
            wrench=(nt * wrenches, WRENCH.record.size),
            force=(nt * forces, MEASURED.record.size),
            body=(nt * bodies, MOVED.record.size),
        )

    def _rows(self, values: Array, rows: RowsType, count: int) -> Rows:
        return rows.record.named(values).reshape(len(self.times), count)
