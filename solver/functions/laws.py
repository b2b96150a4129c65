"""Laws as instructions for a stack: from formulas, controllers and callables."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

from sidtool.formats.errors import InputError
from sidtool.formats.scene import (
    Expression,
    Function,
    Instruction,
    Pid,
    Postfix,
    parse_expression,
)
from sidtool.formats.sid import Array

from .native import Native
from .returned_values import real_number

#: A function of the time and of what a law reads.
OfOutputs = Callable[[float, Array], float]
Slopes = Callable[[float, Array], Sequence[float]]


@dataclass(frozen=True, eq=False)
class Law:
    """A force as a function of outputs of the motion, for `compile_scene(forces=...)`.

    It replaces the function of a force or an actuator; among `drives`, that of a drive
    with `of = "acceleration"`. Where numba can compile the
    callables they are called at the cost of compiled code, else through Python. They
    must depend on t and y alone: methods ask for trial states, and again after steps
    that fail. What a controller remembers are its `states`.

    Attributes
    ----------
    function : f(t, y) [N] or [N m], of a drive [m/s2] or [rad/s2]; y holds what is
        read, then the states, in order
    reads : names of outputs, such as "elbow.angle": positions and velocities
    derivatives : of f by y, (len(y),); default by differences. Newton's iteration
        uses them, the motion does not depend on them
    states : initial value and rate f(t, y) of numbers that follow x' = f; with a
        sample time f gives the next value
    limits : lower and upper bound of the value
    sample_time : time between samples [s], between which the value is held
    """

    function: OfOutputs
    reads: Sequence[str]
    derivatives: Slopes | None = None
    states: Mapping[str, tuple[float, OfOutputs]] = field(default_factory=dict)
    limits: tuple[float, float] | None = None
    sample_time: float | None = None


@dataclass(frozen=True, eq=False)
class Called:
    """A callable among the instructions, which takes `native.count` entries."""

    native: Native


@dataclass(frozen=True, eq=False)
class Timing:
    """A function of time among the instructions, or its rate."""

    function: Function
    order: int


@dataclass(frozen=True, eq=False)
class RateOf:
    """The rate of an output among the instructions."""

    name: str


#: State of a sampled law: what it holds. No name in a scene has a space.
HELD = "held value"
#: What a program is made of.
Part = Instruction | Called | Timing | RateOf
Parts = tuple[Part, ...]


@dataclass(frozen=True, eq=False)
class Kept:
    """A state of a law: its value at the start, and its rate or its next value."""

    initial: float
    change: Parts


@dataclass(frozen=True, eq=False)
class LawParts:
    """A law in instructions.

    value : what scales the force
    states : by name
    sample_time : [s], or None for a continuous law
    led : of the law of a drive, what it prescribes and two derivatives of that
    followed : states in which its value adds up, which no samples hold
    """

    value: Parts
    states: Mapping[str, Kept]
    sample_time: float | None
    led: tuple[Parts, Parts, Parts] | None = None
    followed: Mapping[str, Kept] = field(default_factory=dict)


def continuous(law: Expression | Pid | Law, place: str) -> Expression | Pid | Law:
    """The law without its samples.

    Raises
    ------
    InputError : it keeps states that are known at samples only.
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


def law_parts(law: Expression | Pid | Law | Function, place: str) -> LawParts:
    """A law of a scene or of a program in instructions; a function of time is one.

    Raises
    ------
    InputError : it is not sound.
    """
    if isinstance(law, Expression):
        return _of_expression(law)
    if isinstance(law, Pid):
        return _of_pid(law)
    if isinstance(law, Law):
        return _of_program(law, place)
    return LawParts((Timing(law, 0),), {}, None)


def _number(value: float) -> Part:
    return Instruction("number", float(value))


def _apply(kind: str, *operands: Parts) -> Parts:
    """An operator on operands."""
    return (*(part for operand in operands for part in operand), Instruction(kind))


