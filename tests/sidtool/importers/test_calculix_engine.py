"""CalculiX discretises shells, beams and composites: theory and its own frequencies."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import WARNING
from sidtool.importers import calculix_engine
from sidtool.importers.calculix_engine import free_deck, without_layers
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import codes, only

from .decks import STEEL, calculix, frequencies, listed

E, NU, RHO = STEEL["e"], STEEL["nu"], STEEL["rho"]
MATERIAL = f"*MATERIAL, NAME=M\n*ELASTIC\n{E!r}, {NU!r}\n*DENSITY\n{RHO!r}\n"


def beam_deck(length: float, height: float, width: float, count: int = 40) -> str:
    """B32R along x; its section height is along y, its width along z."""
    points = np.linspace(0.0, length, 2 * count + 1)
    nodes = "".join(f"{i}, {x!r}, 0., 0.\n" for i, x in enumerate(points.tolist(), 1))
    elements = "".join(
        f"{k + 1}, {2 * k + 1}, {2 * k + 2}, {2 * k + 3}\n" for k in range(count)
    )
    return (
        f"*NODE\n{nodes}*ELEMENT, TYPE=B32R, ELSET=EB\n{elements}{MATERIAL}"
        f"{listed('LEFT', [1])}{listed('RIGHT', [2 * count + 1])}"
        "*BEAM SECTION, ELSET=EB, MATERIAL=M, SECTION=RECT\n"
        f"{height!r}, {width!r}\n0., 1., 0.\n"
    )


def plate_deck(kind: str, side: float, section: str, count: int) -> str:
    """A square plate in the xy plane, linear (S4) or quadratic (S8R)."""
    step = 2 if kind == "S8R" else 1
    n = step * count
    number = {}
    for j in range(n + 1):
        for i in range(n + 1):
            if step == 1 or i % 2 == 0 or j % 2 == 0:
                number[i, j] = len(number) + 1
    nodes = "".join(
        f"{k}, {side * i / n!r}, {side * j / n!r}, 0.\n" for (i, j), k in number.items()
    )
    corners = [(0, 0), (step, 0), (step, step), (0, step)]
    middles = [(1, 0), (2, 1), (1, 2), (0, 1)] if step == 2 else []
    rows = []
    for j in range(0, n, step):
        for i in range(0, n, step):
            own = [number[i + a, j + b] for a, b in (*corners, *middles)]
            rows.append(f"{len(rows) + 1}, " + ", ".join(map(str, own)) + "\n")
    left = [k for (i, _), k in number.items() if i == 0]
    return (
        f"*NODE\n{nodes}*ELEMENT, TYPE={kind}, ELSET=EP\n{''.join(rows)}{MATERIAL}"
        f"{listed('LEFT', left)}{section}\n"
    )


def shell(thickness: float) -> str:
    return f"*SHELL SECTION, ELSET=EP, MATERIAL=M\n{thickness!r}"


def body(
    folder: Path, deck: str, node: int, held: str | None = None, **geometry: Any
) -> SID:
    """The SID of shells or beams by CalculiX, which makes solids of them."""
    path = model_file(folder, deck, node, held, **geometry)
    sid = sid_from_model(path)
    assert "N127" in codes(sid)
    return sid


def model_file(
    folder: Path, deck: str, node: int, held: str | None = None, **geometry: Any
) -> Path:
    """A model of a deck by CalculiX, with a marker at a node of the deck."""
    (folder / "part.inp").write_text(deck, encoding="utf-8")
    frame: dict[str, Any] = {"type": "buckens"}
    markers: dict[str, Any] = {"p": {"node": 1, "mesh_node": node}}
    if held:
        markers["root"] = {"node": 2, "mesh_node": 1}
        frame = {"type": "tangent", "marker": "root", "clamp": held}
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {
            "type": "mesh",
            "file": "part.inp",
            "engine": "calculix",
            **geometry,
        },
        "discretisation": {"type": "mesh"},
        "frame": frame,
        "markers": markers,
        "reduction": {"method": "modal", "modes": 4},
    }
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return folder / "model.json"


@pytest.mark.needs("ccx")
def test_a_beam_bends_by_bernoulli_theory(tmp_path: Path) -> None:
    """Two clamped modes about each axis, and how much its end turns as it bends."""
    length, height, width = 1.2, 0.012, 0.02
    sid = body(tmp_path, beam_deck(length, height, width), 81, held="LEFT")
    assert sid.mass == pytest.approx(RHO * length * height * width, rel=1e-6)
    roots = np.array([1.875104, 4.694091])
    wave = np.sqrt(E / (12 * RHO)) * (roots / length) ** 2 / (2 * np.pi)
    found = frequencies(sid)
    assert_allclose(found[[0, 2]], wave * height, rtol=4e-3)
    assert_allclose(found[[1, 3]], wave * width, rtol=4e-3)
    tip = sid.nodes[0]
    bend, turn = tip.phi.m0[1, 0], tip.psi.m0[2, 0]
    assert turn * length / bend == pytest.approx(1.3765, rel=2e-3)


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("unit", ["m", "mm-t-s"])
def test_a_clamped_plate_has_the_frequencies_of_leissa(
    tmp_path: Path, unit: str
) -> None:
    """A square held at one edge (Leissa 1969, table 4.49, nu = 0.3), in two units."""
    side, depth = 0.5, 0.004
    geometry: dict[str, Any] = {}
    deck = plate_deck("S8R", side, shell(depth), 12)
    if unit != "m":
        deck = plate_deck("S8R", 1e3 * side, shell(1e3 * depth), 12).replace(
            MATERIAL,
            f"*MATERIAL, NAME=M\n*ELASTIC\n{E * 1e-6!r}, {NU!r}\n*DENSITY\n"
            f"{RHO * 1e-12!r}\n",
        )
        geometry["unit"] = unit
    sid = body(tmp_path, deck, 2, held="LEFT", **geometry)
    assert sid.mass == pytest.approx(RHO * side**2 * depth, rel=1e-6)
    rigidity = E * depth**3 / (12 * (1 - NU**2))
    scale = np.sqrt(rigidity / (RHO * depth)) / (2 * np.pi * side**2)
    assert_allclose(frequencies(sid)[:3] / scale, [3.492, 8.525, 21.43], rtol=8e-3)


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("kind", ["S4", "S8R"])
def test_frequencies_are_those_of_calculix(tmp_path: Path, kind: str) -> None:
    """Also of S4, whose internal modes are degrees of freedom with mass."""
    deck = plate_deck(kind, 0.3, shell(0.005), 4)
    own = frequencies(body(tmp_path, deck, 2))
    assert_allclose(own, calculix(tmp_path, deck, None), rtol=1e-6)


@pytest.mark.needs("ccx")
def test_moments_of_inertia_of_a_free_plate(tmp_path: Path) -> None:
    """Bounds: places of CalculiX's nodes are refined beyond their six digits."""
    side, depth = 0.371, 0.0061
    sid = body(tmp_path, plate_deck("S4", side, shell(depth), 5), 8)
    mass = RHO * side**2 * depth
    flat, upright = (side**2 + depth**2) / 12, side**2 / 6
    expected = mass * np.array([flat, flat, upright])
    assert sid.mass == pytest.approx(mass, rel=1e-9)
    assert_allclose(sid.J.m0[:3, 0], expected, rtol=1e-6)
    assert_allclose(sid.J.m0[3:, 0], 0, atol=1e-6 * expected[0])


