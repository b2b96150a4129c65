"""Bars and rods of Nastran bulk data: textbook matrices, theory, the same as a beam.

References: characteristic roots of beams; element matrices of J. S. Przemieniecki,
Theory of Matrix Structural Analysis, 1968; frequencies of a cantilevered tube by
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

from sidtool.convert import sid_from_model
from sidtool.formats.errors import InputError
from sidtool.formats.sid import J_INDICES, SID
from sidtool.importers.bdf.bar_sections import section_of

from .decks import frequencies

E, NU, RHO = 2.1e11, 0.3, 7850.0
G = E / (2 * (1 + NU))
#: Area, second moments about y and z, torsion constant.
AREA, IY, IZ, TORSION = 4e-6, 3e-13, 5e-13, 4e-13
MATERIAL = f"MAT1,1,{E!r},,{NU!r},{RHO!r}"
PBAR = f"PBAR,1,1,{AREA!r},{IZ!r},{IY!r},{TORSION!r}"
#: A frame in space and the direction of the y axis of its three legs.
PLACES = np.array([[0, 0, 0], [0.4, 0.1, 0], [0.5, 0.6, 0.2], [0.1, 0.5, 0.7]])
LEGS = ((0, 1), (1, 2), (2, 3))
UP = (0.2, -0.3, 0.9)


def grids(places: Any) -> list[str]:
    rows = np.asarray(places, float).tolist()
    return [f"GRID,{i},,{','.join(map(repr, x))}" for i, x in enumerate(rows, 1)]


def bulk(*cards: str) -> str:
    return "\n".join(["BEGIN BULK", *cards, "ENDDATA", ""])


def frame(*cards: str, tail: str = "", card: str = "CBAR") -> str:
    up = ",".join(map(repr, UP))
    bars = [
        f"{card},{k},1,{a + 1},{b + 1},{up}{tail}" for k, (a, b) in enumerate(LEGS, 1)
    ]
    return bulk(*grids(PLACES), *bars, *cards, MATERIAL)


def model(folder: Path, text: str, **more: Any) -> Path:
    (folder / "part.bdf").write_text(text)
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "mesh", "file": "part.bdf", **more.pop("geometry", {})},
        "discretisation": {"type": "mesh"},
        "frame": {"type": "buckens"},
        "markers": {"p": {"node": 1, "mesh_node": 1}},
        "reduction": {"method": "modal", "modes": more.pop("modes", 6)},
        **more,
    }
    (folder / "model.json").write_text(json.dumps(data))
    return folder / "model.json"


def body(folder: Path, text: str, **more: Any) -> SID:
    return sid_from_model(model(folder, text, **more))


def textbook(length: float, extra: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass (12, 12) of a bar on the x axis, ends u, v, w, rotations.

    extra : mass per length that has no rotary inertia
    """
    k, m = np.zeros((2, 12, 12))
    pair = np.array([[1, -1], [-1, 1]])
    even = np.array([[2, 1], [1, 2]]) / 6
    for i, share, inertia in (
        (0, E * AREA, RHO * AREA + extra),
        (3, G * TORSION, RHO * (IY + IZ)),
    ):
        at = np.ix_([i, i + 6], [i, i + 6])
        k[at] = share / length * pair
        m[at] = inertia * length * even
    le = length
    bend = np.array(
        [
            [12, 6 * le, -12, 6 * le],
            [6 * le, 4 * le**2, -6 * le, 2 * le**2],
            [-12, -6 * le, 12, -6 * le],
            [6 * le, 2 * le**2, -6 * le, 4 * le**2],
        ]
    )
    sway = np.array(
        [
            [156, 22 * le, 54, -13 * le],
            [22 * le, 4 * le**2, 13 * le, -3 * le**2],
            [54, 13 * le, 156, -22 * le],
            [-13 * le, -3 * le**2, -22 * le, 4 * le**2],
        ]
    )
    rotary = np.array(
        [
            [36, 3 * le, -36, 3 * le],
            [3 * le, 4 * le**2, -3 * le, -(le**2)],
            [-36, -3 * le, 36, -3 * le],
            [3 * le, -(le**2), -3 * le, 4 * le**2],
        ]
    )
    for dofs, i, signs in (
        ([1, 5, 7, 11], IZ, [1, 1, 1, 1]),
        ([2, 4, 8, 10], IY, [1, -1, 1, -1]),
    ):
        turn = np.outer(signs, signs)
        k[np.ix_(dofs, dofs)] += E * i / le**3 * bend * turn
        m[np.ix_(dofs, dofs)] += (RHO * AREA + extra) * le / 420 * sway * turn
        m[np.ix_(dofs, dofs)] += RHO * i / (30 * le) * rotary * turn
    return k, m


