"""Kernels, each alone as one unit of LLVM, and linked with all that they call."""

from __future__ import annotations

import ctypes
import re
from dataclasses import dataclass
from types import FunctionType
from typing import Any

import numba
from llvmlite import binding as llvm, ir
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, models, register_model, typeof_impl

from ..inner_kernels import Intrinsic, KernelChoice, lock
from ..targets import ENTRY_SYMBOL, Target, host_target, machine_of
from . import fast_lowering
from .numba_types import kernel_type, numba_type
from .vectors import register_formulas

#: Division by zero gives infinity, as in C.
OPTIONS: dict[str, Any] = {"error_model": "numpy"}
#: How numba names the version of a function that takes arguments as C does.
C_WRAPPER_NAME = re.compile(r'define [^\n]*@"?(cfunc\.[^"\s(]+)"?\(')
#: How names begin that are not of the C library.
PYTHON_SYMBOLS = "numba", "NRT_", "Py", "_Py"
#: numba loads what it compiles, and that has to find something by every name.
_PLACEHOLDER_ADDRESS = ctypes.cast(
    ctypes.pythonapi.Py_GetVersion, ctypes.c_void_p
).value
#: Calls of the kernels whose compilation has begun.
_callee_stack: list[list[Unit]] = []


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
    """Return the LLVM module of a kernel without those that it calls."""
    register_formulas()
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


def _callee(choice: KernelChoice, arguments: tuple[Any, ...]) -> Unit:
    """The unit that a kernel calls with arguments of these types of numba."""
    kernel = choice.kernel_for(tuple(map(kernel_type, arguments)))
    if arguments not in kernel.units:
        kernel.units[arguments] = compile_unit(kernel.py_func, arguments)
    unit: Unit = kernel.units[arguments]
    return unit


class CalleeType(types.Callable, types.Opaque):  # type: ignore[misc]
    """Type in numba of a kernel, a choice of kernels or an intrinsic.

    Literal integers count as integers.
    """

    def __init__(self, callee: Any) -> None:
        self.callee = callee
        super().__init__(f"{type(callee).__name__} {id(callee)}")

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        plain = tuple(types.unliteral(a) for a in args)
        if isinstance(self.callee, Intrinsic):
            called, _ = self.callee.py_func(*map(kernel_type, plain))
            return numba_type(called).replace(recvr=self)
        return _callee(self.callee, plain).returns(*plain).replace(recvr=self)

    def get_call_signatures(self) -> Any:
        return (), True

    def get_impl_key(self, sig: Any) -> Any:
        return type(self)


register_model(CalleeType)(models.OpaqueModel)


@lower_builtin(CalleeType, types.VarArg(types.Any))
def _lower_call(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind, *kinds = sig.args
    if isinstance(kind.callee, Intrinsic):
        _, generate = kind.callee.py_func(*map(kernel_type, kinds))
        return generate(builder, args[1:])
    unit = _callee(kind.callee, tuple(kinds))
    _callee_stack[-1].append(unit)
    result = context.get_value_type(sig.return_type)
    types_of = [context.get_value_type(k) for k in kinds]
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(result, types_of), unit.name
    )
    return builder.call(function, args[1:])


@typeof_impl.register(KernelChoice)
@typeof_impl.register(Intrinsic)
def _type_of_callee(value: Any, context: Any) -> CalleeType:
    return CalleeType(value)


def compile_kernel(
    function: FunctionType,
    signature: Any,
    target: Target | None = None,
    symbol: str = ENTRY_SYMBOL,
) -> bytes:
    """The machine code of a kernel with all that it calls: an object file.

    Parameters
    ----------
    target
        Default this process.
    symbol
        Name of the kernel. In a shared library it is not seen from outside: two
        libraries with kernels of one name do not meet.
    """
    target = target or host_target()
    with lock:
        machine = machine_of(target)
        module = _link_units(compile_unit(function, numba_type(signature)), symbol)
        if not target.in_process:
            module.get_function(symbol).visibility = "hidden"
            module.triple = target.triple
            module.data_layout = str(machine.target_data)
        _optimise(module, machine)
        _refuse_python(function, module)
        code: bytes = machine.emit_object(module)
    return code


def _link_units(entry: Unit, symbol: str) -> Any:
    """One module, in which nothing but the entry is seen from outside."""
    module = llvm.parse_assembly("")
    for unit in entry.with_callees():
        module.link_in(llvm.parse_assembly(unit.text))
    for values in (module.functions, module.global_variables):
        for value in values:
            if not value.is_declaration and value.name != entry.name:
                value.linkage = "internal"
    module.get_function(entry.name).name = symbol
    return module


def _optimise(module: Any, machine: Any) -> None:
    """Loops here are short: to vectorise them takes longer, to compile and to run.

    To unroll them doubles the machine code and its cost, and saves no time in a step.
    """
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = False
    options.loop_unrolling = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)


def _refuse_python(function: FunctionType, module: Any) -> None:
    """Raises TypeError where a kernel may raise or allocate: both go unnoticed."""
    names = [f.name for f in module.functions if f.is_declaration]
    forbidden = [name for name in names if name.startswith(PYTHON_SYMBOLS)]
    if forbidden:
        raise TypeError(f"{function.__qualname__} needs {', '.join(forbidden)}")
