"""Cache of compiled kernels on disk: one file per kernel, complete or absent.

A file holds a checksum, the key of the kernel and its machine code. A file that cannot
be read, does not fit the key or may have been written by another user is ignored. The
key is a digest of the kernel with all functions and constants that it refers to, of
the compiler of this package and of the environment.
"""

import hashlib
import os
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics.record import Diagnostic, diagnose, warn_of
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.storage.operating_system import (
    Untrusted,
    cache_folder,
    create_file,
    make_trusted_folder,
    read_trusted,
)
from sidtool.formats.storage.unreadable import failure_reason

from .arrays import PointerType
from .tables import TableType
from .types import KernelType, Signature

MAGIC = b"sidtool kernel 1\n"
#: Bytes of the checksum and of the length of the key.
DIGEST_SIZE, LENGTH_SIZE = 32, 8
#: Permissions of a file: others may use what an administrator has compiled.
MODE = 0o644
COMPILER_FOLDER = Path(__file__).resolve().parent

_warned: set[str] = set()

#: Globals that kernels take into their code; others only share a name with a field.
HASHED_TYPES = (bool, int, float, complex, str, tuple, list, dict, KernelType)
#: What decides beside the code of a kernel what becomes of it.
COMPILER_MODULES = (
    "compiler.kernels",
    "compiler.inner_kernels",
    "compiler.kernel_cache",
    "compiler.types",
    "compiler.targets",
    "compiler.tables",
    "compiler.arrays",
    "compiler.records",
    "compiler.vectors",
    "compiler.lowering.numba_types",
    "compiler.lowering.memory",
    "compiler.lowering.vectors",
    "compiler.lowering.fast_lowering",
    "compiler.lowering.units",
    "spatial.algebra",
    "spatial.system_arrays",
    "spatial.dimension",
)


def cache_folders() -> list[Path]:
    """Where kernels are looked for, and written if possible: the first comes first.

    The folder in NUMBA_CACHE_DIR, or the package and, behind it, the user's cache.
    """
    package = hashlib.sha256(os.fsencode(COMPILER_FOLDER)).hexdigest()[:16]
    configured = os.environ.get("NUMBA_CACHE_DIR")
    if configured:
        return [Path(configured).absolute() / f"sidtool-{package}"]
    folders, users = [COMPILER_FOLDER / "__pycache__"], cache_folder()
    return folders if users is None else [*folders, users / package]


def read_code(name: str, key: str) -> bytes | None:
    """The machine code in a file, if it is whole and of this key."""
    for folder in cache_folders():
        path = folder / name
        try:
            content = read_trusted(path, _trusted_like(folder))
        except Untrusted as error:
            reason = failure_reason(error)
            warn_once(diagnose("N812", path=error.filename, reason=reason))
            continue
        except OSError:
            continue
        try:
            stored_version, code = _decode(content)
        except ValueError:
            warn_once(diagnose("N811", path=str(path)))
            continue
        if stored_version == key:
            return code
    return None


def write_code(name: str, key: str, code: bytes) -> None:
    """Stores machine code where that is possible."""
    content = _encode(key, code)
    failures = []
    for folder in cache_folders():
        try:
            make_trusted_folder(folder, _trusted_like(folder))
            path = folder / name
            with atomic_path(path, keep_beside=False, mode=MODE) as temporary:
                temporary.write_bytes(content)
            return
        except OSError as error:
            failures.append(f"{folder} ({failure_reason(error)})")
        except InputError as error:
            failures.append(f"{folder} ({error.problem})")
    _warn_unwritable(failures)


def is_writable() -> bool:
    """True if kernels can be cached at all; reports if they cannot."""
    failures = []
    for folder in cache_folders():
        try:
            make_trusted_folder(folder, _trusted_like(folder))
            create_file(folder, ".sidtool-", ".tmp").unlink()
            return True
        except OSError as error:
            failures.append(f"{folder} ({failure_reason(error)})")
    _warn_unwritable(failures)
    return False


def _trusted_like(folder: Path) -> Path | None:
    """The package beside whose code kernels stand: who may change that is trusted."""
    return (
        folder.parent
        if folder.parent == COMPILER_FOLDER and COMPILER_FOLDER.is_dir()
        else None
    )


def has_failed_to_write() -> bool:
    """True if this process has failed to keep a kernel."""
    return "N810" in _warned


