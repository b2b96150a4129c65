"""Libraries for all platforms, linked by ziglang."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path
from unittest.mock import patch

import pytest

from sidtool.fmu import linking
from sidtool.fmu.linking import PLATFORMS, own_platform, parse_platforms
from sidtool.formats.base.errors import InputError
from tests.sidtool.fmu.conftest import slider_crank

#: Folders of FMI 2.0 and 3.0, file type and processor in the header of the library.
EXPECTED = {
    "linux64": ("linux64", "x86_64-linux", ".so", 62),
    "win64": ("win64", "x86_64-windows", ".dll", 0x8664),
    "darwin64": ("darwin64", "x86_64-darwin", ".dylib", 0x01000007),
    "aarch64-linux": ("aarch64-linux", "aarch64-linux", ".so", 183),
    "aarch64-darwin": ("aarch64-darwin", "aarch64-darwin", ".dylib", 0x0100000C),
}
MACHINES = {
    ("linux", "x86_64"): "linux64",
    ("linux", "aarch64"): "aarch64-linux",
    ("win32", "amd64"): "win64",
    ("win32", "arm64"): "",
    ("darwin", "x86_64"): "darwin64",
    ("darwin", "arm64"): "aarch64-darwin",
    ("linux", "riscv64"): "",
}


def processor_of(library: bytes) -> int:
    """The processor that the header of a shared library names."""
    if library[:4] == b"\x7fELF":
        kind, processor = struct.unpack_from("<HH", library, 16)
        assert kind == 3  # shared object
    elif library[:2] == b"MZ":
        (begin,) = struct.unpack_from("<I", library, 0x3C)
        assert library[begin : begin + 4] == b"PE\0\0"
        (processor,) = struct.unpack_from("<H", library, begin + 4)
        (flags,) = struct.unpack_from("<H", library, begin + 22)
        assert flags & 0x2000  # library
    else:
        magic, processor, _, kind = struct.unpack_from("<IIII", library)
        assert magic == 0xFEEDFACF and kind == 6  # dynamic library of 64 bits
    return int(processor)


def names_of_windows(library: bytes) -> tuple[list[str], list[str]]:
    """Functions that a library of Windows exports, and libraries that it imports."""
    (begin,) = struct.unpack_from("<I", library, 0x3C)
    count, size = struct.unpack_from("<H12xH", library, begin + 6)
    optional = begin + 24
    exports, _, imports = struct.unpack_from("<3I", library, optional + 112)
    sections = [
        struct.unpack_from("<4I", library, optional + size + 40 * k + 8)
        for k in range(count)
    ]

    def offset(address: int) -> int:
        for length, start, stored, place in sections:
            if start <= address < start + max(length, stored):
                return address - start + place
        raise AssertionError(address)

    def name(address: int) -> str:
        first = offset(address)
        return library[first : library.index(b"\0", first)].decode("ascii")

    n, *_, table = struct.unpack_from("<3I", library, offset(exports) + 24)
    names = struct.unpack_from(f"<{n}I", library, offset(table))
    entries, libraries = offset(imports), list[str]()
    while (address := struct.unpack_from("<I", library, entries + 12)[0]) != 0:
        libraries.append(name(address).lower())
        entries += 20
    return [name(each) for each in names], libraries


def check_windows(library: bytes) -> None:
    """Only the standard is visible, only the C library and its start-up are needed."""
    exports, imports = names_of_windows(library)
    assert {"fmi2DoStep", "fmi3DoStep"} < {*exports}
    assert all(name.startswith(("fmi2", "fmi3")) for name in exports)
    c_library = "api-ms-win-crt-", "kernel32.dll", "msvcrt.dll"
    assert imports and all(name.startswith(c_library) for name in imports)


def check_archive(path: Path, version: str) -> None:
    with zipfile.ZipFile(path) as archive:
        found = {
            Path(name).parts[1]: (Path(name).suffix, archive.read(name))
            for name in archive.namelist()
            if name.startswith("binaries/")
        }
    k = ("2.0", "3.0").index(version)
    assert found.keys() == {each[k] for each in EXPECTED.values()}
    for *folders, ending, processor in EXPECTED.values():
        suffix, library = found[folders[k]]
        assert suffix == ending
        assert processor_of(library) == processor
        assert b"fmi2DoStep" in library and b"fmi3DoStep" in library
        if ending == ".dll":
            check_windows(library)
        if ending != ".dylib":  # whose table of symbols names hidden ones, too
            assert b"sidtool_" not in library


@pytest.mark.needs("ziglang")
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_scene_is_linked_for_all_platforms(version: str, tmp_path: Path) -> None:
    path = tmp_path / "machine.fmu"
    unit = slider_crank().fmu(
        path, version=version, platforms=list(PLATFORMS), linker="zig"
    )
    assert unit.libraries.keys() == EXPECTED.keys()
    check_archive(path, version)


@pytest.mark.needs("ziglang")
def test_a_state_space_is_linked_for_all_platforms(tmp_path: Path) -> None:
    space = slider_crank().state_space(about="start", outputs=["piston.x"])
    space.fmu(tmp_path / "plant.fmu", version="3.0", platforms=list(PLATFORMS))
    check_archive(tmp_path / "plant.fmu", "3.0")


@pytest.mark.parametrize("machine", MACHINES)
def test_the_default_is_the_own_platform(machine: tuple[str, str]) -> None:
    with patch.object(linking, "system_and_processor", lambda: machine):
        assert own_platform() == MACHINES[machine]
        assert parse_platforms(()) == (MACHINES[machine] or "linux64",)


def test_an_unknown_platform_is_refused() -> None:
    with pytest.raises(InputError, match="platforms"):
        parse_platforms(("amiga",))
