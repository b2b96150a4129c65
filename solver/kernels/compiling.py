"""How kernels are compiled: entry kernels at first use, inner ones with them.

An entry kernel has explicit signatures and a place in the cache on disk. Inner kernels
are compiled into the entry kernels that call them, and only then: a program that finds
its entry kernels in the cache never touches them. The cache of an entry kernel holds
as long as its own code and that of everything it calls stays the same, wherever in the
package that code stands.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from functools import cached_property
from types import FunctionType
from typing import Any

from numba import types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.extending import typeof_impl
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps
from numba.core.typeinfer import register_dispatcher

from . import stored
from .compiler import EntryCompiler, InnerCompiler, compiling_kernels
from .stamps import environment, machinery, stamp

#: Division by zero gives infinity, as in C. Kernels allocate nothing, so that views of
#: arrays need no reference counts: half the time of a call.
OPTIONS: dict[str, Any] = {"nopython": True, "error_model": "numpy", "_nrt": False}
#: Options of kernels that only kernels call.
INNER_OPTIONS: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def _dispatcher_of(function: FunctionType, compiler: Any, **options: Any) -> Any:
    """What numba's `njit` makes of a function, also where NUMBA_DISABLE_JIT is set.

    Kernels read their tables through pointers: they run compiled or not at all.
    """
    return CPUDispatcher(
        function, targetoptions=OPTIONS | options, pipeline_class=compiler
    )


class Entry:
    """A kernel that Python calls, or that other kernels call through a pointer.

    Raises TypeError when Python calls one that is for kernels only.
    """

    def __init__(
        self, function: FunctionType, signatures: tuple[Any, ...], from_python: bool
    ) -> None:
        self.signatures = signatures
        self._function = function
        self._from_python = from_python

    @property
    def stamp(self) -> str:
        """Tells one version of a kernel, with all that it calls, from another."""
        return stamp(self._function, self.signatures, self._caller)

    @property
    def _caller(self) -> str:
        return "python" if self._from_python else "kernels"

    def for_python(self) -> Entry:
        """The same kernel for callers in Python."""
        return Entry(self._function, self.signatures, True)

    @cached_property
    def _dispatcher(self) -> Any:
        dispatcher = _dispatcher_of(
            self._function, EntryCompiler, no_cpython_wrapper=not self._from_python
        )
        dispatcher._cache = _KernelCache(self._function, self._caller, self.stamp)
        return dispatcher

    def compiled(self, signature: Any) -> Any:
        """The machine code for one signature; compiles or loads it once.

        One thread at a time, whoever compiles: numba behaves differently meanwhile.
        """
        arguments = tuple(signature.args)
        with global_compiler_lock:
            dispatcher = self._dispatcher
            if arguments not in dispatcher.overloads:
                with register_dispatcher(dispatcher), compiling_kernels():
                    dispatcher.compile(signature)
            return dispatcher.overloads[arguments]

    def is_cached(self, signature: Any) -> bool:
        """Whether the machine code is there already, loaded or on disk."""
        with global_compiler_lock:
            dispatcher = self._dispatcher
            if tuple(signature.args) in dispatcher.overloads:
                return True
            codegen = dispatcher.targetctx.codegen()
        return dispatcher._cache.find(signature, codegen) is not None

    @cached_property
    def _callable(self) -> Any:
        if not self._from_python:
            raise TypeError(f"{self._function.__name__}: only kernels call it")
        with global_compiler_lock:
            for signature in self.signatures:
                self.compiled(signature)
            self._dispatcher.disable_compile()
            return self._dispatcher

    def __call__(self, *arguments: Any) -> Any:
        return self._callable(*arguments)


def entry(*signatures: Any, from_python: bool = True) -> Callable[[Any], Entry]:
    """An entry kernel for the given signatures.

    One that Python does not call, only kernels, takes less to compile.
    """
    return lambda function: Entry(function, signatures, from_python)


class Inner:
    """A kernel that only kernels call; nothing is made of it before one is compiled.

    py_func : the function itself, for callers in Python
    """

    def __init__(self, function: FunctionType) -> None:
        self.py_func = function

    @cached_property
    def dispatcher(self) -> Any:
        """What the compiler knows it as. Literal integers count as integers."""
        dispatcher = _dispatcher_of(self.py_func, InnerCompiler, **INNER_OPTIONS)
        template = dispatcher.get_call_template

        def plain_template(args: tuple[Any, ...], kws: Any) -> Any:
            return template(tuple(types.unliteral(a) for a in args), kws)

        dispatcher.get_call_template = plain_template
        return dispatcher


@typeof_impl.register(Inner)
def _type_of_inner(value: Inner, context: Any) -> Any:
    return typeof_impl(value.dispatcher, context)


def inner(*signatures: Any) -> Callable[[Any], Any]:
    """A kernel that only kernels call; compiled into them.

    The signatures say what it is called with; one without any is for all types that
    it is called with, plane and space. There is one version for each.
    """
    return Inner


class _KernelCache(NullCache):
    """Where the compiler looks for an entry kernel, and leaves it."""

    def __init__(self, function: FunctionType, caller: str, stamp: str) -> None:
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._caller, self._stamp = caller, stamp

    def _place(self, signature: Any, codegen: Any) -> tuple[str, str]:
        """Name of the file, one for all versions of the code, and the full key."""
        slot = f"{self._name} for {self._caller} {signature} {environment(codegen)}"
        digest = hashlib.sha256(slot.encode()).hexdigest()[:16]
        short = self._name.rpartition(".")[2]
        name = f"{short}.{self._caller}-{digest}.kernel"
        return name, f"{slot} compiler {machinery()} code {self._stamp}"

    def find(self, signature: Any, codegen: Any) -> bytes | None:
        """The machine code for a signature, if it is on disk."""
        return stored.read(*self._place(signature, codegen))

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """What is on disk, without the compiler's own preparations.

        They take longer than all else a program does that finds its kernels there.
        """
        found = self.find(signature, target_context.codegen())
        if found is None:
            return None
        return CompileResult._rebuild(target_context, *pickle.loads(found))

    def save_overload(self, signature: Any, result: Any) -> None:
        if not result.library.has_dynamic_globals:
            place = self._place(signature, result.codegen)
            stored.write(*place, dumps(result._reduce()))
