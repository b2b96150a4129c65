"""Quantities of bodies, the file of derivatives, Python and the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from tests.places import SLIDER_CRANK
from tests.sidtool.models import QM6, rod
from tests.steel_bars import bar_data

from .references import arrays, largest_difference


def bar() -> ModelFile:
    return validate_data(bar_data(width=0.03, elements=2, modes=2), ModelFile)


def test_static_compliance_and_mass_of_a_bar() -> None:
    """u / F = L^3 / (3 E I) by attachment modes; centre at L / 2; J = m L^2 / 3."""
    changes = {"method": "attachment", "modes": 1, "interfaces": ["tip"]}
    model = bar().with_({"reduction": changes})
    d = sidtool.sid_derivatives(model, ["end[0]", "section.height", "youngs_modulus"])
    force = d.value("compliance(tip.y)")
    assert force == pytest.approx(12 / (3 * 2.1e11 * 0.03 * 0.02**3), rel=1e-9)
    slopes = {"end[0]": 3.0, "section.height": -3 / 0.02, "youngs_modulus": -1 / 2.1e11}
    for name, slope in slopes.items():
        found = d.derivative("compliance(tip.y)", name)
        assert found == pytest.approx(force * slope, rel=1e-8), name
    assert d.derivative("centre(x)", "end[0]") == pytest.approx(0.5, rel=1e-12)
    assert d.derivative("mass", "end[0]") == pytest.approx(
        7850 * 0.03 * 0.02, rel=1e-12
    )
    inertia = 7850 * 0.03 * (1 / 3 + 3 * 0.02**2 / 12) * 1.0
    assert d.derivative("inertia(zz)", "section.height") == pytest.approx(inertia)
    assert d.derivative("entry(Ke[0,0])", "youngs_modulus") == pytest.approx(
        d.value("entry(Ke[0,0])") / 2.1e11
    )


COARSE = {**QM6, "elements": [12, 2]}
END = "geometry.control_points[2][{}][1]"


def test_parameters_follow_their_formulas() -> None:
    """The right end has the heights -y and y with y = w / 4 + w^2 / 2."""
    model = rod(COARSE).with_(
        {
            "parameters": {"w": 0.1, "unused": 1.0},
            END.format(0): "-w/4 - w**2/2",
            END.format(1): "w/4 + w**2/2",
        }
    )
    height = sidtool.ShapeVariable("y", {END.format(0): -1, END.format(1): 1})
    d = sidtool.sid_derivatives(model, ["w", height])
    expected = {name: (1 / 4 + 0.1) * block for name, block in arrays(d["y"]).items()}
    assert largest_difference(d["w"], expected, d.sid, 0.1) < (1e-9, "")
    with pytest.raises(InputError, match="no formula reads"):
        sidtool.sid_derivatives(model, ["unused"])


def test_points_that_are_one_move_together() -> None:
    """A rod whose right end shrinks to a point cannot open there."""
    changes: dict[str, Any] = {END.format(i): 0.0 for i in (0, 1)}
    changes["markers.piston_pin"] = {"node": 2, "parameters": [0.8, 0.5]}
    model = rod(COARSE).with_(changes)
    left = {f"geometry.control_points[2][{i}][0]": 1.0 for i in (0, 1)}
    both = sidtool.sid_derivatives(model, [sidtool.ShapeVariable("length", left)])
    assert both.derivative("mass", "length") > 0
    with pytest.raises(InputError, match="one of several control points"):
        sidtool.sid_derivatives(model, [END.format(0)])


def test_file_of_derivatives(tmp_path: Path) -> None:
    shape = sidtool.ShapeVariable("size", {"end[0]": 1.0, "section.height": 0.02})
    written = sidtool.sid_derivatives(bar(), ["material.density", shape])
    path = tmp_path / "bar.h5"
    written.save(path)
    again = sidtool.SidDerivatives.load(path)
    assert list(again) == ["material.density", "size"]
    assert dict(again.variables) == dict(written.variables)
    assert again.value("compliance(tip.z)") == written.value("compliance(tip.z)")
    pairs = [(again.sid, written.sid), *((again[n], written[n]) for n in written)]
    pairs.append((sidtool.read(path), written.sid))
    for one, other in pairs:
        for name, value in arrays(other).items():
            assert np.array_equal(arrays(one)[name], value), name
    sidtool.write(tmp_path / "plain.h5", written.sid)
    with pytest.raises(InputError, match="without derivatives"):
        sidtool.SidDerivatives.load(tmp_path / "plain.h5")


def test_wildcards() -> None:
    found = sidtool.sensitivity(bar(), "section.*, material.d*", "mass")
    sizes = {"geometry.section.height", "geometry.section.width"}
    assert set(found.variables) == {*sizes, "material.density"}
    with pytest.raises(InputError, match="no number of the model"):
        sidtool.sensitivity(bar(), "sect*", "mass")


def test_frequencies_of_a_pair_are_directional() -> None:
    """The frequencies of a square bar move apart: 0 and w / h for its height."""
    square = bar().with_({"geometry.section.width": 0.02})
    found = sidtool.sensitivity(square, "section.height", "frequency(*)")
    assert found.relative[:, 0] == pytest.approx([0.0, 1.0], abs=1e-3)
    assert found.ranked(1) == [0]


@pytest.mark.parametrize(
    "text", ["weight", "frequency(3)", "centre(u)", "inertia(yx)", "compliance(top.y)"]
)
def test_unknown_quantities(text: str) -> None:
    with pytest.raises(InputError, match="--of"):
        sidtool.sensitivity(bar(), "youngs_modulus", text)


@pytest.mark.parametrize("text", ["entry(Xe[0,0])", "entry(Ke[5,0])", "entry(Ke)"])
def test_unknown_entries(text: str) -> None:
    with pytest.raises(InputError, match="--of"):
        sidtool.sensitivity(bar(), "youngs_modulus", text)


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = str(SLIDER_CRANK / "rod_q4.toml")
    change = "discretisation.elements=[20, 2]"
    waist = (
        "waist=geometry.control_points[1][0][1]:-1,geometry.control_points[1][1][1]:1"
    )
    arguments = ["sensitivity", model, "--set", change, "--with", "thickness,density"]
    arguments += ["--with", waist, "--of", "mass", "--json"]
    assert run([*arguments, "-o", str(tmp_path / "d.h5")]) == 0
    rows = json.loads(capsys.readouterr().out)["sensitivities"]
    slopes = {row["variable"]: row["derivative"] for row in rows}
    mass = rows[0]["value"]
    assert slopes["thickness"] == pytest.approx(mass / 0.01)
    assert slopes["density"] == pytest.approx(mass / 7850)
    assert slopes["waist"] == pytest.approx(7850 * 0.01 * 2 / 3, rel=1e-2)
    assert list(sidtool.SidDerivatives.load(tmp_path / "d.h5"))[2] == "waist"
