"""Functions of time, for drives and forces. A new kind is one class in `Function`."""

import math
from collections.abc import Sequence
from functools import cache
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..toml.tables import Entries, Field, Number, Numbers, OptionalNumber, Takes
from .base import Table
from .signal_files import SCALE, SignalTable

SIGNAL_FILE = (
    "CSV file, HDF5 file or result of sidtool with the times and values, relative to "
    "the scene; a scene that is read keeps their numbers"
)
TIME_COLUMN = "its column or dataset of times, by name or number; default the first"
VALUE_COLUMN = "its column or dataset of values, by name or number; default the second"
Values = tuple[float, ...]


class Constant(Table):
    """The same value at all times."""

    type: Literal["constant"] = "constant"
    value: Number = Field(description="of the function at all times")


class Piece(Table):
    """A polynomial on [from, to]: coefficients, or values and derivatives at the ends.

    `coefficients` are in powers of (t - from), lowest first. `start` and `end` hold
    the value and its derivatives by time at both ends (Hermite interpolation).
    """

    from_: Number = Field(alias="from", description="begin of the piece [s]")
    to: OptionalNumber = Field(default=None, description="end of the piece [s]")
    coefficients: Takes[Values | None, ArrayLike | None] = Field(
        default=None, min_length=1, description="of powers of t - from, lowest first"
    )
    start: Takes[Values | None, ArrayLike | None] = Field(
        default=None, min_length=1, description="value, rate, ... at `from`"
    )
    end: Takes[Values | None, ArrayLike | None] = Field(
        default=None, min_length=1, description="value, rate, ... at `to`"
    )


class Polynomial(Table):
    """A function of time in pieces of polynomials without gaps."""

    type: Literal["polynomial"] = "polynomial"
    pieces: Takes[tuple[Piece, ...], Sequence[Piece | Entries]] = Field(min_length=1)


class Harmonic(Table):
    """offset + amplitude sin(2 pi frequency t + phase)."""

    type: Literal["harmonic"] = "harmonic"
    offset: Number = Field(default=0.0, description="the mean")
    amplitude: Number = Field(description="the largest distance from the mean")
    frequency: OptionalNumber = Field(default=None, description="[Hz]")
    angular_frequency: OptionalNumber = Field(default=None, description="[rad/s]")
    phase: Number = Field(default=0.0, description="[rad]")


class SmoothStep(Table):
    """From one value to another by the polynomial that is flat at both ends.

    `continuity` derivatives vanish at `from` and `to`: 2 is a polynomial of degree 5,
    3 of degree 7. The value is `start` before and `end` after.
    """

    type: Literal["smooth_step"] = "smooth_step"
    from_: Number = Field(alias="from", description="begin of the step [s]")
    to: Number = Field(description="end of the step [s]")
    start: Number = Field(default=0.0, description="before")
    end: Number = Field(description="after")
    continuity: Literal[2, 3] = Field(default=2, description="continuous derivatives")


class SineRamp(Table):
    """From one value, or one rate, to another by a straight line with a sine on it.

    Between `from` and `to` it is start + (end - start) (x - sin(2 pi x) / 2 pi), with x
    from 0 to 1: it begins and ends without rate and acceleration. With `of = "rate"`
    that is the rate, so that an angle spins up to the rate `end`, and `offset` the
    value at `from`.
    """

    type: Literal["sine_ramp"] = "sine_ramp"
    from_: Number = Field(alias="from", description="begin of the ramp [s]")
    to: Number = Field(description="end of the ramp [s]")
    start: Number = Field(default=0.0, description="before")
    end: Number = Field(description="after")
    of: Literal["value", "rate"] = Field(default="value", description="what ramps")
    offset: Number = Field(default=0.0, description="of a rate: the value at `from`")