@pytest.mark.needs("ccx")
def test_layers_of_one_material_are_a_plate(tmp_path: Path) -> None:
    layers = "*SHELL SECTION, ELSET=EP, COMPOSITE\n0.001,,M\n0.003,,M"
    found = []
    for section in (shell(0.004), layers):
        deck = plate_deck("S8R", 0.3, section, 3)
        found.append(body(tmp_path, deck, 2, held="LEFT"))
    assert found[1].mass == pytest.approx(found[0].mass, rel=1e-6)
    assert_allclose(frequencies(found[1]), frequencies(found[0]), rtol=1e-5)


@pytest.mark.needs("ccx")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("TYPE=S4", "TYPE=S5"), "CalculiX says"),
        (("*SHELL SECTION", "*CONTACT PAIR\n*SHELL SECTION"), "CONTACT PAIR"),
        (
            ("*SHELL SECTION", "*EQUATION\n2\n1,2,1.,2,2,-1.\n*SHELL SECTION"),
            "resists a rigid motion",
        ),
    ],
)
def test_unsupported_requests_to_calculix_are_refused(
    tmp_path: Path, change: tuple[str, str], message: str
) -> None:
    deck = plate_deck("S4", 0.3, shell(0.005), 2)
    assert change[0] in deck
    (tmp_path / "part.inp").write_text(deck.replace(*change), encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        _convert(tmp_path)
    assert "part.inp" in str(caught.value)


@pytest.mark.needs("ccx")
def test_a_missing_density_is_refused_with_its_remedy(tmp_path: Path) -> None:
    text = plate_deck("S4", 0.3, shell(0.005), 2).replace(f"*DENSITY\n{RHO!r}\n", "")
    (tmp_path / "part.inp").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        _convert(tmp_path)
    assert "geometry.density" in str(caught.value.expected)


@pytest.mark.needs("ccx")
def test_calculix_reports_that_it_is_at_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calculix_engine, "_REPORT_INTERVAL", 1e-3)
    path = model_file(tmp_path, plate_deck("S8R", 0.3, shell(0.005), 3), 2)
    stages: list[str] = []
    sid_from_model(path, stages.append)
    for stage in ("matrices", "mesh", "refining positions, step 1"):
        assert any(stage in text for text in stages)


