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


PLATFORMS = {
    "linux64": Platform(
        "Linux, x86-64",
        Target("x86_64-unknown-linux-gnu", "x86-64"),
        {"2.0": "linux64", "3.0": "x86_64-linux"},
        ".so",
        "x86_64-linux-gnu.2.17",
    ),
    "win64": Platform(
        "Windows, x86-64",
        Target("x86_64-w64-windows-gnu", "x86-64"),
        {"2.0": "win64", "3.0": "x86_64-windows"},
        ".dll",
        "x86_64-windows-gnu",
    ),
}


def own_platform() -> str:
    """Name of the platform of this process, or an empty string if it is no target."""
    system, processor = system_and_processor()
    if processor not in ("x86_64", "amd64"):
        return ""
    return {"linux": "linux64", "win32": "win64"}.get(system, "")


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
