"""Drives: a joint's coordinate as a function of time."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field

from .base import Table

Values = tuple[float, ...]


class Piece(Table):
    """A polynomial on [from, to]: coefficients, or values and derivatives at the ends.

    `coefficients` are in powers of (t - from), lowest first. `start` and `end` hold
    the value and its derivatives by time at both ends (Hermite interpolation).
    """

    from_: float = Field(alias="from", description="begin of the piece [s]")
    to: float | None = Field(default=None, description="end of the piece [s]")
    coefficients: Values | None = Field(default=None, min_length=1)
    start: Values | None = Field(default=None, min_length=1)
    end: Values | None = Field(default=None, min_length=1)


class Polynomial(Table):
    """A function of time in pieces of polynomials without gaps."""

    type: Literal["polynomial"]
    pieces: tuple[Piece, ...] = Field(min_length=1)


#: Kinds of functions of time: a further one joins as a union by ``type``.
Function = Polynomial


class Drive(Table):
    """Prescribes the coordinate of a revolute or prismatic joint."""

    joint: str = Field(description="name of a revolute or prismatic joint")
    function: Function


def coefficients(piece: Piece) -> Values:
    """Coefficients of a piece in powers of (t - from), lowest first.

    Hermite data are interpolated by the polynomial of least degree, found in the
    scaled time (t - from) / (to - from), where the system is well conditioned.
    """
    if piece.coefficients is not None:
        return piece.coefficients
    assert piece.start is not None and piece.end is not None and piece.to is not None
    length = piece.to - piece.from_
    count = len(piece.start) + len(piece.end)
    matrix = np.zeros((count, count))
    for row in range(len(piece.start)):
        matrix[row, row] = math.factorial(row)
    for row in range(len(piece.end)):
        for power in range(row, count):
            matrix[len(piece.start) + row, power] = math.perm(power, row)
    orders = [*range(len(piece.start)), *range(len(piece.end))]
    given = np.array([*piece.start, *piece.end]) * length ** np.array(orders, float)
    scaled = np.linalg.solve(matrix, given)
    return tuple(float(c) / length**power for power, c in enumerate(scaled))
