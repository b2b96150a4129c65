"""Sections of bars and their materials, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.importers.nastran.bar_sections import section_of
from tests.sidtool.importers.bars.decks import (
    AREA,
    IY,
    IZ,
    MATERIAL,
    NU,
    PBAR,
    RHO,
    UP,
    E,
    body,
    frame,
)
from tests.sidtool.importers.bars.test_textbook import PBEAM, arm, by_textbook
from tests.sidtool.importers.bars.test_theory import RODS, truss
from tests.sidtool.importers.decks import frequencies


@pytest.mark.parametrize(
    ("kind", "sizes", "area", "i"),
    [
        ("ROD", (0.02,), np.pi * 4e-4, np.pi / 4 * 1.6e-7),
        ("TUBE", (0.02, 0.01), np.pi * 3e-4, np.pi / 4 * 1.5e-7),
        ("TUBE2", (0.02, 0.01), np.pi * 3e-4, np.pi / 4 * 1.5e-7),
        ("BAR", (0.02, 0.03), 6e-4, 0.02 * 0.03**3 / 12),
        (
            "BOX",
            (0.06, 0.04, 0.002, 0.003),
            6e-2 * 4e-2 - 0.054 * 0.036,
            (0.06 * 0.04**3 - 0.054 * 0.036**3) / 12,
        ),
    ],
)
def test_sections(kind: str, sizes: Any, area: float, i: float) -> None:
    found = section_of(kind, sizes)
    assert_allclose([found.area, found.iz], [area, i], rtol=1e-12)
    if kind.startswith(("ROD", "TUBE")):
        assert found.torsion == pytest.approx(2 * i)
    if kind == "BOX":  # Bredt: 4 A^2 / sum of s / t
        around = 2 * 0.057 / 0.002 + 2 * 0.038 / 0.003
        assert found.torsion == pytest.approx(4 * (0.057 * 0.038) ** 2 / around)


@pytest.mark.parametrize(
    ("kind", "sizes", "share"), [("ROD", (0.02,), 0.9), ("TUBE", (0.02, 0.0199), 0.5)]
)
def test_shear_areas_of_circles(kind: str, sizes: Any, share: float) -> None:
    """Form factors 10/9 and 2 (Roark's formulas for stress and strain, 8.10). With
    those a beam of PBARL ROD has the frequencies of MSC Nastran to five digits.
    """
    assert_allclose(section_of(kind, sizes).shear, share, rtol=1e-4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (frame(PBAR, tail="\n,4"), "is a mechanism"),
        (frame(PBAR, tail="\n,7"), "the pins 7"),
        (frame(PBAR, tail="\n,4,4"), "moves freely between its pins 4 and 4"),
        (frame(PBAR, tail=",GGO"), "OFFT GGO"),
        (frame(PBAR + ",,,\n,\n,,,1.-12"), "I12 squared below"),
        (frame(f"PBAR,1,1,{AREA!r},{IZ!r},{IY!r}"), "is a mechanism"),
        (frame("PBARL,1,1,,CHAN\n,1.,1.,1.,1."), "is no CHAN"),
        (frame("PBARL,1,1,,L\n,1.,1.,.1,.1"), "is a L"),
        (frame("PBEAML,1,1,,T\n,1.,1.,.1,.1", card="CBEAM"), "shear centre"),
        (frame("PBARL,1,1,,TUBE\n,0.01,0.02"), "is no TUBE"),
        (frame("PBARL,1,1,,TUBE\n,0.02"), "DIM2"),
        (
            frame(
                "PBEAML,1,1,,TUBE\n,.03,.02,0.,NO,1.0,.02,,0.",
                card="CBEAM",
            ),
            "DIM2",
        ),
        (frame("PROD,1,1,1.-4"), "CBAR 1 has the property 1"),
        (frame(PBAR).replace("CBAR,2,1,2,3", "CBAR,2,1,2,77"), "node 77"),
        (frame(PBAR).replace("CBAR,2,1,2,3", "CBAR,1,1,2,3"), "1 is defined twice"),
        (frame(PBAR, "RBE2,9,1,,4"), "holds the directions"),
        (frame(PBAR, "RBE2,9,1,123,4", "RBE2,8,2,123,4"), "held already"),
        (frame(PBAR, "RBE2,9,1,123,4", "RBE2,8,4,123,1"), "in a ring"),
        (frame(PBAR, "MPC,9,1,1,1.,2,1,-1."), "resists a rigid motion"),
        (frame(PBAR, "GRID,9,,1.,1.,1.", "CONM2,8,9,,2."), "held by no bar"),
        (
            frame(PBAR, "GRID,9,,1.,1.,1.", "RBE2,8,9,123456,2,3", "RBE2,7,1,123456,2"),
            "held already",
        ),
        (truss(rods=RODS[:-1]), "is a mechanism"),
        (truss(rods=((0, 1), (2, 3))), "2 unconnected parts"),
        (truss("CONM2,8,5,,2.,0.1"), "that turns it"),
        (frame(PBAR, "CBAR,9,1,1,4,0.1,0.5,0.7"), "lies along it"),
        (frame(PBAR, "CBAR,9,1,1,4"), "no direction"),
        (frame(PBEAM + "\n,\n,NO,1.0\n,1.,1.,0.1", card="CBEAM"), "S1, S2"),
        (frame(PBEAM + "\n,\n,NO,1.0\n,1.,1.\n,,,,,0.01", card="CBEAM"), "N1 or N2"),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_unsupported_bars_are_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        body(tmp_path, text)


@pytest.mark.filterwarnings("ignore")
def test_baror_fills_what_bars_leave_blank(tmp_path: Path) -> None:
    """Property and orientation, also of a bar that stands before it."""
    text = frame(PBAR)
    first, second = (x for x in text.splitlines() if x.startswith(("CBAR,1", "CBAR,2")))
    up = first.split(",", 5)[5]
    short = text.replace(first, "CBAR,1,,1,2").replace(
        second, second.replace(",1,", ",,", 1)
    )
    short = short.replace("ENDDATA", f"BAROR,,1,,,{up}\nENDDATA")
    assert_allclose(
        body(tmp_path, short).Ke.m0, body(tmp_path, text).Ke.m0, rtol=1e-12, atol=1e-9
    )
    with pytest.raises(InputError, match="default of CBAR is defined twice"):
        body(tmp_path, short.replace("ENDDATA", "BAROR,,1\nENDDATA"))


@pytest.mark.filterwarnings("ignore")
def test_a_material_of_the_model_file_and_directions(tmp_path: Path) -> None:
    """[material] stands for MAT1; OFFT = BGG counts the y axis in basic directions,
    offsets in those of the nodes, and CONM2 in its own."""
    steel = {"youngs_modulus": E, "poissons_ratio": NU, "density": RHO}
    text = frame(PBAR).replace(MATERIAL, "MAT1,1,1.,,0.")
    with pytest.raises(InputError, match=r"table \[material\]"):
        body(tmp_path, text)
    found = frequencies(body(tmp_path, text, material=steel))
    assert_allclose(found, by_textbook({}, {}), rtol=1e-8)
    system = "CORD2R,5,,0.,0.,0.,1.,0.,0.\n,0.,1.,0."  # x, y, z are y, z, x
    r, own = np.array([0.02, -0.03, 0.01]), np.array([2e-5, 3e-5, 4e-5])
    whole = scipy.linalg.block_diag(0.02 * np.eye(3), np.diag(own[[2, 0, 1]]))
    shift = r[[2, 0, 1]]
    inertia = arm(shift).T @ whole @ arm(shift)
    card = "CONM2,60,3,5,0.02,0.02,-0.03,0.01\n,2.-5,,3.-5,,,4.-5"
    text = frame(PBAR, system, "GRDSET,,,,,,5", card, tail=",BGG")
    expected = by_textbook({}, {2: inertia})
    assert_allclose(frequencies(body(tmp_path, text)), expected, rtol=1e-8)
    text = frame(PBAR, system, "GRDSET,,,,,,5", card)
    turned = ",".join(repr(UP[i]) for i in (1, 2, 0))
    text = text.replace(",".join(map(repr, UP)), turned)
    assert_allclose(frequencies(body(tmp_path, text)), expected, rtol=1e-8)


def test_choices_of_other_elements_are_refused(tmp_path: Path) -> None:
    for more in (
        {"geometry": {"thickness": 0.1}},
        {"discretisation": {"type": "mesh", "state": "plane_stress"}},
    ):
        with pytest.raises(InputError, match="not for bars"):
            body(tmp_path, frame(PBAR), **more)
