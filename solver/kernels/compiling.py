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
from types import CodeType, FunctionType, ModuleType
from typing import Any

from numba import njit, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.typeinfer import register_dispatcher

_njit: Any = njit  # its stubs know no private options
#: Division by zero gives infinity, as in C. Kernels allocate nothing, so that views of
#: arrays need no reference counts: half the time of a call.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}


class Entry:
    """A kernel that Python calls, or that other kernels call through a pointer."""

    def __init__(self, function: FunctionType, signatures: tuple[Any, ...]) -> None:
        self.signatures = signatures
        self._function = function

    @cached_property
    def _dispatcher(self) -> Any:
        dispatcher = _njit(**OPTIONS)(self._function)
        dispatcher._cache = _KernelCache(self._function, self.signatures)
        return dispatcher

    def compiled(self, signature: Any) -> Any:
        """The machine code for one signature; compiles or loads it once."""
        dispatcher = self._dispatcher
        arguments = tuple(signature.args)
        if arguments not in dispatcher.overloads:
            with register_dispatcher(dispatcher):
                dispatcher.compile(signature)
        return dispatcher.overloads[arguments]

    def is_cached(self, signature: Any) -> bool:
        """Whether the machine code is on disk already."""
        cache = self._dispatcher._cache
        codegen = self._dispatcher.targetctx.codegen()
        saved = cache._cache_file._load_index()
        return cache._index_key(signature, codegen) in saved

    @cached_property
    def _callable(self) -> Any:
        for signature in self.signatures:
            self.compiled(signature)
        self._dispatcher.disable_compile()
        return self._dispatcher

    def __call__(self, *arguments: Any) -> Any:
        return self._callable(*arguments)


def entry(*signatures: Any) -> Callable[[Any], Entry]:
    """An entry kernel for the given signatures."""
    return lambda function: Entry(function, signatures)


def inner(*signatures: Any) -> Callable[[Any], Any]:
    """A kernel that only kernels call; compiled into them.

    The signatures say what it is called with. Literal integers count as integers, so
    that there is one version for each.
    """

    def compile_later(function: FunctionType) -> Any:
        wrappers = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        dispatcher = _njit(**OPTIONS, **wrappers)(function)
        template = dispatcher.get_call_template

        def plain_template(args: tuple[Any, ...], kws: Any) -> Any:
            return template(tuple(types.unliteral(a) for a in args), kws)

        dispatcher.get_call_template = plain_template
        return dispatcher

    return compile_later


class _KernelCache(FunctionCache):
    """A cache whose entries hold while the code they were made from is the same."""

    def __init__(self, function: FunctionType, signatures: tuple[Any, ...]) -> None:
        super().__init__(function)
        stamp = hashlib.sha256()
        for signature in signatures:
            stamp.update(_type_text(signature).encode())
        stamp.update(_code_text(function.__code__, function.__globals__, {}).encode())
        self._cache_file = IndexDataCacheFile(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=stamp.hexdigest(),
        )


def _type_text(kind: Any) -> str:
    """A signature with the field names of its tuples."""
    if hasattr(kind, "args") and hasattr(kind, "return_type"):
        return " ".join(_type_text(t) for t in (kind.return_type, *kind.args))
    if isinstance(kind, types.FunctionType):
        return _type_text(kind.signature)
    if isinstance(kind, types.NamedTuple):
        members = " ".join(_type_text(t) for t in kind.types)
        return f"{kind.instance_class.__name__}{kind.fields}({members})"
    return str(kind)


def _code_text(code: CodeType, scope: dict[str, Any], seen: dict[CodeType, int]) -> str:
    """Bytecode and constants of a function and of everything it refers to."""
    if code in seen:
        return f"<{seen[code]}>"
    seen[code] = len(seen)
    parts = [code.co_code.hex(), repr(code.co_varnames), repr(code.co_names)]
    parts += [repr(constant) for constant in code.co_consts]
    for name in code.co_names:
        value = scope.get(name)
        if isinstance(value, ModuleType) or value is None:
            continue
        python = getattr(value, "py_func", None)
        if python is not None:
            parts.append(_code_text(python.__code__, python.__globals__, seen))
        else:
            parts.append(f"{name}={value!r}")
    return " ".join(parts)
