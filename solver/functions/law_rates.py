"""Derivatives in time of what laws yield, as instructions: the chain rule.

With u(t, y, x) of outputs y and of states x' = r(t, y, x),

    u' = du/dt + sum_j du/dy_j y_j' + sum_i du/dx_i r_i,

where y' is known of positions, but not of velocities, whose rates are accelerations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from sidtool.formats.errors import InputError
from sidtool.formats.scene import Instruction

from .laws import Called, Kept, Part, Parts, RateOf, Timing

#: An entry of the stack: its value and its rate, None for one that does not change.
Entry = tuple[Parts, Parts | None]
#: Functions whose rate jumps, or which jump themselves.
BENT = ("abs", "min", "max")


def rate_of(
    parts: Parts, states: Mapping[str, Kept], place: str, smooth: bool
) -> Parts:
    """The rate of what a law yields.

    Parameters
    ----------
    states : of the law, which change continuously
    place : of the law in the scene
    smooth : whether the rate must not jump

    Raises
    ------
    InputError : it holds an acceleration, a callable or a jump.
    """
    stack: list[Entry] = []
    for part in parts:
        if isinstance(part, Instruction) and part.kind in _TWO:
            right = stack.pop()
            stack.append(_of_two(part, stack.pop(), right, place, smooth))
        elif isinstance(part, Instruction) and part.kind in _ONE:
            stack.append(_of_one(part, stack.pop(), place, smooth))
        else:
            stack.append(((part,), _of_leaf(part, states, place)))
    return stack[0][1] or _number(0.0)


def _of_leaf(part: Part, states: Mapping[str, Kept], place: str) -> Parts | None:
    if isinstance(part, Called):
        raise InputError(
            "the derivatives of a callable, which a motion has to have, are not known",
            place=place,
            expected='of = "acceleration" of the drive, with a law that gives that',
        )
    if isinstance(part, Timing) and part.order == 0:
        return (Timing(part.function, 1),)
    if isinstance(part, RateOf | Timing):
        name = part.name if isinstance(part, RateOf) else "a reference"
        raise InputError(
            f"what is prescribed needs the second derivative of {name}, which "
            "follows from all forces at the same instant, that of the drive among them",
            place=place,
            expected="what follows with a lag, such as the state x with x' = v and "
            f"v' = w**2*({name} - x) - 2*w*v of the law; or a gear, a coupling",
        )
    if part.kind == "time":
        return _number(1.0)
    if part.kind == "number":
        return None
    name = str(part.value)
    return states[name].change if name in states else (RateOf(name),)


def _of_two(
    part: Instruction, left: Entry, right: Entry, place: str, smooth: bool
) -> Entry:
    (a, da), (b, db) = left, right
    value = (*a, *b, part)
    if da is None and db is None:
        return value, None
    if smooth and part.kind in BENT:
        raise _bent(part.kind, place)
    return value, _TWO[part.kind](a, b, da or _number(0.0), db or _number(0.0))


def _of_one(part: Instruction, entry: Entry, place: str, smooth: bool) -> Entry:
    a, da = entry
    value = (*a, part)
    if da is None:
        return value, None
    if part.kind == "sign" or (smooth and part.kind in BENT):
        raise _bent(part.kind, place)
    return value, _times(_ONE[part.kind](a), da)


def _bent(kind: str, place: str) -> InputError:
    return InputError(
        f"what is prescribed jumps, or its rate does, where {kind} bends: the speed of "
        "bodies cannot",
        place=place,
        expected="limits of the acceleration; or a smooth function, such as tanh",
    )


def _number(value: float) -> Parts:
    return (Instruction("number", float(value)),)


def _op(kind: str, *operands: Parts) -> Parts:
    return (*(part for operand in operands for part in operand), Instruction(kind))


def _times(a: Parts, b: Parts) -> Parts:
    return _op("*", a, b)


def _over(a: Parts, b: Parts) -> Parts:
    return _op("/", a, b)


def _square(a: Parts) -> Parts:
    return _times(a, a)


def _plus(a: Parts, number: float) -> Parts:
    return _op("+", a, _number(number))


def _minus(a: Parts) -> Parts:
    return _op("negative", a)


def _power(a: Parts, b: Parts, da: Parts, db: Parts) -> Parts:
    """b a^(b - 1) a' + a^b log(a) b'."""
    by_a = _times(_times(b, _op("**", a, _plus(b, -1.0))), da)
    if db == _number(0.0):
        return by_a
    return _op("+", by_a, _times(_times(_op("**", a, b), _op("log", a)), db))


def _chosen(sign: float) -> Callable[[Parts, Parts, Parts, Parts], Parts]:
    """Of the larger (1) or the smaller one (-1): (a' + b' + sign(a - b) (a' - b'))/2,
    with the sign turned for the smaller one."""

    def rate(a: Parts, b: Parts, da: Parts, db: Parts) -> Parts:
        larger = _times(_number(sign), _op("sign", _op("-", a, b)))
        total = _op("+", _op("+", da, db), _times(larger, _op("-", da, db)))
        return _times(_number(0.5), total)

    return rate


_TWO: dict[str, Callable[[Parts, Parts, Parts, Parts], Parts]] = {
    "+": lambda a, b, da, db: _op("+", da, db),
    "-": lambda a, b, da, db: _op("-", da, db),
    "*": lambda a, b, da, db: _op("+", _times(da, b), _times(a, db)),
    "/": lambda a, b, da, db: _over(_op("-", _times(da, b), _times(a, db)), _square(b)),
    "**": _power,
    "max": _chosen(1.0),
    "min": _chosen(-1.0),
    "atan2": lambda a, b, da, db: _over(
        _op("-", _times(da, b), _times(a, db)), _op("+", _square(a), _square(b))
    ),
}
#: Slopes.
_ONE: dict[str, Callable[[Parts], Parts]] = {
    "negative": lambda a: _number(-1.0),
    "sin": lambda a: _op("cos", a),
    "cos": lambda a: _minus(_op("sin", a)),
    "tan": lambda a: _plus(_square(_op("tan", a)), 1.0),
    "asin": lambda a: _over(_number(1.0), _op("sqrt", _plus(_minus(_square(a)), 1.0))),
    "acos": lambda a: _over(_number(-1.0), _op("sqrt", _plus(_minus(_square(a)), 1.0))),
    "atan": lambda a: _over(_number(1.0), _plus(_square(a), 1.0)),
    "sinh": lambda a: _op("cosh", a),
    "cosh": lambda a: _op("sinh", a),
    "tanh": lambda a: _plus(_minus(_square(_op("tanh", a))), 1.0),
    "exp": lambda a: _op("exp", a),
    "log": lambda a: _over(_number(1.0), a),
    "sqrt": lambda a: _over(_number(0.5), _op("sqrt", a)),
    "abs": lambda a: _op("sign", a),
    "sign": lambda a: _number(0.0),
}
