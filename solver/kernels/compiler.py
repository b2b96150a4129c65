"""The compiler of kernels: numba's, without what kernels do not need.

Kernels are plain loops over arrays that they neither make nor free: no closures, no
reference counts, no exceptions. Leaving out what serves these halves the time that a
user waits for the first result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FunctionType
from typing import Any

import numba
from llvmlite import binding as llvm
from numba import types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_lock import require_global_compiler_lock
from numba.core.compiler_machinery import PassManager
from numba.core.cpu import CPUContext
from numba.core.typed_passes import (
    AnnotateTypes,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
)
from numba.core.typing.context import BaseContext as TypingContext
from numba.core.untyped_passes import FixupArgs, IRProcessing, TranslateByteCode
from numba.np import arrayobj

_numba: Any = numba  # its stubs know no private parts

PASSES = (
    TranslateByteCode,
    FixupArgs,
    IRProcessing,
    NopythonTypeInference,
    AnnotateTypes,
    NativeLowering,
    NoPythonBackend,
)


class EntryLibrary(JITCodeLibrary):
    """Code that is called through its address: no other code is linked with it."""

    def _optimize_final_module(self) -> None:
        """Without the first round, which only serves reference counts."""
        passes, builder = self._codegen._module_pass_manager(loop_vectorize=False)
        passes.run(self._final_module, builder)

    def serialize_using_object_code(self) -> Any:
        """The machine code and, in place of code to link with, its names."""
        self._ensure_finalized()
        names = llvm.parse_assembly(_names_of(self._final_module))
        return self.name, "object", (self._get_compiled_object(), names.as_bitcode())


def _names_of(module: Any) -> str:
    """A module that defines the same names and has nothing in them."""
    functions, variables = (
        [value.name for value in values if not value.is_declaration]
        for values in (module.functions, module.global_variables)
    )
    lines = [f'define void @"{name}"() {{ unreachable }}' for name in functions]
    lines += [f'@"{name}" = global i8 0' for name in variables]
    return "\n".join(lines)


class _InnerLibrary(JITCodeLibrary):
    """Code that is only linked into other code: optimised there, not here."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class EntryCompiler(CompilerBase):
    """For kernels that are called through their address."""

    library: type[JITCodeLibrary] = EntryLibrary

    def define_pipelines(self) -> list[PassManager]:
        passes = PassManager("kernel")
        for kind in PASSES:
            passes.add_pass(kind, kind.name())
        passes.finalize()
        return [passes]

    def compile_extra(self, function: FunctionType) -> Any:
        codegen = self.state.targetctx.codegen()
        self.state.library = self.library(codegen, function.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(function)


class InnerCompiler(EntryCompiler):
    """For kernels that are compiled into those that call them."""

    library = _InnerLibrary

    def compile_extra(self, function: FunctionType) -> Any:
        self.state.flags.no_compile = True
        result = super().compile_extra(function)
        described, library = result.fndesc, result.library
        name = _numba._dynfunc.make_function(
            described.lookup_module(),
            described.qualname,
            function.__doc__ or "",
            0,
            result.environment,
            (library,),
        )
        result.target_context.insert_user_function(name, described, [library])
        return result._replace(entry_point=name)


#: What is asked again and again with the same answer: what an operator returns for
#: arguments of certain types, and how large a type is.
QUESTIONS: tuple[tuple[Any, str], ...] = (
    (types.Function, "get_call_type"),
    (BaseContext, "get_abi_sizeof"),
)
#: And while one kernel is compiled: whether somebody has registered anything new.
PREPARATIONS: tuple[tuple[Any, str], ...] = (
    (BaseContext, "refresh"),
    (TypingContext, "refresh"),
)


def _remembering(ask: Callable[..., Any]) -> Callable[..., Any]:
    answers: dict[Any, Any] = {}

    def answer(*arguments: Any) -> Any:
        key = tuple(tuple(a.items()) if type(a) is dict else a for a in arguments)
        if key not in answers:
            answers[key] = ask(*arguments)
        return answers[key]

    return answer


class ArrayValue:
    """The parts of an array, read from its value and written into it.

    It stands in the place of numba's structure in memory, which is dear to compile.
    """

    def __init__(self, context: Any, builder: Any, kind: Any, value: Any) -> None:
        model = context.data_model_manager[kind]
        if value is None:
            value = context.get_constant_null(kind)
        self.__dict__.update(
            _context=context,
            _builder=builder,
            _datamodel=model,
            _fe_type=kind,
            _value=value,
        )

    def __getattr__(self, part: str) -> Any:
        place = self._datamodel.get_field_position(part)
        return self._builder.extract_value(self._value, place)

    def __setattr__(self, part: str, value: Any) -> None:
        place = self._datamodel.get_field_position(part)
        self.__dict__["_value"] = self._builder.insert_value(self._value, value, place)

    def extent(self, axis: int) -> Any:
        """Its length along an axis."""
        place = self._datamodel.get_field_position("shape")
        return self._builder.extract_value(self._value, [place, axis])

    def _getvalue(self) -> Any:
        return self._value


def make_array(kind: Any) -> Callable[..., ArrayValue]:
    """What makes the parts of arrays of one type from values."""

    def make(context: Any, builder: Any, value: Any = None) -> ArrayValue:
        return ArrayValue(context, builder, kind, value)

    return make


def _place_in_array(
    context: Any,
    builder: Any,
    kind: Any,
    array: ArrayValue,
    index_types: Any,
    indices: Any,
    boundscheck: Any = None,
) -> tuple[Any, list[Any], list[Any]]:
    """Address, shape and strides of array[indices]; indices do not count from the end.

    Parameters as those of numba's `basic_indexing`, in whose place it stands.
    """
    assert kind.layout == "C"
    count = len(indices)
    extents = [array.extent(axis) for axis in range(1, kind.ndim)]
    place = context.cast(builder, indices[0], index_types[0], types.intp)
    for axis, extent in enumerate(extents, start=1):
        place = builder.mul(place, extent)
        if axis < count:
            index = context.cast(builder, indices[axis], index_types[axis], types.intp)
            place = builder.add(place, index)
    address = builder.gep(array.data, [place], inbounds=True)
    if count == kind.ndim:
        return address, [], []
    strides = cgutils.unpack_tuple(builder, array.strides, kind.ndim)
    return address, extents[count - 1 :], strides[count:]


def _compile_internal(
    context: Any,
    builder: Any,
    function: Any,
    signature: Any,
    arguments: Any,
    **more: Any,
) -> Any:
    """What the compiler calls for an operator; products of complex numbers in line.

    Its own product asks after every multiplication whether infinity times zero has to
    be repaired.
    """
    if function.__name__ != "complex_mul":
        return _numba_compile_internal(
            context, builder, function, signature, arguments, **more
        )
    (a, b), (c, d) = (
        (builder.extract_value(z, 0), builder.extract_value(z, 1)) for z in arguments
    )
    real = builder.fsub(builder.fmul(a, c), builder.fmul(b, d))
    imaginary = builder.fadd(builder.fmul(a, d), builder.fmul(b, c))
    product = context.get_constant_null(signature.return_type)
    product = builder.insert_value(product, real, 0)
    return builder.insert_value(product, imaginary, 1)


_Substitute = tuple[Any, str, Callable[..., Any]]

_substitutes: list[_Substitute] = [
    (owner, name, _remembering(getattr(owner, name))) for owner, name in QUESTIONS
]
_structure_of_array = arrayobj.make_array
_numba_compile_internal = BaseContext.compile_internal
_substitutes += [
    (arrayobj, "basic_indexing", _place_in_array),
    (arrayobj, "make_array", make_array),
    (CPUContext, "make_array", lambda _, kind: _structure_of_array(kind)),
    (BaseContext, "compile_internal", _compile_internal),
]


@contextmanager
def compiling_kernels() -> Iterator[None]:
    """Has the compiler ask itself the same question once, and index plainly.

    For the whole of numba: whoever enters holds `global_compiler_lock`, so that nobody
    else compiles meanwhile, nor takes substitutes for originals.
    """
    require_global_compiler_lock()
    prepared = [
        (owner, name, _remembering(getattr(owner, name)))
        for owner, name in PREPARATIONS
    ]
    substitutes = [*_substitutes, *prepared]
    originals = [(owner, name, getattr(owner, name)) for owner, name, _ in substitutes]
    try:
        for owner, name, substitute in substitutes:
            setattr(owner, name, substitute)
        yield
    finally:
        for owner, name, original in originals:
            setattr(owner, name, original)
