"""Control laws as stack instructions: from formulas, controllers and callables."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    Expression,
    Function,
    Instruction,
    LookupTable,
    Pid,
)
from sidtool.formats.toml.expressions import LOOKUPS

from .callables import NativeCallable, real_number
from .function_table import curve_of_table, curve_values
from .piecewise import PiecewisePolynomial

#: A function of the time and of what a law reads.
OutputFunction = Callable[[float, Array], float]
OutputDerivatives = Callable[[float, Array], Sequence[float]]

#: State of a sampled law: what it holds. No name in a scene has a space.
HELD_VALUE = "held value"


@dataclass(frozen=True, eq=False)
class Law:
    """A force as a function of outputs of the motion, for `compile_scene(forces=...)`.

    It replaces the function of a force or an actuator; among `drives`, that of a drive
    with `of = "acceleration"`. Where numba can compile the callables they are called at
    the cost of compiled code, else through Python. They must depend on t and y alone:
    methods ask for trial states, and again after steps that fail. What a controller
    remembers are its `states`.

    Attributes
    ----------
    function
        f(t, y) [N] or [N m], of a drive [m/s2] or [rad/s2]; y holds what is read, then
        the states, in order.
    reads
        Names of outputs, such as "elbow.angle": positions and velocities.
    derivatives
        Of f by y, (len(y),); default by differences. Newton's iteration uses them, the
        motion does not depend on them.
    states
        Initial value and rate f(t, y) of numbers that follow x' = f; with a sample time
        f gives the next value.
    limits
        Lower and upper bound of the value.
    sample_time
        Time between samples [s], between which the value is held.
    """

    function: OutputFunction
    reads: Sequence[str]
    derivatives: OutputDerivatives | None = None
    states: Mapping[str, tuple[float, OutputFunction]] = field(default_factory=dict)
    limits: tuple[float, float] | None = None
    sample_time: float | None = None


@dataclass(frozen=True, eq=False)
class CallableInstruction:
    """A callable among the instructions, which takes `native.count` entries."""

    native: NativeCallable


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """A function of time among the instructions, or its rate."""

    function: Function
    order: int


@dataclass(frozen=True, eq=False)
class TableLookup:
    """A table among the instructions, which takes its variables from the stack.

    Attributes
    ----------
    order
        Derivative by the one variable.
    """

    name: str
    table: LookupTable
    order: int = 0

    @cached_property
    def curve(self) -> PiecewisePolynomial:
        """Of a table of one variable."""
        return curve_of_table(self.table)

    def values(self, x: Array) -> Array:
        """The values of a table of one variable at places (nx,)."""
        return curve_values(self.curve, x, self.order)

    def value(self, *point: float) -> float:
        """The value at a point."""
        if self.table.variables == 2:
            return self.table.value(*point)
        return float(self.values(np.array(point))[0])


@dataclass(frozen=True, eq=False)
class OutputRate:
    """The rate of an output among the instructions."""

    name: str


#: What a program is made of.
LawInstruction = Instruction | CallableInstruction | TimeLaw | OutputRate | TableLookup
LawInstructions = tuple[LawInstruction, ...]


@dataclass(frozen=True, eq=False)
class LawState:
    """A state of a law: its value at the start, and its rate or its next value."""

    initial: float
    change: LawInstructions


@dataclass(frozen=True, eq=False)
class CompiledLaw:
    """A law in instructions.

    Attributes
    ----------
    value
        What scales the force.
    states
        By name.
    sample_time
        [s], or None for a continuous law.
    prescribed
        Of the law of a drive, what it prescribes and two derivatives of that.
    integrated_states
        States in which its value adds up, which no samples hold.
    """

    value: LawInstructions
    states: Mapping[str, LawState]
    sample_time: float | None
    prescribed: tuple[LawInstructions, LawInstructions, LawInstructions] | None = None
    integrated_states: Mapping[str, LawState] = field(default_factory=dict)


def continuous_law(law: Expression | Pid | Law, place: str) -> Expression | Pid | Law:
    """The law without its samples.

    Raises
    ------
    InputError
        It keeps states that are known at samples only.
    """
    if law.sample_time is None:
        return law
    if isinstance(law, Pid):
        return law.model_copy(update={"sample_time": None})
    if law.states:
        raise InputError(
            f"its states ({', '.join(law.states)}) are known at samples only",
            place=place,
            expected="a law without a sample time, or without states, in an analysis",
        )
    if isinstance(law, Expression):
        return law.model_copy(update={"sample_time": None})
    return replace(law, sample_time=None)


def compile_law(law: Expression | Pid | Law | Function, place: str) -> CompiledLaw:
    """A law of a scene or of a program in instructions; a function of time is one.

    Raises
    ------
    InputError
        It is not sound.
    """
    if isinstance(law, Expression):
        return _compile_expression(law)
    if isinstance(law, Pid):
        return _compile_pid(law)
    if isinstance(law, Law):
        return _compile_program(law, place)
    return CompiledLaw((TimeLaw(law, 0),), {}, None)


def _number_instruction(value: float) -> LawInstruction:
    return Instruction("number", float(value))


def _apply_operator(kind: str, *operands: LawInstructions) -> LawInstructions:
    """An operator on operands."""
    return (*(part for operand in operands for part in operand), Instruction(kind))


def _scaled(factor: float, operand: LawInstructions) -> LawInstructions:
    return _apply_operator("*", (_number_instruction(factor),), operand)


def _apply_limits(
    value: LawInstructions, limits: tuple[float, float] | None
) -> LawInstructions:
    if limits is None:
        return value
    above = _apply_operator("max", value, (_number_instruction(limits[0]),))
    return _apply_operator("min", above, (_number_instruction(limits[1]),))


def _compile_expression(law: Expression) -> CompiledLaw:
    def parsed(text: str | None) -> LawInstructions:
        assert text is not None
        return tuple(
            TableLookup(str(part.value), law.tables[str(part.value)])
            if part.kind in LOOKUPS
            else part
            for part in law.parse(text)
        )

    key = "rate" if law.sample_time is None else "next"
    states = {
        name: LawState(state.initial, parsed(getattr(state, key)))
        for name, state in law.states.items()
    }
    value = _apply_limits(parsed(law.value), law.limits)
    return CompiledLaw(value, states, law.sample_time)


def _compile_pid(law: Pid) -> CompiledLaw:
    measured: LawInstructions = (Instruction("name", law.measured),)
    reference, reference_rate = _reference(law.reference)
    error = _apply_operator("-", reference, measured)
    slope = _apply_operator("-", reference_rate, (OutputRate(law.measured),))
    states: dict[str, LawState] = {}
    value = _scaled(law.p, error)
    if law.d:
        lagged: LawInstructions = slope
        if law.filter is not None:
            lagged = (Instruction("name", "derivative"),)
            difference = _apply_operator("-", slope, lagged)
            change = _scaled(1.0 / law.filter, difference)
            if law.sample_time is not None:
                share = -math.expm1(-law.sample_time / law.filter)
                lagged = change = _apply_operator(
                    "+", lagged, _scaled(share, difference)
                )
            states["derivative"] = LawState(0.0, change)
        value = _apply_operator("+", value, _scaled(law.d, lagged))
    if law.i:
        integral: LawInstructions = (Instruction("name", "integral"),)
        value = _apply_operator("+", value, _scaled(law.i, integral))
        change = error
        if law.limits is not None:
            excess = _apply_operator("-", _apply_limits(value, law.limits), value)
            factor = 1.0 / (law.i * _tracking_time(law))
            change = _apply_operator("+", change, _scaled(factor, excess))
        if law.sample_time is not None:
            change = _apply_operator("+", integral, _scaled(law.sample_time, change))
        states["integral"] = LawState(0.0, change)
    return CompiledLaw(_apply_limits(value, law.limits), states, law.sample_time)


def _reference(
    reference: float | str | Function,
) -> tuple[LawInstructions, LawInstructions]:
    """What is wanted, and its rate."""
    if isinstance(reference, str):
        return (Instruction("name", reference),), (OutputRate(reference),)
    if isinstance(reference, float):
        return (_number_instruction(reference),), (_number_instruction(0.0),)
    return (TimeLaw(reference, 0),), (TimeLaw(reference, 1),)


def _tracking_time(law: Pid) -> float:
    """Time constant in which the integral follows the limits [s]: K.

    J. Astrom, T. Hagglund, "Advanced PID Control", section 3.5.
    """
    if law.anti_windup is not None:
        return law.anti_windup
    return math.sqrt(abs(law.d / law.i)) if law.d else abs(law.p / law.i)


def _grow(*values: Any) -> bool:
    """True if all are numbers, each greater than the one before."""
    try:
        numbers = [real_number(value) for value in values]
    except (TypeError, ValueError):
        return False
    return all(a < b for a, b in pairwise(numbers))


def _initial(value: Any, place: str) -> float:
    if not _grow(-math.inf, value, math.inf):
        raise InputError(f"found {value!r}", place=place, expected="an initial number")
    return real_number(value)


def _compile_program(law: Law, place: str) -> CompiledLaw:
    names = [*law.reads, *law.states]
    if isinstance(law.reads, str) or not all(isinstance(n, str) for n in law.reads):
        raise InputError(
            "what a law reads is no sequence of names",
            place=place,
            expected='reads=["elbow.angle", ...]',
        )
    if len(set(names)) < len(names):
        raise InputError("a law reads an output twice", place=place)
    limits = law.limits
    if limits is not None and not _grow(*limits):
        raise InputError(
            f"found limits {limits}", place=place, expected="a lower and an upper bound"
        )
    if law.sample_time is not None and not _grow(0.0, law.sample_time, math.inf):
        raise InputError(
            f"found a sample time of {law.sample_time}", place=place, expected="a time"
        )

    for name, state in law.states.items():
        if not (isinstance(state, tuple | list) and len(state) == 2):
            raise InputError(
                f"found {state!r}",
                place=f"{place}.states.{name}",
                expected="an initial value and a callable f(t, y)",
            )

    def callable_instructions(
        function: Any, derivatives: Any = None
    ) -> LawInstructions:
        for each in (function, derivatives):
            if each is not None and not callable(each):
                raise InputError(
                    f"found {each!r}", place=place, expected="a callable f(t, y)"
                )
        native = NativeCallable(function, len(names), derivatives)
        return (
            *(Instruction("name", name) for name in names),
            CallableInstruction(native),
        )

    states = {
        name: LawState(
            _initial(initial, f"{place}.states.{name}"), callable_instructions(change)
        )
        for name, (initial, change) in law.states.items()
    }
    value = _apply_limits(callable_instructions(law.function, law.derivatives), limits)
    return CompiledLaw(value, states, law.sample_time)
