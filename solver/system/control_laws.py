"""Control laws of a scene as rows of the force table, eq. (29).

A law is the row of its force, after the rows of the measures that it reads. Each of
its states is a body with one coordinate and without position. The module also collects
failures of laws during a run.
"""

import math
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import BLOCK_SHAPES, SID, Taylor, block_shape
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import (
    INPUTS,
    STATE,
    Drive,
    Expression,
    Function,
    Given,
    InputFunction,
    Instruction,
    Pid,
    SceneFile,
)
from sidtool.formats.scene.connections import force_coordinate, owner_table
from sidtool.formats.scene.outputs import EFFORTS, POWER

from ..dynamics import control_laws, control_laws as op
from ..functions.callables import Derivatives, NativeCallable, Timed
from ..functions.control_laws import (
    HELD_VALUE,
    CallableInstruction,
    CompiledLaw,
    Law as GivenLaw,
    LawInstruction,
    LawInstructions,
    LawState,
    OutputRate,
    TableLookup,
    TimeLaw,
    compile_law,
    continuous_law,
)
from ..functions.function_table import FunctionTable, grid_data
from ..functions.law_derivatives import function_of_time, prescribed_law
from ..spatial import system_arrays as at
from .body_data import BodyData
from .force_rows import ControlledForce, ForceLaw, ForceRow
from .force_table import force_element
from .sensors import GROUND_MARKER, SensorSignal, elastic_coordinate_row, sensor_signal
from .system import System

