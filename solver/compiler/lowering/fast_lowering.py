"""Compilation with fewer passes of numba.

Kernels compute with numbers, values and views and are called by kernels. Therefore
these steps of numba are left out, which halves its time: inlining of closures, pruning
of dead branches, reference counting, operators on arrays, lists and strings, wrappers
for Python with their errors, and machine code. Nothing in numba is replaced: its parts
are combined in contexts of their own, for the versions that were tested. With other
versions kernels compile as usual, with equal results.
"""

import operator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, reduce
from types import FunctionType
from typing import Any

import numba
from llvmlite import ir
from numba import types

#: Versions of numba that this was tried with.
FIRST_TESTED, LAST_TESTED = (0, 63), (0, 68)
#: What a function would call that may fail; see `machine`.
FAILURE_SYMBOL = "Python error"
ARITHMETIC = operator.add, operator.sub, operator.mul
COMPARISONS = (
    operator.lt,
    operator.le,
    operator.gt,
    operator.ge,
    operator.eq,
    operator.ne,
)
EXTREMES = {min: operator.lt, max: operator.gt}


@dataclass
class LoweredFunction:
    """A function in LLVM's language.

    Attributes
    ----------
    name
        What it is called by, with arguments as in C.
    linked
        Name and text of what numba itself puts to it.
    """

    name: str
    text: str
    returns: Any
    linked: list[tuple[str, str]] = field(default_factory=list)


@cache
def is_tested_version() -> bool:
    """True if this has been tried with the version of numba."""
    version = tuple(int(part) for part in numba.__version__.split(".")[:2])
    return FIRST_TESTED <= version <= LAST_TESTED


def lower_function(
    function: FunctionType, signature: Any, **options: Any
) -> LoweredFunction:
    """Return the machine code of a function for these types of arguments, in LLVM."""
    from numba.core.compiler import Flags, compile_extra
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.sigutils import normalize_signature

    flags: Any = Flags()
    flags.no_cpython_wrapper = flags.no_cfunc_wrapper = flags.no_compile = True
    for option, value in options.items():
        setattr(flags, option, value)
    args, returns = normalize_signature(signature)
    with global_compiler_lock:
        typing, target = _contexts()
        library = _library()(target.codegen(), function.__qualname__)
        compiled = compile_extra(
            typing, target, function, args, returns, flags, {}, library, _pipeline()
        )
        linked = [
            (f"{one.name} {id(one)}", _library_text(one)) for one in library.linked
        ]
    _add_c_wrapper(target, compiled.fndesc, library.module)
    name, returned = (
        compiled.fndesc.llvm_cfunc_wrapper_name,
        compiled.signature.return_type,
    )
    return LoweredFunction(name, str(library.module), returned, linked)


def _add_c_wrapper(context: Any, description: Any, module: Any) -> None:
    """Adds the function that calls it by value."""
    convention = context.call_conv
    returned, argument_types = description.restype, description.argtypes
    kinds = [context.get_value_type(kind) for kind in argument_types]
    kind = ir.FunctionType(context.get_value_type(returned), kinds)
    function = ir.Function(module, kind, description.llvm_cfunc_wrapper_name)
    builder = ir.IRBuilder(function.append_basic_block("entry"))
    callee = module.globals[description.llvm_func_name]
    status, result = convention.call_function(
        builder, callee, returned, argument_types, function.args
    )
    with builder.if_then(status.is_error, likely=False):
        failure_type = ir.FunctionType(ir.VoidType(), [])
        builder.call(ir.Function(module, failure_type, FAILURE_SYMBOL), [])
    builder.ret(result)


def _library_text(library: Any) -> str:
    """Of a library of numba's, with all that it calls."""
    with suppress(RuntimeError):  # where it is final
        library.finalize()
    return str(library.get_llvm_str())


@cache
def _library() -> Any:
    from numba.core.codegen import CodeLibrary

    class Library(CodeLibrary):  # type: ignore[misc]
        """Holds the module of a function; nothing is made of it here."""

        def __init__(self, codegen: Any, name: str) -> None:
            super().__init__(codegen, name)
            self.linked: list[Any] = []

        def add_ir_module(self, module: Any) -> None:
            self.module = module

        def add_linking_library(self, library: Any) -> None:
            self.linked.append(library)

        def finalize(self) -> None:
            pass

        def get_function(self, name: Any) -> None:
            pass

        get_llvm_str = get_asm_str = finalize

    return Library


