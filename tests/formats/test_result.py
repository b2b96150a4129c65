"""Results: what is written is read back, and half files never pass for whole ones."""

from __future__ import annotations

import csv
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import diagnose, plain_text
from sidtool.formats.geometric_stiffening import LoadStiffening
from sidtool.formats.result import (
    Excitation,
    FlexibleBody,
    Result,
    read_result,
    write_csv,
    write_result,
)
from sidtool.formats.result.data import TABLES
from sidtool.formats.result.hdf5 import read_bodies
from sidtool.formats.storage.hdf5_files import write_sealed


@pytest.fixture
def result() -> Result:
    t = np.array([0.0, 0.1, 0.30000000000000004])
    return Result(
        title="Größe",
        names=("piston.x", "rod.q1"),
        t=t,
        values=np.stack([np.sin(t), np.pi * 1e-7 * t], axis=1),
        positions=np.ones((3, 3)),
        velocities=np.zeros((3, 2)),
        multipliers=np.zeros((3, 0)),
        position_names=("a.x", "a.y", "a.angle"),
        velocity_names=("a.vx", "a.vy"),
        counters={"steps": 12, "seconds": 0.25},
        drift={"position": 1e-12},
        settings={"integrator": "radau5", "rtol": 1e-6},
        scene='{"title": "Größe"}',
        versions={"sidtool": "0.1.0"},
        completed=False,
        message="the step became too small",
        diagnostics=(
            diagnose("N233", "a, b", reason="2 redundant constraints"),
            plain_text("größer als 1e-6", "warning"),
        ),
    )


def test_hdf5_returns_every_bit(result: Result, tmp_path: Path) -> None:
    write_result(tmp_path / "r.h5", result)
    back = read_result(tmp_path / "r.h5")
    for name in ("t", "values", "positions", "velocities", "multipliers"):
        assert np.array_equal(getattr(back, name), getattr(result, name))
    texts = ("title", "names", "position_names", "scene", "completed", "message")
    for name in (*texts, "diagnostics", "notes", "warnings"):
        assert getattr(back, name) == getattr(result, name)
    for name in ("counters", "drift", "settings", "versions"):
        assert dict(getattr(back, name)) == dict(getattr(result, name))


def test_flexible_bodies_come_back_whole(result: Result, tmp_path: Path) -> None:
    found = LoadStiffening(-2.5, "rotation of 6 rad/s", diverges=True, time=15.0)
    rod = FlexibleBody(
        highest_frequency=1254.9,
        excitation=Excitation(6.0, "crank_angle"),
        expected=LoadStiffening(0.1, "acceleration of 3 m/s2", carried=True),
        found=found,
        labels=("bending", "größer"),
        frequencies=np.array([31.7, 200.5]),
        amplitudes=np.array([1e-3, 2e-5]),
        energy_shares=np.array([0.9, 0.1]),
        deflection=0.3,
    )
    still = FlexibleBody(3.0, Excitation(), LoadStiffening())
    bodies = {"rod": rod, "still": still}
    write_result(tmp_path / "r.h5", replace(result, bodies=bodies))
    back = read_result(tmp_path / "r.h5").bodies
    assert list(back) == ["rod", "still"]
    for name, body in bodies.items():
        for entry in fields(FlexibleBody):
            one, other = getattr(body, entry.name), getattr(back[name], entry.name)
            assert np.array_equal(one, other), entry.name
        assert (back[name].before, back[name].after) == (body.before, body.after)
    assert back["rod"].diverges and not back["still"].diverges
    assert back["still"].after == "not reached by the run"


def test_files_of_before_have_no_flexible_bodies(
    result: Result, tmp_path: Path
) -> None:
    write_result(tmp_path / "r.h5", result)
    with h5py.File(tmp_path / "r.h5", "r") as file:
        assert len(file["bodies"]) == 0
    assert read_result(tmp_path / "r.h5").bodies == {}
    assert read_bodies(None) == {}


def test_a_result_without_notes_and_a_file_of_before_have_none(
    result: Result, tmp_path: Path
) -> None:
    path = tmp_path / "r.h5"
    write_result(path, replace(result, diagnostics=()))
    assert read_result(path).diagnostics == ()
    older = tmp_path / "older.h5"

    def without_notes(target: h5py.File) -> None:
        with h5py.File(path, "r") as file:
            for name in set(file) - {"notes", "warnings", "diagnostics"}:
                file.copy(name, target)
            target.attrs.update(file.attrs)

    write_sealed(older, without_notes)
    assert read_result(older).diagnostics == ()


def as_version_1(path: Path) -> None:
    """Rewrite a result as it was: every list an attribute."""

    def move(group: h5py.Group, name: str, owner: h5py.HLObject, key: str) -> None:
        dataset = group.pop(name)
        owner.attrs.create(key, dataset[()], dtype=dataset.dtype)

    path.write_bytes(path.read_bytes()[512:])
    with h5py.File(path, "a") as file:
        file.attrs["format_version"] = 1
        for table in TABLES:
            move(file, f"names/{table}", file[table], "names")
        del file["names"], file["diagnostics"]
        for name in ("notes", "warnings"):
            move(file, name, file, name)
        for body in file["bodies"].values():
            for name in list(body):
                move(body, name, body, name)


