"""Files of bodies for other programs, read back as those programs read them."""

from __future__ import annotations

import io
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

import sidtool
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array, Taylor
from sidtool.formats.file_names import OUTPUT_KINDS
from sidtool.formats.sid_files import write_sid
from sidtool.superelement.body_files import (
    BODY_FORMATS,
    dmig_text,
    extptfm_text,
    mbdyn_text,
    op4_text,
    scalar_points,
)
from sidtool.superelement.craig_bampton import Superelement, superelement_of_sid
from tests.codes import unwrapped

from .test_superelement import rod_sid

NAMES = {"K": "stiffness", "M": "mass", "C": "damping", "B": "damping"}


@cache
def damped_sid() -> sidtool.SID:
    return replace(rod_sid(2), De=Taylor(1e-5 * rod_sid(2).Ke.m0))


@cache
def element() -> Superelement:
    return superelement_of_sid(damped_sid(), ["1", "2"], {"1": "a", "2": "b"})


def test_endings() -> None:
    assert set(BODY_FORMATS) == set(OUTPUT_KINDS["body"].endings)


def test_simscape_file(tmp_path: Path) -> None:
    from scipy.io import loadmat

    path = tmp_path / "rod.mat"
    written = sidtool.export_body(path, damped_sid(), ["2", "1"])
    data = loadmat(path)
    for name in "MKC":
        assert np.array_equal(data[name], getattr(written, NAMES[name]))
    assert np.array_equal(data["P"], [[1, 0, 0], [0, 0, 0]])
    assert np.array_equal(data["Q"], [[1, 0, 0, 0]] * 2)
    assert [str(name[0][0]) for name in data["names"]] == ["2", "1"]
    assert data["C"].any()


@pytest.mark.needs("pyyeti")
def test_op4_file_read_by_pyyeti(tmp_path: Path) -> None:
    from pyyeti.nastran import op4

    path = tmp_path / "rod.op4"
    path.write_text(op4_text(element()), encoding="ascii")
    data = op4.read(str(path))
    assert np.array_equal(data["xyz"], element().positions)
    for name in "KMB":
        matrix = data[f"{name.lower()}aax"]
        size = np.abs(matrix).max(initial=1.0)
        assert matrix == pytest.approx(
            getattr(element(), NAMES[name]), abs=1e-15 * size
        )


def read_dmig(text: str) -> dict[str, Array]:
    """Matrices of bulk data with DMIG entries in large fields."""
    rows: dict[tuple[int, int], int] = {}
    entries: dict[str, list[tuple[int, int, float]]] = {}
    name, column = "", (0, 0)
    for line in text.splitlines():
        fields = [line[8:24], line[24:40], line[40:56], line[56:72]]
        if line.startswith("DMIG*"):
            name, column = fields[0].strip(), (int(fields[1]), int(fields[2]))
            rows.setdefault(column, len(rows))
        elif line.startswith("*") and name:
            row = int(fields[0]), int(fields[1])
            rows.setdefault(row, len(rows))
            value = float(fields[2].replace("D", "E"))
            entries.setdefault(name, []).append((rows[row], rows[column], value))
    result = {name: np.zeros((len(rows), len(rows))) for name in entries}
    for name, values in entries.items():
        for i, j, value in values:
            result[name][i, j] = result[name][j, i] = value
    return result


def test_dmig_bulk_data() -> None:
    text = dmig_text(element())
    found = read_dmig(text)
    assert {line[:8].strip() for line in text.splitlines()} >= {"GRID*", "SPOINT"}
    assert max(map(len, text.splitlines())) <= 72
    for name, key in (("KAAX", "stiffness"), ("MAAX", "mass")):
        expected = getattr(element(), key)
        assert found[name] == pytest.approx(expected, rel=1e-9, abs=1e-12)
    values = scipy.linalg.eigh(found["KAAX"], found["MAAX"], eigvals_only=True)
    elastic = np.sqrt(np.maximum(values[6:], 0)) / (2 * np.pi)
    assert elastic == pytest.approx(element().frequencies[6:], rel=1e-6)


@pytest.mark.needs("pyyeti")
def test_dmig_read_by_pyyeti() -> None:
    from pyyeti import nastran

    data = nastran.rddmig(io.StringIO(dmig_text(element())))
    assert data["kaax"].to_numpy() == pytest.approx(
        element().stiffness, rel=1e-9, abs=1e-9
    )
    grids = [grid for grid, _ in data["maax"].index]
    assert grids[:12] == [1] * 6 + [2] * 6 and grids[12:] == scalar_points(element())


@pytest.mark.needs("pyyeti")
def test_craig_bampton_checks_of_pyyeti() -> None:
    from pyyeti import cb, nastran

    one = element()
    uset = nastran.addgrid(None, [1, 2], "b", 0, one.positions, 0)
    report = io.StringIO()
    found = cb.cbcheck(
        report, one.mass, one.stiffness, np.arange(12), np.arange(6), uset=uset
    )
    assert "CHECK!" not in report.getvalue()
    assert found.rbs[:12] == pytest.approx(found.rbg[:12], abs=1e-9)
    assert found.cb_frq == pytest.approx(one.fixed_frequencies, rel=1e-9)


