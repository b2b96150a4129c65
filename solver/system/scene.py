"""A compiled scene: bodies, markers, constraints and drives as flat tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID, Array

from ..functions.features import Features
from ..functions.native import Native
from ..space import layout as at
from ..space.spaces import FRAMES, PLANE, POINTS, SPACE
from .bodies.data import BodyData
from .forces.elements import Element
from .forces.friction import Rubbing
from .forces.grips import Grips
from .turns import Coordinate, Turn

#: Rows with names.
Rows = NDArray[np.void]
GROUND_NAME = "ground"
NO_FORCES = np.zeros((0, at.N_FORCE), np.int64)

T = TypeVar("T")


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
    coordinates : of joints, what measures those that outputs and events look at
    measures : the rows of the table of forces that they would be
    turns : rows of the table of rotations in space
    rubbing : joints with friction, rows of the friction table
    grips : how they moved so far in a run
    from_start : (entry of the pool, constraint row) of constants that the assembled
        start decides
    led : rows of the table of forces that have the laws of drives, by these
    redundant : constraint rows that follow from the others
    features : of functions of time, which no step may pass unseen, by drives and
        forces
    dropped : constraint rows that are left out, since they follow from the others but
        for the rounding of data
    strict : table of all constraints, where some are left out
    seen : by the drives and forces that a program gives, the duration of the shortest
        feature that is surely seen [s]
    carrying : of a scene with all of its joints, the body table in which frames that
        they prescribe have no coordinates
    whole : of a scene that was cut down, the one with all joints, if their forces are
        asked for
    told : what has to be known of how it was made
    sids : as they were read, of the bodies that have one
    source : the scene file as it was given, before what is added for tables
    every_joint : makes the same scene with all of its joints, where some are left out
    unsampled : makes the same scene with laws that act all the time, where some are
        sampled
    integrated : makes the same scene with drives of constant rate or acceleration as
        functions of time, where there are some
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
    coordinates: Mapping[Coordinate, Element] = field(default_factory=dict)
    measures: at.IntTable = field(default_factory=lambda: NO_FORCES)
    turns: tuple[Turn, ...] = field(default=())
    rubbing: tuple[Rubbing, ...] = field(default=())
    grips: Grips | None = None
    from_start: tuple[tuple[int, int], ...] = field(default=())
    led: Mapping[str, int] = field(default_factory=dict)
    redundant: tuple[int, ...] = field(default=())
    features: Mapping[str, Features] = field(default_factory=dict)
    dropped: tuple[int, ...] = field(default=())
    strict: at.IntTable | None = None
    seen: Mapping[str, float] = field(default_factory=dict)
    carrying: at.IntTable | None = None
    whole: System | None = None
    told: tuple[str, ...] = ()
    sids: Mapping[str, SID] = field(default_factory=dict)
    source: SceneFile | None = None
    every_joint: Callable[[], System] | None = None
    unsampled: Callable[[], System] | None = None
    integrated: Callable[[], System] | None = None

    def once(self, find: Callable[[System], T]) -> T:
        """What a function finds of this system, which is looked for once."""
        known: dict[Callable[[System], T], T] = self.__dict__.setdefault("_known", {})
        if find not in known:
            known[find] = find(self)
        return known[find]

    def lasting(self, find: Callable[..., T], *more: Any) -> T:
        """What a function finds of names, integer tables and SIDs of flexible bodies,
        whatever the numbers are: looked for once, with all systems of `with_numbers`.
        """
        known: dict[Any, T] = self.__dict__.setdefault("_lasting", {})
        if (find, more) not in known:
            known[find, more] = find(self, *more)
        return known[find, more]

    def with_numbers(self, **changes: Any) -> System:
        """The system with other numbers in the same tables, as of `renumbered`."""
        made = replace(self, **changes)
        made.__dict__["_lasting"] = self.__dict__.setdefault("_lasting", {})
        return made

    @cached_property
    def complete_scene(self) -> System:
        """The scene with all of its joints as constraints, to look at what they ask."""
        return self if self.every_joint is None else self.every_joint()

    @cached_property
    def natives(self) -> tuple[Native, ...]:
        """Callables in laws."""
        laws = [e.programmed for e in self.forces if e.programmed is not None]
        return tuple(native for law in laws for native in law.natives)

    @cached_property
    def telling(self) -> at.System:
        """What outputs are told from: behind the forces the coordinates of joints."""
        if not len(self.measures):
            return self.arrays
        rows = np.concatenate([self.arrays.force, self.measures])
        return self.arrays.replaced(force=rows)

    @cached_property
    def ends(self) -> at.IntTable:
        """Markers A and B of each row of `acting`, -1 for none."""
        held, rubbing = self.arrays.constraint, self.arrays.sliding.constraint
        constraints = np.concatenate([held, rubbing])[:, [at.MARKER_A, at.MARKER_B]]
        return np.concatenate([constraints, self.arrays.force[:, [at.F_A, at.F_B]]])

    @cached_property
    def acting(self) -> dict[int, list[tuple[int, str, bool]]]:
        """What acts on each marker: its row, its name, whether it is its marker B.

        Rows of constraints, frictions of joints and forces, one behind the other; the
        names of forces begin with `forces.`, as joints may have the same.
        """
        names = {row.first: row.name for row in self.rows}
        held = self.arrays.constraint
        owners = [names[first] for first in held[:, at.ROW]]
        owners += [rub.joint for rub in self.rubbing]
        owners += [f"forces.{e.name}" if e.acts else "" for e in self.forces]
        found: dict[int, list[tuple[int, str, bool]]] = {}
        for k, (owner, markers) in enumerate(zip(owners, self.ends, strict=True)):
            for marker, is_second in zip(markers, (False, True), strict=True):
                if owner:
                    found.setdefault(int(marker), []).append((k, owner, is_second))
        return found

    @property
    def flexible(self) -> tuple[BodyData, ...]:
        """The bodies of the scene that have elastic coordinates."""
        return tuple(data for data in self.bodies if data.of_scene and data.sid.nq)

    @property
    def planar(self) -> bool:
        return self.scene.dimension == "planar"

    @property
    def space(self) -> str:
        return PLANE if self.planar else SPACE

    def frames(self, values: Array) -> Rows:
        """Rows of Work.frame with names, see `space.spaces.FRAMES`."""
        return FRAMES[self.space].record.named(values)

    def points(self, values: Array) -> Rows:
        """Rows of Work.point with names, see `space.spaces.POINTS`."""
        return POINTS[self.space].record.named(values)

    @property
    def n_positions(self) -> int:
        """Entries of z_I: coordinates of bodies, then counted rotations."""
        return self.arrays.n_pos

    @property
    def n_turns(self) -> int:
        return self.arrays.n_turns

    @property
    def n_velocities(self) -> int:
        return self.arrays.n_vel

    @property
    def n_rows(self) -> int:
        return self.arrays.n_rows

    @property
    def n_newton_rows(self) -> int:
        """Constraints and forces, see `newton_rows`."""
        return self.arrays.newton.n_rows

    def clocks(self, times: Array) -> Array:
        """The middle of the smooth interval that each time lies in, (nt,) [s]."""
        edges = np.array([self.scene.time.start, *self.breaks])
        part = np.clip(np.searchsorted(edges, times) - 1, 0, len(edges) - 2)
        return np.asarray(0.5 * (edges[part] + edges[part + 1]))

    def with_states(self, values: Mapping[str, float]) -> System:
        """The system whose laws start with these states, see `laws.state_body`."""
        bodies = tuple(
            replace(data, starts_at=values.get(data.name, data.starts_at))
            for data in self.bodies
        )
        return replace(self, bodies=bodies)

    def index(self, body: str) -> int:
        """Row of a body in the tables."""
        return next(i for i, b in enumerate(self.bodies) if b.name == body)
