"""How kernels are compiled: entry kernels at first use, inner ones with them.

An entry kernel has explicit signatures and a place in the cache on disk. Inner kernels
are compiled into the entry kernels that call them, and only then: a program that finds
its entry kernels in the cache never touches them. The cache of an entry kernel holds
as long as its own code and that of everything it calls stays the same, wherever in the
package that code stands.
"""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Callable
from functools import cached_property
from types import FunctionType
from typing import Any

from numba import types

from . import stored
from .inner import inner, lock
from .machine import compiled, environment, load
from .stamps import machinery, stamp
from .tables import TableType
from .views import ViewType, array_words

__all__ = ["Entry", "entry", "inner"]

#: How numbers get into machine code and out of it.
PLAIN = {types.float64: ctypes.c_double, types.int64: ctypes.c_int64, types.void: None}


class Entry:
    """A kernel that Python calls, or that other kernels call through a pointer."""

    def __init__(self, function: FunctionType, signatures: tuple[Any, ...]) -> None:
        self.signatures = signatures
        self._function = function
        self._addresses: dict[Any, int] = {}

    @cached_property
    def stamp(self) -> str:
        """Tells one version of a kernel, with all that it calls, from another."""
        return stamp(self._function, self.signatures)

    def address(self, signature: Any) -> int:
        """Of the machine code for one signature; compiles or loads it once."""
        if signature not in self._addresses:
            with lock:
                if signature not in self._addresses:
                    self._addresses[signature] = load(self._code(signature))
        return self._addresses[signature]

    def is_cached(self, signature: Any) -> bool:
        """Whether the machine code is there already, loaded or on disk."""
        return signature in self._addresses or self.found(signature) is not None

    def found(self, signature: Any) -> bytes | None:
        """The machine code on disk."""
        return stored.read(*self.place(signature))

    def place(self, signature: Any) -> tuple[str, str]:
        """Name of the file, one for all versions of the code, and the full key."""
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        slot = f"{name} {signature} {environment()}"
        digest = hashlib.sha256(slot.encode()).hexdigest()[:16]
        file = f"{name.rpartition('.')[2]}-{digest}.kernel"
        return file, f"{slot} compiler {machinery()} code {self.stamp}"

    def _code(self, signature: Any) -> bytes:
        code = self.found(signature)
        if code is None:
            code = compiled(self._function, signature)
            stored.write(*self.place(signature), code)
        return code

    def called(self, signature: Any) -> Callable[..., Any]:
        """For callers in Python, with one signature."""
        return _called_from_python(self.address(signature), signature)

    @cached_property
    def _first(self) -> Callable[..., Any]:
        return self.called(self.signatures[0])

    def __call__(self, *arguments: Any) -> Any:
        """Of a kernel with several signatures the first is meant."""
        return self._first(*arguments)


def entry(*signatures: Any) -> Callable[[Any], Entry]:
    """An entry kernel for the given signatures."""
    return lambda function: Entry(function, signatures)


def _called_from_python(address: int, signature: Any) -> Callable[..., Any]:
    """A function of tables, arrays and numbers; what calls it holds them meanwhile."""
    kinds = [_passed(kind) for kind in signature.args]
    returned = PLAIN[signature.return_type]
    words = [word for listed, _ in kinds for word in listed]
    function = ctypes.PYFUNCTYPE(returned, *words)(address)
    ways = [way for _, way in kinds]

    def call(*arguments: Any) -> Any:
        passed: list[Any] = []
        for way, argument in zip(ways, arguments, strict=True):
            passed += way(argument)
        return function(*passed)

    return call


def _passed(kind: Any) -> tuple[list[Any], Callable[[Any], list[Any]]]:
    """What becomes of an argument: types of words, and the words of a value."""
    if isinstance(kind, TableType):
        return [ctypes.c_void_p], lambda table: [kind.checked(table).address]
    if isinstance(kind, ViewType):
        words: list[Any] = [ctypes.c_void_p, *[ctypes.c_int64] * kind.ndim]
        return words, lambda array: array_words(kind, array)
    if kind == types.complex128:
        return [ctypes.c_double] * 2, lambda z: [z.real, z.imag]
    return [PLAIN[kind]], lambda number: [number]