def test_without_calculix_the_message_names_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "part.inp").write_text(
        plate_deck("S4", 0.3, shell(0.005), 2), encoding="utf-8"
    )
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="apt install calculix-ccx"):
        _convert(tmp_path)


def test_own_elements_name_the_engine_for_shells_with_middle_nodes(
    tmp_path: Path,
) -> None:
    (tmp_path / "part.inp").write_text(
        plate_deck("S8R", 0.3, shell(0.005), 2), encoding="utf-8"
    )
    with pytest.raises(InputError, match='geometry.engine = "calculix"'):
        _convert(tmp_path, engine=None)


def _convert(folder: Path, engine: str | None = "calculix") -> SID:
    geometry = {"type": "mesh", "file": "part.inp"}
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": geometry | ({"engine": engine} if engine else {}),
        "discretisation": {"type": "mesh"},
        "frame": {"type": "buckens"},
        "markers": {"p": {"node": 1, "mesh_node": 1}},
        "reduction": {"method": "modal", "modes": 4},
    }
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return sid_from_model(folder / "model.json")


def test_a_deck_loses_its_steps_and_supports_only(tmp_path: Path) -> None:
    (tmp_path / "more.inp").write_text("*NODE\n2, 1.\n", encoding="utf-8")
    (tmp_path / "part.inp").write_text(
        "*NODE\n1, 0.\n*INCLUDE, INPUT=more.inp\n*BOUNDARY\n1, 1, 3\n*BOUNDARY\n2, 1\n"
        "*MASS, ELSET=E\n1.\n*STEP\n*STATIC\n*CLOAD\n2, 1, 1.\n*END STEP\n** the end\n",
        encoding="utf-8",
    )
    lines = free_deck(tmp_path / "part.inp")
    assert lines == ["*NODE", "1, 0.", "*NODE", "2, 1."]


