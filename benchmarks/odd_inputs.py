"""Odd and hostile inputs, as files, and what is wrong with the end of each.

Each is refused with a message of one line, or read, within seconds: no traceback, no
hang, nothing but printable text.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from sidtool.formats.base.sid import BLOCK_SHAPES
from sidtool.formats.sid_files import read_sid, write_sid

#: Seconds that a message may take, also on a machine with other work.
PATIENCE = 60
MODEL = """
format = "sidtool model"
version = 1
material = {{youngs_modulus = 2.1e11, poissons_ratio = 0.3, density = 7850.0}}
geometry = {{type = "mesh", file = "{file}"}}
discretisation = {{type = "mesh"}}
frame = {{type = "buckens"}}
reduction = {{method = "modal", modes = 2}}
markers.a = {{node = 1, mesh_node = 1}}
"""
NODES = "1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,0,0,1\n6,1,0,1\n7,1,1,1\n8,0,1,1\n"
CUBE = f"*NODE\n{NODES}*ELEMENT, TYPE=C3D8, ELSET=E\n1,1,2,3,4,5,6,7,8\n"
SCENE = "format = 'sidtool scene'\nversion = 1\n"


def _mesh(text: str, name: str = "mesh.inp") -> Callable[[Path, Path], tuple[str, ...]]:
    def written_files(folder: Path, sid: Path) -> tuple[str, ...]:
        (folder / name).write_text(text, encoding="utf-8")
        (folder / "model.toml").write_text(MODEL.format(file=name), encoding="utf-8")
        return "convert", "model.toml", "-o", "made.h5"

    return written_files


def _pipe(folder: Path, sid: Path) -> tuple[str, ...]:
    command = _mesh("")(folder, sid)
    (folder / "mesh.inp").unlink()
    os.mkfifo(folder / "mesh.inp")
    return command


def _cascade(folder: Path, sid: Path) -> tuple[str, ...]:
    for i in range(30):
        (folder / f"part{i}.inp").write_text(
            f"*INCLUDE, INPUT=part{i + 1}.inp\n" * 10, encoding="utf-8"
        )
    return _mesh(CUBE, "part30.inp")(folder, sid) and _mesh(
        "*INCLUDE, INPUT=part0.inp\n"
    )(folder, sid)


def _text(content: str) -> Callable[[Path, Path], tuple[str, ...]]:
    def written_files(folder: Path, sid: Path) -> tuple[str, ...]:
        (folder / "odd.toml").write_text(content, encoding="utf-8")
        return "info", "odd.toml"

    return written_files


def _hdf5(change: Callable[[h5py.File], None]) -> Callable[..., tuple[str, ...]]:
    """A SID without its seal, changed."""

    def written_files(folder: Path, sid: Path) -> tuple[str, ...]:
        write_sid(folder / "whole.h5", read_sid(sid))
        (folder / "odd.h5").write_bytes((folder / "whole.h5").read_bytes()[512:])
        (folder / "other.bin").write_bytes(bytes(1 << 16))
        with h5py.File(folder / "odd.h5", "a") as file:
            change(file)
        return "info", "odd.h5"

    return written_files


def _loop(file: h5py.File) -> None:
    del file["nodes"]
    file["nodes"], file["back"] = h5py.SoftLink("/back"), h5py.SoftLink("/nodes")


def _external(file: h5py.File) -> None:
    shape = file["blocks/Cr/m0"].shape
    del file["blocks/Cr/m0"]
    storage = [("other.bin", 0, 8 * int(np.prod(shape)))]
    file.create_dataset("blocks/Cr/m0", shape=shape, dtype="f8", external=storage)


def _elsewhere(file: h5py.File) -> None:
    del file["blocks/Cr/m0"]
    file["blocks/Cr/m0"] = h5py.ExternalLink("whole.h5", "/blocks/Cr/m0")


def _virtual(file: h5py.File) -> None:
    shape = file["blocks/Cr/m0"].shape
    del file["blocks/Cr/m0"]
    layout = h5py.VirtualLayout(shape, "f8")
    layout[:] = h5py.VirtualSource("whole.h5", "blocks/Cr/m0", shape)
    file.create_virtual_dataset("blocks/Cr/m0", layout)


def _escapes(file: h5py.File) -> None:
    file.attrs["title"] = "\x1b]0;title\x07\x1b[31mred"


def _sid(change: Callable[[str], str]) -> Callable[[Path, Path], tuple[str, ...]]:
    def written_files(folder: Path, sid: Path) -> tuple[str, ...]:
        (folder / "odd.SID_FEM").write_text(
            change(sid.read_text(encoding="utf-8")), encoding="utf-8"
        )
        return "validate", "odd.SID_FEM"

    return written_files


def _placeholders(text: str) -> str:
    more = "".join(f"b{i}\nm1(999, 1, 999) = 1\nend b{i}\n" for i in range(1000))
    return text.replace(" end modal", more + " end modal")


def _empty(text: str) -> str:
    lines, inside = [], ""
    for line in text.split("\n"):
        word = line.strip()
        inside = "" if word.startswith("end ") else inside or word
        entry = inside in BLOCK_SHAPES and word[:2] in ("m0", "m1")
        lines += [] if entry and inside not in ("Me", "Ke", "De", "mdCM") else [line]
    return "\n".join(lines)


#: What is odd -> files in a folder, from some SID, and the command that meets them.
INPUTS: dict[str, Callable[[Path, Path], tuple[str, ...]]] = {
    "a node label of 1e20": _mesh(CUBE.replace("\n1,0,0,0", "\n1e20,0,0,0")),
    "a node label of 21 digits": _mesh(CUBE.replace("\n1,0,", f"\n1{'0' * 20},0,")),
    "an element label of 1e20": _mesh(CUBE.replace("\n1,1,2", "\n1e20,1,2")),
    "a node without a number": _mesh(CUBE.replace("\n1,0,0,0", "\n,0,0,0")),
    "a deck that takes in itself": _mesh("*INCLUDE, INPUT=mesh.inp\n" * 2),
    "a cascade of 10^30 includes": _cascade,
    "a mesh that is a FIFO": _pipe,
    "a key of 1000 parts": _text(".".join(["a"] * 1000) + " = 1\n"),
    "a value in 5000 brackets": _text("a = " + "[" * 5000 + "]" * 5000),
    "a hexadecimal version of 20000 digits": _text(f"version = 0x{'f' * 20000}\n"),
    "a version of 4000 digits": _text(f"version = {'9' * 4000}\n"),
    "a NUL in a title": _text(SCENE + 'title = "a\\u0000b"\n'),
    "a loop of links in HDF5": _hdf5(_loop),
    "external storage in HDF5": _hdf5(_external),
    "external links in HDF5": _hdf5(_elsewhere),
    "virtual data in HDF5": _hdf5(_virtual),
    "escape sequences in HDF5": _hdf5(_escapes),
    "a thousand unknown blocks": _sid(_placeholders),
    "blocks without entries": _sid(_empty),
    "a wrong count of modes": _sid(
        lambda text: re.sub(r"nelastq( *= *)\d+", r"nelastq\g<1>9", text)
    ),
}
#: Those that can be read; all others are refused.
READ = {"escape sequences in HDF5": 0, "blocks without entries": 1}


def outcome(what: str, folder: Path, sid: Path) -> list[str]:
    """What is wrong with the end of the command that meets this input."""
    command = INPUTS[what](folder, sid)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "sidtool", *command],
            cwd=folder,
            capture_output=True,
            timeout=PATIENCE,
        )
    except subprocess.TimeoutExpired:
        return [f"{what}: no end after {PATIENCE} s"]
    printed = done.stdout + done.stderr
    found = []
    if done.returncode != READ.get(what, 2):
        found.append(f"{what}: status {done.returncode}, {printed[-200:]!r}")
    if b"Traceback" in printed or any(c < 32 and c not in b"\n\t" for c in printed):
        found.append(f"{what}: {printed[-200:]!r}")
    if (folder / "made.h5").exists():
        found.append(f"{what}: a SID was written")
    return found
