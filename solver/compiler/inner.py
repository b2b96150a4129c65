"""Kernels that only kernels call, and what numba makes of a kernel.

numba would link a kernel with all that it calls, optimise and translate the whole
again for each of its callers. So kernels call each other by name: numba compiles each
alone, and what belongs together is put together once, see `machine`.
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
from llvmlite import binding as llvm
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, models, register_model, typeof_impl

from . import quick

#: Division by zero gives infinity, as in C.
OPTIONS: dict[str, Any] = {"error_model": "numpy"}
#: What numba calls the version of a function that takes arguments as C does.
C_NAME = re.compile(r'define [^\n]*@"?(cfunc\.[^"\s(]+)"?\(')


@dataclass
class Unit:
    """A function in LLVM's language.

    calls : the units that it calls
    """

    name: str
    text: str
    returns: Any
    calls: list[Unit]

    def whole(self) -> list[Unit]:
        """It and all that it needs."""
        found: dict[str, Unit] = {}
        left = [self]
        while left:
            unit = left.pop()
            if unit.name not in found:
                found[unit.name] = unit
                left += unit.calls
        return list(found.values())


class Inner:
    """A kernel that only kernels call; nothing is made of it before one is compiled.

    py_func : the function itself, for callers in Python
    """

    def __init__(self, function: FunctionType) -> None:
        self.py_func = function
        self._units: dict[tuple[Any, ...], Unit] = {}

    def unit(self, arguments: tuple[Any, ...]) -> Unit:
        """What numba makes of it for arguments of these types."""
        if arguments not in self._units:
            self._units[arguments] = unit_of(self.py_func, arguments)
        return self._units[arguments]

    def chosen(self, arguments: Any) -> Inner:
        """The kernel that is called with arguments of these types."""
        return self


def inner(*signatures: Any) -> Callable[[Any], Any]:
    """A kernel that only kernels call; compiled into them.

    The signatures say what it is called with; one without any is for all types that
    it is called with, plane and space. There is one version for each.
    """
    return Inner


#: numba loads what it compiles, and that has to find something by every name.
_NEVER_CALLED = ctypes.cast(ctypes.pythonapi.Py_GetVersion, ctypes.c_void_p).value
#: Kernels are compiled one after the other: these are the calls of those begun.
lock = threading.RLock()
_calls: list[list[Unit]] = []


def _jitted(function: FunctionType) -> Any:
    """What `njit` makes of it, also where a user disables that for own functions.

    Kernels read their tables through pointers: they run compiled or not at all.
    """
    settings: Any = numba.config
    disabled, settings.DISABLE_JIT = settings.DISABLE_JIT, 0
    try:
        return numba.njit(**OPTIONS)(function)
    finally:
        settings.DISABLE_JIT = disabled


def unit_of(function: FunctionType, signature: Any) -> Unit:
    """What numba makes of a function alone."""
    with lock:
        _calls.append([])
        try:
            made = _lowered(function, signature)
        finally:
            calls = _calls.pop()
    calls += [Unit(name, text, None, []) for name, text in made.linked]
    llvm.add_symbol(made.name, _NEVER_CALLED)
    return Unit(made.name, made.text, made.returns, calls)


def _lowered(function: FunctionType, signature: Any) -> quick.Lowered:
    if quick.is_tried():
        try:
            return quick.lowered(function, signature, **OPTIONS)
        except (NotImplementedError, numba.NumbaError):
            _calls[-1].clear()  # it knows less than all of numba, which also tells why
    jitted = _jitted(function)
    jitted.compile(signature)
    (arguments,) = jitted.signatures
    (known,) = jitted.nopython_signatures
    # numba forbids to put a function in line where it is called as by C
    text = jitted.inspect_llvm(arguments).replace("noinline", "nounwind")
    found = C_NAME.search(text)
    assert found is not None
    return quick.Lowered(found.group(1), text, known.return_type)


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
        unit = self.choice.chosen(plain).unit(plain)
        return unit.returns(*plain).replace(recvr=self)

    def get_call_signatures(self) -> Any:
        return (), True

    def get_impl_key(self, sig: Any) -> Any:
        return type(self)


register_model(InnerType)(models.OpaqueModel)


@lower_builtin(InnerType, types.VarArg(types.Any))
def _call(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind, *kinds = sig.args
    unit = kind.choice.chosen(kinds).unit(tuple(kinds))
    _calls[-1].append(unit)
    result = context.get_value_type(sig.return_type)
    types_of = [context.get_value_type(k) for k in kinds]
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(result, types_of), unit.name
    )
    return builder.call(function, args[1:])


@typeof_impl.register(Inner)
def _type_of(value: Any, context: Any) -> InnerType:
    return InnerType(value)
