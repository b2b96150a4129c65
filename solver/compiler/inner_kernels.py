"""Kernels that only kernels call, compiled once and linked into their callers.

numba would optimise and translate a called kernel again for each of its callers.
Therefore each inner kernel is compiled to one LLVM unit, and the units are linked.
The module also holds the dot product over consecutive reals, which LLVM vectorises,
and the division of complex numbers.
"""

from __future__ import annotations

import ctypes
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import FunctionType
from typing import Any

import numba
from llvmlite import binding as llvm, ir
from numba import int64, types
from numba.core import cgutils
from numba.extending import (
    intrinsic,
    lower_builtin,
    models,
    register_model,
    typeof_impl,
)

from . import fast_lowering
from .arrays import INDEX
from .vectors import REAL

#: Division by zero gives infinity, as in C.
OPTIONS: dict[str, Any] = {"error_model": "numpy"}
#: What numba calls the version of a function that takes arguments as C does.
C_WRAPPER_NAME = re.compile(r'define [^\n]*@"?(cfunc\.[^"\s(]+)"?\(')

LANES = 8


@dataclass
class Unit:
    """A function in LLVM's language.

    Attributes
    ----------
    calls
        The units that it calls.
    """

    name: str
    text: str
    returns: Any
    calls: list[Unit]

    def with_callees(self) -> list[Unit]:
        """It and all that it needs."""
        units: dict[str, Unit] = {}
        left = [self]
        while left:
            unit = left.pop()
            if unit.name not in units:
                units[unit.name] = unit
                left += unit.calls
        return list(units.values())


class Inner:
    """A kernel that only kernels call; nothing is made of it before one is compiled.

    Attributes
    ----------
    py_func
        The function itself, for callers in Python.
    """

    def __init__(self, function: FunctionType) -> None:
        self.py_func = function
        self._units: dict[tuple[Any, ...], Unit] = {}

    def unit(self, arguments: tuple[Any, ...]) -> Unit:
        """What numba makes of it for arguments of these types."""
        if arguments not in self._units:
            self._units[arguments] = compile_unit(self.py_func, arguments)
        return self._units[arguments]

    def kernel_for(self, arguments: Any) -> Inner:
        """The kernel that is called with arguments of these types."""
        return self


def inner(*signatures: Any) -> Callable[[Any], Any]:
    """A kernel that only kernels call; compiled into them.

    The signatures are those of its calls; one without any is for all types that it
    is called with, plane and space. There is one version for each.
    """
    return Inner


#: numba loads what it compiles, and that has to find something by every name.
_PLACEHOLDER_ADDRESS = ctypes.cast(
    ctypes.pythonapi.Py_GetVersion, ctypes.c_void_p
).value
#: Kernels are compiled one after the other: these are the calls of those begun.
lock = threading.RLock()
_callee_stack: list[list[Unit]] = []


def _dispatcher(function: FunctionType) -> Any:
    """What `njit` makes of it, also where a user disables that for own functions.

    Kernels read their tables through pointers: they run compiled or not at all.
    """
    settings: Any = numba.config
    disabled, settings.DISABLE_JIT = settings.DISABLE_JIT, 0
    try:
        return numba.njit(**OPTIONS)(function)
    finally:
        settings.DISABLE_JIT = disabled


def compile_unit(function: FunctionType, signature: Any) -> Unit:
    """What numba makes of a function alone."""
    with lock:
        _callee_stack.append([])
        try:
            lowered = _lower(function, signature)
        finally:
            calls = _callee_stack.pop()
    calls += [Unit(name, text, None, []) for name, text in lowered.linked]
    llvm.add_symbol(lowered.name, _PLACEHOLDER_ADDRESS)
    return Unit(lowered.name, lowered.text, lowered.returns, calls)


def _lower(function: FunctionType, signature: Any) -> fast_lowering.LoweredFunction:
    if fast_lowering.is_tested_version():
        try:
            return fast_lowering.lower_function(function, signature, **OPTIONS)
        except (NotImplementedError, numba.NumbaError):
            _callee_stack[
                -1
            ].clear()  # it knows less than all of numba, which also gives the reason
    jitted = _dispatcher(function)
    jitted.compile(signature)
    (arguments,) = jitted.signatures
    (known,) = jitted.nopython_signatures
    # numba forbids to put a function in line where it is called as by C
    text = jitted.inspect_llvm(arguments).replace("noinline", "nounwind")
    match = C_WRAPPER_NAME.search(text)
    assert match is not None
    return fast_lowering.LoweredFunction(match.group(1), text, known.return_type)


class InnerType(types.Callable, types.Opaque):  # type: ignore[misc]
    """The compiled type of what stands for one kernel or for several.

    Which one is called is for `choice.chosen` to say, from the types of the arguments.
    Literal integers count as integers.
    """

    def __init__(self, choice: Any) -> None:
        self.choice = choice
        super().__init__(f"kernel {id(choice)}")

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        plain = tuple(types.unliteral(a) for a in args)
        unit = self.choice.kernel_for(plain).unit(plain)
        return unit.returns(*plain).replace(recvr=self)

    def get_call_signatures(self) -> Any:
        return (), True

    def get_impl_key(self, sig: Any) -> Any:
        return type(self)


register_model(InnerType)(models.OpaqueModel)


@lower_builtin(InnerType, types.VarArg(types.Any))
def _lower_inner_call(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind, *kinds = sig.args
    unit = kind.choice.kernel_for(kinds).unit(tuple(kinds))
    _callee_stack[-1].append(unit)
    result = context.get_value_type(sig.return_type)
    types_of = [context.get_value_type(k) for k in kinds]
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(result, types_of), unit.name
    )
    return builder.call(function, args[1:])


@typeof_impl.register(Inner)
def _type_of_inner(value: Any, context: Any) -> InnerType:
    return InnerType(value)


_INT32 = ir.IntType(32)


def _load_lanes(builder: Any, view: Any, index: Any, count: int) -> Any:
    """Consecutive reals of an array, real or complex, from entry `index` on."""
    address = builder.gep(builder.extract_value(view, 0), [index])
    kind = ir.VectorType(REAL, count).as_pointer()
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


@intrinsic
def _lane_products(typing: Any, a: Any, i: Any, x: Any, k: Any, n: Any):  # type: ignore[no-untyped-def]
    """Sum of a[i + j] x[k + j] over j below n, a multiple of the lanes."""
    components = 2 if isinstance(x.dtype, types.Complex) else 1
    groups = LANES // components

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        a, i, x, k, n = values
        zeros = [ir.Constant(REAL, 0.0)] * LANES
        none = ir.Constant(ir.VectorType(REAL, LANES), zeros)
        total = cgutils.alloca_once_value(builder, none)
        with cgutils.for_range(builder, builder.sdiv(n, INDEX(groups))) as loop:
            at = builder.mul(loop.index, INDEX(groups))
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


class _QuotientKernels:
    """A kernel for real numbers and one for complex ones."""

    py_funcs = _real_quotient.py_func, _complex_quotient.py_func

    def kernel_for(self, arguments: Any) -> Inner:
        """The kernel that is called with arguments of these types."""
        real = not any(isinstance(a, types.Complex) for a in arguments)
        return _real_quotient if real else _complex_quotient  # type: ignore[no-any-return]


@typeof_impl.register(_QuotientKernels)
def _type_of_quotient(value: _QuotientKernels, context: Any) -> InnerType:
    return InnerType(value)


#: a / b
quotient = _QuotientKernels()
