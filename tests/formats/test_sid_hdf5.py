"""HDF5 files that are damaged, edited, or written by another program."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.sid_files import read_sid, write_sid
from tests.bodies import particle_body
from tests.formats.sids import assert_same

BODY = particle_body(2, 6, nodes=2, stiffening=True)
Change = Callable[[h5py.File], None]


@pytest.mark.parametrize("damage", ["bytes", "cut"])
def test_damaged_files(tmp_path: Path, damage: str) -> None:
    """No bit of a damaged file is believed."""
    path, rng = tmp_path / "body.h5", random.Random(damage)
    write_sid(path, BODY)
    whole = path.read_bytes()
    for _ in range(100):
        content = bytearray(whole)
        if damage == "cut":
            del content[rng.randrange(len(content)) :]
        else:
            for where in rng.sample(range(len(content)), rng.randrange(1, 9)):
                content[where] ^= rng.randrange(1, 256)
        path.unlink()  # to shorten a file takes much longer
        path.write_bytes(content)
        with pytest.raises(InputError) as caught:
            read_sid(path)
        assert caught.value.source == str(path)
        assert caught.value.expected


def unsealed(path: Path) -> None:
    """The same file without the user block, as another HDF5 program would write it."""
    copy = path.with_suffix(".copy")
    with h5py.File(path) as source, h5py.File(copy, "w") as target:
        for name in source:
            source.copy(name, target)
        target.attrs.update(source.attrs)
    copy.replace(path)


def test_files_of_other_programs_are_read(tmp_path: Path) -> None:
    path = tmp_path / "body.h5"
    write_sid(path, BODY)
    unsealed(path)
    assert_same(read_sid(path), BODY, 0.0)


def test_edits_of_a_sealed_file_are_noticed(tmp_path: Path) -> None:
    path = tmp_path / "body.h5"
    write_sid(path, BODY)
    with h5py.File(path, "r+") as file:
        file["blocks/Ke/m0"][0, 0] = 1.0
    with pytest.raises(InputError, match="changed after it was written"):
        read_sid(path)


def test_the_file_describes_itself(tmp_path: Path) -> None:
    """Any HDF5 program finds the blocks under their names."""
    path = tmp_path / "body.h5"
    write_sid(path, BODY)
    with h5py.File(path) as file:
        assert (file.attrs["format"], file.attrs["version"]) == ("sidtool SID", 1)
        assert list(file["labels"].asstr()) == list(BODY.labels)
        assert np.array_equal(file["blocks/Ke/m0"], BODY.Ke.m0)
        assert file["nodes/phi/m0"].shape == (2, 3, 2)
        assert list(file["nodes/id"].asstr()) == ["1", "2"]


def test_a_text_that_hdf5_cannot_hold_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "body.h5"
    write_sid(path, BODY)
    with pytest.raises(InputError, match="text"):
        write_sid(path, replace(BODY, title="a\0b"))
    assert_same(read_sid(path), BODY, 0.0)
    assert [entry.name for entry in tmp_path.iterdir()] == ["body.h5"]


def put(name: str, data: object) -> Change:
    def change(file: h5py.File) -> None:
        del file[name]
        if data is not None:
            file[name] = data

    return change


def attribute(name: str, data: object) -> Change:
    def change(file: h5py.File) -> None:
        del file.attrs[name]
        if data is not None:
            file.attrs[name] = data

    return change


def absurd(file: h5py.File) -> None:
    del file["blocks/Ke/m0"]
    file.create_dataset("blocks/Ke/m0", (10**6, 10**6), chunks=(100, 100), dtype="f8")


def never_written(file: h5py.File) -> None:
    del file["blocks/Ke/m0"]
    file.create_dataset("blocks/Ke/m0", (2, 2), dtype="f8")


def a_group(file: h5py.File) -> None:
    del file["nodes/AP/node"]
    file.create_group("nodes/AP/node")


WRONG: dict[str, Change] = {
    "no format": attribute("format", None),
    "other format": attribute("format", "sidtool result"),
    "format is a number": attribute("format", 3),
    "later version": attribute("version", 2),
    "version is a text": attribute("version", "1"),
    "mass is a text": attribute("mass", "heavy"),
    "mass is NaN": attribute("mass", float("nan")),
    "mass is a list": attribute("mass", [1.0, 2.0]),
    "title is a number": attribute("title", 1.0),
    "no dialect": attribute("dialect", None),
    "dialect is not JSON": attribute("dialect", "{"),
    "dialect is a list": attribute("dialect", "[]"),
    "dialect of wrong types": attribute("dialect", '{"writer": 1}'),
    "no labels": put("labels", None),
    "labels are numbers": put("labels", np.zeros(2)),
    "too many labels": put("labels", ["a", "b", "c"]),
    "no block": put("blocks/Ke", None),
    "block is a dataset": put("blocks/Ke", np.zeros((2, 2))),
    "dataset is a group": a_group,
    "block of integers": put("blocks/Ke/m0", np.zeros((2, 2), dtype=int)),
    "block of texts": put("blocks/Ke/m0", ["a"]),
    "block of complex numbers": put("blocks/Ke/m0", np.zeros((2, 2), dtype=complex)),
    "block of wrong shape": put("blocks/Ke/m0", np.zeros((3, 2))),
    "block of wrong rank": put("blocks/Ke/m0", np.zeros(4)),
    "block with NaN": put("blocks/Ke/m0", np.full((2, 2), np.nan)),
    "block of absurd size": absurd,
    "block never written": never_written,
    "too few nodes": put("nodes/phi/m0", np.zeros((1, 3, 2))),
    "node numbers are real": put("nodes/phi/node", np.zeros(2)),
    "node numbers repeat": put("nodes/phi/node", np.zeros(2, dtype=int)),
    "nodes named alike": put("nodes/id", ["1", "1"]),
    "no nodes": put("nodes", None),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_types_and_sizes(tmp_path: Path, wrong: str) -> None:
    path = tmp_path / "body.h5"
    write_sid(path, BODY)
    unsealed(path)
    with h5py.File(path, "r+") as file:
        WRONG[wrong](file)
    with pytest.raises(InputError) as caught:
        read_sid(path)
    assert caught.value.source == str(path)
    assert "\n" not in str(caught.value)
    assert caught.value.expected


def _external(file: h5py.File, folder: Path) -> None:
    secret = folder / "secret"
    np.arange(4.0).tofile(secret)
    del file["blocks/Ke/m0"]
    file.create_dataset(
        "blocks/Ke/m0", (2, 2), np.float64, external=[(str(secret), 0, 32)]
    )


def _virtual(file: h5py.File, folder: Path) -> None:
    with h5py.File(folder / "other.h5", "w") as other:
        other["numbers"] = np.eye(2)
    layout = h5py.VirtualLayout((2, 2), np.float64)
    layout[:] = h5py.VirtualSource(folder / "other.h5", "numbers", (2, 2))
    del file["blocks/Ke/m0"]
    file.create_virtual_dataset("blocks/Ke/m0", layout)


def _external_link(file: h5py.File, folder: Path) -> None:
    with h5py.File(folder / "other.h5", "w") as other:
        other["numbers"] = np.eye(2)
    del file["blocks/Ke/m0"]
    file["blocks/Ke/m0"] = h5py.ExternalLink("other.h5", "numbers")


def _loop(file: h5py.File, folder: Path) -> None:
    del file["labels"]
    file["labels"] = h5py.SoftLink("/round")
    file["round"] = h5py.SoftLink("/labels")


@pytest.mark.parametrize("put", [_external, _virtual, _external_link, _loop])
def test_only_data_of_the_file_itself_are_read(
    tmp_path: Path, put: Callable[[h5py.File, Path], None]
) -> None:
    path = tmp_path / "body.h5"
    write_sid(path, BODY)
    unsealed(path)
    with h5py.File(path, "a") as file:
        put(file, tmp_path)
    with pytest.raises(InputError) as caught:
        read_sid(path)
    assert caught.value.expected == "data in this file itself"
    assert caught.value.place in {"/blocks/Ke/m0", "/labels", "/round"}
