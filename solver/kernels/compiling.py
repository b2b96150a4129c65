"""How kernels are compiled: entry kernels at first use, inner ones with them.

An entry kernel has explicit signatures and a place in the cache on disk. Inner kernels
are compiled into the entry kernels that call them, and only then: a program that finds
its entry kernels in the cache never touches them. The cache of an entry kernel holds
as long as its own code and that of everything it calls stays the same, wherever in the
package that code stands.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cached_property
from types import CodeType, FunctionType
from typing import Any

import numba
from numba import types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.extending import typeof_impl
from numba.core.typeinfer import register_dispatcher

from .compiler import EntryCompiler, InnerCompiler, compiling_kernels
from .tables import TableType

_numba: Any = numba  # its stubs know no private parts
#: Division by zero gives infinity, as in C. Kernels allocate nothing, so that views of
#: arrays need no reference counts: half the time of a call.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}

#: Globals that kernels take into their code; others only share a name with a field.
CONSTANTS = (bool, int, float, complex, str, tuple, types.Type)


#: Options of kernels that only kernels call.
INNER_OPTIONS: dict[str, Any] = {
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": InnerCompiler,
}


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
        texts = [_type_text(signature) for signature in self.signatures]
        texts += [_code_text(self._function, {}), str(self._from_python)]
        return hashlib.sha256("\n".join(texts).encode()).hexdigest()

    def for_python(self) -> Entry:
        """The same kernel for callers in Python."""
        return Entry(self._function, self.signatures, True)

    @cached_property
    def _dispatcher(self) -> Any:
        dispatcher = _numba.njit(
            **OPTIONS,
            no_cpython_wrapper=not self._from_python,
            pipeline_class=EntryCompiler,
        )(self._function)
        caller = "python" if self._from_python else "kernels"
        dispatcher._cache = _KernelCache(self._function, caller, self.stamp)
        return dispatcher

    def compiled(self, signature: Any) -> Any:
        """The machine code for one signature; compiles or loads it once."""
        dispatcher = self._dispatcher
        arguments = tuple(signature.args)
        if arguments not in dispatcher.overloads:
            with register_dispatcher(dispatcher), compiling_kernels():
                dispatcher.compile(signature)
        return dispatcher.overloads[arguments]

    def is_cached(self, signature: Any) -> bool:
        """Whether the machine code is there already, loaded or on disk."""
        if tuple(signature.args) in self._dispatcher.overloads:
            return True
        cache = self._dispatcher._cache
        codegen = self._dispatcher.targetctx.codegen()
        saved = cache._cache_file._load_index()
        return cache._index_key(signature, codegen) in saved

    @cached_property
    def _callable(self) -> Any:
        if not self._from_python:
            raise TypeError(f"{self._function.__name__}: only kernels call it")
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
        dispatcher = _numba.njit(**OPTIONS, **INNER_OPTIONS)(self.py_func)
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

    The signatures say what it is called with. There is one version for each.
    """
    return Inner


class _CacheFile(IndexDataCacheFile):
    def _load_index(self) -> dict[Any, str]:
        """What is on disk; nothing if other versions of the tables wrote it."""
        try:
            return super()._load_index()
        except (AttributeError, ImportError, TypeError):
            return {}


class _KernelCache(FunctionCache):
    """A cache whose entries hold while the code they were made from is the same."""

    def __init__(self, function: FunctionType, caller: str, stamp: str) -> None:
        super().__init__(function)
        self._cache_file = _CacheFile(
            cache_path=self._cache_path,
            filename_base=f"{self._impl.filename_base}.{caller}",
            source_stamp=stamp,
        )

    def _index_key(self, signature: Any, codegen: Any) -> Any:
        """The stamp of the file knows the code, also that of enclosed kernels."""
        return signature, codegen.magic_tuple()

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """What is on disk, without the compiler's own preparations.

        They take longer than all else a program does that finds its kernels there.
        """
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target_context)


def _type_text(kind: Any) -> str:
    """A signature with the fields of its tables."""
    if hasattr(kind, "args") and hasattr(kind, "return_type"):
        return " ".join(_type_text(t) for t in (kind.return_type, *kind.args))
    if isinstance(kind, types.FunctionType):
        return _type_text(kind.signature)
    if isinstance(kind, TableType):
        members = (t for t in kind.members.values() if t is not kind)
        return f"{kind}{kind.fields}({' '.join(map(_type_text, members))})"
    return str(kind)


def _code_text(function: FunctionType, seen: dict[CodeType, int]) -> str:
    """Bytecode and constants of a function and of everything it refers to."""
    code = function.__code__
    if code in seen:
        return f"<{seen[code]}>"
    seen[code] = len(seen)
    parts = [code.co_code.hex(), repr(code.co_varnames), repr(code.co_names)]
    parts += [repr(constant) for constant in code.co_consts]
    scope = {name: function.__globals__.get(name) for name in code.co_names}
    cells = function.__closure__ or ()
    enclosed = {
        n: c.cell_contents for n, c in zip(code.co_freevars, cells, strict=True)
    }
    for name, value in (scope | enclosed).items():
        python = getattr(value, "py_func", None)
        if python is not None:
            parts.append(_code_text(python, seen))
        elif isinstance(value, CONSTANTS):
            parts.append(f"{name}={value!r}")
    return " ".join(parts)