def test_a_deck_has_cartesian_nodes_for_calculix(tmp_path: Path) -> None:
    """It would take radius and degrees for x and y without a word."""
    text = "*Node, System = C, NSET=A\n7, 2., 90., 3.\n*ELSET, ELSET=B\n*MATERIAL\n"
    (tmp_path / "part.inp").write_text(text, encoding="utf-8")
    head, node, *rest = free_deck(tmp_path / "part.inp")
    assert head == "*NODE"
    assert_allclose([float(w) for w in node.split(",")], [7, 0, 2, 3], atol=1e-15)
    assert rest == ["*NSET, NSET=A", "7,", "*ELSET, ELSET=B", "*MATERIAL"]


@pytest.mark.needs("ccx")
@pytest.mark.filterwarnings("ignore:CalculiX")
@pytest.mark.parametrize(("kind", "node"), [("S4", 14), ("S8R", 26), ("S8R", 29)])
def test_a_mass_at_a_node_of_a_shell(kind: str, node: int, tmp_path: Path) -> None:
    """At corners and in the middle of an edge; CalculiX itself on the whole deck.

    How the three nodes through the thickness share the mass at a corner of S8R is
    worth 4e-5.
    """
    text = plate_deck(kind, 0.3, shell(0.005), 4)
    mass = f"*ELEMENT, TYPE=MASS, ELSET=Q\n500, {node}\n*MASS, ELSET=Q\n0.8\n"
    sid = body(tmp_path, text + mass, node)
    assert sid.mass == pytest.approx(RHO * 0.3**2 * 0.005 + 0.8, rel=1e-9)
    expected = calculix(tmp_path, text + mass, None)
    assert_allclose(frequencies(sid), expected, rtol=1e-4)
    plain = calculix(tmp_path, text, None)
    assert (expected / plain).min() < 0.97


@pytest.mark.needs("ccx")
@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            "*SURFACE, NAME=S\n1, S2\n*COUPLING, REF NODE=99, SURFACE=S, "
            "CONSTRAINT NAME=C\n*DISTRIBUTING\n1, 6\n",
            "CalculiX couples forces alone",
        ),
        (
            "*MASS, ELSET=Q\n9.\n*ELEMENT, TYPE=MASS, ELSET=Q\n50, 99\n",
            "mass at node 99",
        ),
    ],
)
def test_masses_that_calculix_drops_are_refused(
    more: str, message: str, tmp_path: Path
) -> None:
    """A mass at a point that no element holds was lost without a word."""
    text = plate_deck("S4", 0.3, shell(0.005), 2) + "*NODE\n99, 0., 0., 1.\n"
    (tmp_path / "part.inp").write_text(text + more, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        _convert(tmp_path)


@pytest.mark.needs("ccx")
def test_elements_unknown_to_calculix_are_refused(tmp_path: Path) -> None:
    text = plate_deck("S8R", 0.3, shell(0.005), 2).replace("S8R", "S8R5")
    (tmp_path / "part.inp").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="says: .*S8R5 is an unknown element type"):
        _convert(tmp_path)
    with pytest.raises(InputError, match=r"S8R5.*geometry\.engine"):
        _convert(tmp_path, engine=None)
    (tmp_path / "part.inp").write_text(f"{text}*NGEN\n1, 3\n", encoding="utf-8")
    with pytest.raises(InputError, match="S8R5 is not supported.* of CalculiX, as S8R"):
        _convert(tmp_path)


def test_layers_become_one(tmp_path: Path) -> None:
    lines = ["*SHELL SECTION, COMPOSITE, ELSET=E, OFFSET=0.5", "1.,,A", "2.5,,B", "*X"]
    expected = ["*SHELL SECTION,ELSET=E,OFFSET=0.5,MATERIAL=A", "3.5", "*X"]
    assert without_layers(lines) == expected


