"""Model files: what is right is read, every mistake is named with its key."""

from __future__ import annotations

import copy
import re
from typing import Any

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile, read_model
from sidtool.formats.model.beams import LumpedMass
from sidtool.formats.toml.reading import read_data, validate_data
from tests.places import ROOT

ROD = ROOT / "examples" / "slider_crank" / "rod_q4.toml"
MISSING = object()


def changed(key: str, value: Any) -> dict[str, Any]:
    """The rod with one entry replaced or removed; `key` is dotted."""
    data = copy.deepcopy(read_data(ROD))
    *path, last = key.split(".")
    table = data
    for part in path:
        table = table.setdefault(part, {})
    if value is MISSING:
        del table[last]
    else:
        table[last] = value
    return data


def test_the_examples_are_read() -> None:
    q4, iga = (read_model(ROD.with_name(f"rod_{n}.toml")) for n in ("q4", "iga"))
    assert q4.geometry == iga.geometry and q4.material == iga.material
    assert q4.frame == iga.frame and q4.markers == iga.markers
    assert q4.discretisation.type == "q4" and iga.discretisation.type == "iga"
    assert list(q4.markers) == ["crank_pin", "piston_pin"]


def test_further_names_of_edges_and_several_clamps() -> None:
    data = changed("geometry.edges", {"crank_side": "left"})
    data["frame"]["clamp"] = ["crank_side", "top"]
    data["markers"]["crank_pin"]["edge"] = "crank_side"
    model = validate_data(data, ModelFile)
    assert model.geometry.edge_names["crank_side"] == (0, 0)
    assert model.frame.clamped_edges == ("crank_side", "top")


@pytest.mark.parametrize(
    ("key", "value", "place", "problem"),
    [
        ("format", "sidtool scene", "format", "'sidtool scene'"),
        ("version", 2, "version", "2"),
        ("material.density", MISSING, "material.density", "missing"),
        ("material.density", -7850.0, "material.density", "-7850"),
        ("material.density", 0, "material.density", "0"),
        ("material.density", "7850 kg/m^3", "material.density", "7850 kg"),
        ("material.density", True, "material.density", "true"),
        ("material.density", float("nan"), "material.density", "nan"),
        ("material.youngs_modulus", float("inf"), "material.youngs_modulus", "inf"),
        ("material.poissons_ratio", 0.5, "material.poissons_ratio", "0.5"),
        ("material.poissons_ratio", -1, "material.poissons_ratio", "-1"),
        ("material.colour", "red", "material.colour", "not a known key"),
        ("geometry.thickness", -0.01, "geometry.thickness", "-0.01"),
        ("geometry.type", "sheet", "geometry.type", "sheet"),
        ("geometry.degrees", [0, 1], "geometry.degrees[0]", "0"),
        ("geometry.degrees", [2.5, 1], "geometry.degrees[0]", "2.5"),
        ("geometry.degrees", [3, 1], "geometry.knots[0]", "3 functions of degree 3"),
        ("geometry.weights", [[1, 1], [1, 1]], "geometry.weights", "2 rows"),
        ("geometry.weights", [[1, 1], [1], [1, 1]], "geometry.weights[1]", "1 ent"),
        ("geometry.weights", [[1, 0]] * 3, "geometry.weights[0][1]", "0"),
        ("geometry.control_points", [[[0, 0], [0, 1]]], "geometry.control_points", ""),
        (
            "geometry.control_points",
            [[[0, 0], [0, 1]], [[1, 0]], [[2, 0], [2, 1]]],
            "geometry.control_points[1]",
            "1 entries",
        ),
        ("geometry.edges", {"foot": "front"}, "geometry.edges.foot", "front"),
        ("geometry.edges", {"left": "right"}, "geometry.edges.left", "a side already"),
        ("discretisation.type", "q5", "discretisation", "q5"),
        ("discretisation.elements", [150, 0], "discretisation.elements[1]", "0"),
        ("discretisation.elements", [150], "discretisation.elements", ""),
        ("discretisation.elements", [1.5, 2], "discretisation.elements[0]", "1.5"),
        ("discretisation.state", "plane", "discretisation.state", "plane"),
        ("frame.clamp", "front", "frame.clamp", "no edge 'front'"),
        ("frame.marker", "pin", "frame.marker", "no marker 'pin'"),
        ("markers", {}, "markers", ""),
        ("markers.piston_pin.node", 1, "markers.piston_pin.node", "crank_pin already"),
        ("markers.piston_pin.node", 0, "markers.piston_pin.node", "0"),
        ("markers.piston_pin.node", 100000, "markers.piston_pin.node", "100000"),
        ("markers.piston_pin.at", 1.2, "markers.piston_pin.at", "1.2"),
        ("markers.piston_pin.at", MISSING, "markers.piston_pin", "edge and at"),
        ("markers.piston_pin.edge", "end", "markers.piston_pin.edge", "no edge 'end'"),
        ("markers.piston_pin.position", [0, 0], "markers.piston_pin", "edge and posi"),
        ("reduction.modes", 0, "reduction.modes", "0"),
        ("reduction.method", "magic", "reduction.method", "magic"),
        ("damping.alpha", -1, "damping.alpha", "-1"),
    ],
)
def test_a_mistake_is_named_with_its_key(
    key: str, value: Any, place: str, problem: str
) -> None:
    with pytest.raises(InputError) as caught:
        validate_data(changed(key, value), ModelFile, source="rod.toml")
    error = caught.value
    assert error.source == "rod.toml"
    assert error.place is not None and error.place.startswith(place)
    assert problem in error.problem
    assert error.expected


