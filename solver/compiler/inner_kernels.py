"""Kernels that only kernels call, compiled once and linked into their callers.

numba would optimise and translate a called kernel again for each of its callers.
Therefore each inner kernel is compiled to one LLVM unit, and the units are linked.
The module also holds the dot product over consecutive reals, which LLVM vectorises,
and the division of complex numbers.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import FunctionType
from typing import Any

from llvmlite import ir

from .types import KernelType, complex128, int64

LANES = 8
#: Kernels are compiled one after the other.
lock = threading.RLock()
_INDEX, _INT32, _REAL = ir.IntType(64), ir.IntType(32), ir.DoubleType()


class KernelChoice:
    """What kernels call: one kernel, or several for different types of arguments."""

    def kernel_for(self, arguments: tuple[KernelType, ...]) -> Inner:
        """The kernel that is called with arguments of these types."""
        raise NotImplementedError


class Inner(KernelChoice):
    """A kernel that only kernels call; nothing is made of it before one is compiled.

    Attributes
    ----------
    py_func
        The function itself, for callers in Python.
    units
        What was compiled of it, by the types of the arguments.
    """

    def __init__(self, function: FunctionType) -> None:
        self.py_func = function
        self.units: dict[tuple[Any, ...], Any] = {}

    def kernel_for(self, arguments: tuple[KernelType, ...]) -> Inner:
        """The kernel that is called with arguments of these types."""
        return self


def inner(*signatures: Any) -> Callable[[Any], Any]:
    """A kernel that only kernels call; compiled into them.

    The signatures are those of its calls; one without any is for all types that it
    is called with, plane and space. There is one version for each.
    """
    return Inner


class Intrinsic:
    """A function of kernels that writes its machine code itself.

    Attributes
    ----------
    py_func
        Takes the types of the arguments and returns the signature and a function
        `generate(builder, values)`, which writes it and returns its value.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.py_func = function

    def __call__(self, *arguments: Any) -> Any:
        raise TypeError("for kernels only")


def _load_lanes(builder: Any, view: Any, index: Any, count: int) -> Any:
    """Consecutive reals of an array, real or complex, from entry `index` on."""
    address = builder.gep(builder.extract_value(view, 0), [index])
    kind = ir.VectorType(_REAL, count).as_pointer()
    return builder.load(builder.bitcast(address, kind), align=8)


def _select_lanes(builder: Any, lanes: Any, positions: list[int]) -> Any:
    """Some of the lanes, in this order."""
    mask = ir.Constant(ir.VectorType(_INT32, len(positions)), positions)
    return builder.shuffle_vector(lanes, lanes, mask)


def _reduce_lanes(builder: Any, lanes: Any, components: int) -> list[Any]:
    """Sums of every second of so many lanes, or of all."""
    count = LANES
    while count > components:
        count //= 2
        low = _select_lanes(builder, lanes, list(range(count)))
        high = _select_lanes(builder, lanes, list(range(count, 2 * count)))
        lanes = builder.fadd(low, high)
    return [builder.extract_element(lanes, _INT32(k)) for k in range(components)]


@Intrinsic
def _lane_products(a: Any, i: Any, x: Any, k: Any, n: Any) -> Any:
    """Sum of a[i + j] x[k + j] over j below n, a multiple of the lanes."""
    components = 2 if x.dtype == complex128 else 1
    groups = LANES // components

    def generate(builder: Any, values: Any) -> Any:
        from numba.core import cgutils

        a, i, x, k, n = values
        zeros = [ir.Constant(_REAL, 0.0)] * LANES
        none = ir.Constant(ir.VectorType(_REAL, LANES), zeros)
        total = cgutils.alloca_once_value(builder, none)
        with cgutils.for_range(builder, builder.sdiv(n, _INDEX(groups))) as loop:
            at = builder.mul(loop.index, _INDEX(groups))
            left = _load_lanes(builder, a, builder.add(i, at), groups)
            left = _select_lanes(
                builder, left, [lane // components for lane in range(LANES)]
            )
            right = _load_lanes(builder, x, builder.add(k, at), LANES)
            sums = builder.fadd(builder.load(total), builder.fmul(left, right))
            builder.store(sums, total)
        sums = _reduce_lanes(builder, builder.load(total), components)
        return sums[0] if components == 1 else cgutils.pack_struct(builder, sums)

    return x.dtype(a, int64, x, int64, int64), generate


@inner()
def row_dot(a, i, x, k, n):
    """Sum of a[i + j] x[k + j] over j below n, one at least; x is real or complex."""
    vectorised = n & -LANES
    if vectorised > 0:
        total, first = _lane_products(a, i, x, k, vectorised), vectorised
    else:
        total, first = a[i] * x[k], 1
    for j in range(first, n):
        total += a[i + j] * x[k + j]
    return total


@inner()
def _real_quotient(a, b):
    return a / b


@inner()
def _complex_quotient(a, b):
    """R. L. Smith, Algorithm 116: Complex division, Comm. ACM 5 (1962)."""
    if abs(b.real) >= abs(b.imag):
        ratio = b.imag / b.real
        scale = b.real + b.imag * ratio
        return complex(
            (a.real + a.imag * ratio) / scale, (a.imag - a.real * ratio) / scale
        )
    ratio = b.real / b.imag
    scale = b.real * ratio + b.imag
    return complex((a.real * ratio + a.imag) / scale, (a.imag * ratio - a.real) / scale)


class _QuotientKernels(KernelChoice):
    """A kernel for real numbers and one for complex ones."""

    py_funcs = _real_quotient.py_func, _complex_quotient.py_func

    def kernel_for(self, arguments: tuple[KernelType, ...]) -> Inner:
        """The kernel that is called with arguments of these types."""
        kernel: Inner = _complex_quotient if complex128 in arguments else _real_quotient
        return kernel


#: a / b
quotient = _QuotientKernels()
