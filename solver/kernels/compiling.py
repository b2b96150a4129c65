"""How kernels are compiled: entry kernels eagerly and cached, inner ones with them.

An entry kernel has explicit signatures and a place in the cache on disk. Inner kernels
are compiled into the entry kernels that call them, and only then: a program that finds
its entry kernels in the cache never touches them. The cache of an entry kernel holds
as long as its own code and that of everything it calls stays the same, wherever in the
package that code stands.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from types import CodeType, FunctionType, ModuleType
from typing import Any

from numba import njit, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.typeinfer import register_dispatcher

#: Division by zero gives infinity, as in C. Kernels allocate nothing, so that views of
#: arrays need no reference counts: half the time of a call.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}


def entry(*signatures: Any) -> Callable[[Any], Any]:
    """Compiles a kernel for the given signatures now, or loads it from the cache."""

    def compile_now(function: FunctionType) -> Any:
        dispatcher = njit(**OPTIONS)(function)
        dispatcher._cache = _KernelCache(function, signatures)
        with register_dispatcher(dispatcher):
            for signature in signatures:
                dispatcher.compile(signature)
            dispatcher.disable_compile()
        return dispatcher

    return compile_now


def inner(*signatures: Any) -> Callable[[Any], Any]:
    """A kernel that only kernels call; compiled into them.

    The signatures say what it is called with. Literal integers count as integers, so
    that there is one version for each.
    """

    def compile_later(function: FunctionType) -> Any:
        wrappers = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        dispatcher = njit(**OPTIONS, **wrappers)(function)
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
