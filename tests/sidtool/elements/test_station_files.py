"""Files of stations: other programs, orders, units, faults."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.beams.station_section import station_sections
from sidtool.cli.main import run
from sidtool.discretisation.registry import finite_element_model
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import beams
from sidtool.formats.model.stations import read_stations, write_stations
from sidtool.importers.openfast import read_openfast

from .station_tables import LENGTH, UNIFORM, eccentric, frequencies, matrices, model

ELASTODYN = """ELASTODYN blade
Title
      3   NBlInpSt    - Number of stations (-)
    1.1   AdjBlMs     - Factor (-)
    2.0   AdjFlSt     - Factor (-)
    1.0   AdjEdSt     - Factor (-)
    BlFract  PitchAxis  StrcTwst  BMassDen  FlpStff  EdgStff
      (-)       (-)      (deg)     (kg/m)    (Nm^2)   (Nm^2)
 0.0  0.25  10.0  100.0  1.0E+08  2.0E+08
 0.5  0.25   5.0   80.0  0.5E+08  1.0E+08
 1.0  0.25   0.0   50.0  0.2E+08  0.5E+08
---------------------- BLADE MODE SHAPES -----------------
"""


def test_elastodyn_files_become_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Factors, the sign of the twist, flapwise about z, what the file lacks."""
    source, target = tmp_path / "blade.dat", tmp_path / "blade.csv"
    source.write_text(ELASTODYN, encoding="utf-8")
    with pytest.raises(InputError, match="--length"):
        read_openfast(source)
    assert run(["stations", str(source), "-o", str(target), "--length", "20"]) == 0
    printed = capsys.readouterr().out
    assert "PitchAxis" in printed and 'sections = "blade.csv"' in printed
    assert run(["stations", str(target), "--length", "20"]) == 0
    assert 'sections = "blade.csv"' in capsys.readouterr().out
    table = read_stations(target)
    assert_allclose(table.mass_per_length, [110.0, 88.0, 55.0])
    assert_allclose(table.EI_z, [2e8, 1e8, 4e7])
    assert_allclose(table.EI_y, [2e8, 1e8, 5e7])
    assert_allclose(table.twist, -np.radians([10.0, 5.0, 0.0]))
    body = finite_element_model(model(str(target), 20.0, theory="euler_bernoulli"))
    same = finite_element_model(
        model(
            read_openfast(source, 20.0).table.file_data(),
            20.0,
            theory="euler_bernoulli",
        )
    )
    assert_allclose(body.stiffness.toarray(), same.stiffness.toarray())


def test_beamdyn_files_become_tables(tmp_path: Path) -> None:
    """6 x 6 matrices along the key points of a bent axis."""
    own = matrices(eccentric())
    rows = [1, 2, 0, 4, 5, 3]
    blocks = []
    for k, place in enumerate((0.0, 1.0)):
        parts = [
            np.array(own[name][k])[rows][:, rows] for name in ("stiffness", "mass")
        ]
        text = "\n\n".join(
            "\n".join(" ".join(map(repr, r)) for r in p.tolist()) for p in parts
        )
        blocks.append(f"{place}\n{text}")
    (tmp_path / "props.dat").write_text(
        " 2  station_total - stations\n--- Distributed Properties ---\n"
        + "\n\n".join(blocks),
        encoding="utf-8",
    )
    (tmp_path / "primary.dat").write_text(
        "1 member_total - members\n"
        "kp_xr kp_yr kp_zr initial_twist\n (m) (m) (m) (deg)\n"
        "0 0 0 4.0\n0.1 0 4 2.0\n0.4 0 8 0.0\n--- MESH\n"
        '"props.dat"    BldFile - Name of file\n',
        encoding="utf-8",
    )
    found = read_openfast(tmp_path / "primary.dat")
    assert_allclose(found.table.stiffness[::2], own["stiffness"])
    assert_allclose(found.table.mass[::2], own["mass"])
    assert_allclose(found.table.twist, -np.radians([4.0, 2.0, 0.0]))
    assert found.geometry["through"] == [[0.1, 0.0, 4.0]]
    write_stations(tmp_path / "x.csv", found.table, [])
    again = read_stations(tmp_path / "x.csv")
    assert_allclose(again.stiffness[::2], own["stiffness"])
    assert_allclose(again.mass[::2], own["mass"])


