"""Machine code of kernels: compilation, loading and the call from Python.

numba translates a kernel and each kernel that it calls to LLVM; the units are linked,
optimised as a whole and compiled to an object file, which is cached on disk (see
`kernel_cache`) and loaded into the process. An entry kernel is one that Python calls,
or that other kernels call through a pointer.
"""

import ctypes
import hashlib
import platform
from collections.abc import Callable
from functools import cache, cached_property, partial
from types import FunctionType
from typing import Any

import llvmlite
from llvmlite import binding as llvm

from sidtool.formats.storage.hdf5_files import version_of

from . import kernel_cache
from .arrays import CHECKED, ViewType, array_words
from .inner_kernels import inner, lock
from .kernel_cache import compiler_digest, kernel_digest
from .tables import TableType
from .targets import ENTRY_SYMBOL, Target, host_target, new_machine
from .types import complex128, float64, int64, void

#: Engines, and the kernels by symbol that each one holds.
_engines: list[tuple[Any, set[str]]] = []

#: How numbers get into machine code and out of it.
C_TYPES = {
    float64: ctypes.c_double,
    int64: ctypes.c_int64,
    void: None,
}


@cache
def environment(target: Target | None = None) -> str:
    """The processor, and the versions of everything else that compiles."""
    target = target or host_target()
    versions = f"numba {version_of('numba')} llvmlite {llvmlite.__version__}"
    python = f"{platform.python_implementation()} {platform.python_version()}"
    processor = f"{target.triple} {target.processor} {target.features}"
    kind = "" if target.in_process else " library"
    checked = " checked" if CHECKED else ""
    return f"{python} {versions} {processor}{kind}{checked}"


def load_object_code(code: bytes, symbol: str = ENTRY_SYMBOL) -> int:
    """The address of a kernel in this process, where it stays.

    An engine takes any number of kernels, but each symbol once. One engine for all is
    made, and has their memory protected, in a third of the time of one for each.
    """
    with lock:
        engine, symbols = next(
            (each for each in _engines if symbol not in each[1]), (None, set())
        )
        if engine is None:
            machine = new_machine(host_target())
            engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
            _engines.append((engine, symbols))
        symbols.add(symbol)
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        return int(engine.get_function_address(symbol))


__all__ = ["Entry", "entry", "inner"]


class Entry:
    """A kernel that Python calls, or that other kernels call through a pointer."""

    def __init__(self, function: FunctionType, signatures: tuple[Any, ...]) -> None:
        self.signatures = signatures
        self._function = function
        self._addresses: dict[Any, int] = {}
        self._read: dict[Any, bytes] = {}

    @cached_property
    def code_digest(self) -> str:
        """Identifies one version of a kernel, with all that it calls."""
        return kernel_digest(self._function, self.signatures)

    def address(self, signature: Any) -> int:
        """Of the machine code for one signature; compiles or loads it once."""
        if signature not in self._addresses:
            with lock:
                if signature not in self._addresses:
                    code = self._read.pop(signature, None) or self._code(signature)
                    address = load_object_code(code, self._symbol(signature))
                    self._addresses[signature] = address
        return self._addresses[signature]

    def is_cached(self, signature: Any) -> bool:
        """True if the machine code is there already, loaded or on disk."""
        if signature not in self._addresses and signature not in self._read:
            code = self.cached_code(signature)
            if code is not None:
                self._read[signature] = code
        return signature in self._addresses or signature in self._read

    def cached_code(self, signature: Any, *library: Any) -> bytes | None:
        """The machine code on disk."""
        return kernel_cache.read_code(*self.cache_location(signature, *library))

    def cache_location(
        self, signature: Any, target: Target | None = None, symbol: str = ""
    ) -> tuple[str, str]:
        """Name of the file, one for all versions of the code, and the full key."""
        name, symbol = self._name, symbol or self._symbol(signature)
        slot = f"{name} {signature} {symbol} {environment(target)}"
        digest = hashlib.sha256(slot.encode()).hexdigest()[:16]
        file = f"{name.rpartition('.')[2]}-{digest}.kernel"
        return file, f"{slot} compiler {compiler_digest()} code {self.code_digest}"

    def library_object(self, signature: Any, target: Target, symbol: str) -> bytes:
        """An object file for shared libraries, see `compile_kernel`."""
        return self._code(signature, target, symbol)

    @property
    def _name(self) -> str:
        return f"{self._function.__module__}.{self._function.__qualname__}"

    def _symbol(self, signature: Any) -> str:
        """Name of the kernel in this process."""
        digest = hashlib.sha256(f"{self._name} {signature}".encode()).hexdigest()
        return f"{ENTRY_SYMBOL}_{digest[:16]}"

    def _code(self, signature: Any, *library: Any) -> bytes:
        library = library or (None, self._symbol(signature))
        code = self.cached_code(signature, *library)
        if code is None:
            from .lowering.units import compile_kernel

            code = compile_kernel(self._function, signature, *library)
            location = self.cache_location(signature, *library)
            kernel_cache.write_code(*location, code)
        return code

    def python_callable(self, signature: Any) -> Callable[..., Any]:
        """For callers in Python, with one signature."""
        return _python_wrapper(self.address(signature), signature)

    @cached_property
    def _default_callable(self) -> Callable[..., Any]:
        return self.python_callable(self.signatures[0])

    def __call__(self, *arguments: Any) -> Any:
        """Of a kernel with several signatures the first is meant."""
        return self._default_callable(*arguments)


def entry(*signatures: Any) -> Callable[[Any], Entry]:
    """An entry kernel for the given signatures."""
    return lambda function: Entry(function, signatures)


def _python_wrapper(address: int, signature: Any) -> Callable[..., Any]:
    """A function of tables, arrays and numbers; what calls it holds them meanwhile.

    Other threads of Python go on while it runs: machine code does not touch Python, see
    `_refuse_python`, and callables of laws take the lock of the interpreter themselves.
    """
    kinds = [_argument_conversion(kind) for kind in signature.args]
    returned = C_TYPES[signature.return_type]
    words = [word for listed, _ in kinds for word in listed]
    function = ctypes.CFUNCTYPE(returned, *words)(address)
    converters = [way for _, way in kinds]

    def call(*arguments: Any) -> Any:
        passed: list[Any] = []
        for converter, argument in zip(converters, arguments, strict=True):
            passed += converter(argument)
        return function(*passed)

    return call


def _argument_conversion(kind: Any) -> tuple[list[Any], Callable[[Any], list[Any]]]:
    """What becomes of an argument: types of words, and the words of a value."""
    if isinstance(kind, TableType):
        return [ctypes.c_void_p], lambda table: [kind.checked(table).address]
    if isinstance(kind, ViewType):
        words: list[Any] = [ctypes.c_void_p, *[ctypes.c_int64] * kind.ndim]
        return words, partial(array_words, kind)
    if kind == complex128:
        return [ctypes.c_double] * 2, lambda z: [z.real, z.imag]
    return [C_TYPES[kind]], lambda number: [number]