@cache
def _pipeline() -> Any:
    from numba.core.compiler import CompilerBase
    from numba.core.compiler_machinery import PassManager
    from numba.core.typed_passes import (
        NativeLowering,
        NoPythonBackend,
        NopythonTypeInference,
    )
    from numba.core.untyped_passes import FixupArgs, IRProcessing, TranslateByteCode

    passes = TranslateByteCode, FixupArgs, IRProcessing
    typed = NopythonTypeInference, NativeLowering, NoPythonBackend

    class Pipeline(CompilerBase):  # type: ignore[misc]
        def define_pipelines(self) -> list[Any]:
            manager = PassManager("kernel")
            for kind in (*passes, *typed):
                manager.add_pass(kind, kind.name())
            manager.finalize()
            return [manager]

    return Pipeline


@cache
def _contexts() -> tuple[Any, Any]:
    """Return numba's contexts of types and of machine code, without arrays."""
    from numba.core.cpu import CPUContext
    from numba.core.typing import BaseContext, cmathdecl, mathdecl
    from numba.cpython import (  # noqa: F401
        builtins,
        cmathimpl,
        mathimpl,
        numbers,
        rangeobj,
        tupleobj,
    )

    kinds, code = _number_registries()

    class Typing(BaseContext):  # type: ignore[misc]
        def load_additional_registries(self) -> None:
            for registry in (kinds, mathdecl.registry, cmathdecl.registry):
                self.install_registry(registry)

    class Target(CPUContext):  # type: ignore[misc]
        def load_additional_registries(self) -> None:
            for registry in (code, mathimpl.registry, cmathimpl.registry):
                self.install_registry(registry)

        def post_lowering(self, module: Any, library: Any) -> None:
            """Would link what counts references."""

    typing = Typing()
    return typing, Target(typing, "cpu")


def _number_registries() -> tuple[Any, Any]:
    """Operators on equal kinds of numbers, and what numba makes closures for."""
    from numba.core.imputils import Registry as Code
    from numba.core.typing.templates import AbstractTemplate, Registry, signature

    kinds, code = Registry(), Code("kernels")
    numbers = types.float64, types.int64, types.complex128

    class Operator(AbstractTemplate):  # type: ignore[misc]
        key: Any

        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) != 2 or args[0] != args[1] or args[0] not in numbers:
                return None
            if self.key in ARITHMETIC:
                return signature(args[0], *args)
            real = args[0] is not types.complex128
            return signature(types.boolean, *args) if real else None

    class Extreme(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) < 2 or not all(isinstance(a, types.Number) for a in args):
                return None
            return signature(self.context.unify_types(*args), *args)

    class Whole(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(types.int64, *args) if args == (types.float64,) else None

    class Part(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, kws: Any) -> Any:
            whole, index = args
            if isinstance(whole, types.UniTuple) and isinstance(index, types.Literal):
                return signature(whole.dtype, *args)
            return None

    kinds.register_global(operator.getitem)(Part)
    for key in (*ARITHMETIC, *COMPARISONS):
        kinds.register_global(key)(Operator)
    kinds.register_global(int)(Whole)
    for key in EXTREMES:
        kinds.register_global(key)(Extreme)
        code.lower(key, types.VarArg(types.Number))(_lower_extreme(EXTREMES[key]))

    @code.lower(int, types.Float)
    def whole(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.cast(builder, args[0], sig.args[0], sig.return_type)

    @code.lower(operator.getitem, types.UniTuple, types.IntegerLiteral)
    def part(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind, index = sig.args
        return builder.extract_value(args[0], index.literal_value % kind.count)

    return kinds, code


def _lower_extreme(better: Any) -> Any:
    """As in Python: a later number counts where it is better than those before."""
    from numba.core.typing.templates import signature

    def write(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = sig.return_type
        compare = context.get_function(better, signature(types.boolean, kind, kind))
        cast = [
            context.cast(builder, value, given, kind)
            for value, given in zip(args, sig.args, strict=True)
        ]
        return reduce(
            lambda best, new: builder.select(compare(builder, (new, best)), new, best),
            cast,
        )

    return write
