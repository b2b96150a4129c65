"""Files that are cut off or changed: a message that names the file, or a sound body."""

from __future__ import annotations

import json
import os
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import read_model
from sidtool.geometry.nurbs_patch import patch_from_model
from sidtool.pipeline.model_to_sid import finite_element_model

from ..bodies import SOLIDS, volume, volume_data
from ..elements.test_frontend_patches import GISMO, geomdl, patches_model, written
from ..importers import test_import_matrices as matrices
from ..importers.mesh_files import BDF, FORMATS, cdb_text, mesh_model, rod_mesh
from ..models import IGA, annulus

SMALL = {"type": "iga", "degrees": [2, 2], "elements": [1, 1]}
#: How many spoiled copies of every file are read.
COPIES = int(os.environ.get("SIDTOOL_DAMAGED_COPIES", "12"))
NUMBERS = ["-1", "0", "1e400", "nan", "99999999999", "1.5", "x", "", "1e-320", "7"]
#: Writes files into a folder; returns the model file and the file to be spoiled.
Case = Callable[[Path], tuple[Path, str]]


def mesh_case(name: str) -> Case:
    def write(folder: Path) -> tuple[Path, str]:
        file, writer = FORMATS[name]
        (folder / file).write_text(writer(rod_mesh("hex8")), encoding="utf-8")
        clamp = "LEFT" if name == "inp" else "left"
        frame = {"type": "tangent", "marker": "crank_pin", "clamp": clamp}
        return mesh_model(folder, file, frame=frame), file

    return write


def bulk_case(file: str, text: str) -> Case:
    def write(folder: Path) -> tuple[Path, str]:
        (folder / file).write_text(text, encoding="utf-8")
        markers = {"pin": {"node": 1, "mesh_node": 1}}
        return mesh_model(
            folder, file, frame={"type": "buckens"}, markers=markers
        ), file

    return write


def matrix_case(name: str, file: str) -> Case:
    def write(folder: Path) -> tuple[Path, str]:
        body = finite_element_model(volume({"type": "hex8", "elements": [1, 1, 1]}))
        return matrices.model(folder, matrices.FORMATS[name](folder, body)), file

    return write


def patch_case(file: str) -> Case:
    def write(folder: Path) -> tuple[Path, str]:
        patch = patch_from_model(annulus(IGA).geometry)
        if file == "own.json":
            written(folder / file, {"a": patch})
        elif file == "arc.xml":
            (folder / file).write_text(GISMO, encoding="utf-8")
        else:
            (folder / file).write_text(json.dumps(geomdl(patch)), encoding="utf-8")
        path = patches_model(folder, "x", SMALL)
        data = json.loads(path.read_text(encoding="utf-8"))
        data["geometry"]["file"] = file
        data["frame"] = {"type": "buckens"}
        data["geometry"]["edges"] = {}
        data["markers"] = {"end": {"node": 2, "position": [0.0, 1.5]}}
        path.write_text(json.dumps(data), encoding="utf-8")
        return path, file

    return write


def volume_case(folder: Path) -> tuple[Path, str]:
    patch = patch_from_model(volume(SOLIDS["iga"]).geometry)
    (folder / "rod.json").write_text(json.dumps(geomdl(patch)), encoding="utf-8")
    settings = {"type": "iga", "degrees": [2, 1, 1], "elements": [1, 1, 1]}
    data = volume_data(settings)
    data["geometry"] = {"type": "patches", "file": "rod.json"}
    data["frame"] = {"type": "buckens"}
    data["markers"] = {"middle": {"node": 1, "position": [0.5, 0.0, 0.0]}}
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return folder / "model.json", "rod.json"


CASES: dict[str, Case] = {
    **{name: mesh_case(name) for name in FORMATS},
    "bdf": bulk_case("one.bdf", BDF),
    "cdb": bulk_case("one.cdb", cdb_text()),
    "sti": matrix_case("calculix", "rod.sti"),
    "mas": matrix_case("calculix", "rod.mas"),
    "dof": matrix_case("calculix", "rod.dof"),
    "nodes": matrix_case("calculix", "nodes.txt"),
    "mtx of Abaqus": matrix_case("abaqus", "k.mtx"),
    "mtx of MatrixMarket": matrix_case("matrix market", "m.mtx"),
    "npz": matrix_case("npz", "rod.npz"),
    "hdf5": matrix_case("hdf5", "rod.h5"),
    "own patches": patch_case("own.json"),
    "geomdl": patch_case("arc.json"),
    "geomdl volume": volume_case,
    "gismo": patch_case("arc.xml"),
}
BINARY = ("npz", "hdf5")


def spoiled_text(text: str, dice: random.Random) -> str:
    """One change: cut off, a character, a line, or a number."""
    lines = text.splitlines(keepends=True)
    i, j = dice.randrange(len(lines)), dice.randrange(len(lines))
    at = dice.randrange(len(text))
    kind = dice.randrange(7)
    if kind == 0:
        return text[:at]
    if kind == 1:
        return text[:at] + dice.choice("0 9,.-*$\nxé{[\0") + text[at + 1 :]
    if kind == 2:
        return "".join(lines[:i] + lines[i + 1 :])
    if kind == 3:
        return "".join(lines[:i] + [lines[j]] + lines[i:])
    if kind == 4:
        lines[i], lines[j] = lines[j], lines[i]
        return "".join(lines)
    words = text.split(" ")
    places = [k for k, word in enumerate(words) if any(c.isdigit() for c in word)]
    words[dice.choice(places)] = dice.choice(NUMBERS)
    return " ".join(words)


def spoiled_bytes(data: bytes, dice: random.Random) -> bytes:
    at = dice.randrange(len(data))
    if dice.random() < 0.3:
        return data[:at]
    return data[:at] + bytes([dice.randrange(256)]) + data[at + 1 :]


def spoil(path: Path, name: str, seed: int) -> None:
    dice, sound = random.Random(f"{name} {seed}"), path.read_bytes()
    if name in BINARY:
        spoiled = spoiled_bytes(sound, dice)
    else:
        spoiled = spoiled_text(sound.decode(), dice).encode()
    path.unlink()  # to shorten a file takes much longer
    path.write_bytes(spoiled)


@pytest.mark.parametrize("name", CASES)
def test_spoiled_copies(tmp_path: Path, name: str) -> None:
    model, file = CASES[name](tmp_path)
    finite_element_model(read_model(model))
    sound = (tmp_path / file).read_bytes()
    refused = 0
    for seed in range(COPIES):
        (tmp_path / file).unlink()
        (tmp_path / file).write_bytes(sound)
        spoil(tmp_path / file, name, seed)
        try:
            body = finite_element_model(read_model(model))
        except InputError as error:
            assert error.problem and (error.source or error.place)
            refused += 1
            continue
        assert np.isfinite(body.stiffness.data).all()
        assert (body.mass.diagonal() > 0).all()
    assert refused >= COPIES // 5
