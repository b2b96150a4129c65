"""Derivatives in time of the value of a law, as instructions of a law: the chain rule.

With a law u(t, y, x) of outputs y and of states x' = r(t, y, x):

    u' = du/dt + sum_j du/dy_j y_j' + sum_i du/dx_i r_i

Drives with a law need the first two derivatives of what they prescribe.
"""

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import repeat
from typing import Any, Literal

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Instruction

from .callables import real_number
from .control_laws import (
    HELD_VALUE,
    CallableInstruction,
    CompiledLaw,
    LawInstruction,
    LawInstructions,
    LawState,
    OutputRate,
    TableLookup,
    TimeLaw,
)

#: An entry of the stack: its value and its rate, None for one that does not change.
StackEntry = tuple[LawInstructions, LawInstructions | None]
#: Functions whose rate jumps, or which jump themselves.
NONSMOOTH = ("abs", "min", "max")

PrescribedOrder = Literal["value", "rate", "acceleration"]


def time_derivative(
    parts: LawInstructions, states: Mapping[str, LawState], place: str, smooth: bool
) -> LawInstructions:
    """The rate of what a law yields.

    Parameters
    ----------
    states
        Of the law, which change continuously.
    place
        Of the law in the scene.
    smooth
        Whether the rate must not jump.

    Raises
    ------
    InputError
        It holds an acceleration, a callable or a jump.
    """
    stack: list[StackEntry] = []
    for part in parts:
        if isinstance(part, Instruction) and part.kind in _BINARY_RATES:
            right = stack.pop()
            stack.append(_binary_rate(part, stack.pop(), right, place, smooth))
        elif isinstance(part, Instruction) and part.kind in _UNARY_DERIVATIVES:
            stack.append(_unary_rate(part, stack.pop(), place, smooth))
        elif isinstance(part, TableLookup):
            stack.append(_lookup_rate(part, stack, place, smooth))
        else:
            stack.append(((part,), _leaf_rate(part, states, place)))
    return stack[0][1] or _number(0.0)


def _leaf_rate(
    part: LawInstruction, states: Mapping[str, LawState], place: str
) -> LawInstructions | None:
    if isinstance(part, CallableInstruction):
        raise InputError(
            "the derivatives of a callable, which a motion has to have, are not known",
            place=place,
            expected='of = "acceleration" of the drive, with a law that gives that',
        )
    if isinstance(part, TimeLaw) and part.order == 0:
        return (TimeLaw(part.function, 1),)
    if isinstance(part, OutputRate | TimeLaw):
        name = part.name if isinstance(part, OutputRate) else "a reference"
        raise InputError(
            f"what is prescribed needs the second derivative of {name}, which "
            "follows from all forces at the same instant, that of the drive among them",
            place=place,
            expected="what follows with a lag, such as the state x with x' = v and "
            f"v' = w**2*({name} - x) - 2*w*v of the law; or a gear, a coupling",
        )
    assert isinstance(part, Instruction)
    if part.kind == "time":
        return _number(1.0)
    if part.kind == "number":
        return None
    name = str(part.value)
    return states[name].change if name in states else (OutputRate(name),)


def _binary_rate(
    part: Instruction, left: StackEntry, right: StackEntry, place: str, smooth: bool
) -> StackEntry:
    (a, da), (b, db) = left, right
    value = (*a, *b, part)
    if da is None and db is None:
        return value, None
    if smooth and part.kind in NONSMOOTH:
        raise _nonsmooth_error(part.kind, place)
    return value, _BINARY_RATES[part.kind](a, b, da or _number(0.0), db or _number(0.0))


def _unary_rate(
    part: Instruction, entry: StackEntry, place: str, smooth: bool
) -> StackEntry:
    a, da = entry
    value = (*a, part)
    if da is None:
        return value, None
    if part.kind == "sign" or (smooth and part.kind in NONSMOOTH):
        raise _nonsmooth_error(part.kind, place)
    return value, _product(_UNARY_DERIVATIVES[part.kind](a), da)


def _lookup_rate(
    part: TableLookup, stack: list[StackEntry], place: str, smooth: bool
) -> StackEntry:
    """Of a table of one variable; takes it from the stack.

    Raises
    ------
    InputError
        Its rate jumps, or it has two variables.
    """
    table, (a, da) = part.table, stack.pop()
    if table.variables == 2:
        raise InputError(
            f"what is prescribed looks up {part.name}, a table of two variables, whose "
            "slopes jump",
            place=place,
            expected='a table of one variable; or of = "acceleration" of the drive',
        )
    value = (*a, part)
    if da is None:
        return value, None
    if table.interpolation == "hold" or (smooth and table.interpolation == "linear"):
        raise _nonsmooth_error(f"the table {part.name}", place)
    return value, _product((*a, replace(part, order=part.order + 1)), da)


def _nonsmooth_error(kind: str, place: str) -> InputError:
    return InputError(
        f"what is prescribed jumps, or its rate does, where {kind} bends: the speed of "
        "bodies cannot",
        place=place,
        expected="limits of the acceleration; or a smooth function, such as tanh",
    )