def beamdyn_files(folder: Path, twist: list[float]) -> Path:
    """A straight, uniform blade of two stations, with key points of other twists."""
    own = matrices(UNIFORM)
    rows = [1, 2, 0, 4, 5, 3]
    parts = [np.array(own[k][0])[rows][:, rows] for k in ("stiffness", "mass")]
    text = "\n".join(" ".join(map(repr, r)) for part in parts for r in part.tolist())
    (folder / "props.dat").write_text(
        " 2  station_total - stations\n 1  damp_type - Damping type: 0, 1\n"
        "--- DAMPING COEFFICIENT ---\n   mu1 mu2 mu3 mu4 mu5 mu6\n"
        "   (-) (-) (-) (-) (-) (-)\n 0.001 0.001 0.001 0.001 0.001 0.001\n"
        f"--- Distributed Properties ---\n0.0\n{text}\n1.0\n{text}\n",
        encoding="utf-8",
    )
    points = np.linspace(0.0, LENGTH, len(twist))
    lines = [
        f"0 0 {z!r} {phi!r}" for z, phi in zip(points.tolist(), twist, strict=True)
    ]
    path = folder / "primary.dat"
    path.write_text(
        "1 member_total - members\nkp_xr kp_yr kp_zr initial_twist\n"
        " (m) (m) (m) (deg)\n" + "\n".join(lines) + "\n--- MESH\n"
        '"props.dat"    BldFile - Name of file\n',
        encoding="utf-8",
    )
    return path


@pytest.mark.parametrize(
    "twist", [[0.0, 30.0, 0.0], [10.0, 10.0, 40.0, 0.0], [0.0, 30.0, 0.0, 0.0, 0.0]]
)
def test_twist_of_key_points_between_stations(
    twist: list[float], tmp_path: Path
) -> None:
    """Two stations, the twist is that of the key points: the same blade by columns."""
    found = read_openfast(beamdyn_files(tmp_path, twist))
    at = np.linspace(0.0, 1.0, len(twist))
    assert_allclose(
        np.interp(at, found.table.fraction, found.table.twist),
        -np.radians(twist),
        atol=1e-12,
    )
    data = {k: [v[0]] * len(at) for k, v in UNIFORM.items() if k != "position"}
    data |= {"fraction": at.tolist(), "twist": (-np.radians(twist)).tolist()}
    bodies = [
        finite_element_model(model(sections, elements=12))
        for sections in (found.table.file_data(), data)
    ]
    assert_allclose(frequencies(bodies[0], 4), frequencies(bodies[1], 4), rtol=1e-9)
    straight = read_openfast(beamdyn_files(tmp_path, [0.0, 5.0, 10.0]))
    assert straight.table.fraction == (0.0, 1.0)


def test_damping_of_openfast_is_named(tmp_path: Path) -> None:
    """A table of stations holds none: the notes name a law that is the same."""
    notes = read_openfast(beamdyn_files(tmp_path, [0.0, 0.0])).notes
    assert any("mu = 0.001" in note and "beta = 0.001" in note for note in notes)
    file = tmp_path / "blade.dat"
    damped = "  0.477   BldFlDmp(1) - Damping (%)\n    BlFract"
    file.write_text(ELASTODYN.replace("    BlFract", damped), encoding="utf-8")
    assert any("ratio = 0.00477" in note for note in read_openfast(file, 20.0).notes)
    file.write_text(ELASTODYN, encoding="utf-8")
    assert not any("damping" in note for note in read_openfast(file, 20.0).notes)


