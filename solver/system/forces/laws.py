"""Laws of a scene as rows of the table of forces, eq. (29).

A law is the row of its force, behind rows for the measures that it reads. Each of its
states is a body with one coordinate and no place, whose velocity is the state: the
rate of the state is a law that pushes it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import (
    STATE,
    Drive,
    Expression,
    Function,
    Given,
    Instruction,
    Pid,
    SceneFile,
)
from sidtool.formats.scene.connections import force_coordinate, holder
from sidtool.formats.scene.outputs import EFFORTS, POWER
from sidtool.formats.sid import BLOCK_SHAPES, SID, Taylor, block_shape

from ...equations.forces import programs as op
from ...functions.callables import Derivatives, Timed
from ...functions.law_drives import led_by
from ...functions.law_times import of_time
from ...functions.laws import (
    HELD,
    Called,
    Kept,
    LawParts,
    Parts,
    RateOf,
    Timing,
    continuous,
    law_parts,
)
from ...functions.laws import Law as GivenLaw
from ...functions.native import Native
from ...functions.table import FunctionTable
from ...space import layout as at
from ..bodies.data import BodyData
from .elements import Element, Programmed
from .force_laws import Law
from .rows import force_element
from .sensors import GROUND, Reading, coordinate, reading

MOST_SAMPLES = 1_000_000
_POSITIONS = "d with a measured output and a reference that are positions or angles"
_LAGGED = (
    "a motion whose derivatives hold positions and velocities only: a state of the law "
    'that follows with a lag, or of = "acceleration"'
)
_OPERATORS = {
    "+": op.ADD,
    "-": op.SUBTRACT,
    "*": op.MULTIPLY,
    "/": op.DIVIDE,
    "**": op.POWER,
    "min": op.LEAST,
    "max": op.MOST,
    "atan2": op.ANGLE_OF,
    "negative": op.NEGATIVE,
    "sin": op.SIN,
    "cos": op.COS,
    "tan": op.TAN,
    "asin": op.ASIN,
    "acos": op.ACOS,
    "atan": op.ATAN,
    "sinh": op.SINH,
    "cosh": op.COSH,
    "tanh": op.TANH,
    "exp": op.EXP,
    "log": op.LOG,
    "sqrt": op.SQRT,
    "abs": op.ABS,
    "sign": op.SIGN,
}


def state_body(force: str, state: str) -> str:
    """Name of the body that carries a state of a law."""
    return f"{force}.{STATE}.{state}"


def laws_of(
    scene: SceneFile,
    forces: Mapping[str, Derivatives | GivenLaw],
    drives: Mapping[str, Derivatives | GivenLaw],
    sampled: bool,
) -> dict[str, LawParts]:
    """The laws of forces and drives, of the scene and of a program, by their names.

    sampled : whether laws with a sample time are sampled; else they act all the time

    Raises
    ------
    InputError : one is not sound.
    """
    found = {}
    for name, force in scene.forces.items():
        law = forces.get(name, getattr(force, "function", None))
        if isinstance(law, Expression | Pid | GivenLaw):
            found[name] = _compiled(law, scene, f"forces.{name}.function", sampled)
    for name, drive in scene.drives.items():
        moves = drives.get(name, drive.function)
        if isinstance(moves, Expression | Pid | GivenLaw) or drive.of != "value":
            place = f"drives.{name}.function"
            _check_drive(moves, drive, name in found, place)
            parts = _compiled(moves, scene, place, sampled)
            found[name] = led_by(parts, drive.of, drive.start, drive.start_rate, place)
    return found


def _check_drive(moves: Any, drive: Drive, is_force: bool, place: str) -> None:
    if is_force:
        fail = "is a law, as that of the force of the same name"
        raise InputError(fail, place=place, expected="different names")
    if callable(moves) or isinstance(moves, tuple | Timed):
        raise InputError(
            f"a callable of time cannot give the {drive.of} of a drive",
            place=place,
            expected='with of = "acceleration" a Law(lambda t, y: ..., reads=[])',
        )


def _compiled(law: Any, scene: SceneFile, place: str, sampled: bool) -> LawParts:
    if not sampled and isinstance(law, Expression | Pid | GivenLaw):
        law = continuous(law, place)
    parts = law_parts(law, place)
    _check_sample_time(parts, scene, place)
    return parts


def _check_sample_time(law: LawParts, scene: SceneFile, place: str) -> None:
    span = scene.time.end - scene.time.start
    if law.sample_time is not None and span > MOST_SAMPLES * law.sample_time:
        raise InputError(
            f"a run of {span:.6g} s has more than {MOST_SAMPLES} samples",
            place=f"{place}.sample_time",
            expected=f"at least {span / MOST_SAMPLES:.3g}",
        )


def state_bodies(laws: Mapping[str, LawParts]) -> dict[str, BodyData]:
    """The bodies that carry the states of all laws."""
    return {
        state_body(force, name): BodyData(
            state_body(force, name),
            _state_sid(),
            False,
            False,
            {},
            of_scene=False,
            starts_at=kept.initial,
        )
        for force, parts in laws.items()
        for name, kept in _kept(parts).items()
    }


def _kept(parts: LawParts) -> dict[str, Kept]:
    """The states of a law, of a sampled one what is held between samples, and of a
    drive what it adds up to."""
    held = {} if parts.sample_time is None else {HELD: Kept(0.0, parts.value)}
    return {**held, **parts.states, **parts.followed}


def _state_sid() -> SID:
    """One coordinate of unit mass on nothing."""
    blocks: dict[str, Any] = {
        name: Taylor(np.zeros(block_shape(name, 1))) for name in BLOCK_SHAPES
    }
    blocks["Me"] = Taylor(np.ones((1, 1)))
    return SID(mass=0.0, labels=("state",), nodes=(), **blocks)


class LawTable:
    """Compiles laws; what they read is looked up in the whole scene.

    laws : of all forces that have one
    programs : forces whose function a program gives
    """

    def __init__(
        self,
        scene: SceneFile,
        data: Mapping[str, BodyData],
        functions: FunctionTable,
        laws: Mapping[str, LawParts],
        programs: Container[str] = (),
    ) -> None:
        self.scene, self._data, self._functions = scene, data, functions
        self.laws, self.programs = laws, programs

    def rows(self, element: Element) -> list[Element]:
        """The rows of a force: itself, what its law reads, and the states of that."""
        force = element.name
        parts = self.laws.get(force)
        if parts is None:
            return [element]
        return [*self._rows(element, self.value_of(force), force), *self._states(force)]

    def value_of(self, force: str) -> Parts:
        """What the law of a force gives; of a sampled one what it holds."""
        parts = self.laws[force]
        held: Parts = (Instruction("name", HELD),)
        return parts.value if parts.sample_time is None else held

    def rows_of_drive(self, drive: str) -> list[Element]:
        """The rows of a drive: what it prescribes, the first, its derivatives, and the
        states of its law."""
        led = self.laws[drive].led
        assert led is not None
        prescribed = Element(drive, at.PRESCRIBED, None, GROUND, (), Law())
        value, rate, second = (
            list(self._rows(prescribed, parts, drive)) for parts in led
        )
        rates = len(rate), len(rate) + len(second)
        value[-1] = replace(value[-1], rates=rates)
        return [*value, *rate, *second, *self._states(drive)]

    def _states(self, force: str) -> Iterator[Element]:
        """The rows that change the states of a law."""
        parts = self.laws[force]
        for name, kept in _kept(parts).items():
            sampled = 0.0 if name in parts.followed else parts.sample_time or 0.0
            pushed = replace(
                coordinate(state_body(force, name), 0),
                name=force,
                law=Law(applied=0.0 if sampled else 1.0),
                sampled=sampled,
            )
            yield from self._rows(pushed, kept.change, force)
        if parts.sample_time is None:
            self._watch(parts, force)

    def _watch(self, law: LawParts, force: str) -> None:
        """Tells the table of functions what a law makes of time."""
        for parts in (law.value, *(kept.change for kept in law.states.values())):
            program = of_time(parts)
            if program is not None:
                self._functions.watch(program, force)

    def _rows(self, element: Element, parts: Parts, force: str) -> Iterator[Element]:
        compiled = _Program(self, parts, force)
        for sensor in compiled.sensors:
            yield replace(sensor, name=force, is_read=True)
        law = Programmed(compiled.reads, tuple(compiled.natives))
        yield replace(element, code=compiled.code(), programmed=law)

    def read(self, name: str, force: str) -> Reading:
        """The measure of an output or a state; states of the law itself come first."""
        if name in _kept(self.laws[force]):
            return Reading(coordinate(state_body(force, name), 0), 1)
        owner, _, state = name.partition(f".{STATE}.")
        if owner in self.laws and state in _kept(self.laws[owner]):
            return Reading(coordinate(state_body(owner, state), 0), 1)
        return reading(name, self.scene, self._data, self.place(force))

    def function(self, timing: Timing, force: str) -> int:
        """The row of a function of time; a speed that it gives must not jump."""
        is_speed = getattr(self.scene.drives.get(force), "of", "") == "rate"
        place, joined = self.place(force), int(is_speed)
        return self._functions.add(timing.function, place, None, joined)

    def place(self, owner: str) -> str:
        """The key of a law in the scene."""
        table = "forces" if self.laws[owner].led is None else "drives"
        return f"{table}.{owner}.function"


class _Program:
    """The instructions of one law, as they stand in the pool."""

    def __init__(self, table: LawTable, parts: Parts, force: str) -> None:
        self.table, self.force = table, force
        self.sensors: list[Element] = []
        self.reads: dict[str, tuple[int, Callable[[float, float], float]]] = {}
        self.natives: list[Native] = []
        self.rows: dict[int, int] = {}
        self.reading: list[str] = []
        self.words: list[tuple[float, float, float]] = []
        self.height = self.highest = 0
        for part in parts:
            self._add(part)
            self.highest = max(self.highest, self.height)
        if self.highest >= op.DEPTH - 1:
            raise InputError(
                "the law has too many nested parts",
                place=table.place(force),
                expected="a simpler one",
            )

    def code(self) -> tuple[float, ...]:
        words = [word for words in self.words for word in words]
        return (float(len(self.sensors)), float(len(self.words)), *words)

    def _add(self, part: Instruction | Called | Timing | RateOf) -> None:
        if isinstance(part, Called):
            native = part.native
            self.natives.append(native)
            kind = op.CALL if native.derivatives is None else op.CALL_GIVEN
            self._word(kind, native.address, native.count, 1 - native.count)
        elif isinstance(part, Timing):
            row = self.rows.get(id(part.function))
            if row is None:
                row = self.table.function(part, self.force)
                self.rows[id(part.function)] = row
            self._word(op.FUNCTION, row, part.order, 1)
        elif isinstance(part, RateOf):
            found = self.table.read(part.name, self.force)
            led = self.table.laws[self.force].led
            if found.order == 1:
                raise InputError(
                    f"the rate of {part.name} is an acceleration or unknown, which a "
                    "law cannot read",
                    place=self.table.place(self.force),
                    expected=_POSITIONS if led is None else _LAGGED,
                )
            self._measure(f"rate of {part.name}", Reading(found.element, 1))
        elif part.kind == "name":
            self._read(str(part.value))
        elif part.kind == "number":
            self._word(op.CONSTANT, float(part.value), 0.0, 1)
        elif part.kind == "time":
            self._word(op.TIME, 0.0, 0.0, 1)
        else:
            kind = _OPERATORS[part.kind]
            self._word(kind, 0.0, 0.0, 0 if kind >= op.NEGATIVE else -1)

    def _read(self, name: str) -> None:
        """Pushes what stands behind a name."""
        owner, _, quantity = name.rpartition(".")
        scene, is_along = self.table.scene, quantity in (*EFFORTS, POWER)
        if not is_along or holder(owner, quantity, scene) != "forces":
            self._measure(name, self.table.read(name, self.force))
        elif not force_coordinate(scene.forces[owner], scene):
            self.table.read(name, self.force)  # raises
        else:
            self._read_force(name, owner, quantity == POWER)

    def _read_force(self, name: str, owner: str, is_power: bool) -> None:
        """Pushes the force of another element along its coordinate, or its power."""
        element = force_element(self.table.scene, owner)
        index, law = self._sensor(element), element.law
        self._word(op.FORCE, index, 0.0, 1)
        if law.applied:
            self._add_applied(name, owner)
            self._word(op.ADD, 0.0, 0.0, -1)
        if is_power:
            self._word(op.MEASURE, index, 1, 1)
            self._word(op.MULTIPLY, 0.0, 0.0, -1)
        value = _not_of_measures if law.applied else partial(_force, law, is_power)
        self.reads[name] = index, value

    def _add_applied(self, name: str, owner: str) -> None:
        """Pushes what the function or law of another force gives.

        Raises
        ------
        InputError : it depends on itself, or only a program knows it.
        """
        table, place = self.table, self.table.place(self.force)
        function = getattr(table.scene.forces[owner], "function", None)
        if owner in self.reading:
            raise InputError(
                f"a law cannot read {name!r}: it depends on itself",
                place=place,
                expected="a state that follows it with a lag",
            )
        if owner in table.programs or isinstance(function, Given):
            raise InputError(
                f"a law cannot read {name!r}, whose function a program gives",
                place=place,
                expected="a function or law in the scene",
            )
        self.reading.append(owner)
        if owner not in table.laws:
            self._add(Timing(cast(Function, function), 0))
        else:
            outer, self.force = self.force, owner
            for part in table.value_of(owner):
                self._add(part)
            self.force = outer
        self.reading.pop()

    def _measure(self, name: str, found: Reading) -> None:
        index, order, constant = self._sensor(found.element), *found[1:]
        self.reads[name] = index, partial(_measured, order, constant)
        self._word(op.MEASURE, index, order, 1)
        if constant:
            self._word(op.CONSTANT, constant, 0.0, 1)
            self._word(op.SUBTRACT, 0.0, 0.0, -1)

    def _sensor(self, element: Element) -> int:
        """Number of the measure of an element, which is added where it is new."""
        keys = [_key(sensor) for sensor in self.sensors]
        if _key(element) not in keys:
            self.sensors.append(element)
            return len(keys)
        return keys.index(_key(element))

    def _word(self, kind: int, a: float, b: float, grows: int) -> None:
        self.words.append((float(kind), float(a), float(b)))
        self.height += grows


def _key(element: Element) -> tuple[object, ...]:
    law = tuple(element.law.packed())
    return element.kind, element.a, element.b, element.data, law


def _measured(order: int, constant: float, measure: float, rate: float) -> float:
    """An output that is a measure less a constant, or its rate."""
    return (measure, rate)[order] - constant


def _force(law: Law, is_power: bool, measure: float, rate: float) -> float:
    """Force or power of a spring or damper."""
    return law.passive_force(measure, rate) * (rate if is_power else 1.0)


def _not_of_measures(measure: float, rate: float) -> float:
    """What follows from the law of another force."""
    return math.nan
