"""Drives that follow laws: what they prescribe, with two derivatives.

All reduce to one case, a value s with s' and s'' that are known at a state, none of
which holds accelerations: a law of s itself is differentiated, one of s' or s'' is
added up by states of its own.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

from sidtool.formats.errors import InputError
from sidtool.formats.scene import Instruction

from .law_rates import rate_of
from .law_times import value_at
from .laws import HELD, Kept, LawParts, Parts

Order = Literal["value", "rate", "acceleration"]


def led_by(
    law: LawParts, of: Order, start: float, start_rate: float, place: str
) -> LawParts:
    """The law of a drive with what it prescribes, and the states that takes.

    Parameters
    ----------
    of : what the law gives
    start, start_rate : of a rate or an acceleration, where it starts

    Raises
    ------
    InputError : what it prescribes has no two derivatives that are known without
        accelerations, or jumps.
    """
    is_sampled = law.sample_time is not None
    if of == "acceleration":
        held: Parts = (Instruction("name", HELD),)
        follows = held if is_sampled else law.value
        value, rate = _state("value"), _state("rate")
        states = {"value": Kept(start, rate), "rate": Kept(start_rate, follows)}
        return replace(law, led=(value, rate, follows), followed=states)
    if is_sampled:
        raise InputError(
            f"a sampled law gives the {of}, which would jump at each sample",
            place=f"{place}.sample_time",
            expected='of = "acceleration", which may jump: to follow a command that is '
            'sampled, value = "w**2*(command - value) - 2*w*rate", or a speed that is '
            'reached at the next sample, value = "(command - rate)/SAMPLE_TIME"',
        )
    if of == "rate":
        states = {"value": Kept(start, law.value)}
        second = rate_of(law.value, {**law.states, **states}, place, smooth=False)
        return replace(law, led=(_state("value"), law.value, second), followed=states)
    first = rate_of(law.value, law.states, place, smooth=True)
    second = rate_of(first, law.states, place, smooth=False)
    return replace(law, led=(law.value, first, second))


def value_at_start(law: LawParts, t: float, place: str) -> float:
    """Where a drive starts.

    Raises
    ------
    InputError : its law gives no number there.
    """
    assert law.led is not None
    known = {
        name: kept.initial for name, kept in {**law.states, **law.followed}.items()
    }
    try:
        value = value_at(law.led[0], t, known)
    except (ValueError, ArithmeticError):
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            f"gives no finite number at the start, t = {t:.6g} s",
            place=place,
            expected="a formula that is defined there",
        )
    return value


def _state(name: str) -> Parts:
    return (Instruction("name", name),)