def test_matrices_in_other_units_and_orders(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """kN and t are converted; what the command writes has the order it says."""
    own = matrices(eccentric())
    rows = [1, 2, 0, 4, 5, 3]
    units = {"K": ("kN", "kN m", "kN m^2"), "M": ("t/m", "t", "t m")}
    heads, columns = ["position [mm]"], [[0.0, 1e3 * LENGTH]]
    for letter, name in (("K", "stiffness"), ("M", "mass")):
        given = np.array(own[name])[:, rows][:, :, rows]
        for i in range(6):
            for j in range(i, 6):
                unit = units[letter][(i > 2) + (j > 2)]
                heads.append(f"{letter}{i + 1}{j + 1} [{unit}]")
                columns.append((given[:, i, j] / 1e3).tolist())
    lines = [
        ",".join(heads),
        *(",".join(map(repr, row)) for row in zip(*columns, strict=True)),
    ]
    file, target = tmp_path / "bd.csv", tmp_path / "own.csv"
    file.write_text("\n".join(lines), encoding="utf-8")
    words = ["stations", str(file), "--order", "beamdyn", "-o", str(target)]
    assert run(words) == 0
    assert 'sections = "own.csv"' in capsys.readouterr().out
    table = read_stations(target)
    assert_allclose(table.stiffness, own["stiffness"], rtol=1e-12)
    assert_allclose(table.mass, own["mass"], rtol=1e-12)
    file.write_text(
        "\n".join(lines).replace("K11 [kN]", "K11 [kN m]"), encoding="utf-8"
    )
    with pytest.raises(InputError, match="K11"):
        read_stations(file)


HEADER = (
    "position [m],mass_per_length [t/m],EA [MN],EI_y [kN m^2],EI_z [Nm^2],"
    "GJ [N*m\u00b2]"
)


def test_units_of_a_header(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text(f"# mast\n{HEADER}\n0,1,2,3,4,5\n2,1,2,3,4,5\n", encoding="utf-8")
    table = read_stations(file)
    values = (table.mass_per_length, table.EA, table.EI_y, table.EI_z, table.GJ)
    assert_allclose(np.array(values)[:, 0], [1e3, 2e6, 3e3, 4.0, 5.0])
    file.write_text(
        "position [%];mass_per_length;EA;EI_y;EI_z;GJ;twist [deg]\n"
        "0;1;2;3;4;5;90\n100;1;2;3;4;5;0\n",
        encoding="utf-8",
    )
    table = read_stations(file)
    assert table.fraction == (0.0, 1.0)
    assert table.twist[0] == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("position [m],EA [kg]\n0,1\n1,1", "EA [kg]: has the unit 'kg'"),
        ("position,EAA\n0,1\n1,1", "EAA: is no column of stations; expected EA"),
        ("position,EA\n0,1\n1,x", "row 1,x: found 'x'"),
        ("position,EA\n0,1\n1", "row 1: has 1 cells; expected 2"),
        ("position,EA\n0,1\n1,1", "has no mass_per_length, EI_y, EI_z, GJ"),
        ("position,EA,EA\n0,1,1\n1,1,1", "EA: appears twice"),
        ("position,EA\n0,1", "has 1 stations"),
        (f"{HEADER}\n0,1,2,3,4,5\n2,1,2,3,4,0", "GJ: is 0 at a station"),
        (f"{HEADER}\n1,1,2,3,4,5\n2,1,2,3,4,5", "position: runs from 1 to 2"),
        (f"{HEADER}\n0,1,2,3,4,5\n2,1,2,3,4,5\n1,1,2,3,4,5", "position: decreases"),
    ],
)
def test_tables_that_are_not_sound(tmp_path: Path, text: str, expected: str) -> None:
    file = tmp_path / "a.csv"
    file.write_text(text + "\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_stations(file)
    assert str(caught.value).startswith(f"{file}: {expected}")


def test_models_that_contradict_their_tables() -> None:
    with pytest.raises(InputError, match="needs"):
        table = {k: v for k, v in UNIFORM.items() if not k.startswith("GA")}
        finite_element_model(model(table))
    with pytest.raises(InputError, match="8 m, but the axis of the beam is 9 m"):
        finite_element_model(model(UNIFORM, 9.0))
    with pytest.raises(InputError, match="material"):
        steel = {"youngs_modulus": 1.0, "poissons_ratio": 0.3, "density": 1.0}
        model(UNIFORM, material=steel)
    with pytest.raises(InputError, match="section"):
        beams.BeamGeometry(start=[0, 0, 0], end=[1, 0, 0])
    with pytest.raises(InputError, match="mass matrix of a thin slice"):
        wrong = matrices(UNIFORM)
        wrong["mass"][0][1][1] = 31.0
        finite_element_model(model(wrong))
    geometry = model(UNIFORM | {"twist": [0.0, 0.5]}).geometry
    assert isinstance(geometry, beams.BeamGeometry)
    turned = geometry.model_copy(update={"twist": 0.25})
    assert_allclose(
        station_sections(turned, LENGTH).twist(np.array([0.0, 1.0])), [0.25, 0.75]
    )
