"""Operating systems and processors that libraries are made for."""

from __future__ import annotations

from dataclasses import dataclass

from sidtool.formats.base.errors import InputError
from sidtool.formats.storage.operating_system import system_and_processor
from sidtool.solver.compiler.kernels import Target


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
_PROCESSORS = {
    "x86_64": "x86_64",
    "amd64": "x86_64",
    "aarch64": "aarch64",
    "arm64": "aarch64",
}
_SYSTEMS = {"linux": "linux", "win32": "windows", "darwin": "darwin"}


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