def test_files_of_version_1_are_read(result: Result, tmp_path: Path) -> None:
    rod = FlexibleBody(
        highest_frequency=1254.9,
        excitation=Excitation(6.0, "crank_angle"),
        expected=LoadStiffening(),
        labels=("bending", "größer"),
        amplitudes=np.array([1e-3, 2e-5]),
    )
    result = replace(result, bodies={"rod": rod})
    path = tmp_path / "r.h5"
    write_result(path, result)
    as_version_1(path)
    back = read_result(path)
    for name in ("names", "position_names", "multiplier_names", "notes", "warnings"):
        assert getattr(back, name) == getattr(result, name)
    assert back.bodies["rod"].labels == rod.labels
    assert np.array_equal(back.bodies["rod"].amplitudes, rod.amplitudes)


def test_lists_of_any_length_are_stored(result: Result, tmp_path: Path) -> None:
    """5 000 planar bodies, 15 000 outputs, a body of 10 000 elastic coordinates."""
    names = tuple(f"b{k}.x" for k in range(15_000))
    rod = FlexibleBody(
        highest_frequency=1.0,
        excitation=Excitation(),
        expected=LoadStiffening(),
        labels=names[:10_000],
        frequencies=np.arange(10_000.0),
    )
    wide = replace(
        result,
        names=names,
        values=np.arange(4.5e4).reshape(3, -1),
        positions=np.ones((3, 15_000)),
        position_names=names[:15_000],
        diagnostics=tuple(map(plain_text, names[:5000])),
        bodies={"rod": rod},
    )
    write_result(tmp_path / "r.h5", wide)
    back = read_result(tmp_path / "r.h5")
    assert np.array_equal(back.values, wide.values)
    for name in ("names", "position_names", "diagnostics"):
        assert getattr(back, name) == getattr(wide, name)
    assert back.bodies["rod"].labels == rod.labels
    assert np.array_equal(back.bodies["rod"].frequencies, rod.frequencies)


@pytest.mark.parametrize("packed", [None, "gzip"])
def test_rows_that_are_not_stored_are_refused(
    result: Result, tmp_path: Path, packed: str | None
) -> None:
    """They would be zeros, and 1e9 of them more than the memory."""
    path = tmp_path / "r.h5"
    write_result(path, result)
    path.write_bytes(path.read_bytes()[512:])
    with h5py.File(path, "a") as file:
        for name in ("t", *TABLES):
            shape = (10**9, *file[name].shape[1:])
            del file[name]
            chunks = tuple(min(size, 1000) or 1 for size in shape)
            data = file.create_dataset(
                name, shape, float, maxshape=(None,) * len(shape), chunks=chunks,
                compression=packed,
            )  # fmt: skip
            if data.size:
                data[0] = 1.0
    with pytest.raises(InputError, match="no more data than the file holds"):
        read_result(path)


def test_csv_has_one_header_and_returns_every_bit(
    result: Result, tmp_path: Path
) -> None:
    write_csv(tmp_path / "r.csv", result)
    text = (tmp_path / "r.csv").read_text(encoding="utf-8")
    assert text.splitlines()[0] == "t,piston.x,rod.q1"
    rows = list(csv.reader(text.splitlines()[1:]))
    assert np.array_equal(np.array(rows, float)[:, 0], result.t)
    assert np.array_equal(np.array(rows, float)[:, 1:], result.values)


def test_an_output_is_found_by_its_name(result: Result) -> None:
    assert np.array_equal(result["rod.q1"], result.values[:, 1])
    with pytest.raises(InputError, match="one of piston.x, rod.q1"):
        result["rod.q2"]


def test_sizes_that_do_not_fit_are_refused(result: Result) -> None:
    with pytest.raises(InputError, match="3 times and 2 names"):
        Result(
            title="",
            names=("a", "b"),
            t=result.t,
            values=np.zeros((3, 1)),
            positions=np.zeros((3, 0)),
            velocities=np.zeros((3, 0)),
            multipliers=np.zeros((3, 0)),
        )


def test_a_failed_write_keeps_the_old_file(result: Result, tmp_path: Path) -> None:
    target = tmp_path / "r.h5"
    write_result(target, result)
    before = target.read_bytes()
    object.__setattr__(result, "settings", {"bad": object()})
    with pytest.raises(TypeError):
        write_result(target, result)
    assert target.read_bytes() == before
    assert list(tmp_path.iterdir()) == [target]


def test_a_cut_file_is_refused_wherever_it_is_cut(
    result: Result, tmp_path: Path
) -> None:
    write_result(tmp_path / "whole.h5", result)
    whole = (tmp_path / "whole.h5").read_bytes()
    cut = tmp_path / "cut.h5"
    for size in range(0, len(whole), len(whole) // 40):
        cut.write_bytes(whole[:size])
        with pytest.raises(InputError, match="cut.h5"):
            read_result(cut)


@pytest.mark.parametrize("change", ["format", "version", "missing", "type", "size"])
def test_a_foreign_hdf5_file_is_refused(
    result: Result, tmp_path: Path, change: str
) -> None:
    path = tmp_path / "r.h5"
    write_result(path, result)
    path.write_bytes(path.read_bytes()[512:])
    with h5py.File(path, "a") as file:
        if change == "format":
            file.attrs["format"] = "something"
        elif change == "version":
            file.attrs["format_version"] = 99
        elif change == "size":
            del file["t"]
            file["t"] = np.zeros(2)
        else:
            del file["values"]
            if change == "type":
                file.create_group("values")
    with pytest.raises(InputError, match="r.h5"):
        read_result(path)


def test_a_damaged_byte_is_noticed(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    write_result(path, result)
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 1
    path.write_bytes(whole)
    with pytest.raises(InputError, match="was damaged"):
        read_result(path)


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none.h5.*no such file"):
        read_result(tmp_path / "none.h5")
    with pytest.raises(InputError, match="is a folder"):
        read_result(tmp_path)
