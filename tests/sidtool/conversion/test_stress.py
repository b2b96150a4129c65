"""Stress recovery: against beam theory and the full finite-element stress."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any
from weakref import WeakSet

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.conversion.quadrature import QuadraturePart, quadrature_parts
from sidtool.conversion.stress_recovery import peak_points
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.elements.material_points import stress_rows
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.stress import (
    node_stress,
    peak_stress,
    stress_nodes,
    von_mises,
)
from sidtool.formats.model import ModelFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import FRAMES
from sidtool.reduction.methods import REDUCTIONS
from sidtool.validate import check
from tests.codes import only

from ..beams import beam
from ..bodies import beam_data as beam_rod
from ..models import IGA, Q4, rod, rod_data

TOP = {
    "root": {"node": 1, "edge": "left", "at": 0.5},
    "tip": {"node": 2, "edge": "right", "at": 0.5},
    "top": {"node": 3, "edge": "top", "at": 0.5},
}
ROD_MARKERS = {
    "crank_pin": {"node": 1, "edge": "left", "at": 0.5},
    "piston_pin": {"node": 2, "edge": "right", "at": 0.5},
    "top": {"node": 3, "edge": "top", "at": 0.5},
}
TIP_LOAD = {"method": "attachment", "interfaces": ["tip"], "modes": 3}
MESHES = {
    "q4": {"type": "q4", "elements": [20, 2], "formulation": "incompatible_modes"},
    "iga": {"type": "iga", "degrees": [3, 2], "elements": [12, 1]},
}


def tip_loaded(sid: Any, force: float) -> np.ndarray:
    return np.linalg.solve(sid.Ke.m0, sid.node(2).phi.m0[1] * force)


def test_tip_loaded_cantilever() -> None:
    """sigma_xx = F (L - x) h / (2 I) on the upper edge, compressed by a lift."""
    model = beam(MESHES["iga"], markers=TOP, reduction=TIP_LOAD, stress={})
    sid = sid_from_model(model)
    height, inertia = 0.01, 0.01 * 0.01**3 / 12
    expected = -1e-3 * 0.5 * height / 2 / inertia
    sigma = node_stress(sid, 3, tip_loaded(sid, 1e-3))
    assert sigma[0] == pytest.approx(expected, rel=2e-3)
    assert np.abs(sigma[1:]).max() < 0.02 * abs(expected)


@pytest.mark.parametrize("mesh", MESHES)
def test_spanned_states_have_the_stress_of_the_full_model(mesh: str) -> None:
    """The static state is among the shape functions: equal to 1e-7."""
    model = beam(MESHES[mesh], markers=TOP, reduction=TIP_LOAD, stress={})
    sid, body = sid_from_model(model), finite_element_model(model)
    frame = FRAMES["tangent"](body, model.frame)
    load = body.marker("tip").displacement[1].T.toarray()
    full = constrained_space(body, frame).static(load)[:, 0]
    rows = stress_rows(body.marker("top").gradient, body.continua[0])
    expected = rows @ full
    found = node_stress(sid, 3, tip_loaded(sid, 1.0))
    assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_other_states_converge_with_the_shape_functions() -> None:
    """Modes alone: the static stress comes closer with their number."""
    errors = []
    for count in (2, 8, 32):
        modes = {"method": "modal", "modes": count}
        sid = sid_from_model(
            beam(MESHES["iga"], markers=TOP, reduction=modes, stress={})
        )
        exact = -1e-3 * 0.5 * 0.01 / 2 / (0.01 * 0.01**3 / 12)
        found = node_stress(sid, 3, tip_loaded(sid, 1e-3))[0]
        errors.append(abs(found / exact - 1))
    assert errors[0] > 2 * errors[1] > 4 * errors[2]
    assert errors[2] < 0.03


@pytest.mark.parametrize("discretisation", [Q4, IGA], ids=["q4", "iga"])
def test_stress_of_the_rod_under_a_load_that_modes_do_not_span_converges(
    discretisation: dict[str, Any],
) -> None:
    """A lift at the piston pin, half-way on the upper edge, against the full model."""
    model = rod(discretisation, markers=ROD_MARKERS, stress={})
    body = finite_element_model(model)
    frame = FRAMES["tangent"](body, model.frame)
    load = body.marker("piston_pin").displacement[1].T.toarray()
    full = stress_rows(body.marker("top").gradient, body.continua[0])
    full = full @ constrained_space(body, frame).static(load)[:, 0]
    errors = []
    for modes in (2, 8, 32):
        reduction = {"method": "modal", "modes": modes}
        sid = sid_from_model(model.with_({"reduction": reduction}))
        found = node_stress(sid, 3, tip_loaded(sid, 1.0))
        errors.append(np.abs(found - full).max() / np.abs(full).max())
    assert errors[0] > 4 * errors[1] > 16 * errors[2]
    assert errors[2] < 1e-3


@pytest.mark.parametrize("discretisation", [Q4, IGA], ids=["q4", "iga"])
def test_rod_stress_is_that_of_the_reconstructed_displacement(
    discretisation: dict[str, Any],
) -> None:
    """The slider-crank's rod in any state that its modes span."""
    model = rod(discretisation, stress={"peak_points": 20})
    sid, body = sid_from_model(model), finite_element_model(model)
    basis = REDUCTIONS["modal"](
        body, FRAMES["tangent"](body, model.frame), model.reduction
    )
    q = np.array([1e-3, -2e-5, 3e-6, 1e-6, -2e-7])
    u = basis.reconstruct(q)
    for marker in body.markers:
        full = stress_rows(marker.gradient, body.continua[0]) @ u
        found = node_stress(sid, marker.node, q)
        assert_allclose(found, full, atol=1e-9 * np.abs(full).max())
    assert [c.id for c in check(sid) if c.failed] == []