def _number(value: float) -> LawInstructions:
    return (Instruction("number", float(value)),)


def _apply_operator(kind: str, *operands: LawInstructions) -> LawInstructions:
    return (*(part for operand in operands for part in operand), Instruction(kind))


def _product(a: LawInstructions, b: LawInstructions) -> LawInstructions:
    return _apply_operator("*", a, b)


def _quotient(a: LawInstructions, b: LawInstructions) -> LawInstructions:
    return _apply_operator("/", a, b)


def _square(a: LawInstructions) -> LawInstructions:
    return _product(a, a)


def _plus_number(a: LawInstructions, number: float) -> LawInstructions:
    return _apply_operator("+", a, _number(number))


def _negative(a: LawInstructions) -> LawInstructions:
    return _apply_operator("negative", a)


def _power_rate(
    a: LawInstructions, b: LawInstructions, da: LawInstructions, db: LawInstructions
) -> LawInstructions:
    """b a^(b - 1) a' + a^b log(a) b'."""
    by_a = _product(_product(b, _apply_operator("**", a, _plus_number(b, -1.0))), da)
    if db == _number(0.0):
        return by_a
    return _apply_operator(
        "+",
        by_a,
        _product(_product(_apply_operator("**", a, b), _apply_operator("log", a)), db),
    )


def _extremum_rate(
    sign: float,
) -> Callable[
    [LawInstructions, LawInstructions, LawInstructions, LawInstructions],
    LawInstructions,
]:
    """Of the larger (1) or the smaller one (-1): (a' + b' + sign(a - b) (a' - b'))/2,
    with the sign turned for the smaller one."""

    def rate(
        a: LawInstructions, b: LawInstructions, da: LawInstructions, db: LawInstructions
    ) -> LawInstructions:
        larger = _product(
            _number(sign), _apply_operator("sign", _apply_operator("-", a, b))
        )
        total = _apply_operator(
            "+",
            _apply_operator("+", da, db),
            _product(larger, _apply_operator("-", da, db)),
        )
        return _product(_number(0.5), total)

    return rate


_BINARY_RATES: dict[
    str,
    Callable[
        [LawInstructions, LawInstructions, LawInstructions, LawInstructions],
        LawInstructions,
    ],
] = {
    "+": lambda a, b, da, db: _apply_operator("+", da, db),
    "-": lambda a, b, da, db: _apply_operator("-", da, db),
    "*": lambda a, b, da, db: _apply_operator("+", _product(da, b), _product(a, db)),
    "/": lambda a, b, da, db: _quotient(
        _apply_operator("-", _product(da, b), _product(a, db)), _square(b)
    ),
    "**": _power_rate,
    "max": _extremum_rate(1.0),
    "min": _extremum_rate(-1.0),
    "atan2": lambda a, b, da, db: _quotient(
        _apply_operator("-", _product(da, b), _product(a, db)),
        _apply_operator("+", _square(a), _square(b)),
    ),
}
#: Slopes.
_UNARY_DERIVATIVES: dict[str, Callable[[LawInstructions], LawInstructions]] = {
    "negative": lambda a: _number(-1.0),
    "sin": lambda a: _apply_operator("cos", a),
    "cos": lambda a: _negative(_apply_operator("sin", a)),
    "tan": lambda a: _plus_number(_square(_apply_operator("tan", a)), 1.0),
    "asin": lambda a: _quotient(
        _number(1.0), _apply_operator("sqrt", _plus_number(_negative(_square(a)), 1.0))
    ),
    "acos": lambda a: _quotient(
        _number(-1.0), _apply_operator("sqrt", _plus_number(_negative(_square(a)), 1.0))
    ),
    "atan": lambda a: _quotient(_number(1.0), _plus_number(_square(a), 1.0)),
    "sinh": lambda a: _apply_operator("cosh", a),
    "cosh": lambda a: _apply_operator("sinh", a),
    "tanh": lambda a: _plus_number(_negative(_square(_apply_operator("tanh", a))), 1.0),
    "exp": lambda a: _apply_operator("exp", a),
    "log": lambda a: _quotient(_number(1.0), a),
    "sqrt": lambda a: _quotient(_number(0.5), _apply_operator("sqrt", a)),
    "abs": lambda a: _apply_operator("sign", a),
    "sign": lambda a: _number(0.0),
}


#: Operators that give arrays the same bits as numbers, and raise nothing.
_ARRAY_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
}
_BINARY_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "/": operator.truediv,
    "**": math.pow,
    "min": min,
    "max": max,
    "atan2": math.atan2,
}
_UNARY_OPERATORS: dict[str, Callable[[Any], Any]] = {
    "negative": operator.neg,
    "abs": abs,
    "sign": np.sign,
}


def function_of_time(parts: LawInstructions) -> Callable[[Array], Array] | None:
    """Values (nt,) of a law at times (nt,) while all that it reads is one; None for a
    law that does not look at the time.

    Functions of time in it are known as such.
    """
    looks = [
        isinstance(p, CallableInstruction) or getattr(p, "kind", "") == "time"
        for p in parts
    ]
    if not any(looks):
        return None

    return lambda t: np.array(np.broadcast_to(_law_value(parts, t, {}), t.shape), float)


