"""The compiled scene: bodies, markers, constraints and drives as tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.scene import SceneFile

from ..functions.callables import NativeCallable
from ..functions.piecewise import N_INPUT_TERMS, Features
from ..spatial import system_arrays as at
from ..spatial.dimension import FRAMES, PLANE, POINTS, SPACE
from .body_data import BodyData
from .force_rows import ForceRow
from .joint_friction import (
    Coordinate,
    CountedRotation,
    FrictionJoint,
    FrictionStateHistory,
)

#: Rows with names.
RecordRows = NDArray[np.void]
GROUND_NAME = "ground"
NO_FORCES = np.zeros((0, at.N_FORCE), np.int64)

T = TypeVar("T")


@dataclass(frozen=True)
class ConstraintRows:
    """Where the rows of one joint or drive stand among the constraints."""

    name: str
    first: int
    count: int


@dataclass(frozen=True, eq=False)
class System:
    """A compiled scene. Immutable; work arrays are made for each run.

    Attributes
    ----------
    scene, source
        The scene file, and the one given before anything was added to it.
    arrays
        Arrays that the kernels read.
    bodies
        Bodies in the order of the tables, the ground first.
    markers
        (body, marker) to row of the marker table.
    rows
        Constraint rows of each joint and drive.
    eliminated
        Joints and drives that became prescribed frames.
    breaks, break_causes
        Times at which a drive or a force is not smooth, then the end [s]; drives and
        forces by these times.
    length
        Size of the mechanism [m].
    forces
        Rows of the force table.
    coordinates, measures
        Measures of the joint coordinates that outputs and events use, and their rows.
    rotations
        Rows of the table of rotations in space.
    friction_joints
        Joints with friction, rows of the friction table.
    friction_history
        Their states of stick and slip so far in a run.
    set_at_start
        (index in the real data, constraint row) of constants that the assembly decides.
    drive_law_rows
        Rows of the force table with the laws of drives, by drive.
    redundant
        Constraint rows that follow from the others.
    features
        Features of the functions of time that no step may skip, by drives and forces.
    input_rows, input_continuity
        Rows of the functions of inputs, and what drives need of these, see
        `FunctionTable.required_continuity`.
    lookup_rows
        Rows of tables of formulas, which are no functions of time.
    inactive_rows
        Constraint rows that are left out, since they follow from the others except for
        rounding of the data.
    full_constraints
        Table of all constraints, where some are left out.
    shortest_features
        By drives and forces of a program: duration of the shortest feature that is
        certainly detected [s].
    prescribed_body_table
        Of a scene with all its joints: the body table in which frames that they
        prescribe have no coordinates.
    full_system
        Of a reduced scene: the one with all joints, if their forces are requested.
    diagnostics
        Of how the system was compiled.
    sids
        SIDs as they were read, by body.
    make_full_system
        Makes the scene with all of its joints, where some are eliminated.
    make_continuous
        Makes the scene with continuous laws, where some are sampled.
    make_integrated
        Makes the scene with drives of constant rate or acceleration as functions of
        time, where there are some.
    """

    scene: SceneFile
    arrays: at.SystemArrays
    bodies: tuple[BodyData, ...]
    markers: Mapping[tuple[str, str], int]
    rows: tuple[ConstraintRows, ...]
    eliminated: Mapping[str, str]
    breaks: tuple[float, ...]
    break_causes: Mapping[float, tuple[str, ...]]
    length: float
    forces: tuple[ForceRow, ...] = field(default=())
    coordinates: Mapping[Coordinate, ForceRow] = field(default_factory=dict)
    measures: at.IntTable = field(default_factory=lambda: NO_FORCES)
    rotations: tuple[CountedRotation, ...] = field(default=())
    friction_joints: tuple[FrictionJoint, ...] = field(default=())
    friction_history: FrictionStateHistory | None = None
    set_at_start: tuple[tuple[int, int], ...] = field(default=())
    drive_law_rows: Mapping[str, int] = field(default_factory=dict)
    redundant: tuple[int, ...] = field(default=())
    features: Mapping[str, Features] = field(default_factory=dict)
    input_rows: Mapping[str, int] = field(default_factory=dict)
    input_continuity: Mapping[str, int] = field(default_factory=dict)
    lookup_rows: tuple[int, ...] = ()
    inactive_rows: tuple[int, ...] = field(default=())
    full_constraints: at.IntTable | None = None
    shortest_features: Mapping[str, float] = field(default_factory=dict)
    prescribed_body_table: at.IntTable | None = None
    full_system: System | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    sids: Mapping[str, SID] = field(default_factory=dict)
    source: SceneFile | None = None
    make_full_system: Callable[[], System] | None = None
    make_continuous: Callable[[], System] | None = None
    make_integrated: Callable[[], System] | None = None

    def cached(self, find: Callable[[System], T]) -> T:
        """What a function finds of this system, which is looked for once."""
        known: dict[Callable[[System], T], T] = self.__dict__.setdefault("_known", {})
        if find not in known:
            known[find] = find(self)
        return known[find]

    def cached_by_topology(self, find: Callable[..., T], *more: Any) -> T:
        """What a function finds of names, integer tables and SIDs of flexible bodies,
        whatever the numbers are: looked for once, with all systems of
        `with_numbers`.
        """
        known: dict[Any, T] = self.__dict__.setdefault("_lasting", {})
        if (find, more) not in known:
            known[find, more] = find(self, *more)
        return known[find, more]

    def with_numbers(self, **changes: Any) -> System:
        """The system with other numbers in the same tables, as of `updated_system`."""
        changed = replace(self, **changes)
        changed.__dict__["_lasting"] = self.__dict__.setdefault("_lasting", {})
        return changed

    @cached_property
    def full_joint_system(self) -> System:
        """The scene with all of its joints as constraints, to look at what they ask."""
        return self if self.make_full_system is None else self.make_full_system()

    @cached_property
    def natives(self) -> tuple[NativeCallable, ...]:
        """Callables in laws."""
        laws = [e.control for e in self.forces if e.control is not None]
        return tuple(native for law in laws for native in law.natives)

    @cached_property
    def output_rows(self) -> at.SystemArrays:
        """What outputs are reported from: behind the forces the coordinates
        of joints.
        """
        if not len(self.measures):
            return self.arrays
        rows = np.concatenate([self.arrays.force, self.measures])
        return self.arrays.replaced(force=rows)

    @cached_property
    def ends(self) -> at.IntTable:
        """Markers A and B of each row of `acting`, -1 for none."""
        held, friction_constraints = (
            self.arrays.constraint,
            self.arrays.friction_subsystem.constraint,
        )
        constraints = np.concatenate([held, friction_constraints])[
            :, [at.MARKER_A, at.MARKER_B]
        ]
        return np.concatenate([constraints, self.arrays.force[:, [at.F_A, at.F_B]]])

    @cached_property
    def forces_by_marker(self) -> dict[int, list[tuple[int, str, bool]]]:
        """What acts on each marker: its row, its name, whether it is its marker B.

        Rows of constraints, frictions of joints and forces, one behind the other; the
        names of forces begin with `forces.`, as joints may have the same.
        """
        names = {row.first: row.name for row in self.rows}
        constraints = self.arrays.constraint
        owners = [names[first] for first in constraints[:, at.ROW]]
        owners += [rub.joint for rub in self.friction_joints]
        owners += [f"forces.{e.name}" if e.is_force else "" for e in self.forces]
        forces: dict[int, list[tuple[int, str, bool]]] = {}
        for k, (owner, markers) in enumerate(zip(owners, self.ends, strict=True)):
            for marker, is_second in zip(markers, (False, True), strict=True):
                if owner:
                    forces.setdefault(int(marker), []).append((k, owner, is_second))
        return forces

    @property
    def flexible(self) -> tuple[BodyData, ...]:
        """The bodies of the scene that have elastic coordinates."""
        return tuple(data for data in self.bodies if data.is_scene_body and data.sid.nq)

    @property
    def planar(self) -> bool:
        return self.scene.dimension == "planar"

    @property
    def space(self) -> str:
        return PLANE if self.planar else SPACE

    def frames(self, values: Array) -> RecordRows:
        """Rows of WorkArrays.frame with names, see `space.spaces.FRAMES`."""
        return FRAMES[self.space].record.as_records(values)

    def points(self, values: Array) -> RecordRows:
        """Rows of WorkArrays.point with names, see `space.spaces.POINTS`."""
        return POINTS[self.space].record.as_records(values)

    @property
    def n_positions(self) -> int:
        """Entries of z_I: coordinates of bodies, then counted rotations."""
        return self.arrays.n_positions

    @property
    def n_rotation_counters(self) -> int:
        return self.arrays.n_rotation_counters

    @property
    def n_velocities(self) -> int:
        return self.arrays.n_velocities

    @property
    def n_rows(self) -> int:
        return self.arrays.n_rows

    @property
    def n_newton_rows(self) -> int:
        """Constraints and forces, see `newton_pattern`."""
        return self.arrays.newton_subsystem.n_rows

    def input_data(self, name: str) -> slice:
        """Entries of the real data with the start of an input, and behind it the
        coefficients of its only polynomial."""
        start = int(self.arrays.drive[self.input_rows[name], at.D_DATA])
        return slice(start, start + 1 + N_INPUT_TERMS)

    def clocks(self, times: Array) -> Array:
        """The middle of the smooth interval that each time lies in, (nt,) [s]."""
        edges = np.array([self.scene.time.start, *self.breaks])
        part = np.clip(np.searchsorted(edges, times) - 1, 0, len(edges) - 2)
        return np.asarray(0.5 * (edges[part] + edges[part + 1]))

    def index(self, body: str) -> int:
        """Row of a body in the tables."""
        return self._body_rows[body]

    @cached_property
    def _body_rows(self) -> dict[str, int]:
        """Rows of the bodies by their names."""
        return {data.name: row for row, data in enumerate(self.bodies)}
