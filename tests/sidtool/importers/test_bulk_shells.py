"""Shells of Nastran bulk data by CalculiX: plate theory, anywhere in space."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.pipeline.model_to_sid import sid_from_model

from .decks import STEEL, frequencies

SIDE, DEPTH, COUNT = 0.4, 0.004, 8
TURN = Rotation.from_euler("zyx", [40.0, 25.0, -70.0], degrees=True).as_matrix()
#: Free square plates of nu = 0.3: a^2 omega sqrt(rho h/D) (A. W. Leissa, "Vibration of
#: plates", NASA SP-160, 1969).
LEISSA = (13.489, 19.789, 24.432)


def plate(*, turned: bool, tail: str = "", property_: str = "1") -> str:
    """A square of CQUAD8 around the origin."""
    n = 2 * COUNT
    number: dict[tuple[int, int], int] = {}
    lines = ["BEGIN BULK"]
    for i in range(n + 1):
        for j in range(n + 1):
            if i % 2 and j % 2:
                continue
            number[i, j] = len(number) + 1
            place = np.array([i / n - 0.5, j / n - 0.5, 0.0]) * SIDE
            place = TURN @ place if turned else place
            words = ",".join(repr(round(float(x), 12)) for x in place)
            lines.append(f"GRID,{number[i, j]},,{words}")
    steps = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    for i in range(0, n, 2):
        for j in range(0, n, 2):
            nodes = [str(number[i + a, j + b]) for a, b in steps]
            label = len(lines)
            lines += [
                f"CQUAD8,{label},1,{','.join(nodes[:6])}",
                f",{nodes[6]},{nodes[7]}{tail}",
            ]
    lines += [
        f"PSHELL,1,1,{DEPTH!r},{property_}",
        f"MAT1,1,{STEEL['e']!r},,{STEEL['nu']!r},{STEEL['rho']!r}",
    ]
    return "\n".join([*lines, "ENDDATA", ""])


def body(folder: Path, text: str, **geometry: Any) -> SID:
    (folder / "part.bdf").write_text(text, encoding="utf-8")
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "mesh", "file": "part.bdf", **geometry},
        "discretisation": {"type": "mesh"},
        "frame": {"type": "buckens"},
        "markers": {"p": {"node": 1, "mesh_node": 1}},
        "reduction": {"method": "modal", "modes": 4},
    }
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return sid_from_model(folder / "model.json")


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.filterwarnings("ignore")
def test_a_free_plate_has_the_frequencies_of_leissa(
    turned: bool, tmp_path: Path
) -> None:
    zeros = ",0.,0.,0.,0.,0.,0.00E+00"
    text = plate(turned=turned, tail=zeros if turned else "")
    sid = body(tmp_path, text, engine="calculix")
    bending = STEEL["e"] * DEPTH**3 / (12 * (1 - STEEL["nu"] ** 2))
    unit = np.sqrt(bending / (STEEL["rho"] * DEPTH)) / SIDE**2 / (2 * np.pi)
    assert_allclose(frequencies(sid)[:3], unit * np.array(LEISSA), rtol=1e-2)
    assert sid.mass == pytest.approx(STEEL["rho"] * SIDE**2 * DEPTH, rel=1e-6)


@pytest.mark.needs("ccx")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("PSHELL,1,1,0.004,1,1.0", "PSHELL,1,1,0.004"), "MID2 0"),
        (("PSHELL,1,1,0.004,1,1.0", "PSHELL,1,1,0.004,1,2.0,1"), "12I/T3 2.0"),
        (
            ("PSHELL,1,1,0.004,1,1.0", "PSHELL,2,1,0.004,1"),
            "no complete material",
        ),
        (("ENDDATA", "CONM2,9000,1,,2.0,0.1\nENDDATA"), "CONM2 with offset"),
        (
            ("ENDDATA", "CONROD,9000,1,2,1,1.\nENDDATA"),
            "bars, couplings.*not handed to CalculiX",
        ),
    ],
)
def test_incomplete_shells_are_refused(
    change: tuple[str, str], message: str, tmp_path: Path
) -> None:
    text = plate(turned=True, property_="1,1.0")
    assert change[0] in text
    with pytest.raises(InputError, match=message):
        body(tmp_path, text.replace(*change), engine="calculix")


@pytest.mark.needs("ccx")
@pytest.mark.filterwarnings("ignore")
def test_a_mass_lies_where_the_plate_does_not_move(tmp_path: Path) -> None:
    """In its middle: of the first two modes alone, which have nodal lines there."""
    text = plate(turned=True)
    middle = sum(1 for line in text.splitlines() if line.startswith("GRID")) // 2 + 1
    heavy = text.replace("ENDDATA", f"CONM2,9000,{middle},,0.5\nENDDATA")
    plain = body(tmp_path, text, engine="calculix")
    sid = body(tmp_path, heavy, engine="calculix")
    assert sid.mass == pytest.approx(plain.mass + 0.5, rel=1e-9)
    assert_allclose(sid.mdCM.m0, plain.mdCM.m0, atol=1e-9)
    ratio = frequencies(sid) / frequencies(plain)
    assert_allclose(ratio[:2], 1, atol=1e-5)
    assert ratio[2] < 0.95


@pytest.mark.needs("ccx")
@pytest.mark.filterwarnings("ignore")
def test_a_single_element_far_away_is_where_it_is(tmp_path: Path) -> None:
    """CalculiX writes six digits of its places, 1e-3 here; the stiffness knows more."""
    corners = np.array([[-5, -4, 0], [5, -4, 0], [5, 4, 0], [-5, 4, 0]]) @ TURN.T
    rows = np.round(corners + [420.0, 170.0, -440.0], 9).tolist()
    grids = [f"GRID,{i},,{','.join(map(repr, x))}" for i, x in enumerate(rows, 1)]
    cards = ["CQUAD4,1,1,1,2,3,4", "PSHELL,1,1,1.5,1,,1", "MAT1,1,2.+5,,0.3,7.9-9"]
    text = "\n".join(["BEGIN BULK", *grids, *cards, "ENDDATA", ""])
    sid = body(tmp_path, text, engine="calculix", unit=0.001)
    mass, own = 7.9e3 * 80 * 1.5e-9, np.diag([64 + 1.5**2, 100 + 1.5**2, 164]) / 12e6
    assert sid.mass == pytest.approx(mass, rel=1e-9)
    inertia = mass * TURN @ own @ TURN.T
    found = [inertia[i] for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    assert_allclose(sid.J.m0[:, 0], found, atol=1e-5 * np.abs(found).max())


@pytest.mark.parametrize("tail", [",,,,,,0.001", ",0.005"])
def test_offsets_and_corner_thicknesses_are_refused(tail: str, tmp_path: Path) -> None:
    text = plate(turned=False, tail=tail)
    with pytest.raises(InputError, match="an offset or thicknesses of its own"):
        body(tmp_path, text, engine="calculix")


def test_own_elements_name_the_engine(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"geometry\.engine"):
        body(tmp_path, plate(turned=True))
