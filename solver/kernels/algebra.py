"""Formulas of plane and space: nothing else in the equations knows a dimension.

In the plane translations have two components and rotations one; in space both have
three.
"""

from __future__ import annotations

from typing import Any

from .values import Turn, Vector, formula


def _directions(x: Vector) -> list[Vector]:
    """Unit vectors along the axes of vectors like x."""
    many = range(len(x))
    return [Vector(*(1.0 if i == j else 0.0 for i in many)) for j in many]


@formula
def size(x: Vector) -> int:
    """How many components it has."""
    return len(x)


@formula
def zero(x: Vector) -> Vector:
    return Vector(*[0.0] * len(x))


@formula
def unit(x: Vector, i: Any) -> Vector:
    """The i-th unit vector of those like x."""
    return Vector(*(i.matches(j) for j in range(len(x))))


@formula
def load(x: Vector, a: Any, at: Any) -> Vector:
    """A vector like x that stands at `at`."""
    return type(x)(*(a[at + i] for i in range(len(x))))


@formula
def store(a: Any, at: Any, x: Vector) -> None:
    for i, part in enumerate(x):
        a[at + i] = part


@formula
def column(x: Vector, a: Any, at: Any, stride: Any, k: Any) -> Vector:
    """Entry k of consecutive rows of length `stride`, a vector like x."""
    return type(x)(*(a[at + i * stride + k] for i in range(len(x))))


@formula
def add_row(a: Any, at: Any, x: Vector) -> None:
    for i, part in enumerate(x):
        a[at + i] = a[at + i] + part


@formula
def add_column(a: Any, at: Any, stride: Any, x: Vector) -> None:
    for i, part in enumerate(x):
        place = at + i * stride
        a[place] = a[place] + part


@formula
def dot(a: Vector, b: Vector) -> Any:
    return sum(x * y for x, y in zip(a, b, strict=True))


@formula
def cross(a: Vector, b: Vector) -> Vector:
    """In the plane of two translations, of a rotation and a translation, or of two
    rotations, which is nothing."""
    if len(a) == 3:
        return Vector(
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        )
    if len(a) == len(b) == 2:
        return Vector(a[0] * b[1] - a[1] * b[0])
    if len(b) == 2:
        return Vector(-a[0] * b[1], a[0] * b[0])
    if len(a) == 2:
        return Vector(b[0] * a[1], -b[0] * a[0])
    return Vector(0.0)


@formula
def rotate(R: Turn, x: Vector) -> Vector:
    """Turned by R; rotations in the plane stay."""
    if len(x) == 1:
        return x
    if len(x) == 2:
        return Vector(R[0] * x[0] - R[1] * x[1], R[1] * x[0] + R[0] * x[1])
    return Vector(*(dot(Vector(*R[i : i + 3]), x) for i in (0, 3, 6)))


@formula
def back(R: Turn, x: Vector) -> Vector:
    """Turned backwards."""
    if len(x) == 1:
        return x
    if len(x) == 2:
        return Vector(R[0] * x[0] + R[1] * x[1], R[0] * x[1] - R[1] * x[0])
    return Vector(*(dot(Vector(*R[i::3]), x) for i in range(3)))


def _add_matrix(out: Any, at: Any, stride: Any, columns: list[Vector]) -> None:
    for j, entries in enumerate(columns):
        add_column(out, at + j, stride, entries)


@formula
def add_cross(out: Any, at: Any, stride: Any, a: Vector, x: Vector) -> None:
    """Adds the matrix that makes cross(a, x) of vectors like x."""
    _add_matrix(out, at, stride, [cross(a, e) for e in _directions(x)])


@formula
def add_twice_cross(
    out: Any, at: Any, stride: Any, a: Vector, b: Vector, x: Vector
) -> None:
    """Adds the matrix that makes cross(a, cross(b, x)) of vectors like x."""
    _add_matrix(out, at, stride, [cross(a, cross(b, e)) for e in _directions(x)])
