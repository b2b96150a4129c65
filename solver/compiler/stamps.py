"""What tells one version of a kernel from another: its code and what compiles it."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import import_module
from types import CodeType, FunctionType
from typing import Any

from numba import types

from .tables import TableType
from .views import PointerType

#: Globals that kernels take into their code; others only share a name with a field.
CONSTANTS = (bool, int, float, complex, str, tuple, types.Type)
#: What decides beside the code of a kernel what becomes of it.
MACHINERY = (
    "compiler.compiling",
    "compiler.inner",
    "compiler.machine",
    "compiler.quick",
    "compiler.stamps",
    "compiler.tables",
    "compiler.views",
    "compiler.lanes",
    "compiler.records",
    "compiler.values",
    "space.algebra",
    "space.rows",
    "space.spaces",
)


def stamp(function: FunctionType, signatures: tuple[Any, ...]) -> str:
    """Of a kernel with all that it calls.

    Its name is a part: kernels of plane and of space are written once.
    """
    texts = [function.__qualname__, *map(_type_text, signatures)]
    texts.append(_function_text(function, {}))
    return _digest("\n".join(texts))


@cache
def machinery() -> str:
    """Of our own code that turns kernels into machine code."""
    solver = __package__.rpartition(".")[0]
    modules = [import_module(f"{solver}.{name}") for name in MACHINERY]
    sources = [m.__loader__.get_data(m.__file__) for m in modules]  # type: ignore
    return hashlib.sha256(b"".join(sources)).hexdigest()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _type_text(kind: Any) -> str:
    """A signature with the fields of its tables."""
    if hasattr(kind, "args") and hasattr(kind, "return_type"):
        return " ".join(_type_text(t) for t in (kind.return_type, *kind.args))
    if isinstance(kind, PointerType):
        return _type_text(kind.signature)
    if isinstance(kind, TableType):
        members = (t for t in kind.members.values() if t is not kind)
        return f"{kind}{kind.fields}({' '.join(map(_type_text, members))})"
    return str(kind)


def _function_text(function: FunctionType, seen: dict[CodeType, int]) -> str:
    """Bytecode and constants of a function and of everything it refers to."""
    code = function.__code__
    if code in seen:
        return f"<{seen[code]}>"
    seen[code] = len(seen)
    parts = [_code_text(code), repr(function.__defaults__)]
    scope = {name: function.__globals__.get(name) for name in _names(code)}
    cells = function.__closure__ or ()
    enclosed = {
        n: c.cell_contents for n, c in zip(code.co_freevars, cells, strict=True)
    }
    for name, value in (scope | enclosed).items():
        # kernels and numba's functions have a py_func, intrinsics a _defn
        python = getattr(value, "py_func", None) or getattr(value, "_defn", None)
        either = getattr(value, "py_funcs", () if python is None else (python,))
        if either:
            parts += [_function_text(function, seen) for function in either]
        elif isinstance(value, CONSTANTS):
            parts.append(f"{name}={value!r}")
        elif isinstance(value, FunctionType):
            parts.append(f"{name}={value.__qualname__}")
    return " ".join(parts)


def _code_text(code: CodeType) -> str:
    """Bytecode, names and constants, also of functions within."""
    parts = [code.co_code.hex(), repr(code.co_varnames), repr(code.co_names)]
    for constant in code.co_consts:
        within = isinstance(constant, CodeType)
        parts.append(_code_text(constant) if within else repr(constant))
    return " ".join(parts)


def _names(code: CodeType) -> list[str]:
    """Names that a function and those within it look up."""
    within = [c for c in code.co_consts if isinstance(c, CodeType)]
    return [*code.co_names, *(name for c in within for name in _names(c))]
