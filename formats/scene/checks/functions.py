"""Checks of functions of time: one definition, growing times, the whole time span."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from ..functions import (
    Given,
    Harmonic,
    Piece,
    Polynomial,
    SineRamp,
    SmoothStep,
    Spline,
    Sum,
)
from ..laws import Expression, ForceFunction, Pid
from .failures import fail
from .laws import check_expression, check_pid

if TYPE_CHECKING:
    from ..file import Time


def check_function(function: ForceFunction, place: str, time: Time) -> None:
    """Raise what does not fit in a function or a law as `InputError` with its key."""
    if isinstance(function, Polynomial):
        _check_polynomial(function, place, time)
    elif isinstance(function, Harmonic):
        _check_harmonic(function, place)
    elif isinstance(function, Sum):
        for index, part in enumerate(function.parts):
            check_function(part, f"{place}.parts[{index}]", time)
    elif isinstance(function, SmoothStep | SineRamp):
        if not function.to > function.from_:
            fail(f"{place}.to", f"found {function.to}", f"more than {function.from_}")
        if isinstance(function, SineRamp):
            _check_offset(function, place)
    elif isinstance(function, Spline):
        _check_spline(function, place, time)
    elif isinstance(function, Given):
        _check_given(function, place, time)
    elif isinstance(function, Expression):
        check_expression(function, place)
    elif isinstance(function, Pid):
        check_pid(function, place)
        if not isinstance(function.reference, float | str):
            check_function(function.reference, f"{place}.reference", time)


def _check_offset(ramp: SineRamp, place: str) -> None:
    if ramp.of == "value" and ramp.offset != 0.0:
        fail(f"{place}.offset", "stands beside a ramp of the value", "start")


def _check_harmonic(function: Harmonic, place: str) -> None:
    both = function.frequency is not None and function.angular_frequency is not None
    if both or function.frequency == function.angular_frequency:
        found = "both are given" if both else "neither is given"
        fail(place, found, "one of frequency [Hz] and angular_frequency [rad/s]")


def _check_spline(function: Spline, place: str, time: Time) -> None:
    times, values = function.times, function.values
    if len(times) != len(values):
        found = f"has {len(values)} values for {len(times)} times"
        fail(f"{place}.values", found, "one value for each time")
    for earlier, later in pairwise(times):
        if not later > earlier:
            fail(f"{place}.times", f"{later} follows {earlier}", "growing times")
    if times[0] > time.start or times[-1] < time.end:
        found = f"goes from {times[0]} to {times[-1]}"
        fail(f"{place}.times", found, f"times from {time.start} to {time.end} at least")


def _check_given(function: Given, place: str, time: Time) -> None:
    """The pieces that a result keeps, if there are any."""
    edges, terms = function.edges, function.terms
    if len(edges) != len(terms) + bool(terms):
        found = f"has {len(edges)} edges for {len(terms)} pieces"
        fail(f"{place}.edges", found, "one more than pieces")
    if len({len(piece) for piece in terms} | {0}) > 2 or () in terms:
        fail(f"{place}.terms", "has pieces of several lengths", "one length")
    for earlier, later in pairwise(edges):
        if not later > earlier:
            fail(f"{place}.edges", f"{later} follows {earlier}", "growing times")
    if edges and (edges[0] > time.start or edges[-1] < time.end):
        found = f"goes from {edges[0]} to {edges[-1]}"
        fail(f"{place}.edges", found, f"times from {time.start} to {time.end} at least")


def _check_polynomial(function: Polynomial, place: str, time: Time) -> None:
    pieces = function.pieces
    for index, piece in enumerate(pieces):
        _check_piece(piece, f"{place}.pieces[{index}]")
    for index, (piece, later) in enumerate(pairwise(pieces)):
        here = f"{place}.pieces[{index + 1}].from"
        if piece.to is None:
            fail(f"{place}.pieces[{index}].to", "is missing", "the end of the piece")
        elif abs(later.from_ - piece.to) > 1e-12 * max(1.0, abs(piece.to)):
            fail(here, f"found {later.from_}", f"the end before it, {piece.to}")
    if pieces[0].from_ > time.start:
        found = f"begins at {pieces[0].from_}"
        fail(f"{place}.pieces[0].from", found, f"at most the start, {time.start}")
    last = pieces[-1].to
    if last is not None and last < time.end:
        expected = f"no `to`, or at least the end of the simulation, {time.end}"
        fail(f"{place}.pieces[{len(pieces) - 1}].to", f"ends at {last}", expected)


def _check_piece(piece: Piece, place: str) -> None:
    hermite = piece.start is not None and piece.end is not None
    partly = piece.start is not None or piece.end is not None
    if hermite == (piece.coefficients is not None) or (partly and not hermite):
        fail(place, "is not one polynomial", "coefficients, or start and end")
    if hermite and piece.to is None:
        fail(f"{place}.to", "is missing", "the end of the piece")
    if piece.to is not None and piece.to <= piece.from_:
        fail(f"{place}.to", f"found {piece.to}", f"a time after {piece.from_}")
