"""Decks whose bodies were wrong without a word: mass and frequencies as they are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import read_model
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model

from .decks import STEEL, Block, body, calculix, deck, deck_file, frequencies, listed

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

BEAM = Block((10, 1, 1), (1.0, 0.04, 0.05))
STRIP = Block((10, 1), (1.0, 0.05))


def beam_theory(height: float) -> float:
    """First frequency of a cantilever of 1 m (Euler and Bernoulli) [Hz]."""
    radius = height / np.sqrt(12)
    speed = np.sqrt(STEEL["e"] / STEEL["rho"])
    return float(1.8751041**2 / (2 * np.pi) * speed * radius)


@pytest.mark.parametrize("kind", ["C3D8I", "C3D8R", "C3D8IH"])
def test_solids_that_bend_are_read_as_such(tmp_path: Path, kind: str) -> None:
    sid = body(tmp_path, deck(BEAM, kind), held="LEFT")
    assert frequencies(sid)[0] == pytest.approx(beam_theory(0.04), rel=0.02)
    assert frequencies(sid)[1] == pytest.approx(beam_theory(0.05), rel=0.02)


@pytest.mark.parametrize("kind", ["CPS4I", "CPS4R"])
def test_plane_elements_that_bend_are_read_as_such(tmp_path: Path, kind: str) -> None:
    sid = body(tmp_path, deck(STRIP, kind, section="0.02"), held="LEFT")
    assert frequencies(sid)[0] == pytest.approx(beam_theory(0.05), rel=0.02)


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("kind", ["C3D8", "C3D8I"])
def test_hexahedra_are_those_of_calculix(tmp_path: Path, kind: str) -> None:
    text = deck(Block((7, 2, 1), (0.6, 0.05, 0.03)), kind)
    expected = calculix(tmp_path, text, "LEFT")
    found = frequencies(body(tmp_path, text, held="LEFT"))
    # CalculiX gives the internal modes a mass of their own: seen in short waves.
    count, rtol = (4, 1e-6) if kind == "C3D8" else (2, 2e-3)
    assert_allclose(found[:count], expected[:count], rtol=rtol)


def test_the_model_file_may_choose_another_formulation(tmp_path: Path) -> None:
    text = deck(BEAM, "C3D8I")
    settings = {"formulation": "full_integration"}
    sid = body(tmp_path, text, held="LEFT", discretisation=settings)
    full = body(tmp_path, deck(BEAM, "C3D8"), held="LEFT")
    assert_allclose(frequencies(sid), frequencies(full), rtol=1e-9)
    assert frequencies(full)[0] > 1.3 * beam_theory(0.04)


@pytest.mark.parametrize("depths", [(0.1, 0.3), (0.02, 0.005)])
def test_every_section_has_its_own_thickness(
    tmp_path: Path, depths: tuple[float, float]
) -> None:
    """Mass, and one thickness for all only where the model file says it."""
    halves = "*ELSET, ELSET=A, GENERATE\n1, 5\n*ELSET, ELSET=B, GENERATE\n6, 10\n"
    text = deck(STRIP, "CPS4", section="9.9").replace(
        "*SOLID SECTION, ELSET=E, MATERIAL=S\n9.9\n",
        halves
        + "".join(
            f"*SOLID SECTION, ELSET={name}, MATERIAL=S\n{depth}\n"
            for name, depth in zip("AB", depths, strict=True)
        ),
    )
    sid = body(tmp_path, text, held="LEFT")
    assert sid.mass == pytest.approx(7850 * 0.05 * 0.5 * sum(depths), rel=1e-12)
    one = body(tmp_path, text, thickness=0.2)
    assert one.mass == pytest.approx(7850 * 0.05 * 0.2, rel=1e-12)


SYSTEMS = {
    "mm, N, s": (0.001, 1e3, {"e": 2.1e5, "nu": 0.3, "rho": 7.85e-9}),
    "inch": (0.0254, 1 / 0.0254, None),
    "mm-kg-ms": ("mm-kg-ms", 1e3, {"e": 210.0, "nu": 0.3, "rho": 7.85e-6}),
}


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("kind", ["C3D8I", "CPS4I"])
def test_units_scale_the_materials_of_the_deck(
    tmp_path: Path, name: str, kind: str
) -> None:
    """The same part in metres and in other units is the same body."""
    unit, scale, material = SYSTEMS[name]
    if material is None:
        inch = 0.0254
        material = {
            "e": 2.1e11 * inch**2,
            "nu": 0.3,
            "rho": 7850 * inch**4,
        }
    block, depth = (BEAM, 0.0) if kind == "C3D8I" else (STRIP, 0.01)
    expected = body(tmp_path, deck(block, kind, section=f"{depth}"), held="LEFT")
    text = deck(block, kind, scale=scale, material=material, section=f"{depth * scale}")
    sid = body(tmp_path, text, held="LEFT", unit=unit)
    assert sid.mass == pytest.approx(expected.mass, rel=1e-9)
    assert_allclose(frequencies(sid), frequencies(expected), rtol=1e-6)


@pytest.mark.parametrize("unit", [0.001, "mm-t-s", "cm-g-s"])
def test_materials_in_other_units_than_the_lengths_are_refused(
    tmp_path: Path, unit: float | str
) -> None:
    with pytest.raises(InputError, match="material S would have .*the units that"):
        body(tmp_path, deck(BEAM, "C3D8", scale=1e3), unit=unit)


def test_an_unknown_unit_system_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no unit system 'furlong'.*mm-t-s") as caught:
        body(tmp_path, deck(BEAM, "C3D8"), unit="furlong")
    assert "geometry.unit" in str(caught.value)


def test_a_blank_field_is_zero(tmp_path: Path) -> None:
    """A coordinate that is left blank, in the middle or at the end of a line."""
    text = deck(Block((2, 1, 1), (0.3, 0.2, 0.1)), "C3D8")
    blank = text.replace(" 0.0,", " ,").replace(", 0.0\n", ",\n")
    assert ", ," in blank and blank != text
    expected, sid = body(tmp_path, text), body(tmp_path, blank)
    assert sid.mass == pytest.approx(7850 * 0.3 * 0.2 * 0.1, rel=1e-12)
    assert_allclose(sid.J.m0, expected.J.m0, rtol=1e-12)


def test_short_lines_of_coordinates_are_filled(tmp_path: Path) -> None:
    text = deck(Block((2, 1), (0.3, 0.2)), "CPS4", section="0.1")
    short = text.replace("1, 0.0, 0.0\n", "1\n", 1)
    assert short != text
    assert body(tmp_path, short).mass == pytest.approx(7850 * 0.006, rel=1e-12)


def part_deck(block: Block) -> str:
    """A part and an assembly that both have a set called HELD, and a reference node."""
    return (
        "*PART, NAME=P\n*NODE\n"
        + block.node_lines()
        + "*ELEMENT, TYPE=C3D8I, ELSET=E\n"
        + block.element_lines()
        + listed("HELD", block.left)
        + "*SOLID SECTION, ELSET=E, MATERIAL=S\n,\n*END PART\n"
        + "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=P-1, PART=P\n*END INSTANCE\n"
        + "*NODE\n1, 9., 9., 9.\n*NSET, NSET=REF\n1,\n"
        + listed("HELD, INSTANCE=P-1", block.right[:2])
        + "*NSET, NSET=OTHER\nP-1.HELD, P-1.3\n"
        + "*END ASSEMBLY\n"
        + "*MATERIAL, NAME=S\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7850.\n"
    )


def test_sets_of_a_part_and_of_its_assembly_stay_apart(tmp_path: Path) -> None:
    block = Block((4, 1, 1), (0.6, 0.05, 0.03))
    text = part_deck(block)
    sets = finite_element_model(read_model(deck_file(tmp_path, text))).node_sets
    assert {n + 1 for n in sets["P-1.HELD"]} == set(block.left)
    assert {n + 1 for n in sets["HELD"]} == set(block.right[:2])
    assert {n + 1 for n in sets["OTHER"]} == {*block.left, 3}
    flat = body(tmp_path, deck(block, "C3D8I"), held="LEFT")
    sid = body(tmp_path, text, held="P-1.HELD")
    assert_allclose(frequencies(sid), frequencies(flat), rtol=1e-9)


def test_a_set_without_nodes_of_the_body_holds_nothing(tmp_path: Path) -> None:
    text = part_deck(Block((4, 1, 1), (0.6, 0.05, 0.03)))
    with pytest.raises(InputError, match="'REF' holds no node"):
        body(tmp_path, text, held="REF")


def test_reduction_fix_names_sets_of_the_file(tmp_path: Path) -> None:
    """A beam held at both ends, by the frame alone or by frame and reduction."""
    text = deck(BEAM, "C3D8I") + listed("RIGHT", BEAM.right)
    path = deck_file(tmp_path, text, held="LEFT")
    data = json.loads(path.read_text(encoding="utf-8"))
    both = frequencies(_with(path, data, "frame", "clamp", ["LEFT", "RIGHT"]))
    fixed = frequencies(_with(path, data, "reduction", "fix", "RIGHT"))
    assert_allclose(fixed, both, rtol=1e-9)
    assert fixed[0] == pytest.approx(6.36 * beam_theory(0.04), rel=0.05)


def _with(path: Path, data: Any, table: str, key: str, value: Any) -> SID:
    path.write_text(
        json.dumps(data | {table: data[table] | {key: value}}), encoding="utf-8"
    )
    return sid_from_model(path)