def test_peak_points_find_the_peak_of_the_body() -> None:
    """Over random states, the peak over the chosen nodes is that over all points."""
    model = rod(Q4)
    body = finite_element_model(model)
    basis = REDUCTIONS["modal"](
        body, FRAMES["tangent"](body, model.frame), model.reduction
    )
    everywhere = peak_points(body, basis, 10_000)
    few = peak_points(body, basis, 30)
    random = np.random.default_rng(5).standard_normal((200, 5))
    states = random / np.sqrt(np.diag(basis.stiffness))
    peaks = [
        np.max([von_mises(states @ p.sigma.T) for p in points], axis=0)
        for points in (few, everywhere)
    ]
    assert (peaks[0] >= 0.9 * peaks[1]).all()
    assert len(few) == 30


@pytest.mark.parametrize("mesh", ["iga", "q4"])
def test_peak_points_hold_few_points_of_quadrature(
    mesh: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of them were held: 0.43 for 0.31 GB with 4 000 unknowns of a volume."""
    alive: WeakSet[QuadraturePart] = WeakSet()
    most = []

    def told(body: FiniteElementModel, points: int) -> Iterator[QuadraturePart]:
        for part in quadrature_parts(body, points=20):
            alive.add(part)
            most.append(sum(len(held.weights) for held in alive))
            yield part

    model = rod(IGA if mesh == "iga" else Q4)
    body = finite_element_model(model)
    basis = REDUCTIONS["modal"](
        body, FRAMES["tangent"](body, model.frame), model.reduction
    )
    expected = [point.position for point in peak_points(body, basis, 8)]
    monkeypatch.setattr("sidtool.conversion.stress_recovery.quadrature_parts", told)
    found = peak_points(body, basis, 8)
    assert_allclose([point.position for point in found], expected)
    assert len(most) > 8 and max(most) < 120


def test_peak_stress_and_files(tmp_path: Any) -> None:
    model = rod(IGA, stress={"peak_points": 5, "first_node": 500})
    sid = sid_from_model(model)
    assert stress_nodes(sid) == ("1", "2", "500", "501", "502", "503", "504")
    q = np.array([[1e-3, 0, 0, 0, 0], [0, 0, 0, 0, 0]])
    peak = peak_stress(sid, q)
    assert peak[0] > 1e6 and peak[1] == 0
    write_sid(tmp_path / "rod.SID_FEM", sid)
    back = read_sid(tmp_path / "rod.SID_FEM")
    assert_allclose(peak_stress(back, q), peak, rtol=1e-10)


def test_prestress_is_the_constant_part() -> None:
    pull = {"prestress": {"forces": {"tip": [2.0, 0.0]}}}
    model = beam(MESHES["iga"], markers=TOP, stiffening=pull, stress={})
    sid = sid_from_model(model)
    assert_allclose(sid.node(3).sigma.m0[0, 0], 2.0 / 1e-4, rtol=1e-3)


def test_plane_strain_has_a_transverse_stress() -> None:
    settings = {**Q4, "state": "plane_strain"}
    sid = sid_from_model(rod(settings, stress={}))
    sigma = node_stress(sid, 2, [0, 0, 0, 0, 1e-3])
    assert_allclose(sigma[2], 0.3 * (sigma[0] + sigma[1]), rtol=1e-9)


def test_von_mises() -> None:
    assert von_mises([3.0, 0, 0, 0, 0, 0]) == pytest.approx(3)
    assert von_mises([0, 0, 0, 2.0, 0, 0]) == pytest.approx(2 * np.sqrt(3))
    assert von_mises([5.0, 5, 5, 0, 0, 0]) == 0


def test_stress_that_is_not_there_is_refused() -> None:
    sid = sid_from_model(rod(Q4))
    with pytest.raises(InputError, match="node 2 carries no stress"):
        node_stress(sid, 2, np.zeros(5))
    with pytest.raises(InputError, match=r"expected a body .* a table \[stress\]"):
        peak_stress(sid, np.zeros(5))
    clash = {"peak_points": 3, "first_node": 1}
    with pytest.raises(InputError, match="stress.first_node"):
        sid_from_model(rod(Q4, stress=clash))


def test_prestress_in_plane_strain_is_triaxial() -> None:
    """sigma_zz = nu (sigma_xx + sigma_yy), given as uniform stress or by a force."""
    nu, stress = 0.3, (5.0e6, -2.0e6, 1.0e6)
    mesh = {"type": "q4", "elements": [8, 2]}
    for state, ratio in (("plane_strain", nu), ("plane_stress", 0.0)):
        data = rod_data({**mesh, "state": state})
        data["stress"] = {"peak_points": 2}
        data["stiffening"] = {"prestress": {"stress": list(stress)}}
        sid = sid_from_model(validate_data(data, ModelFile))
        stresses = [node.sigma.m0[:, 0] for node in sid.nodes if node.sigma is not None]
        assert len(stresses) == 4
        for sigma in stresses:
            assert_allclose(sigma[[0, 1, 3]], stress, rtol=1e-12)
            assert sigma[2] == pytest.approx(ratio * (stress[0] + stress[1]), abs=1e-3)


def test_stress_that_is_not_known_is_refused() -> None:
    """Not left out without a word: where all markers are tied."""
    data = rod_data({"type": "q4", "elements": [8, 2]})
    data["stress"] = {"peak_points": 0}
    for marker in data["markers"].values():
        marker["tie"] = {"type": "distributing", "to": marker.pop("edge")}
        del marker["at"]
    data["frame"] = {"type": "buckens"}
    with pytest.raises(InputError, match="stress: has no stress: markers are"):
        sid_from_model(validate_data(data, ModelFile))


REFUSED = [
    ({"stress": {"peak_points": 2, "first_node": 1}}, "stress.first_node"),
    ({"stress": {"markers": ["piston_pin"]}}, "stress.markers: there is no stress at"),
    ({"stress": {"markers": [], "peak_points": 0}}, "stress: has no stress"),
    ({"stiffening": {"prestress": {"stress": [1.0]}}}, "prestress.stress: has 1"),
    (
        {
            "frame": {"type": "buckens"},
            "stiffening": {"prestress": {"forces": {"piston_pin": [1.0, 0.0]}}},
        },
        "stiffening.prestress: the forces and moments are not in balance",
    ),
]


@pytest.mark.parametrize(("tables", "message"), REFUSED)
def test_unavailable_outputs_are_refused_before_anything_is_solved(
    tables: dict[str, Any], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However large the mesh is: no equations are solved, no modes computed."""

    def solved(*_: Any) -> None:
        raise AssertionError("equations were solved first")

    monkeypatch.setitem(REDUCTIONS, "modal", solved)
    data = rod_data({"type": "q4", "elements": [8, 2]}) | tables
    pin = data["markers"]["piston_pin"]
    pin["tie"] = {"type": "distributing", "to": pin.pop("edge")}
    del pin["at"]
    with pytest.raises(InputError, match=re.escape(message)):
        sid_from_model(validate_data(data, ModelFile))


def test_bodies_that_know_no_stress_are_refused_when_the_file_is_read() -> None:
    """Before a deck is discretised by another program, or a matrix is read."""
    beam = beam_rod({"type": "beam", "elements": 4}, 3)
    deck = rod_data({"type": "mesh"})
    deck["geometry"] = {"type": "mesh", "file": "no.inp", "engine": "calculix"}
    uniform = {"stiffening": {"prestress": {"stress": [1.0, 0.0, 0.0]}}}
    for data in (
        beam | uniform,
        deck | {"stress": {}},
        deck | {"stiffening": {}},
    ):
        with pytest.raises(InputError, match="there is no (uniform )?stress in"):
            validate_data(data, ModelFile)


def test_markers_without_stress_are_noted() -> None:
    data = rod_data({"type": "q4", "elements": [8, 2]}) | {"stress": {}}
    pin = data["markers"]["piston_pin"]
    pin["tie"] = {"type": "distributing", "to": pin.pop("edge")}
    del pin["at"]
    sid = sid_from_model(validate_data(data, ModelFile))
    assert only(sid, "N171").data["markers"] == ("piston_pin",)
    assert [node.sigma is not None for node in sid.nodes][:2] == [True, False]


def bent_bar(discretisation: dict[str, Any], volume: bool) -> ModelFile:
    """A clamped bar without contraction, 1 m long, with a square section of 0.05 m."""
    h = 0.025
    corners = [[[x, y] for y in (-h, h)] for x in (0.0, 1.0)]
    if volume:
        corners = [[[[*p, z] for z in (-h, h)] for p in row] for row in corners]
    d = 3 if volume else 2
    geometry: dict[str, Any] = {
        "type": "nurbs_volume" if volume else "nurbs",
        "degrees": [1] * d,
        "knots": [[0, 0, 1, 1]] * d,
        "control_points": corners,
    }
    if not volume:
        geometry["thickness"] = 2 * h
    root = {"node": 1, "edge": "left", "at": [0.5, 0.5] if volume else 0.5}
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": 2e11, "poissons_ratio": 0.0, "density": 7850.0},
        "geometry": geometry,
        "discretisation": discretisation,
        "frame": {"type": "tangent", "marker": "root", "clamp": "left"},
        "markers": {
            "root": root,
            "tip": {"node": 2, "tie": {"type": "distributing", "to": "right"}},
        },
        "reduction": {
            "method": "attachment",
            "interfaces": ["tip"],
            "modes": 0,
            "inertia_relief": False,
        },
        "stress": {"markers": [], "peak_points": 10},
    }
    return validate_data(data, ModelFile)


