"""The shared library of a unit, compiled and linked by `cc` or by `zig cc`.

`cc` is the C compiler of this machine, for libraries of its own platform. `ziglang` is
a Python package that compiles and links for all platforms.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from sidtool.formats.base.errors import InputError
from sidtool.formats.storage.operating_system import cache_folder

from .platforms import PLATFORMS, own_platform

_COMMON_SOURCES = ("unit.c", "fmi2.c", "fmi3.c")
#: Sources of the unit of a scene, and of a linearised one.
SCENE_SOURCES = (*_COMMON_SOURCES, "plant.c", "lapack.c")
LINEAR_SOURCES = (
    *_COMMON_SOURCES,
    *("linear_plant.c", "exchange.c", "exchange2.c", "exchange3.c"),
)
HEADERS = ("plant.h", "unit.h", "linear_plant.h", "exchange.h")
#: C files that one platform needs beside the others.
PLATFORM_SOURCES = {"win64": ("windows.c",)}
FOLDER = Path(__file__).parent
#: Words of the image are read as numbers and as pointers.
OPTIONS = (
    *("-std=c11", "-O2", "-fno-strict-aliasing", "-ffp-contract=off"),
    *("-fvisibility=hidden", "-shared", "-s"),
)


def c_sources(sources: Sequence[str]) -> dict[str, str]:
    """C files of this package with their headers, by name."""
    others = [name for names in PLATFORM_SOURCES.values() for name in names]
    names = (*sources, *HEADERS, *others)
    return {name: (FOLDER / name).read_text(encoding="utf-8") for name in names}


def choose_linker(platform: str, wanted: str | None) -> list[str]:
    """The command that links for a platform: `cc` for the own one, else `zig cc`.

    Raises
    ------
    InputError : neither is there, or not the wanted one.
    """
    cc = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    can_use_cc = platform == own_platform() and PLATFORMS[platform].ending == ".so"
    if wanted != "zig" and can_use_cc and cc:
        return [cc, "-fPIC", "-Wl,-z,noexecstack"]
    if wanted != "cc" and find_spec("ziglang") is not None:
        target = PLATFORMS[platform].zig_target
        return [sys.executable, "-m", "ziglang", "cc", "-target", target]
    title = PLATFORMS[platform].title
    package = 'the package ziglang: pip install "sidtool[fmu]"'
    raise InputError(
        f"there is no C compiler and linker for {title}",
        place="platforms",
        expected=f"a C compiler (cc), or {package}" if can_use_cc else package,
    )


def link(
    platform: str,
    headers: Mapping[str, str],
    objects: Mapping[str, bytes],
    linker: str | None = None,
    sources: Sequence[str] = SCENE_SOURCES,
) -> bytes:
    """The shared library of a platform.

    Parameters
    ----------
    sources : C files of this package, `SCENE_SOURCES` or `LINEAR_SOURCES`
    headers : generated headers, by name
    objects : object files of the kernels, by symbol
    linker : "cc", "zig" or None for what is there

    Raises
    ------
    InputError : there is no linker, or it fails.
    """
    command = choose_linker(platform, linker)
    with tempfile.TemporaryDirectory(prefix="sidtool-fmu-") as folder:
        return _linked(command, platform, headers, objects, Path(folder), sources)


def _linked(
    command: list[str],
    platform: str,
    headers: Mapping[str, str],
    objects: Mapping[str, bytes],
    folder: Path,
    sources: Sequence[str],
) -> bytes:
    """The library of `link`, made in an empty folder, which takes all files."""
    for name, text in (c_sources(sources) | dict(headers)).items():
        (folder / name).write_text(text, encoding="utf-8")
    for symbol, code in objects.items():
        (folder / f"{symbol}.o").write_bytes(code)
    library = "unit" + PLATFORMS[platform].ending
    files = [*sources, *PLATFORM_SOURCES.get(platform, ())]
    files += [f"{symbol}.o" for symbol in objects]
    options = [*OPTIONS, "-DLINEAR"] if sources == LINEAR_SOURCES else OPTIONS
    libraries = ["-lm"] if library.endswith(".so") else []
    outcome = subprocess.run(
        [*command, *options, *files, "-o", library, *libraries],
        cwd=folder,
        env=os.environ | _zig_caches(folder),
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
    )
    if outcome.returncode:
        lines = (outcome.stderr or outcome.stdout).strip().splitlines()
        raise InputError(
            f"{command[0]} cannot link the library: {' | '.join(lines[:5])}",
            place="linker",
            expected="a working C compiler, or --linker",
        )
    return (folder / library).read_bytes()


def _zig_caches(folder: Path) -> dict[str, str]:
    """Folders of zig: it compiles the C library of a platform once, and keeps it."""
    users = cache_folder()
    kept = str(users / "zig") if users is not None else str(folder / "zig")
    known = {"ZIG_GLOBAL_CACHE_DIR": kept, "ZIG_LOCAL_CACHE_DIR": kept}
    return {name: os.environ.get(name, value) for name, value in known.items()}