class Spline(SignalTable):
    """A table of values over time, joined by straight lines or by a smooth curve.

    `interpolation = "linear"`, the default of forces and of prescribed accelerations:
    straight lines; beyond its ends the first and the last value hold.
    `interpolation = "hold"`: each value until the next time; only where a jump is
    possible. `interpolation = "smooth"`, the default of prescribed positions and rates,
    whose derivatives are in the equations of motion: a cubic spline with two continuous
    derivatives; beyond its ends it goes on in a straight line. `ends` is what holds at
    both ends of the spline: `not-a-knot` (the outer two pieces are one polynomial),
    `clamped` (no slope) or `natural` (no curvature).
    """

    type: Literal["table"] = "table"
    file: str | None = Field(default=None, description=SIGNAL_FILE)
    time: str | int | None = Field(default=None, description=TIME_COLUMN)
    value: str | int | None = Field(default=None, description=VALUE_COLUMN)
    scale: float | None = Field(default=None, description=SCALE)
    times: Takes[Values, ArrayLike] = Field(
        default=(), min_length=2, description="[s], growing; or a file"
    )
    values: Takes[Values, ArrayLike] = Field(
        default=(), min_length=2, description="as many as there are times"
    )
    interpolation: Literal["hold", "linear", "smooth"] | None = Field(
        default=None,
        description="between the points: hold the last value, straight lines, or a "
        "cubic spline; default linear, of positions and rates smooth",
    )
    ends: Literal["not-a-knot", "clamped", "natural"] = Field(
        default="not-a-knot", description="what holds at both ends of a smooth curve"
    )


class Given(Table):
    """A function that a program hands to `compile_scene(..., drives={NAME: f})`, or in
    `forces` if it belongs to a force. Of it only values can be seen: what lasts less
    than 1/4096 of the run may be missed, unless `Timed(f, times=[...])` says where it
    is, or `shortest` how short.

    A result keeps what its run saw of it, in pieces: no program is needed any more."""

    type: Literal["callable"] = "callable"
    edges: Numbers = Field(
        default=(), description="where pieces begin and the last one ends [s]"
    )
    terms: Takes[tuple[tuple[float, ...], ...], ArrayLike] = Field(
        default=(),
        description="of each piece, coefficients of powers of x, which goes from -1 to "
        "1 in it, lowest first",
    )
    kinks: Numbers = Field(
        default=(), description="times at which it is not smooth [s]"
    )


class InputFunction(Table):
    """The value of an input of the scene, see `Input`."""

    type: Literal["input"] = "input"
    name: str = Field(description="of one of the inputs of the scene")


Single = Annotated[
    Constant | Polynomial | Harmonic | SmoothStep | SineRamp | Spline | InputFunction,
    Field(discriminator="type"),
]


class Sum(Table):
    """The sum of other functions, such as two harmonics or a ramp and a harmonic."""

    type: Literal["sum"] = "sum"
    parts: Takes[tuple[Single, ...], Sequence[Single | Entries]] = Field(
        min_length=1, description="functions of time"
    )


Function = Annotated[
    Constant
    | Polynomial
    | Harmonic
    | SmoothStep
    | SineRamp
    | Spline
    | InputFunction
    | Sum
    | Given,
    Field(discriminator="type"),
]


def coefficients(piece: Piece) -> Values:
    """Coefficients of a piece in powers of (t - from), lowest first.

    Hermite data are interpolated by the polynomial of least degree, found in the
    scaled time (t - from) / (to - from), where the system is well conditioned.
    """
    if piece.coefficients is not None:
        return piece.coefficients
    assert piece.start is not None and piece.end is not None and piece.to is not None
    length = piece.to - piece.from_
    orders = [*range(len(piece.start)), *range(len(piece.end))]
    given = np.array([*piece.start, *piece.end]) * length ** np.array(orders, float)
    matrix = _derivatives(len(piece.start), len(piece.end))
    scaled = np.linalg.solve(matrix, given)
    with np.errstate(over="ignore"):  # powers of a length without bounds
        powers = np.float64(length) ** np.arange(len(scaled))
    return tuple((scaled / powers).tolist())


@cache
def _derivatives(at_start: int, at_end: int) -> NDArray[np.float64]:
    """Return derivatives of powers 0, 1, ... at 0, then at 1, of as many orders as
    given.
    """
    count = at_start + at_end
    matrix = np.zeros((count, count))
    for row in range(at_start):
        matrix[row, row] = math.factorial(row)
    for row in range(at_end):
        for power in range(row, count):
            matrix[at_start + row, power] = math.perm(power, row)
    return matrix