def arm(r: np.ndarray) -> np.ndarray:
    """(6, 6) motion at r from a point by the motion of that point."""
    x, y, z = r
    result = np.eye(6)
    result[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return result


def by_textbook(
    offsets: dict[int, np.ndarray],
    masses: dict[int, np.ndarray],
    extra: float = 0.0,
) -> np.ndarray:
    """Elastic frequencies [Hz] of the frame.

    offsets : leg -> of both its ends from their nodes; masses : node -> (6, 6)
    """
    k, m = np.zeros((2, 24, 24))
    for number, (a, b) in enumerate(LEGS):
        shift = offsets.get(number, np.zeros((2, 3)))
        x, y = PLACES[a] + shift[0], PLACES[b] + shift[1]
        length = float(np.linalg.norm(y - x))
        e1 = (y - x) / length
        e3 = np.cross(e1, UP) / np.linalg.norm(np.cross(e1, UP))
        turn = np.kron(np.eye(4), np.array([e1, np.cross(e3, e1), e3]))
        turn = turn @ scipy.linalg.block_diag(arm(shift[0]), arm(shift[1]))
        dofs = [*range(6 * a, 6 * a + 6), *range(6 * b, 6 * b + 6)]
        for total, part in zip((k, m), textbook(length, extra), strict=True):
            total[np.ix_(dofs, dofs)] += turn.T @ part @ turn
    for node, inertia in masses.items():
        m[6 * node : 6 * node + 6, 6 * node : 6 * node + 6] += inertia
    values = scipy.linalg.eigh(k, m, eigvals_only=True)
    return np.sqrt(values[6:12]) / (2 * np.pi)


@pytest.mark.filterwarnings("ignore")
def test_a_frame_has_the_matrices_of_the_textbook(tmp_path: Path) -> None:
    found = frequencies(body(tmp_path, frame(PBAR)))
    assert_allclose(found, by_textbook({}, {}), rtol=1e-8)


PBEAM = f"PBEAM,1,1,{AREA!r},{IZ!r},{IY!r},,{TORSION!r}"


@pytest.mark.parametrize("card", [PBEAM + ",,NO\n,,,,,,,,\n,0.,0.", PBEAM])
@pytest.mark.filterwarnings("ignore")
def test_a_beam_is_the_same(card: str, tmp_path: Path) -> None:
    """K1 = K2 = 1 of a beam: shear is small in slender ones."""
    card = PBEAM + "\n,\n,NO,1.0\n,0.,0." if "NO" in card else card
    found = frequencies(body(tmp_path, frame(card, card="CBEAM")))
    assert_allclose(found, by_textbook({}, {}), rtol=1e-5)


SHIFT = np.array([[0.01, 0.03, -0.02], [-0.02, 0.05, 0.04]])


@pytest.mark.filterwarnings("ignore")
def test_offsets_and_rigid_couplings_are_arms(tmp_path: Path) -> None:
    """The middle leg aside of its nodes, by offsets, and by nodes of its own."""
    words = ",".join(map(repr, SHIFT.ravel().tolist()))
    text = frame(PBAR)
    lines = text.splitlines()
    middle = next(i for i, line in enumerate(lines) if line.startswith("CBAR,2,"))
    lines[middle] += f"\n,,,{words}"
    expected = by_textbook({1: SHIFT}, {})
    assert_allclose(frequencies(body(tmp_path, "\n".join(lines))), expected, rtol=1e-8)
    own = [
        f"GRID,{i},,{','.join(map(repr, (PLACES[k] + s).tolist()))}"
        for i, k, s in ((8, 1, SHIFT[0]), (9, 2, SHIFT[1]))
    ]
    held = [*own, "RBE2,70,2,123456,8", "RBE2,71,3,123456,9"]
    text = frame(PBAR, *held).replace("CBAR,2,1,2,3,", "CBAR,2,1,8,9,")
    assert_allclose(frequencies(body(tmp_path, text)), expected, rtol=1e-8)
    chain = ["GRID,7,,0.3,0.3,0.3", "RBE2,72,7,123456,2,8"]
    text = text.replace("RBE2,70,2,123456,8", "\n".join(chain))
    assert_allclose(frequencies(body(tmp_path, text)), expected, rtol=1e-8)


@pytest.mark.filterwarnings("ignore")
def test_masses_and_their_inertia(tmp_path: Path) -> None:
    """CONM2 beside its node, and further mass along the bars."""
    r, own = np.array([0.02, -0.03, 0.01]), np.diag([2e-5, 3e-5, 4e-5])
    whole = scipy.linalg.block_diag(0.02 * np.eye(3), own)
    inertia = arm(r).T @ whole @ arm(r)
    offset = ",".join(map(repr, r.tolist()))
    card = f"CONM2,60,3,,0.02,{offset}\n,2.-5,,3.-5,,,4.-5"
    found = frequencies(body(tmp_path, frame(PBAR, card)))
    assert_allclose(found, by_textbook({}, {2: inertia}), rtol=1e-8)
    sid = body(tmp_path, frame(f"{PBAR},{RHO * AREA!r}"))
    assert_allclose(frequencies(sid), by_textbook({}, {}, RHO * AREA), rtol=1e-8)
    length = sum(np.linalg.norm(PLACES[b] - PLACES[a]) for a, b in LEGS)
    assert sid.mass == pytest.approx(2 * RHO * AREA * length, rel=1e-12)


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
    bare = 139.45115
    rotary = 1 - found[0] / bare
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
    found = body(tmp_path, text, **more)
    data = json.loads((tmp_path / "model.json").read_text())
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
    (tmp_path / "beam.json").write_text(json.dumps(data))
    expected = sid_from_model(tmp_path / "beam.json")
    assert found.mass == pytest.approx(expected.mass, rel=1e-12)
    for name in ("J", "Ct", "Cr", "Me", "Gr", "Oe", "Ge", "Ke"):
        a, b = getattr(found, name), getattr(expected, name)
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
    ("text", "said"),
    [
        (frame(PBAR, tail="\n,4"), "pins 4 and 0"),
        (frame(PBAR, tail=",GGO"), "OFFT GGO"),
        (frame(PBAR + ",,,\n,\n,,,1.-13"), "holds I12"),
        (frame(f"PBAR,1,1,{AREA!r},{IZ!r},{IY!r}"), "torsion with nothing"),
        (frame("PBARL,1,1,,CHAN\n,1.,1.,1.,1."), "is a CHAN"),
        (frame("PBARL,1,1,,TUBE\n,0.01,0.02"), "is no TUBE"),
        (frame("PROD,1,1,1.-4"), "CBAR 1 has the property 1"),
        (frame(PBAR).replace("CBAR,2,1,2,3", "CBAR,2,1,2,77"), "node 77"),
        (frame(PBAR).replace("CBAR,2,1,2,3", "CBAR,1,1,2,3"), "1 is defined twice"),
        (frame(PBAR, "RBE2,9,1,123,4"), "RBE2 without all six"),
        (frame(PBAR, "MPC,9,1,1,1.,2,1,-1."), "MPC, RBE3"),
        (frame(PBAR, "GRID,9,,1.,1.,1.", "CONM2,8,9,,2."), "held by no bar"),
        (
            frame(PBAR, "GRID,9,,1.,1.,1.", "RBE2,8,9,123456,2,3", "RBE2,7,1,123456,2"),
            "held already",
        ),
        (truss(rods=RODS[:-1]), "is a mechanism"),
        (truss(rods=((0, 1), (2, 3))), "2 unconnected parts"),
        (truss("CONM2,8,5,,2.,0.1"), "that turns it"),
        (frame(PBAR, "CTETRA,90,90,1,2,3,4", "PSOLID,90,1"), "bars beside solids"),
        (frame(PBAR, "CBAR,9,1,1,4,0.1,0.5,0.7"), "lies along it"),
        (frame(PBAR, "CBAR,9,1,1,4"), "no direction"),
        (frame(PBEAM + "\n,\n,NO,1.0\n,1.,1.,0.1", card="CBEAM"), "S1, S2"),
        (frame(PBEAM + "\n,\n,NO,1.0\n,1.,1.\n,,,,,0.01", card="CBEAM"), "N1 or N2"),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_what_own_bars_are_not_is_refused(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        body(tmp_path, text)


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
