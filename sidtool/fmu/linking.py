"""The shared library of a unit, compiled and linked by `cc` or by `zig cc`.

`cc` is the C compiler of this machine, for libraries of its own platform. `ziglang` is
a Python package that compiles and links for all platforms.

Operating systems and processors that libraries are made for.

Object files of the kernels that a library is linked from.

They depend on the dimension of the scene, on the integrator and on the platform, not on
the scene. They are compiled once and cached on disk like the kernels of a run.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import report_stage
from sidtool.formats.storage.operating_system import cache_folder, system_and_processor
from sidtool.solver.compiler.kernels import Entry, Target
from sidtool.solver.compiler.precompile import find_kernel
from sidtool.solver.dynamics import output_quantities
from sidtool.solver.dynamics.equations_of_motion import kernels_by_name, law_value_at
from sidtool.solver.integrators import output_sampling
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.linear.factor_storage import KERNELS

from .supported import UNIT_INTEGRATORS

_PROCESSORS = {
    "x86_64": "x86_64",
    "amd64": "x86_64",
    "aarch64": "aarch64",
    "arm64": "aarch64",
}
_SYSTEMS = {"linux": "linux", "win32": "windows", "darwin": "darwin"}
#: How names of kernels begin in a library.
PREFIX = "sidtool_"
HEADERS = ("plant.h", "unit.h", "linear_plant.h", "exchange.h")
#: C files that one platform needs beside the others.
PLATFORM_SOURCES = {"win64": ("windows.c",)}


@dataclass(frozen=True)
class Platform:
    """A kind of machine on which a unit runs.

    Attributes
    ----------
    target : what LLVM compiles kernels for; a processor that all machines contain
    folders : folder of the library in the archive, by version of FMI
    ending : of the library
    zig_target : the same for `zig cc`
    """

    title: str
    target: Target
    folders: dict[str, str]
    ending: str
    zig_target: str


def _linux(processor: str, cpu: str, folder: str) -> Platform:
    """Linux with glibc 2.17 (2014) or newer."""
    return Platform(
        f"Linux, {processor}",
        Target(f"{processor}-unknown-linux-gnu", cpu),
        {"2.0": folder, "3.0": f"{processor}-linux"},
        ".so",
        f"{processor}-linux-gnu.2.17",
    )


def _macos(processor: str, cpu: str, folder: str) -> Platform:
    """MacOS 11 or newer."""
    return Platform(
        f"macOS, {processor}",
        Target(f"{processor}-apple-macosx11.0.0", cpu),
        {"2.0": folder, "3.0": f"{processor}-darwin"},
        ".dylib",
        f"{processor}-macos.11.0",
    )


#: FMI 2.0 names folders of processors that it does not know as FMI 3.0 does.
PLATFORMS = {
    "linux64": _linux("x86_64", "x86-64", "linux64"),
    "win64": Platform(
        "Windows, x86_64",
        Target("x86_64-w64-windows-gnu", "x86-64"),
        {"2.0": "win64", "3.0": "x86_64-windows"},
        ".dll",
        "x86_64-windows-gnu",
    ),
    "darwin64": _macos("x86_64", "x86-64", "darwin64"),
    "aarch64-linux": _linux("aarch64", "generic", "aarch64-linux"),
    "aarch64-darwin": _macos("aarch64", "apple-m1", "aarch64-darwin"),
}


def own_platform() -> str:
    """Name of the platform of this process, or an empty string if it is no target."""
    system, processor = system_and_processor()
    folder = f"{_PROCESSORS.get(processor)}-{_SYSTEMS.get(system)}"
    names = (name for name, each in PLATFORMS.items() if each.folders["3.0"] == folder)
    return next(names, "")


def parse_platforms(names: tuple[str, ...]) -> tuple[str, ...]:
    """Check names of platforms; by default that of this process, else Linux.

    Raises
    ------
    InputError : there is no such platform.
    """
    for name in names:
        if name not in PLATFORMS:
            raise InputError(
                f"found {name!r}",
                place="platforms",
                expected=" or ".join(PLATFORMS),
            )
    return tuple(dict.fromkeys(names)) or (own_platform() or "linux64",)


def called_kernels(planar: bool, integrator: str) -> dict[str, Entry]:
    """Kernels that the C sources call, by their names there."""
    method = INTEGRATORS[integrator]
    if planar:
        forces = output_quantities.write_forces_in_plane
        bodies = output_quantities.write_bodies_in_plane
    else:
        forces = output_quantities.write_forces_in_space
        bodies = output_quantities.write_bodies_in_space
    return {
        "advance": find_kernel(method.step_loop),
        "advance_past_singularity": find_kernel(method.singular_loop),
        "evaluate_start": output_sampling.evaluate_start,
        "sample": output_sampling.sample,
        "law_value_at": law_value_at,
        "write_forces": forces,
        "write_bodies": bodies,
    }


def library_kernels(planar: bool, integrator: str) -> Iterator[tuple[str, Entry, Any]]:
    """Symbol, kernel and signature of all kernels of a library."""
    for name, kernel in kernels_by_name(planar).items():
        yield PREFIX + name, kernel, KERNELS.members[name].signature
    for name, kernel in called_kernels(planar, integrator).items():
        yield PREFIX + name, kernel, kernel.signatures[0]


def precompile_units() -> int:
    """Compile the kernels of all units of this platform.

    Returns
    -------
    how many had to be compiled
    """
    (platform,) = parse_platforms(())
    target, count = PLATFORMS[platform].target, 0
    for planar in (True, False):
        for integrator in UNIT_INTEGRATORS:
            for symbol, kernel, signature in library_kernels(planar, integrator):
                if kernel.cached_code(signature, target, symbol) is None:
                    kernel.library_object(signature, target, symbol)
                    count += 1
    return count


def kernel_objects(planar: bool, integrator: str, target: Target) -> dict[str, bytes]:
    """Object files by symbol; they are compiled where they are not in the cache."""
    objects = {}
    kernels = list(library_kernels(planar, integrator))
    for k, (symbol, kernel, signature) in enumerate(kernels):
        report_stage(f"compiling for {target.triple}, once", k / len(kernels))
        objects[symbol] = kernel.library_object(signature, target, symbol)
    return objects


_COMMON_SOURCES = ("unit.c", "fmi2.c", "fmi3.c")
#: Sources of the unit of a scene, and of a linearised one.
SCENE_SOURCES = (*_COMMON_SOURCES, "plant.c", "lapack.c")
LINEAR_SOURCES = (
    *_COMMON_SOURCES,
    *("linear_plant.c", "exchange.c", "exchange2.c", "exchange3.c"),
)
FOLDER = Path(__file__).parent
#: Words of the image are read as numbers and as pointers.
OPTIONS = (
    *("-std=c11", "-O2", "-fno-strict-aliasing", "-ffp-contract=off"),
    *("-fvisibility=hidden", "-s"),
)
#: Sources that include a generated header; the others are the same in all units.
OWN_SOURCES = ("unit.c", "plant.c", "linear_plant.c")


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
    options = (*OPTIONS, "-DLINEAR") if sources == LINEAR_SOURCES else OPTIONS
    files = (*sources, *PLATFORM_SOURCES.get(platform, ()))
    keeps_objects = "ziglang" in command
    own = [name for name in files if keeps_objects or name in OWN_SOURCES]
    common = tuple(name for name in files if name not in own)
    compiled = _compiled((*command, *options), common) if common else {}
    for name, text in (c_sources(own) | dict(headers)).items():
        (folder / name).write_text(text, encoding="utf-8")
    for name, code in (compiled | dict(objects)).items():
        own.append(f"{name}.o")
        (folder / own[-1]).write_bytes(code)
    library = "unit" + PLATFORMS[platform].ending
    libraries = ["-lm"] if library.endswith(".so") else []
    output = ["-shared", *own, "-o", library, *libraries]
    _run_compiler([*command, *options, *output], folder)
    return (folder / library).read_bytes()


@cache
def _compiled(command: tuple[str, ...], sources: tuple[str, ...]) -> dict[str, bytes]:
    """Object files of C sources of this package by name, compiled once per process."""
    with tempfile.TemporaryDirectory(prefix="sidtool-fmu-") as name:
        folder = Path(name)
        for source, text in c_sources(sources).items():
            (folder / source).write_text(text, encoding="utf-8")
        _run_compiler([*command, "-c", *sources], folder)
        return {path.stem: path.read_bytes() for path in folder.glob("*.o")}


def _run_compiler(command: list[str], folder: Path) -> None:
    """Run a C compiler in a folder.

    Raises
    ------
    InputError : it fails.
    """
    outcome = subprocess.run(
        command,
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


def _zig_caches(folder: Path) -> dict[str, str]:
    """Folders of zig: it compiles the C library of a platform once, and keeps it."""
    users = cache_folder()
    kept = str(users / "zig") if users is not None else str(folder / "zig")
    known = {"ZIG_GLOBAL_CACHE_DIR": kept, "ZIG_LOCAL_CACHE_DIR": kept}
    return {name: os.environ.get(name, value) for name, value in known.items()}
