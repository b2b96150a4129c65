"""Trusses, tubes, rings and beams of bars against theory, and against a beam.

References: characteristic roots of beams; frequencies of a cantilevered tube by
Nastran, printed in the test data of TACS (smdogroup/tacs, nastran_beam_compat).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from sidtool.formats.base.sid import J_INDICES
from sidtool.importers.nastran.bar_sections import section_of
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.sidtool.importers.bars.decks import MATERIAL, NU, RHO, E, body, bulk, grids
from tests.sidtool.importers.decks import frequencies

TRUSS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
RODS = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3), (4, 1), (4, 2), (4, 3))


def truss(*cards: str, rods: Any = RODS) -> str:
    bars = [f"CROD,{k},1,{a + 1},{b + 1}" for k, (a, b) in enumerate(rods, 1)]
    return bulk(*grids(TRUSS), *bars, *cards, "PROD,1,1,1.-4", MATERIAL)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("conrod", [False, True])
def test_a_truss_of_rods(conrod: bool, tmp_path: Path) -> None:
    """Directions times E A / L, and masses of linear displacements."""
    k, m = np.zeros((2, 15, 15))
    for a, b in RODS:
        length = float(np.linalg.norm(TRUSS[b] - TRUSS[a]))
        stretch = np.zeros(15)
        stretch[3 * b : 3 * b + 3] = (TRUSS[b] - TRUSS[a]) / length
        stretch[3 * a : 3 * a + 3] = -stretch[3 * b : 3 * b + 3]
        k += E * 1e-4 / length * np.outer(stretch, stretch)
        for i in (a, b):
            for j in (a, b):
                share = RHO * 1e-4 * length / 6 * (1 + (i == j))
                m[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] += share * np.eye(3)
    values = scipy.linalg.eigh(k, m, eigvals_only=True)
    text = truss()
    if conrod:
        for n, (a, b) in enumerate(RODS, 1):
            old = f"CROD,{n},1,{a + 1},{b + 1}\n"
            text = text.replace(old, f"CONROD,{n},{a + 1},{b + 1},1,1.-4\n")
    found = frequencies(body(tmp_path, text))
    assert_allclose(found, np.sqrt(values[6:12]) / (2 * np.pi), rtol=1e-9)


def tube(count: int = 30) -> str:
    x = np.linspace(0, 1, count + 1)
    bars = [f"CBAR,{i},1,{i},{i + 1},0.,1.,0." for i in range(1, count + 1)]
    pbarl = "PBARL,1,1,,TUBE\n,0.1,0.01,0."
    material = "MAT1,1,7.17+10,,0.33,2810."
    places = grids(np.outer(x, [1.0, 0, 0]))
    return bulk(*places, *bars, pbarl, material, "SPC1,100,123456,1")


@pytest.mark.filterwarnings("ignore")
def test_a_cantilevered_tube_is_that_of_nastran(tmp_path: Path) -> None:
    """Torsion and stretch to the digits of its points; bending without the rotary
    inertia that Nastran leaves out, 0.6 % of the first frequency."""
    held = {"type": "tangent", "marker": "p", "clamp": "SPC100"}
    sid = body(tmp_path, tube(), frame=held, modes=9)
    found = frequencies(sid)
    assert_allclose(
        found[[4, 5, 8]], [774.38194643, 1262.9787415, 2325.2692963], rtol=1e-6
    )
    radius = np.sqrt(0.0101) / 2
    plain = 139.45115
    rotary = 1 - found[0] / plain
    assert 0.3 * (np.pi / 2 * radius) ** 2 < rotary < 1.2 * (np.pi / 2 * radius) ** 2


@pytest.mark.filterwarnings("ignore")
def test_a_straight_bar_is_the_beam_of_a_model_file(tmp_path: Path) -> None:
    """The same beam by its own geometry: every block, with what loads stiffen."""
    height, width = 0.03, 0.02
    x = np.linspace(0, 0.8, 9)
    axis, y = np.array([0.6, 0.0, 0.8]), (0.0, 1.0, 0.0)
    area, iy, iz = width * height, height * width**3 / 12, width * height**3 / 12
    torsion = section_of("BAR", (width, height)).torsion
    bars = [f"CBAR,{i},1,{i},{i + 1},{','.join(map(repr, y))}" for i in range(1, 9)]
    card = f"PBARL,1,1,,BAR\n,{width!r},{height!r}"
    more = {
        "markers": {"p": {"node": 1, "mesh_node": 1}, "q": {"node": 2, "mesh_node": 9}},
        "frame": {"type": "tangent", "marker": "p"},
        "reduction": {"method": "modal", "modes": 5},
    }
    text = bulk(*grids(np.outer(x, axis)), *bars, card, MATERIAL)
    sid = body(tmp_path, text, **more)
    data = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    data["material"] = {"youngs_modulus": E, "poissons_ratio": NU, "density": RHO}
    data["geometry"] = {
        "type": "beam",
        "start": [0.0, 0.0, 0.0],
        "end": (0.8 * axis).tolist(),
        "y_axis": y,
        "section": {
            "shape": "general",
            "area": area,
            "iy": iy,
            "iz": iz,
            "torsion": torsion,
        },
    }
    data["discretisation"] = {"type": "beam", "elements": 8, "theory": "timoshenko"}
    data["markers"] = {
        "p": {"node": 1, "parameters": [0.0]},
        "q": {"node": 2, "parameters": [1.0]},
    }
    (tmp_path / "beam.json").write_text(json.dumps(data), encoding="utf-8")
    expected = sid_from_model(tmp_path / "beam.json")
    assert sid.mass == pytest.approx(expected.mass, rel=1e-12)
    for name in ("J", "Ct", "Cr", "Me", "Gr", "Oe", "Ge", "Ke"):
        a, b = getattr(sid, name), getattr(expected, name)
        for one, other in ((a.m0, b.m0), (a.m1, b.m1)):
            if other is None or not np.size(other):
                continue
            size = np.abs(other).max()
            # modes may have other signs: products of two of them are compared
            assert_allclose(np.abs(one), np.abs(other), atol=1e-7 * size)


@pytest.mark.filterwarnings("ignore")
def test_a_closed_ring(tmp_path: Path) -> None:
    """Two waves in its plane: omega^2 = 36/5 E I / (rho A R^4) (R. Hoppe, 1871), and
    out of it less by what torsion gives (A. E. H. Love, Mathematical Theory, 293)."""
    count, radius, nu = 24, 0.5, 0.3
    angles = 2 * np.pi * np.arange(count) / count
    # the polygon of the circle's length
    places = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    places *= radius * (np.pi / count) / np.sin(np.pi / count)
    bars = [f"CBAR,{i},1,{i},{i % count + 1},0.,0.,1." for i in range(1, count + 1)]
    card = "PBARL,1,1,,ROD\n,0.005"
    found = frequencies(body(tmp_path, bulk(*grids(places), *bars, card, MATERIAL)))
    bend = E * 0.005**2 / 4 / (RHO * radius**4)
    out = bend * 36 / (5 + nu)
    expected = np.sqrt([out, out, 36 / 5 * bend, 36 / 5 * bend]) / (2 * np.pi)
    assert_allclose(np.sort(found[:4]), np.sort(expected), rtol=1e-2)


@pytest.mark.filterwarnings("ignore")
def test_a_tapered_beam_has_its_mass_and_centre(tmp_path: Path) -> None:
    """A and B of PBEAML: area in the square of the place, as of a cone of bars."""
    x = np.linspace(0, 1, 41)
    side = (0.04 - 0.02 * x).tolist()
    cards = []
    for i in range(40):
        a, b = side[i], side[i + 1]
        cards += [
            f"CBEAM,{i + 1},{i + 1},{i + 1},{i + 2},0.,1.,0.",
            f"PBEAML,{i + 1},1,,BAR\n,{a!r},{a!r},0.,NO,1.0,{b!r},{b!r},0.",
        ]
    sid = body(
        tmp_path, bulk(*grids(np.outer(x, [1.0, 0, 0])), *cards, MATERIAL), modes=2
    )
    volume = (0.04**2 + 0.04 * 0.02 + 0.02**2) / 3
    assert sid.mass == pytest.approx(RHO * volume, rel=1e-4)
    # pyramid: integral of x (0.04 - 0.02 x)^2
    first = 0.04**2 / 2 - 2 * 0.04 * 0.02 / 3 + 0.02**2 / 4
    second = 0.04**2 / 3 - 2 * 0.04 * 0.02 / 4 + 0.02**2 / 5
    about = RHO * (second - first**2 / volume)
    moments = dict(zip(J_INDICES, sid.J.m0, strict=True))
    assert max(moments.values()) == pytest.approx(about, rel=2e-3)