def evaluate_law(parts: LawInstructions, t: float, known: Mapping[str, float]) -> float:
    """The value of a law where all that it reads is one, but for what is known."""
    return float(_law_value(parts, t, known))


def _law_value(
    parts: LawInstructions, t: float | Array, known: Mapping[str, float]
) -> Any:
    """The value at a time; the values (nt,), or the only one, at times (nt,)."""
    stack: list[Any] = []
    with np.errstate(over="ignore", invalid="ignore"):  # as of floats
        for part in parts:
            _execute(part, stack, t, known)
    return stack[0]


def _each(function: Callable[..., Any], *operands: Any) -> Any:
    """A function of numbers for each row of operands of which some are arrays."""
    if not any(isinstance(operand, np.ndarray) for operand in operands):
        return function(*operands)
    rows = (o.tolist() if isinstance(o, np.ndarray) else repeat(o) for o in operands)
    return np.array(list(map(function, *rows)), float)


def _execute(
    part: Any, stack: list[Any], t: float | Array, known: Mapping[str, float]
) -> None:
    if isinstance(part, CallableInstruction):
        native = part.native
        values = stack[len(stack) - native.count :]
        del stack[len(stack) - native.count :]

        def number(t: float, *values: float) -> float:
            return real_number(native.function(t, np.array(values, float)))

        try:
            stack.append(_each(number, t, *values))
        except Exception as error:
            raise ValueError(str(error)) from None
    elif isinstance(part, TableLookup):
        first = len(stack) - part.table.variables
        point = stack[first:]
        del stack[first:]
        if len(point) == 1 and isinstance(point[0], np.ndarray):
            stack.append(part.values(point[0]))
        else:
            stack.append(_each(lambda *x: part.value(*map(float, x)), *point))
    elif not isinstance(part, Instruction):
        stack.append(1.0)
    elif part.kind == "name":
        stack.append(known.get(str(part.value), 1.0))
    elif part.kind in ("number", "time"):
        stack.append(part.value if part.kind == "number" else t)
    elif part.kind in _ARRAY_OPERATORS:
        right = stack.pop()
        stack.append(_ARRAY_OPERATORS[part.kind](stack.pop(), right))
    elif part.kind in _BINARY_OPERATORS:
        right = stack.pop()
        stack.append(_each(_BINARY_OPERATORS[part.kind], stack.pop(), right))
    elif part.kind in _UNARY_OPERATORS:
        stack.append(_UNARY_OPERATORS[part.kind](stack.pop()))
    else:
        stack.append(_each(getattr(math, part.kind), stack.pop()))


def prescribed_law(
    law: CompiledLaw, of: PrescribedOrder, start: float, start_rate: float, place: str
) -> CompiledLaw:
    """The law of a drive with what it prescribes, and the states that takes.

    Parameters
    ----------
    of
        What the law gives.
    start, start_rate
        Of a rate or an acceleration, where it starts.

    Raises
    ------
    InputError
        What it prescribes has no two derivatives that are known without accelerations,
        or jumps.
    """
    is_sampled = law.sample_time is not None
    if of == "acceleration":
        held_value: LawInstructions = (Instruction("name", HELD_VALUE),)
        acceleration = held_value if is_sampled else law.value
        value, rate = _state_instruction("value"), _state_instruction("rate")
        states = {
            "value": LawState(start, rate),
            "rate": LawState(start_rate, acceleration),
        }
        return replace(
            law, prescribed=(value, rate, acceleration), integrated_states=states
        )
    if is_sampled:
        raise InputError(
            f"a sampled law gives the {of}, which would jump at each sample",
            place=f"{place}.sample_time",
            expected='of = "acceleration", which may jump: to follow a command that is '
            'sampled, value = "w**2*(command - value) - 2*w*rate", or a speed that is '
            'reached at the next sample, value = "(command - rate)/SAMPLE_TIME"',
        )
    if of == "rate":
        states = {"value": LawState(start, law.value)}
        second = time_derivative(
            law.value, {**law.states, **states}, place, smooth=False
        )
        return replace(
            law,
            prescribed=(_state_instruction("value"), law.value, second),
            integrated_states=states,
        )
    first = time_derivative(law.value, law.states, place, smooth=True)
    second = time_derivative(first, law.states, place, smooth=False)
    return replace(law, prescribed=(law.value, first, second))


def initial_value(law: CompiledLaw, t: float, place: str) -> float:
    """Where a drive starts.

    Raises
    ------
    InputError
        Its law gives no number there.
    """
    assert law.prescribed is not None
    known = {
        name: kept.initial
        for name, kept in {**law.states, **law.integrated_states}.items()
    }
    try:
        value = evaluate_law(law.prescribed[0], t, known)
    except (ValueError, ArithmeticError):
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            f"gives no finite number at the start, t = {t:.6g} s",
            place=place,
            expected="a formula that is defined there",
        )
    return value


def _state_instruction(name: str) -> LawInstructions:
    return (Instruction("name", name),)