@pytest.mark.parametrize("kind", ["rigid", "distributing"])
def test_a_tie_to_nothing_is_refused(kind: str) -> None:
    """It ended in a traceback of NumPy once the mesh was there."""
    key = "markers.crank_pin.tie"
    with pytest.raises(InputError) as caught:
        validate_data(changed(key, {"type": kind, "to": []}), ModelFile)
    assert caught.value.place == f"{key}.to"


def test_a_lumped_mass_has_no_negative_inertia() -> None:
    with pytest.raises(InputError) as caught:
        LumpedMass(at=1.0, mass=0.5, inertia=(0.0, 1.0, -0.1))
    assert caught.value.place == "inertia[2]"


@pytest.mark.parametrize(
    ("table", "key", "kinds"),
    [
        ("discretisation", "type", "one of 'q4', 'iga', 'hex8', .*'matrices'"),
        ("geometry", "type", "one of 'nurbs', .*'beam'"),
        ("frame", "type", "one of 'tangent', 'chord', 'buckens'"),
        ("reduction", "method", "one of 'modal', 'craig_bampton', .*'krylov'"),
    ],
)
def test_a_table_without_its_kind_hears_which_there_are(
    table: str, key: str, kinds: str
) -> None:
    with pytest.raises(InputError) as caught:
        validate_data(changed(table, {}), ModelFile)
    assert (caught.value.place, caught.value.problem) == (
        f"{table}.{key}",
        "is missing",
    )
    assert re.match(kinds, caught.value.expected or "")


@pytest.mark.parametrize(
    ("knots", "problem"),
    [
        ([0, 0, 0, 1, 1], "has 5 knots"),
        ([0, 0, 0, 1, 1, 0.5], "decreases"),
        ([0, 0, 0.2, 1, 1, 1], "has the end knot 0 2 times"),
        ([0, 0, 0, 0, 0, 0], "has the end knot 0 6 times"),
    ],
)
def test_a_knot_vector_that_does_not_fit(knots: list[float], problem: str) -> None:
    data = changed("geometry.knots", [knots, [0, 0, 1, 1]])
    with pytest.raises(InputError) as caught:
        validate_data(data, ModelFile)
    assert caught.value.place == "geometry.knots[0]"
    assert problem in caught.value.problem


def test_a_patch_must_not_fall_apart_inside() -> None:
    data = changed("geometry.degrees", [1, 1])
    data["geometry"]["control_points"] *= 2
    data["geometry"]["knots"][0] = [0, 0, 0.3, 0.5, 0.5, 0.7, 1, 1]
    with pytest.raises(InputError, match="inner knot 0.5 2 times; expected at most 1"):
        validate_data(data, ModelFile)


@pytest.mark.parametrize(
    "targets",
    [{}, {"functions": [25, 8], "elements": [18, 4]}],
)
def test_iga_needs_exactly_one_target(targets: dict[str, Any]) -> None:
    settings = {"type": "iga", "degrees": [7, 4], **targets}
    with pytest.raises(InputError, match="exactly one of functions, elements, knots"):
        validate_data(changed("discretisation", settings), ModelFile)
