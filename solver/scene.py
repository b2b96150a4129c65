"""A compiled scene: bodies, markers, constraints and drives as flat tables.

Compiling keeps only what the scene needs: a frame whose motion is prescribed has no
coordinates, a planar body has three, a point mass does not rotate, and terms of the
SID that are zero are not evaluated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from formats.errors import InputError
from formats.scene import (
    Coupling,
    Gear,
    Joint,
    SceneFile,
    as_3d,
    driven_coordinate,
    marker_names,
    marker_reference,
    parse_output,
    watched,
)
from formats.sid import SID, Array

from . import bodies as packing
from .bodies import BodyData, body_data
from .callables import Derivatives
from .couplings import coupling_terms
from .forces import Element, compile_forces, force_table
from .functions import FunctionTable
from .joints import (
    Primitive,
    joint_parts,
    marker_coordinate,
    marker_rotation,
    planar_axis,
    spatial_axis,
)
from .kernels import layout as at
from .kernels.layout import IntTable
from .newton_rows import newton_rows
from .ordering import reverse_cuthill_mckee
from .pool import Pool
from .sizes import diameter

GROUND_NAME = "ground"
#: Energies that need the forces of all joints and drives.
_OF_ALL_JOINTS = ("supplied", "balance")
_PRESCRIBED = {"fixed": at.FIXED, "revolute": at.REVOLUTE, "prismatic": at.PRISMATIC}


@dataclass(frozen=True)
class Row:
    """Where the rows of one joint or drive stand among the constraints."""

    name: str
    first: int
    count: int


@dataclass(frozen=True, eq=False)
class System:
    """A scene, ready to be integrated. Immutable; work arrays are made per run.

    Attributes
    ----------
    scene : the scene file
    arrays : what kernels read
    bodies : bodies in the order of the tables, the ground first
    markers : (body, marker) to row of the marker table
    rows : constraint rows of each joint and drive
    eliminated : joints and drives that became prescribed frames
    breaks : times at which a drive or a force is not smooth, then the end
    causes : drives and forces by the times at which they break
    length : size of the mechanism [m]
    forces : rows of the force table
    from_start : (entry of the pool, constraint row) of constants that the assembled
        start decides
    redundant : constraint rows that follow from the others
    """

    scene: SceneFile
    arrays: at.System
    bodies: tuple[BodyData, ...]
    markers: Mapping[tuple[str, str], int]
    rows: tuple[Row, ...]
    eliminated: Mapping[str, str]
    breaks: tuple[float, ...]
    causes: Mapping[float, tuple[str, ...]]
    length: float
    forces: tuple[Element, ...] = field(default=())
    from_start: tuple[tuple[int, int], ...] = field(default=())
    redundant: tuple[int, ...] = field(default=())

    @property
    def planar(self) -> bool:
        return self.scene.dimension == "planar"

    @property
    def n_positions(self) -> int:
        return int(self.arrays.dims[at.N_POS])

    @property
    def n_velocities(self) -> int:
        return int(self.arrays.dims[at.N_VEL])

    @property
    def n_rows(self) -> int:
        return int(self.arrays.dims[at.N_ROWS])

    @property
    def n_newton_rows(self) -> int:
        """Constraints and forces, see `newton_rows`."""
        return int(self.arrays.newton.dims[at.N_ROWS])

    def index(self, body: str) -> int:
        """Row of a body in the tables."""
        return next(i for i, b in enumerate(self.bodies) if b.name == body)


@dataclass(frozen=True)
class _Constraint:
    owner: str
    primitive: Primitive
    a: tuple[str, str]
    b: tuple[str, str]
    drive: int = -1
    continues: bool = False  # another term of the row before


@dataclass(frozen=True)
class _Frame:
    """How a prescribed frame hangs on its base."""

    joint: Joint
    base: tuple[str, str]
    tip: tuple[str, str]
    drive: str | None


def build_system(
    scene: SceneFile,
    folder: Path,
    sids: Mapping[str, SID] | None = None,
    drives: Mapping[str, Derivatives] | None = None,
    keep_joints: bool = False,
    forces: Mapping[str, Derivatives] | None = None,
) -> System:
    """Flat tables of a scene, before its initial conditions are looked at.

    drives, forces : callables that replace functions of time, by name
    keep_joints : joints stay constraints even where they prescribe a frame

    Raises
    ------
    InputError : a SID cannot be read, or a marker does not exist.
    """
    programs = dict(drives or {}), dict(forces or {})
    return _Builder(scene, folder, dict(sids or {}), *programs, keep_joints).build()


class _Builder:
    """Collects the tables of one scene; used once."""

    def __init__(
        self,
        scene: SceneFile,
        folder: Path,
        sids: dict[str, SID],
        drives: dict[str, Derivatives],
        forces: dict[str, Derivatives],
        keep_joints: bool,
    ) -> None:
        self.scene, self.keep_joints = scene, keep_joints
        self.planar = scene.dimension == "planar"
        self.pool = Pool()
        self.data = {
            name: body_data(name, body, folder, sids, self.planar)
            for name, body in scene.bodies.items()
        }
        self.data[GROUND_NAME] = _ground(scene)
        self.driven = _driven_coordinates(scene)
        self.functions = FunctionTable(self.pool, (scene.time.start, scene.time.end))
        self.drive_index = self._drive_functions(drives)
        self.forces = compile_forces(scene, self.functions, self.planar, forces)
        self.frames = self._prescribed_frames()
        self.order = self._body_order()

    def build(self) -> System:
        constraints = self._constraints()
        markers = self._markers(constraints)
        body = self._body_table()
        marker, phi = self._marker_table(markers)
        for name, frame in self.frames.items():
            row = self.order.index(name)
            body[row, at.BASE] = markers[frame.base]
            body[row, at.TIP] = markers[frame.tip]
        table, segment, rows, bandwidth = self._constraint_tables(
            constraints, markers, body, marker
        )
        dims = np.zeros(at.N_DIMS, np.int64)
        dims[at.PLANAR] = int(self.planar)
        dims[at.N_POS] = body[:, at.NP].sum()
        dims[at.N_VEL] = body[:, at.NV].sum()
        dims[at.N_ROWS] = sum(row.count for row in rows)
        dims[at.BANDWIDTH] = bandwidth
        dims[at.N_PHI] = phi
        dims[at.N_ENTRIES] = body[segment[:, at.S_BODY], at.NV].sum()
        force = force_table(self.forces, markers, self.pool)
        rows_of_newton = newton_rows(body, marker, segment, dims, force)
        arrays = at.System(
            body,
            marker,
            table,
            segment,
            self.functions.table(),
            dims,
            self.pool.array(),
            as_3d(self.scene.gravity),
            np.zeros(int(dims[at.N_ROWS])),
            force,
            None,
        )
        newton = arrays.replaced(**rows_of_newton._asdict())
        return System(
            scene=self.scene,
            arrays=arrays.replaced(newton=newton),
            bodies=tuple(self.data[name] for name in self.order),
            markers=markers,
            rows=rows,
            eliminated=self._eliminated(),
            breaks=self.functions.breaks(),
            causes=self.functions.causes(),
            length=self._length(markers),
            forces=self.forces,
            from_start=_from_start(constraints, table),
        )

    def _drive_functions(self, programs: dict[str, Derivatives]) -> dict[str, int]:
        """Row of the function of each drive."""
        for name in programs:
            if name not in self.scene.drives:
                raise InputError(
                    f"there is no drive {name!r} for a callable",
                    place="drives",
                    expected=", ".join(self.scene.drives) or "a drive in the scene",
                )
        return {
            name: self.functions.add(
                drive.function, f"drives.{name}.function", programs.get(name), True
            )
            for name, drive in self.scene.drives.items()
        }

    # --- what can be left out -----------------------------------------------------

    def _prescribed_frames(self) -> dict[str, _Frame]:
        """Bodies whose frame follows from the ground by fixed and driven joints."""
        known = {GROUND_NAME}
        frames: dict[str, _Frame] = {}
        outputs = [parse_output(text) for text in watched(self.scene)]
        wanted = {output.owner for output in outputs}
        if self.keep_joints or any(o.quantity in _OF_ALL_JOINTS for o in outputs):
            return frames
        grown = True
        while grown:
            grown = False
            for name, joint in self.scene.joints.items():
                if joint.type not in _PRESCRIBED:
                    continue
                a, b = (marker_reference(text) for text in marker_names(joint))
                drive = next(iter(self.driven[name].values()), None)
                kept = name in wanted or drive in wanted
                if kept or a[0] not in known or b[0] in known:
                    continue
                if self._carries_frame(joint, b, drive):
                    frames[b[0]] = _Frame(joint, a, b, drive)
                    known.add(b[0])
                    grown = True
        return frames

    def _carries_frame(
        self, joint: Joint, tip: tuple[str, str], drive: str | None
    ) -> bool:
        if joint.type != "fixed" and drive is None:
            return False
        node = self.data[tip[0]].node(tip[1])
        parts = (node.phi.m0, node.phi.m1, node.psi.m0, node.psi.m1)
        return not any(part is not None and part.any() for part in parts)

    def _eliminated(self) -> dict[str, str]:
        gone = {}
        for name, joint in self.scene.joints.items():
            for body, frame in self.frames.items():
                if frame.joint is joint:
                    gone[name] = body
                    if frame.drive is not None:
                        gone[frame.drive] = body
        return gone

    def _body_order(self) -> list[str]:
        """The ground, then prescribed frames after their bases, then the others."""
        others = [name for name in self.scene.bodies if name not in self.frames]
        return [GROUND_NAME, *self.frames, *others]

    # --- tables --------------------------------------------------------------------

    def _body_table(self) -> IntTable:
        table = np.zeros((len(self.order), at.N_BODY), np.int64)
        position = velocity = block = 0
        for i, name in enumerate(self.order):
            data = self.data[name]
            nq, row = data.sid.nq, table[i]
            rigid, turns = self._rigid_coordinates(name, data)
            row[at.NQ], row[at.RD] = nq, rigid
            row[at.NV], row[at.NP] = rigid + nq, rigid + nq + turns
            row[at.POS], row[at.VEL], row[at.BLOCK] = position, velocity, block
            row[at.FLAGS] = packing.flags(data.sid, data.quadratic_inertia)
            row[at.DATA] = self.pool.add(self._pack(data))
            row[at.FRAME], row[at.MOTION] = self._frame_data(name)
            row[at.DRIVE] = self._frame_drive(name)
            position += row[at.NP]
            velocity += row[at.NV]
            block += row[at.NV] ** 2
        return table

    def _pack(self, data: BodyData) -> Array:
        if self.planar:
            return packing.pack_planar(data)
        return packing.pack_spatial(data)

    def _rigid_coordinates(self, name: str, data: BodyData) -> tuple[int, int]:
        """Rigid velocity coordinates, and how many position coordinates come on top."""
        if name == GROUND_NAME or name in self.frames:
            return 0, 0
        if self.planar:
            return (3, 0) if data.rotates else (2, 0)
        return (6, 1) if data.rotates else (3, 0)

    def _frame_data(self, name: str) -> tuple[int, int]:
        if name == GROUND_NAME:
            return 0, at.GROUND
        frame = self.frames.get(name)
        if frame is None:
            return self.pool.add(self._orientation(name)), at.FREE
        return self.pool.add(self._slide(frame.joint)), _PRESCRIBED[frame.joint.type]

    def _orientation(self, name: str) -> Array:
        from formats.scene import rotation

        matrix = rotation(self.scene.bodies[name].initial)
        if self.planar:
            return np.array([np.arctan2(matrix[1, 0], matrix[0, 0])])
        return packing.quaternion(matrix)

    def _slide(self, joint: Joint) -> Array:
        """Direction of a prescribed joint in its base marker."""
        if not self.planar:
            return spatial_axis(joint)
        return np.array([planar_axis(joint)])

    def _frame_drive(self, name: str) -> int:
        frame = self.frames.get(name)
        if frame is None or frame.drive is None:
            return -1
        return self.drive_index[frame.drive]

    def _constraints(self) -> list[_Constraint]:
        carried = [frame.joint for frame in self.frames.values()]
        found = []
        for name, joint in self.scene.joints.items():
            if isinstance(joint, Gear | Coupling):
                found += self._coupling(name, joint)
            elif not any(joint is other for other in carried):
                found += self._joint(name, joint)
        for name, drive in self.scene.drives.items():
            if drive.marker is None:
                continue
            a, b = marker_reference(drive.reference), marker_reference(drive.marker)
            if drive.axis is not None:
                fixed, part = marker_rotation(drive.axis)
                found += [_Constraint(name, other, a, b) for other in fixed]
            else:
                part = marker_coordinate(drive.coordinate or "", self.planar)
            found.append(_Constraint(name, part, a, b, self.drive_index[name]))
        return found

    def _joint(self, name: str, joint: Joint) -> list[_Constraint]:
        a, b = (marker_reference(text) for text in marker_names(joint))
        parts, drives = joint_parts(joint, self.planar), self.driven[name]
        found = [_Constraint(name, part, a, b) for part in parts.constraints]
        if "length" in drives:
            found = []
        for coordinate, drive in drives.items():
            part = parts.coordinates[coordinate]
            first, second = (b, a) if part.swapped else (a, b)
            index = self.drive_index[drive]
            found.append(_Constraint(drive, part, first, second, index))
        return found

    def _coupling(self, name: str, joint: Gear | Coupling) -> list[_Constraint]:
        found: list[_Constraint] = []
        for other, part in coupling_terms(name, joint, self.scene.joints, self.planar):
            texts = marker_names(self.scene.joints[other])
            a, b = (marker_reference(text) for text in texts)
            first, second = (b, a) if part.swapped else (a, b)
            found.append(_Constraint(name, part, first, second, continues=bool(found)))
        return found

    def _markers(self, constraints: list[_Constraint]) -> dict[tuple[str, str], int]:
        """Only markers that something uses, sorted by body."""
        used = {reference for c in constraints for reference in (c.a, c.b)}
        used |= {
            reference for f in self.frames.values() for reference in (f.base, f.tip)
        }
        for force in self.forces:
            used |= {m for m in (force.a, force.b) if m is not None}
        for text in watched(self.scene):
            name = parse_output(text)
            if name.marker:
                used.add((name.owner, name.marker))
        for body, marker in used:
            self.data[body].node(marker)
        ranked = sorted(used, key=lambda ref: (self.order.index(ref[0]), ref[1]))
        return {reference: i for i, reference in enumerate(ranked)}

    def _marker_table(
        self, markers: dict[tuple[str, str], int]
    ) -> tuple[IntTable, int]:
        forces, moments = slice(3), slice(3)
        if self.planar:
            forces, moments = slice(2), slice(2, 3)
        table = np.zeros((len(markers), at.N_MARKER), np.int64)
        pack = (
            packing.pack_planar_marker if self.planar else packing.pack_spatial_marker
        )
        phi = 0
        for (body, marker), i in markers.items():
            node = self.data[body].node(marker)
            table[i, at.M_BODY] = self.order.index(body)
            table[i, at.M_DATA] = self.pool.add(pack(node))
            table[i, at.M_PHI] = phi
            for column, shapes, rows in (
                (at.M_PHI1, node.phi, forces),
                (at.M_PSI1, node.psi, moments),
            ):
                term = packing.pack_stiffening(shapes, rows)
                table[i, column] = self.pool.add(term) if len(term) else -1
            phi += packing.shape_functions(node, self.planar).size
        return table, phi

    def _constraint_tables(
        self,
        constraints: list[_Constraint],
        markers: dict[tuple[str, str], int],
        body: IntTable,
        marker: IntTable,
    ) -> tuple[IntTable, IntTable, tuple[Row, ...], int]:
        point = 2 if self.planar else 3
        counts = [
            point if c.primitive.kind == at.COINCIDENT else 1 for c in constraints
        ]
        ends = [(markers[c.a], markers[c.b]) for c in constraints]
        owners = [tuple(int(marker[m, at.M_BODY]) for m in pair) for pair in ends]
        groups = _groups(constraints)
        order, bandwidth = reverse_cuthill_mckee(
            [tuple(b for i in group for b in owners[i]) for group in groups],
            [counts[group[0]] for group in groups],
            body[:, at.NV],
        )
        table = np.zeros((len(constraints), at.N_CONSTRAINT), np.int64)
        first: dict[int, int] = {}
        row = 0
        for g in order:
            first |= dict.fromkeys(groups[g], row)
            row += counts[groups[g][0]]
        for i, c in enumerate(constraints):
            table[i, at.KIND] = c.primitive.kind
            table[i, at.ROW] = first[i]
            table[i, [at.MARKER_A, at.MARKER_B]] = ends[i]
            table[i, at.C_DATA] = self.pool.add(c.primitive.data)
            table[i, at.C_DRIVE] = c.drive
        segment = _segments(table, counts, owners, body)
        return table, segment, _rows(constraints, first, counts), bandwidth

    def _length(self, markers: dict[tuple[str, str], int]) -> float:
        """Largest distance in a body, or between places of bodies and of the ground.

        A body alone that has no extent is measured by how far it flies.
        """
        sizes = []
        places = [
            self.data[GROUND_NAME].node(name).position
            for body, name in markers
            if body == GROUND_NAME
        ]
        for name, body in self.scene.bodies.items():
            sid = self.data[name].sid
            points = [node.position for node in sid.nodes]
            points += [np.zeros(3), sid.mdCM.m0[:, 0] / (sid.mass or 1.0)]
            sizes.append(diameter(np.array(points)))
            places.append(as_3d(body.initial.position))
        sizes.append(diameter(np.array(places)))
        return max(sizes) or self._travel() or 1.0

    def _travel(self) -> float:
        """How far initial velocities and gravity carry a body at most."""
        time, bodies = self.scene.time, self.scene.bodies.values()
        speeds = [np.linalg.norm(as_3d(body.initial.velocity)) for body in bodies]
        fall = 0.5 * np.linalg.norm(as_3d(self.scene.gravity))
        duration = time.end - time.start
        return float(duration * (max(speeds) + duration * fall))


def _ground(scene: SceneFile) -> BodyData:
    from formats.scene import position_3d, rotation
    from formats.sid import rigid_node, rigid_sid

    nodes = [rigid_node("", np.zeros(3))]
    for name, placement in scene.ground.markers.items():
        nodes.append(rigid_node(name, position_3d(placement), rotation(placement)))
    sid = rigid_sid(0.0, np.zeros(3), np.zeros((3, 3)), tuple(nodes))
    return BodyData(GROUND_NAME, sid, False, False, {})


def _segments(
    table: IntTable, counts: list[int], owners: list[tuple[int, ...]], body: IntTable
) -> IntTable:
    """Entries of the constraint Jacobian by body; fills the references to them."""
    found = []
    for i, pair in enumerate(owners):
        for side, b in enumerate(pair):
            column = (at.SEG_A, at.SEG_B)[side]
            table[i, column] = -1
            if body[b, at.NV] > 0:
                found += [(b, i, column, k) for k in range(counts[i])]
    found.sort()
    segment = np.zeros((len(found), at.N_SEGMENT), np.int64)
    offset = 0
    for s, (b, i, column, k) in enumerate(found):
        segment[s] = table[i, at.ROW] + k, b, offset
        offset += body[b, at.NV]
        if k == 0:
            table[i, column] = s
    owner = segment[:, at.S_BODY]
    for b in range(len(body)):
        body[b, at.SEG0] = np.searchsorted(owner, b)
        body[b, at.SEG1] = np.searchsorted(owner, b, side="right")
    return segment


def _rows(
    constraints: list[_Constraint], first: dict[int, int], counts: list[int]
) -> tuple[Row, ...]:
    return tuple(
        Row(c.owner, first[i], counts[i])
        for i, c in enumerate(constraints)
        if not c.continues
    )


def _driven_coordinates(scene: SceneFile) -> dict[str, dict[str, str]]:
    """Drive of each driven coordinate, for all joints."""
    found: dict[str, dict[str, str]] = {name: {} for name in scene.joints}
    for name, drive in scene.drives.items():
        if drive.joint is not None:
            found[drive.joint][driven_coordinate(drive, scene.joints)] = name
    return found


def _groups(constraints: list[_Constraint]) -> list[list[int]]:
    """Constraints that share their rows."""
    groups: list[list[int]] = []
    for i, constraint in enumerate(constraints):
        if constraint.continues:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _from_start(
    constraints: list[_Constraint], table: IntTable
) -> tuple[tuple[int, int], ...]:
    return tuple(
        (int(row[at.C_DATA]) + c.primitive.from_start, int(row[at.ROW]))
        for c, row in zip(constraints, table, strict=True)
        if c.primitive.from_start >= 0
    )