@pytest.mark.parametrize(
    "discretisation",
    [
        {"type": "q4", "elements": [8, 1]},
        {"type": "q4", "elements": [16, 2]},
        {"type": "iga", "degrees": [2, 2], "elements": [4, 1]},
        {"type": "iga", "degrees": [3, 2], "elements": [4, 2]},
        {"type": "hex20", "elements": [6, 1, 1]},
        {"type": "tet10", "elements": [8, 1, 1]},
        {"type": "iga", "degrees": [2, 2, 2], "elements": [4, 1, 1]},
    ],
    ids=lambda x: f"{x['type']}-{len(x['elements'])}-{x['elements'][1]}",
)
def test_peak_of_pure_bending_is_that_of_the_surface(
    discretisation: dict[str, Any],
) -> None:
    """It is M / W, on the upper or lower side. Points inside elements had 0.577 of it
    with one q4 in the height, 0.775 with hex20 and IGA."""
    d = len(discretisation["elements"])
    sid = sid_from_model(bent_bar(discretisation, volume=d == 3))
    moment, modulus = 1000.0, 0.05**3 / 6
    q = np.linalg.solve(sid.Ke.m0, sid.node(2).psi.m0[2] * moment)
    assert peak_stress(sid, q[None])[0] == pytest.approx(moment / modulus, rel=1e-6)
    stressed = [node for node in sid.nodes if node.sigma is not None]
    best = max(stressed, key=lambda node: abs(node_stress(sid, int(node.id), q)[0]))
    place = best.origin.m0[:, 0]
    assert abs(place[1]) == pytest.approx(0.025, rel=1e-9)
    # Of the line u = -y w'(x): rotation M x / (E I), no shift along the middle.
    turned = moment * place[0] / (2e11 * 0.05**4 / 12)
    assert best.psi.m0[2] @ q == pytest.approx(turned, rel=1e-6, abs=1e-12)
    moved = best.phi.m0 @ q
    assert moved[0] == pytest.approx(-place[1] * turned, rel=1e-6, abs=1e-15)


def test_peak_points_carry_the_stress_of_the_undeformed_body() -> None:
    """At nodes as at points inside: that of a tension."""
    data = bent_bar({"type": "q4", "elements": [8, 1]}, volume=False)
    pull = {"prestress": {"forces": {"tip": [2.0, 0.0]}}}
    table = data.model_dump(exclude_unset=True) | {"stiffening": pull}
    sid = sid_from_model(validate_data(table, ModelFile))
    stresses = [node.sigma for node in sid.nodes if node.sigma is not None]
    assert stresses
    for sigma in stresses:
        assert_allclose(sigma.m0[:, 0], [2.0 / 0.05**2, 0, 0, 0, 0, 0], atol=1e-6)