def _scaled(factor: float, operand: Parts) -> Parts:
    return _apply("*", (_number(factor),), operand)


def _limited(value: Parts, limits: tuple[float, float] | None) -> Parts:
    if limits is None:
        return value
    above = _apply("max", value, (_number(limits[0]),))
    return _apply("min", above, (_number(limits[1]),))


def _of_expression(law: Expression) -> LawParts:
    def parsed(text: str | None) -> Postfix:
        assert text is not None
        return parse_expression(text, law.known)

    key = "rate" if law.sample_time is None else "next"
    states = {
        name: Kept(state.initial, parsed(getattr(state, key)))
        for name, state in law.states.items()
    }
    value = _limited(parsed(law.value), law.limits)
    return LawParts(value, states, law.sample_time)


def _of_pid(law: Pid) -> LawParts:
    measured: Parts = (Instruction("name", law.measured),)
    reference, wanted_rate = _reference(law.reference)
    error = _apply("-", reference, measured)
    slope = _apply("-", wanted_rate, (RateOf(law.measured),))
    states: dict[str, Kept] = {}
    value = _scaled(law.p, error)
    if law.d:
        lagged: Parts = slope
        if law.filter is not None:
            lagged = (Instruction("name", "derivative"),)
            behind = _apply("-", slope, lagged)
            change = _scaled(1.0 / law.filter, behind)
            if law.sample_time is not None:
                share = -math.expm1(-law.sample_time / law.filter)
                lagged = change = _apply("+", lagged, _scaled(share, behind))
            states["derivative"] = Kept(0.0, change)
        value = _apply("+", value, _scaled(law.d, lagged))
    if law.i:
        integral: Parts = (Instruction("name", "integral"),)
        value = _apply("+", value, _scaled(law.i, integral))
        change = error
        if law.limits is not None:
            excess = _apply("-", _limited(value, law.limits), value)
            factor = 1.0 / (law.i * _tracking(law))
            change = _apply("+", change, _scaled(factor, excess))
        if law.sample_time is not None:
            change = _apply("+", integral, _scaled(law.sample_time, change))
        states["integral"] = Kept(0.0, change)
    return LawParts(_limited(value, law.limits), states, law.sample_time)


def _reference(reference: float | str | Function) -> tuple[Parts, Parts]:
    """What is wanted, and its rate."""
    if isinstance(reference, str):
        return (Instruction("name", reference),), (RateOf(reference),)
    if isinstance(reference, float):
        return (_number(reference),), (_number(0.0),)
    return (Timing(reference, 0),), (Timing(reference, 1),)


def _tracking(law: Pid) -> float:
    """Time constant in which the integral follows the limits [s]: K. J. Astrom,
    T. Hagglund, "Advanced PID Control", section 3.5."""
    if law.anti_windup is not None:
        return law.anti_windup
    return math.sqrt(abs(law.d / law.i)) if law.d else abs(law.p / law.i)


def _grow(*values: Any) -> bool:
    """Whether all are numbers, each greater than the one before."""
    try:
        numbers = [real_number(value) for value in values]
    except (TypeError, ValueError):
        return False
    return all(a < b for a, b in pairwise(numbers))


def _initial(value: Any, place: str) -> float:
    if not _grow(-math.inf, value, math.inf):
        raise InputError(f"found {value!r}", place=place, expected="an initial number")
    return real_number(value)


def _of_program(law: Law, place: str) -> LawParts:
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

    def called(function: Any, derivatives: Any = None) -> Parts:
        for each in (function, derivatives):
            if each is not None and not callable(each):
                raise InputError(
                    f"found {each!r}", place=place, expected="a callable f(t, y)"
                )
        native = Native(function, len(names), derivatives)
        return (*(Instruction("name", name) for name in names), Called(native))

    states = {
        name: Kept(_initial(initial, f"{place}.states.{name}"), called(change))
        for name, (initial, change) in law.states.items()
    }
    value = _limited(called(law.function, law.derivatives), limits)
    return LawParts(value, states, law.sample_time)
