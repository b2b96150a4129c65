"""The result of a simulation: motion, cost and drift, with the scene that caused it.

Rows of a result in transfer: into memory, or into files while a run continues.

Events of a run and their storage in HDF5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.sid import SID
from ..diagnostics import Diagnostic, WithDiagnostics
from .accuracy_report import AccuracyReport, FlexibleBody

Array = NDArray[np.float64]
#: Names of columns by table, see `TABLES`.
Columns = Mapping[str, tuple[str, ...]]
#: Rows that are written together.
ROWS_PER_BLOCK = 4096

_TEXT_FIELDS, _ROW_FIELDS = ("name", "kind"), ("t", "values", "positions", "velocities")
Scalar = bool | int | float | str
#: the arrays of a result and where the names of their columns stand
TABLES = {
    "values": "names",
    "positions": "position_names",
    "velocities": "velocity_names",
    "multipliers": "multiplier_names",
}


@dataclass(frozen=True, eq=False)
class Rows:
    """Some output times (nt,) [s] and the rows of each of `TABLES` there, (nt, n)."""

    t: Array
    tables: Mapping[str, Array]


class Sink(Protocol):
    """Protocol: takes the rows of one run, in the order of time."""

    def begin(self, columns: Columns, most: int) -> None:
        """Take the names of all columns, and the largest number of rows."""

    def add(self, rows: Rows) -> None:
        """Takes more rows; their arrays are used again."""

    def finish(self, result: Result) -> None:
        """Take everything else; the tables of this result are empty."""


class InMemory:
    """Stores the rows of a run as arrays."""

    def begin(self, columns: Columns, most: int) -> None:
        self._count, self._t = 0, np.empty(most)
        self._tables = {k: np.empty((most, len(names))) for k, names in columns.items()}

    def add(self, rows: Rows) -> None:
        part = slice(self._count, self._count + len(rows.t))
        self._t[part] = rows.t
        for name, table in rows.tables.items():
            self._tables[name][part] = table
        self._count += len(rows.t)

    def finish(self, result: Result) -> None:
        """Do nothing: the arrays hold everything."""

    def arrays(self) -> dict[str, Any]:
        """t and the tables."""
        arrays = {"t": self._t, **self._tables}
        if self._count == len(self._t):
            return arrays
        return {name: array[: self._count].copy() for name, array in arrays.items()}


def column_names(result: Result) -> Columns:
    return {table: getattr(result, names) for table, names in TABLES.items()}


def iterate_rows(result: Result) -> Iterator[Rows]:
    """The rows of a result, block by block."""
    for first in range(0, len(result.t), ROWS_PER_BLOCK):
        part = slice(first, first + ROWS_PER_BLOCK)
        tables = {name: getattr(result, name)[part] for name in TABLES}
        yield Rows(result.t[part], tables)


def write_rows(result: Result, sink: Sink) -> None:
    """Gives a whole result to a sink."""
    sink.begin(column_names(result), len(result.t))
    for rows in iterate_rows(result):
        sink.add(rows)
    sink.finish(result)


@dataclass(frozen=True, eq=False)
class Event:
    """An event at one instant of a run.

    Attributes
    ----------
    name : of the event in the scene; of the drive or force for a break
    kind : "rising" or "falling" for a crossing; "break" where a drive or a force
        continues with another piece, so that the integration restarts
    t : [s]
    values : the outputs of the result, (n outputs,)
    positions, velocities : the full state
    """

    name: str
    kind: str
    t: float
    values: Array
    positions: Array
    velocities: Array


def write_events(group: h5py.Group, events: Sequence[Event]) -> None:
    """One dataset per attribute, one row per event."""
    for key in _TEXT_FIELDS:
        texts = [getattr(event, key) for event in events]
        group.create_dataset(key, data=texts, dtype=h5py.string_dtype())
    for key in _ROW_FIELDS:
        group[key] = np.array([getattr(event, key) for event in events], float)


def read_events(group: h5py.Group | None) -> tuple[Event, ...]:
    """Inverse of `write_events`; results without events have no such group."""
    if group is None:
        return ()
    texts = [group[key].asstr()[()] for key in _TEXT_FIELDS]
    rows = [np.asarray(group[key][()], float) for key in _ROW_FIELDS]
    return tuple(
        Event(str(name), str(kind), float(t), *states)
        for name, kind, t, *states in zip(*texts, *rows, strict=True)
    )


@dataclass(frozen=True, eq=False)
class Result(WithDiagnostics):
    """What a simulation recorded. SI units, angles in radians.

    Attributes
    ----------
    title : title of the scene
    names : output names, as in the scene, `*` expanded
    t : (nt,) output times [s]; when not `completed` those before the end, which is the
        last if a state is known there
    values : (nt, n outputs)
    positions, velocities, multipliers : (nt, ...) full state, one column per name in
        `position_names`, `velocity_names`, `multiplier_names`; velocities of frames
        are in body axes (vx_body ... wz_body) and outputs in inertial ones unless
        their names end in _body; positions end with the
        angles in space that are counted beyond half a turn [rad]
    counters : cost of the run: steps, rejected, evaluations, factorisations, seconds
    drift : largest constraint residuals: position, velocity
    settings : integrator, rtol, step and whatever else the run was made with
    bodies : what the run asked of each flexible body, see `FlexibleBody`
    events : crossings that the scene asks for, and breaks, in the order of time
    scene : the scene as JSON
    sids : the SIDs of the bodies that have one, by body
    accuracy : how exact the numbers are, of a run with a requested accuracy
    versions : of this program and of the libraries under it
    diagnostics : what a reader has to know of the numbers, see `Diagnostic`; `notes`
        and `warnings` give them as sentences
    laws : of the program that the run was made with, by force or drive; files do not
        hold them
    completed : False when the run stopped early, or its numbers mean nothing, for the
        reason in `message`; True when an event of the scene ended it, which `message`
        then names

    Raises
    ------
    InputError : the sizes of the arrays do not fit each other.
    """

    is_file: ClassVar[bool] = True
    title: str
    names: tuple[str, ...]
    t: Array
    values: Array
    positions: Array
    velocities: Array
    multipliers: Array
    position_names: tuple[str, ...] = ()
    velocity_names: tuple[str, ...] = ()
    multiplier_names: tuple[str, ...] = ()
    counters: Mapping[str, int | float] = field(default_factory=dict)
    drift: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    bodies: Mapping[str, FlexibleBody] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    scene: str = field(default_factory=str)
    sids: Mapping[str, SID] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    diagnostics: tuple[Diagnostic, ...] = field(default_factory=tuple)
    completed: bool = True
    message: str = ""
    accuracy: AccuracyReport | None = None
    laws: Mapping[str, Any] = field(default_factory=dict)

    def with_lazy_fields(
        self, find: Callable[[], Mapping[str, Any]], *names: str
    ) -> Self:
        """Return the result with some fields computed on first access.

        Parameters
        ----------
        find : computes a field by its name, and others that come with it
        names : fields without a default value in the class
        """
        result = object.__new__(type(self))
        lazy = self.__dict__.get("_late", {}) | dict.fromkeys(names, find)
        result.__dict__.update(self.__dict__, _late=lazy, _lock=Lock())
        for name in names:
            result.__dict__.pop(name, None)
        return result

    def _compute_lazy_field(self, name: str) -> None:
        """Compute a field that is not computed yet, and those that come with it."""
        with self.__dict__.get("_lock", Lock()):
            lazy = self.__dict__.get("_late", {})
            if name in lazy:
                values = lazy[name]()
                left = {n: find for n, find in lazy.items() if n not in values}
                self.__dict__.update(values, _late=left)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name in type(self).__dataclass_fields__:
                self._compute_lazy_field(name)
            if name in self.__dict__:
                return self.__dict__[name]
            raise AttributeError(f"a result has no {name!r}")

    def __getstate__(self) -> dict[str, Any]:
        for name in self.__dict__.get("_late", {}):
            self._compute_lazy_field(name)
        return {k: v for k, v in self.__dict__.items() if k not in ("_late", "_lock")}

    def __post_init__(self) -> None:
        for table, names in TABLES.items():
            array, count = getattr(self, table), len(getattr(self, names))
            if array.shape != (len(self.t), count):
                raise InputError(
                    f"has shape {array.shape}",
                    place=table,
                    expected=f"{len(self.t)} times and {count} names",
                )

    @property
    def error(self) -> dict[str, float]:
        """Estimated error of each output relative to its variation, by name.

        Empty if no accuracy was requested.
        """
        return {} if self.accuracy is None else self.accuracy.errors()

    def keys(self) -> tuple[str, ...]:
        """Names of the outputs that were recorded."""
        return self.names

    def items(self) -> Iterator[tuple[str, Array]]:
        """Recorded outputs with their values over the times, (nt,)."""
        return ((name, self[name]) for name in self.names)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def __bool__(self) -> bool:
        return True

    def __getitem__(self, name: str) -> Array:
        """The course of one output, (nt,).

        Raises
        ------
        InputError : no output has this name.
        """
        if name not in self.names:
            expected = f"one of {', '.join(self.names) or 'no outputs'}"
            raise InputError(f"there is no output {name!r}", expected=expected)
        return self.values[:, self.names.index(name)]