def hoop_deck(radius: float, thickness: float, along: float) -> str:
    """A ring of 24 C3D20R about z whose modulus is `along` in its circumference."""
    count = 24
    places: dict[tuple[int, int, int], int] = {}
    corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
    corners += [(r, t, 2) for r, t, _ in corners]
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)]
    edges += [(k, k + 4) for k in range(4)]
    middles = [tuple((np.array(corners[a]) + corners[b]) // 2) for a, b in edges]
    rows = []
    for k in range(count):
        own = [(r, (t + 2 * k) % (2 * count), z) for r, t, z in (*corners, *middles)]
        numbers = [places.setdefault(place, len(places) + 1) for place in own]
        first, second = (", ".join(map(str, x)) for x in (numbers[:15], numbers[15:]))
        rows.append(f"{k + 1}, {first},\n{second}\n")
    nodes = ""
    for (r, t, z), number in places.items():
        a, distance = np.pi * t / count, radius + thickness * (r - 1) / 2
        place = (distance * np.cos(a), distance * np.sin(a), thickness * (z - 1) / 2)
        nodes += f"{number}, " + ", ".join(f"{c:.12e}" for c in place) + "\n"
    return (
        f"*NODE, NSET=ALL\n{nodes}*ELEMENT, TYPE=C3D20R, ELSET=EB\n{''.join(rows)}"
        "*MATERIAL, NAME=M\n*ELASTIC, TYPE=ENGINEERING CONSTANTS\n"
        f"1.5e9, {along!r}, 4e9, 0., 0., 0., 5e9, 5e9\n5e9\n*DENSITY\n1200.\n"
        "*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL\n0., 0., 0., 0., 0., 1.\n"
        "*SOLID SECTION, ELSET=EB, MATERIAL=M, ORIENTATION=O\n"
    )


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("along", [1.1e10, 6e9])
def test_a_ring_with_cylindrical_axes_becomes_oval(
    along: float, tmp_path: Path
) -> None:
    """Two modes of a thin ring, which know the modulus along it alone (Hoppe, 1871)."""
    radius, thickness = 0.5, 0.01
    text = hoop_deck(radius, thickness, along)
    sid = sid_from_model(model_file(tmp_path, text, 1))
    assert only(sid, "N127").data["elements"] == 24
    assert sid.mass == pytest.approx(2400 * np.pi * radius * thickness**2, rel=1e-5)
    wave = 6 / np.sqrt(5) * np.sqrt(along / (12 * 1200.0)) * thickness / radius**2
    differences = np.sort(np.abs(frequencies(sid) / (wave / (2 * np.pi)) - 1))
    assert_allclose(differences[:2], 0, atol=2e-3)


@pytest.mark.needs("ccx")
def test_content_skipped_by_geometry_ignore_is_noted(tmp_path: Path) -> None:
    """Springs of a deck are not in its body, which must not go without a word."""
    deck = plate_deck("S8R", 0.3, shell(0.005), 3)
    deck += "*NODE PRINT, NSET=LEFT\nU\n*NONSTRUCTURAL MASS, ELSET=EP\n5.0\n"
    ignore = ["NONSTRUCTURAL MASS", "NODE PRINT"]
    path = model_file(tmp_path, deck, 2, ignore=ignore)
    note = only(sid_from_model(path), "N113")
    assert note.severity == WARNING
    assert note.data["keywords"] == ("*NONSTRUCTURAL MASS",)


@pytest.mark.needs("ccx")
@pytest.mark.skipif(os.name == "nt", reason="a script of the shell")
def test_warnings_of_calculix_are_diagnostics(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each once, on however many lines they are."""
    text = " *WARNING in e_c3d: not\\n       meant\\n"
    own = tmp_path / "programs" / "ccx"
    own.parent.mkdir()
    lines = ["#!/bin/sh", f'{shutil.which("ccx")} "$@"', f"printf '\\n{2 * text}'", ""]
    own.write_text("\n".join(lines), encoding="utf-8")
    own.chmod(0o755)
    path = os.pathsep.join((str(own.parent), os.environ["PATH"]))
    monkeypatch.setenv("PATH", path)
    sid = sid_from_model(
        model_file(tmp_path, plate_deck("S8R", 0.3, shell(0.005), 3), 2)
    )
    warning = only(sid, "N128")
    assert warning.severity == WARNING
    assert warning.data["warning"] == "in e_c3d: not meant"