def warn_once(found: Diagnostic) -> None:
    """Warns once of each code."""
    if found.code not in _warned:
        _warned.add(found.code)
        warn_of(found)


def _warn_unwritable(failures: list[str]) -> None:
    if "N812" in _warned:  # the same folders: one warning is enough
        _warned.add("N810")
    warn_once(diagnose("N810", folders=failures))


def _encode(key: str, code: bytes) -> bytes:
    text = key.encode()
    body = len(text).to_bytes(LENGTH_SIZE, "little") + text + code
    return MAGIC + hashlib.sha256(body).digest() + body


def _decode(content: bytes) -> tuple[str, bytes]:
    """Key and machine code.

    Raises
    ------
    ValueError
        These are not the bytes that were written.
    """
    start = len(MAGIC) + DIGEST_SIZE
    header, body = content[:start], content[start:]
    if header != MAGIC + hashlib.sha256(body).digest():
        raise ValueError("checksum")
    end = LENGTH_SIZE + int.from_bytes(body[:LENGTH_SIZE], "little")
    return body[LENGTH_SIZE:end].decode(), body[end:]


def kernel_digest(function: FunctionType, signatures: tuple[Any, ...]) -> str:
    """Of a kernel with all that it calls.

    Its name is a part: kernels of plane and of space are written once.
    """
    texts = [function.__qualname__, *map(_type_text, signatures)]
    functions, numbers = [function], {function: 0}
    for each in functions:  # which grow meanwhile
        digest, callees = _function_digest(each)
        for callee in callees:
            if callee not in numbers:
                numbers[callee] = len(functions)
                functions.append(callee)
        texts.append(f"{digest} {[numbers[callee] for callee in callees]}")
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


@cache
def compiler_digest() -> str:
    """Of our own code that turns kernels into machine code."""
    solver = __package__.rpartition(".")[0]
    specs: list[Any] = [find_spec(f"{solver}.{name}") for name in COMPILER_MODULES]
    sources = [spec.loader.get_data(spec.origin) for spec in specs]
    return hashlib.sha256(b"".join(sources)).hexdigest()


def _type_text(kind: Any) -> str:
    """A signature with the fields of its tables."""
    if isinstance(kind, Signature):
        return " ".join(_type_text(t) for t in (kind.return_type, *kind.args))
    if isinstance(kind, PointerType):
        return _type_text(kind.signature)
    return _table_text(kind) if isinstance(kind, TableType) else str(kind)


@cache
def _table_text(kind: TableType) -> str:
    members = (t for t in kind.members.values() if t is not kind)
    return f"{kind}{kind.fields}({' '.join(map(_type_text, members))})"


@cache
def _function_digest(function: FunctionType) -> tuple[str, list[FunctionType]]:
    """Of bytecode and constants of a function, and the functions that it refers to.

    Those of one factory have the same code, and differ in what they enclose.
    """
    code = function.__code__
    parts = [_code_text(code), repr(function.__defaults__)]
    callees: list[FunctionType] = []
    scope = {name: function.__globals__.get(name) for name in _looked_up_names(code)}
    cells = function.__closure__ or ()
    enclosed = {
        n: c.cell_contents for n, c in zip(code.co_freevars, cells, strict=True)
    }
    for name, value in (scope | enclosed).items():
        if value is None:  # as for names of attributes
            continue
        # kernels and numba's functions have a py_func, intrinsics a _defn
        python = getattr(value, "py_func", None) or getattr(value, "_defn", None)
        python = value if isinstance(value, FunctionType) else python
        either = getattr(value, "py_funcs", () if python is None else (python,))
        callees += either
        if either or isinstance(value, HASHED_TYPES):
            parts.append(name if either else f"{name}={value!r}")
    return hashlib.sha256(" ".join(parts).encode()).hexdigest(), callees


def _code_text(code: CodeType) -> str:
    """Bytecode, names and constants, also of functions within."""
    parts = [code.co_code.hex(), repr(code.co_varnames), repr(code.co_names)]
    for constant in code.co_consts:
        is_code = isinstance(constant, CodeType)
        parts.append(_code_text(constant) if is_code else repr(constant))
    return " ".join(parts)


def _looked_up_names(code: CodeType) -> list[str]:
    """Names that a function and those within it look up."""
    nested = [c for c in code.co_consts if isinstance(c, CodeType)]
    return [*code.co_names, *(name for c in nested for name in _looked_up_names(c))]