def read_extptfm(text: str) -> tuple[dict[str, Array], Array]:
    """Read the reduced file as ExtPtfm does: keywords, a comment line, then numbers."""
    lines = text.splitlines()
    size, matrices, loads = 0, {}, np.zeros((0, 0))
    end, step = -1.0, -1.0
    for k, line in enumerate(lines):
        key = line.upper()
        if key.startswith("!DIMENSION:") and not matrices and not size:
            size = int(line[11:])
        elif key.startswith("!TIME INCREMENT IN SIMULATION:"):
            step = float(line[30:])
        elif key.startswith("!TOTAL SIMULATION TIME IN FILE:"):
            end = float(line[31:])
        elif key.startswith(("!MASS", "!STIFFNESS", "!DAMPING")):
            rows = lines[k + 2 : k + 2 + size]
            matrices[key[1:].split()[0]] = np.array([r.split() for r in rows], float)
        elif key.startswith("!LOADING"):
            rows = lines[k + 2 : k + 2 + round(end / step) + 1]
            loads = np.array([r.split() for r in rows], float)
    return matrices, loads


def test_extptfm_file(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        extptfm_text(element())
    assert refused.value.place == "interfaces"
    path = tmp_path / "tower.dat"
    tower = sidtool.export_body(path, rod_sid(2), ["1", "2"], fixed=["1"])
    matrices, loads = read_extptfm(path.read_text(encoding="ascii"))
    assert tower is not None and tower.interfaces == ("2",)
    for name, matrix in matrices.items():
        assert np.array_equal(matrix, getattr(tower, name.lower()))
    assert loads.shape == (2, 1 + len(tower.mass)) and not loads[:, 1:].any()


def masses_and_springs() -> tuple[sidtool.SID, Array, Array, Array]:
    """Five point masses joined by springs; masses, positions and shapes (n, 3, nq)."""
    random = np.random.default_rng(4)
    points, masses = random.normal(size=(5, 3)), random.uniform(1, 2, 5)
    k = np.zeros((15, 15))
    for i in range(5):
        for j in range(i):
            direction = points[i] - points[j]
            row = np.zeros(15)
            row[3 * i : 3 * i + 3], row[3 * j : 3 * j + 3] = direction, -direction
            k += 1e4 * np.outer(row, row) / (direction @ direction)
    m = np.diag(np.repeat(masses, 3))
    _, vectors = scipy.linalg.eigh(k, m)
    shapes = vectors[:, 6:10] @ random.normal(size=(4, 4))
    sid = sidtool.sid_from_shapes(m, k, points, shapes, {7: 0, 8: 3})
    return sid, masses, points, shapes.reshape(5, 3, -1)


def read_records(text: str) -> dict[int, Array]:
    """Record groups of a file of MBDyn's modal joint, as numbers one after another."""
    records: dict[int, list[float]] = {}
    group = 0
    for line in text.splitlines():
        if line.startswith("** RECORD GROUP"):
            group = int(line.split()[3].rstrip(","))
        elif not line.startswith("**") and group > 1:
            records.setdefault(group, []).extend(map(float, line.split()))
    return {group: np.array(values) for group, values in records.items()}


def test_mbdyn_invariants_of_point_masses() -> None:
    """Invariants by their definition: sums over the masses, as in MBDyn's manual."""
    sid, masses, points, shapes = masses_and_springs()
    text = mbdyn_text(sid, ["7", "8"], [7, 8])
    records = read_records(text)
    n = sid.nq
    assert "REV0 2 4 0 0 0" in text and records[2].tolist() == [7, 8]
    moved = np.zeros((2, 6, n))
    moved[:, :3] = shapes[[0, 3]]
    assert records[8].reshape(n, 2, 6) == pytest.approx(np.moveaxis(moved, 2, 0))
    sums = {
        14: np.zeros((3, n)),
        15: np.zeros((3, n)),
        16: np.zeros((3, n, 3)),
        17: np.zeros((3, n, n)),
        18: np.zeros((3, n, n, 3)),
    }
    for mass, point, shape in zip(masses, points, shapes, strict=True):
        u = tilde(point)
        sums[14] += mass * shape
        sums[15] += mass * u @ shape
        for j, phi in enumerate(shape.T):
            sums[16][:, j] -= mass * u @ tilde(phi)
            for k, other in enumerate(shape.T):
                sums[17][:, j, k] += mass * np.cross(phi, other)
                sums[18][:, j, k] += mass * tilde(phi) @ tilde(other)
    for group, expected in sums.items():
        assert records[group] == pytest.approx(expected.ravel(), abs=1e-12)
    centre = masses @ points / masses.sum()
    arms = points - centre
    squares = sum(m * tilde(a) @ tilde(a) for m, a in zip(masses, arms, strict=True))
    expected = [masses.sum(), *centre, *(-np.asarray(squares)).ravel()]
    assert records[12] == pytest.approx(expected, abs=1e-12)


def tilde(vector: Array) -> Array:
    return np.cross(vector, -np.eye(3))


def test_bodies_with_a_floating_frame_take_no_supports(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        sidtool.export_body(tmp_path / "rod.fem", rod_sid(0), fixed=["1"])
    assert refused.value.place == "fixed"


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "rod.SID_FEM"
    write_sid(source, rod_sid(2))
    for ending in BODY_FORMATS:
        target = tmp_path / f"rod{ending}"
        fixed = ["--fixed", "1"] if ending == ".dat" else []
        for _ in range(2):  # an own file is replaced
            assert run(["export", str(source), "-o", str(target), *fixed]) == 0
    foreign = tmp_path / "mine.bdf"
    foreign.write_text("GRID,1\n", encoding="ascii")
    assert run(["export", str(source), "-o", str(foreign)]) == 2
    assert run(["export", str(source), "-o", str(tmp_path / "rod.vtkhdf")]) == 2
    assert run(["export", str(source), "-o", str(target), "--peak"]) == 2
    assert run(["export", str(source)]) == 2
    assert "-o" in unwrapped(capsys.readouterr().err)
