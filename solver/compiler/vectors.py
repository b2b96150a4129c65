"""Short vectors and matrices in kernels, and formulas on them.

A `Vector` has one, two or three components: an angular velocity is a Vector(1) in the
plane and a Vector(3) in space. Formulas are plain Python functions of values, numbers,
arrays and records, without branches on numbers. Where a kernel calls a formula, it is
executed twice during compilation: on placeholders, for the type of its result, and on
numbers in machine code, which writes its operations inline. In Python the same function
computes with floats, complex numbers or arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

from .types import KernelType

#: Formulas that the compiler does not know yet.
new_formulas: list[Callable[..., Any]] = []


class KernelValue(tuple[Any, ...]):
    """Some numbers that are added and scaled together."""

    __slots__ = ()
    __array_ufunc__ = None

    def __new__(cls, *numbers: Any) -> Self:
        return super().__new__(cls, numbers)

    def __add__(self, other: Any) -> Self:
        return type(self)(*(a + b for a, b in zip(self, other, strict=True)))

    def __sub__(self, other: Any) -> Self:
        return type(self)(*(a - b for a, b in zip(self, other, strict=True)))

    def __neg__(self) -> Self:
        return type(self)(*(-a for a in self))

    def __rmul__(self, factor: Any) -> Self:
        return type(self)(*(factor * a for a in self))

    __mul__ = __rmul__


class Vector(KernelValue):
    """Components of a translation or a rotation."""


class Rotation(KernelValue):
    """A rotation: its cosine and sine, or its matrix by rows."""


class SymmetricMatrix(KernelValue):
    """A symmetric matrix on rotations: a number, or xx, yy, zz, xy, xz, yz."""


class ValueType(KernelType):
    """The compiled type of a value."""

    def __init__(self, python: type[KernelValue], size: int) -> None:
        self.python, self.size = python, size
        super().__init__(f"{python.__name__}({size})")


def formula(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of values, numbers and arrays that kernels may call."""
    new_formulas.append(function)
    function.py_func = function  # type: ignore[attr-defined]
    return function