MAX_SAMPLES = 1_000_000
_POSITION_OUTPUTS = (
    "d with a measured output and a reference that are positions or angles"
)
_LAGGING_LAW = (
    "a motion whose derivatives hold positions and velocities only: a state of the law "
    'that follows with a lag, or of = "acceleration"'
)
_OPERATORS = {
    "+": op.ADD,
    "-": op.SUBTRACT,
    "*": op.MULTIPLY,
    "/": op.DIVIDE,
    "**": op.POWER,
    "min": op.MINIMUM,
    "max": op.MAXIMUM,
    "atan2": op.ATAN2,
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


def compile_laws(
    scene: SceneFile,
    forces: Mapping[str, Derivatives | GivenLaw],
    drives: Mapping[str, Derivatives | GivenLaw],
    sampled: bool,
) -> dict[str, CompiledLaw]:
    """The laws of forces and drives, of the scene and of a program, by their names.

    Parameters
    ----------
    sampled
        Whether laws with a sample time are sampled; else they act all the time.

    Raises
    ------
    InputError
        One is not sound.
    """
    compiled = {}
    for name, force in scene.forces.items():
        law = forces.get(name, getattr(force, "function", None))
        if isinstance(law, Expression | Pid | GivenLaw):
            compiled[name] = _compile_checked(
                law, scene, f"forces.{name}.function", sampled
            )
    for name, drive in scene.drives.items():
        function = drives.get(name, drive.function)
        if isinstance(function, Expression | Pid | GivenLaw) or drive.of != "value":
            place = f"drives.{name}.function"
            _check_drive(function, drive, name in compiled, place)
            parts = _compile_checked(function, scene, place, sampled)
            compiled[name] = prescribed_law(
                parts, drive.of, drive.start, drive.start_rate, place
            )
    return compiled


def _check_drive(function: Any, drive: Drive, is_force: bool, place: str) -> None:
    if is_force:
        fail = "is a law, as that of the force of the same name"
        raise InputError(fail, place=place, expected="different names")
    if callable(function) or isinstance(function, tuple | Timed):
        raise InputError(
            f"a callable of time cannot give the {drive.of} of a drive",
            place=place,
            expected='with of = "acceleration" a Law(lambda t, y: ..., reads=[])',
        )


def _compile_checked(
    law: Any, scene: SceneFile, place: str, sampled: bool
) -> CompiledLaw:
    if not sampled and isinstance(law, Expression | Pid | GivenLaw):
        law = continuous_law(law, place)
    parts = compile_law(law, place)
    _check_sample_time(parts, scene, place)
    return parts


def _check_sample_time(law: CompiledLaw, scene: SceneFile, place: str) -> None:
    span = scene.time.end - scene.time.start
    if law.sample_time is not None and span > MAX_SAMPLES * law.sample_time:
        raise InputError(
            f"a run of {span:.6g} s has more than {MAX_SAMPLES} samples",
            place=f"{place}.sample_time",
            expected=f"at least {span / MAX_SAMPLES:.3g}",
        )


def state_bodies(
    laws: Mapping[str, CompiledLaw], given: Mapping[str, float]
) -> dict[str, BodyData]:
    """The bodies that carry the states of all laws.

    Parameters
    ----------
    given
        States at the start, in place of those of the laws.
    """
    return {
        state_body(force, name): BodyData(
            state_body(force, name),
            _state_sid(),
            False,
            False,
            {},
            is_scene_body=False,
            initial_state=given.get(state_body(force, name), state.initial),
        )
        for force, parts in laws.items()
        for name, state in _all_states(parts).items()
    }


def _all_states(parts: CompiledLaw) -> dict[str, LawState]:
    """The states of a law, of a sampled one what is held between samples, and of a
    drive what it adds up to."""
    held_value = (
        {} if parts.sample_time is None else {HELD_VALUE: LawState(0.0, parts.value)}
    )
    return {**held_value, **parts.states, **parts.integrated_states}


def _state_sid() -> SID:
    """One coordinate of unit mass on nothing."""
    blocks: dict[str, Any] = {
        name: Taylor(np.zeros(block_shape(name, 1))) for name in BLOCK_SHAPES
    }
    blocks["Me"] = Taylor(np.ones((1, 1)))
    return SID(mass=0.0, labels=("state",), nodes=(), **blocks)


class LawTable:
    """Compiles laws; what they read is looked up in the whole scene.

    Attributes
    ----------
    laws
        Of all forces that have one.
    programs
        Forces whose function a program gives.
    """

    def __init__(
        self,
        scene: SceneFile,
        data: Mapping[str, BodyData],
        functions: FunctionTable,
        laws: Mapping[str, CompiledLaw],
        programs: Container[str] = (),
    ) -> None:
        self.scene, self._data, self.functions = scene, data, functions
        self.laws, self.programs = laws, programs
        self._inputs = {name: InputFunction(name=name) for name in scene.inputs}

    def rows(self, element: ForceRow) -> list[ForceRow]:
        """The rows of a force: itself, what its law reads, and the states of that."""
        force = element.name
        parts = self.laws.get(force)
        if parts is None:
            return [element]
        return [
            *self._rows(element, self.value_or_held(force), force),
            *self._states(force),
        ]

    def value_or_held(self, force: str) -> LawInstructions:
        """What the law of a force gives; of a sampled one what it holds."""
        parts = self.laws[force]
        held_value: LawInstructions = (Instruction("name", HELD_VALUE),)
        return parts.value if parts.sample_time is None else held_value

    def rows_of_drive(self, drive: str) -> list[ForceRow]:
        """The rows of a drive: what it prescribes, the first, its derivatives, and the
        states of its law."""
        led = self.laws[drive].prescribed
        assert led is not None
        prescribed = ForceRow(
            drive, at.PRESCRIBED_VALUE, None, GROUND_MARKER, (), ForceLaw()
        )
        value, rate, second = (
            list(self._rows(prescribed, parts, drive, continuity))
            for parts, continuity in zip(led, (1, 1, 0), strict=True)
        )
        rates = len(rate), len(rate) + len(second)
        value[-1] = replace(value[-1], derivative_rows=rates)
        return [*value, *rate, *second, *self._states(drive)]

    def _states(self, force: str) -> Iterator[ForceRow]:
        """The rows that change the states of a law."""
        parts = self.laws[force]
        for name, state in _all_states(parts).items():
            sampled = (
                0.0 if name in parts.integrated_states else parts.sample_time or 0.0
            )
            state_row = replace(
                elastic_coordinate_row(state_body(force, name), 0),
                name=force,
                law=ForceLaw(applied=0.0 if sampled else 1.0),
                sample_period=sampled,
            )
            yield from self._rows(state_row, state.change, force)
        if parts.sample_time is None:
            self._add_features(parts, force)

    def _add_features(self, law: CompiledLaw, force: str) -> None:
        """Give the table of functions what a law makes of time."""
        for parts in (law.value, *(state.change for state in law.states.values())):
            program = function_of_time(parts)
            if program is not None:
                self.functions.add_law_features(program, force)

    def _rows(
        self,
        element: ForceRow,
        parts: LawInstructions,
        force: str,
        continuity: int = 0,
    ) -> Iterator[ForceRow]:
        """Rows of the measures that a law reads, then its own.

        Parameters
        ----------
        continuity
            1 if inputs in it must not jump.
        """
        compiled = _LawCompiler(self, parts, force, continuity)
        for sensor in compiled.sensors:
            yield replace(sensor, name=force, is_measure=True)
        law = ControlledForce(compiled.reads, tuple(compiled.natives))
        yield replace(element, code=compiled.code(), control=law)

    def read(self, name: str, force: str) -> SensorSignal:
        """The measure of an output or a state; states of the law itself come first."""
        if name in _all_states(self.laws[force]):
            return SensorSignal(elastic_coordinate_row(state_body(force, name), 0), 1)
        owner, _, state = name.partition(f".{STATE}.")
        if owner in self.laws and state in _all_states(self.laws[owner]):
            return SensorSignal(elastic_coordinate_row(state_body(owner, state), 0), 1)
        return sensor_signal(name, self.scene, self._data, self.place(force))

    def function(self, timing: TimeLaw, force: str, continuity: int) -> int:
        """The row of a function of time; a speed that it gives must not jump.

        Parameters
        ----------
        continuity
            1 if an input must not jump.
        """
        is_speed = getattr(self.scene.drives.get(force), "of", "") == "rate"
        place, joined = self.place(force), int(is_speed)
        if isinstance(timing.function, InputFunction):
            joined = continuity
        return self.functions.add(timing.function, place, None, joined)

    def input_function(self, name: str) -> InputFunction | None:
        """The function that an input is, by its name or that of its output."""
        return self._inputs.get(name.removeprefix(f"{INPUTS}."))

    def place(self, owner: str) -> str:
        """The key of a law in the scene."""
        table = "forces" if self.laws[owner].prescribed is None else "drives"
        return f"{table}.{owner}.function"


class _LawCompiler:
    """The instructions of one law, as they are in the real data."""

    def __init__(
        self, table: LawTable, parts: LawInstructions, force: str, continuity: int
    ) -> None:
        self.table, self.force, self.continuity = table, force, continuity
        self.sensors: list[ForceRow] = []
        self.reads: dict[str, tuple[int, Callable[[float, float], float]]] = {}
        self.natives: list[NativeCallable] = []
        self.rows: dict[int, int] = {}
        self.open_forces: list[str] = []
        self.instructions: list[tuple[float, float, float]] = []
        self.depth = self.max_depth = 0
        for part in parts:
            self._add_instruction(part)
            self.max_depth = max(self.max_depth, self.depth)
        if self.max_depth >= op.STACK_DEPTH - 1:
            raise InputError(
                "the law has too many nested parts",
                place=table.place(force),
                expected="a simpler one",
            )

    def code(self) -> tuple[float, ...]:
        numbers = [number for numbers in self.instructions for number in numbers]
        return (float(len(self.sensors)), float(len(self.instructions)), *numbers)

    def _add_instruction(self, part: LawInstruction) -> None:
        if isinstance(part, CallableInstruction):
            native = part.native
            self.natives.append(native)
            kind = op.CALL if native.derivatives is None else op.CALL_GIVEN
            self._emit(kind, native.address, native.count, 1 - native.count)
        elif isinstance(part, TimeLaw):
            row = self.rows.get(id(part.function))
            if row is None:
                row = self.table.function(part, self.force, self.continuity)
                self.rows[id(part.function)] = row
            self._emit(op.FUNCTION, row, part.order, 1)
        elif isinstance(part, TableLookup):
            self._emit_lookup(part)
        elif isinstance(part, OutputRate) and self._emit_input(part.name, 1):
            pass
        elif isinstance(part, OutputRate):
            signal = self.table.read(part.name, self.force)
            prescribed = self.table.laws[self.force].prescribed
            if signal.order == 1:
                raise InputError(
                    f"the rate of {part.name} is an acceleration or unknown, which a "
                    "law cannot read",
                    place=self.table.place(self.force),
                    expected=_POSITION_OUTPUTS if prescribed is None else _LAGGING_LAW,
                )
            self._emit_measure(f"rate of {part.name}", SensorSignal(signal.element, 1))
        elif part.kind == "name":
            self._emit_name(str(part.value))
        elif part.kind == "number":
            self._emit(op.CONSTANT, float(part.value), 0.0, 1)
        elif part.kind == "time":
            self._emit(op.TIME, 0.0, 0.0, 1)
        else:
            kind = _OPERATORS[part.kind]
            self._emit(kind, 0.0, 0.0, 0 if kind >= op.NEGATIVE else -1)

    def _emit_lookup(self, part: TableLookup) -> None:
        functions = self.table.functions
        if part.table.variables == 1:
            row = functions.add_lookup(part.name, part.curve)
            self._emit(op.LOOKUP, row, part.order, 0)
        else:
            data = functions.add_grid(part.name, grid_data(part.table))
            self._emit(op.LOOKUP_GRID, data, 0.0, -1)

    def _emit_name(self, name: str) -> None:
        """Pushes what stands behind a name."""
        if self._emit_input(name, 0):
            return
        owner, _, quantity = name.rpartition(".")
        scene, is_along = self.table.scene, quantity in (*EFFORTS, POWER)
        if not is_along or owner_table(owner, quantity, scene) != "forces":
            self._emit_measure(name, self.table.read(name, self.force))
        elif not force_coordinate(scene.forces[owner], scene):
            self.table.read(name, self.force)  # raises
        else:
            self._emit_force(name, owner, quantity == POWER)

    def _emit_input(self, name: str, order: int) -> bool:
        """Pushes an input or its rate; False if a name is that of no input."""
        function = self.table.input_function(name)
        if function is None or name in _all_states(self.table.laws[self.force]):
            return False
        self._add_instruction(TimeLaw(function, order))
        if order == 0:
            self.reads[name] = 0, _unknown_output
        return True

    def _emit_force(self, name: str, owner: str, is_power: bool) -> None:
        """Pushes the force of another element along its coordinate, or its power."""
        element = force_element(self.table.scene, owner)
        index, law = self._sensor_index(element), element.law
        self._emit(op.PASSIVE_FORCE, index, 0.0, 1)
        if law.applied:
            self._emit_applied_force(name, owner)
            self._emit(op.ADD, 0.0, 0.0, -1)
        if is_power:
            self._emit(op.MEASURE, index, 1, 1)
            self._emit(op.MULTIPLY, 0.0, 0.0, -1)
        value = (
            _unknown_output
            if law.applied
            else partial(_passive_force_output, law, is_power)
        )
        self.reads[name] = index, value

    def _emit_applied_force(self, name: str, owner: str) -> None:
        """Pushes what the function or law of another force gives.

        Raises
        ------
        InputError
            It depends on itself, or only a program knows it.
        """
        table, place = self.table, self.table.place(self.force)
        function = getattr(table.scene.forces[owner], "function", None)
        if owner in self.open_forces:
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
        self.open_forces.append(owner)
        if owner not in table.laws:
            self._add_instruction(TimeLaw(cast(Function, function), 0))
        else:
            outer, self.force = self.force, owner
            for part in table.value_or_held(owner):
                self._add_instruction(part)
            self.force = outer
        self.open_forces.pop()

    def _emit_measure(self, name: str, signal: SensorSignal) -> None:
        index, order, constant = self._sensor_index(signal.element), *signal[1:]
        self.reads[name] = index, partial(_measured_output, order, constant)
        self._emit(op.MEASURE, index, order, 1)
        if constant:
            self._emit(op.CONSTANT, constant, 0.0, 1)
            self._emit(op.SUBTRACT, 0.0, 0.0, -1)

    def _sensor_index(self, element: ForceRow) -> int:
        """Number of the measure of an element, which is added where it is new."""
        keys = [_sensor_key(sensor) for sensor in self.sensors]
        if _sensor_key(element) not in keys:
            self.sensors.append(element)
            return len(keys)
        return keys.index(_sensor_key(element))

    def _emit(self, kind: int, a: float, b: float, depth_change: int) -> None:
        self.instructions.append((float(kind), float(a), float(b)))
        self.depth += depth_change


def _sensor_key(element: ForceRow) -> tuple[object, ...]:
    law = tuple(element.law.packed())
    return element.kind, element.a, element.b, element.data, law


def _measured_output(order: int, constant: float, measure: float, rate: float) -> float:
    """An output that is a measure less a constant, or its rate."""
    return (measure, rate)[order] - constant


def _passive_force_output(
    law: ForceLaw, is_power: bool, measure: float, rate: float
) -> float:
    """Force or power of a spring or damper."""
    return law.passive_force(measure, rate) * (rate if is_power else 1.0)


def _unknown_output(measure: float, rate: float) -> float:
    """What follows from the law of another force, or comes from outside."""
    return math.nan


def law_failure(
    system: System, work: at.WorkArrays, t: float, since: float = -np.inf
) -> Diagnostic | None:
    """The law that gave no number at a time t [s] that was reached (N509)."""
    text = law_error(system, work, since)
    return diagnose("N509", t=t, reason=text) if text else None


def law_error(system: System, work: at.WorkArrays, since: float = -np.inf) -> str:
    """Which law gave no number, when, and of what; nothing if all did since a time."""
    if (
        work.law_failure[control_laws.FAILED_LAW] == 0.0
        or work.law_failure[control_laws.FAILURE_TIME] < since
    ):
        return ""
    element = system.forces[int(work.law_failure[control_laws.FAILED_LAW]) - 1]
    law, t = element.control, float(work.law_failure[control_laws.FAILURE_TIME])
    assert law is not None
    values = {}
    for name, (index, output) in law.reads.items():
        first = control_laws.FAILURE_MEASURES + 2 * index
        values[name] = output(
            float(work.law_failure[first]), float(work.law_failure[first + 1])
        )
    problem = "gives no finite number"
    # What a sampled law holds is a row of its own, as are its states.
    natives = law.natives or tuple(_natives(system, element.name))
    at_time = (n for n in natives if n.failure and n.failure[0] == t)
    native = next(at_time, natives[0] if law.natives else None)
    if native is not None:
        problem = native.failure_text(
            t, np.array(list(values.values())[: native.count])
        )
    known = {name: value for name, value in values.items() if value == value}
    arguments = ", ".join(f"{name} = {value:.6g}" for name, value in known.items())
    text = f"the law of {element.name} {problem} at t = {t:.9g} s"
    return f"{text}, where {arguments}" if arguments else text


def _natives(system: System, name: str) -> Iterator[NativeCallable]:
    """Callables of all rows of a force."""
    for element in system.forces:
        if element.name == name and element.control is not None:
            yield from element.control.natives


def rejected_trials(system: System, work: at.WorkArrays) -> list[Diagnostic]:
    """Which laws gave no number where a run could do without it (N510).

    An exception of a callable is a defect of a program, whether the run needed the
    number or not.
    """
    error = law_error(system, work)
    last, compiled = (
        float(work.law_failure[control_laws.FAILURE_TIME]),
        [error] if error else [],
    )
    for name in dict.fromkeys(element.name for element in system.forces):
        for native in _natives(system, name):
            if native.failure is not None and not (error and native.failure[0] == last):
                t, why = native.failure
                compiled.append(f"the law of {name} {why} at t = {t:.9g} s")
    return [diagnose("N510", reason=text) for text in dict.fromkeys(compiled)]
