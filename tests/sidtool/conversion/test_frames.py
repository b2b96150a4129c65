"""Body frames from the model: what vanishes, what does not depend on them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.motion_kinds import check_moves, dead_nodes
from sidtool.formats.sid_mass import free_modal_mass
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.reduction.body_frames import FRAMES, mass_and_centre
from sidtool.report.sid import describe_sid, frame_kind_of, natural_modes
from sidtool.validate import check
from tests.steel_bars import bar_data

from ..models import DISCRETISATIONS, Q4, rod

PINS = ["crank_pin", "piston_pin"]
FREE: dict[str, dict[str, Any]] = {
    "crank pin": {"type": "tangent", "marker": "crank_pin"},
    "piston pin": {"type": "tangent", "marker": "piston_pin"},
    "chord": {"type": "chord", "markers": PINS},
    "back": {"type": "chord", "markers": PINS[::-1]},
    "buckens": {"type": "buckens"},
    "buckens at a pin": {"type": "buckens", "marker": "crank_pin"},
}


@cache
def converted(frame: str, kind: str = "q4") -> SID:
    modes = {"method": "modal", "modes": 4}
    model = rod(DISCRETISATIONS[kind], frame=FREE[frame], reduction=modes)
    return sid_from_model(model)


@cache
def discretised() -> FiniteElementModel:
    return finite_element_model(rod(Q4))


@pytest.mark.parametrize("kind", ["q4", "iga"])
@pytest.mark.parametrize("frame", FREE)
def test_all_checks_pass(frame: str, kind: str) -> None:
    sid = converted(frame, kind)
    assert [(c.id, c.measured) for c in check(sid) if c.failed] == []


@pytest.mark.parametrize("frame", [n for n in FREE if FREE[n]["type"] != "chord"])
def test_free_modes_have_the_frequencies_of_the_free_body(frame: str) -> None:
    """The same modes in every frame: the coupled system has the same frequencies."""
    body = discretised()
    exact = scipy.linalg.eigvalsh(
        body.stiffness.toarray(), body.mass.toarray(), subset_by_index=[3, 6]
    )
    sid = converted(frame)
    found = scipy.linalg.eigvalsh(sid.Ke.m0, free_modal_mass(sid))
    assert_allclose(found, exact, rtol=1e-6)


@pytest.mark.parametrize("frame", ["chord", "back"])
def test_modes_in_a_chord_frame_are_those_between_two_pins(frame: str) -> None:
    """Dense algebra with one end held and the other one free along the chord. The free
    modes had the third of these 3.5 % too high."""
    body, model = discretised(), rod(Q4, frame=FREE[frame])
    ways = scipy.linalg.null_space(FRAMES["chord"](body, model.frame).rows)
    k, m = (ways.T @ (a @ ways) for a in (body.stiffness, body.mass))
    exact = scipy.linalg.eigvalsh(k, m, subset_by_index=[0, 3])
    sid = converted(frame)
    assert_allclose(scipy.linalg.eigvalsh(sid.Ke.m0, sid.Me.m0), exact, rtol=1e-6)


@pytest.mark.parametrize("method", ["attachment", "craig_bampton", "herting"])
def test_a_shaft_between_bearings_has_the_compliance_of_its_middle(method: str) -> None:
    """L^3 / 48 E I and shear, and the first three frequencies (k pi / L)^2."""
    frame = {"type": "chord", "markers": ["root", "tip"]}
    more = {"method": method, "interfaces": ["root", "tip", "middle"], "modes": 12}
    data = bar_data(frame=frame, reduction=more)
    data["markers"]["middle"] = {"node": 3, "parameters": [0.5]}
    sid = sid_from_model(validate_data(data, ModelFile))
    across = sid.node(3).phi.m0[1]
    found = across @ np.linalg.solve(sid.Ke.m0, across)
    bending = 2.1e11 * 0.02**4 / 12.0
    assert found == pytest.approx(1.0 / (48.0 * bending), rel=3e-3)
    squares = scipy.linalg.eigvalsh(sid.Ke.m0, sid.Me.m0)
    per_length = 7850.0 * 0.02**2
    for k, square in zip((1, 2, 3), squares[:6:2], strict=True):
        pinned = (k * np.pi) ** 4 * bending / per_length
        assert square == pytest.approx(pinned, rel=5e-3)


def test_what_vanishes_where() -> None:
    tangent = converted("piston pin").node(2)
    assert_allclose(tangent.phi.m0, 0, atol=1e-12)
    assert_allclose(tangent.psi.m0, 0, atol=1e-10)
    assert_allclose(tangent.position, 0, atol=1e-12)
    chord = converted("chord")
    assert_allclose(chord.node(1).phi.m0, 0, atol=1e-12)
    assert_allclose(chord.node(2).phi.m0[1], 0, atol=1e-12)
    assert np.abs(chord.node(1).psi.m0).max() > 0.1
    mean = converted("buckens")
    for block in (mean.Ct.m0, mean.Cr.m0, mean.mdCM.m0, mean.mdCM.m1):
        assert_allclose(block, 0, atol=1e-12)
    at_pin = converted("buckens at a pin")
    assert_allclose(at_pin.node(1).position, 0, atol=1e-15)
    assert_allclose(at_pin.Cr.m0, 0, atol=1e-12)


def test_mass_and_centre() -> None:
    mass, centre = mass_and_centre(discretised())
    assert mass == pytest.approx(3.14, rel=2e-3)
    assert_allclose(centre, [0.5, 0, 0], atol=1e-12)


def test_frames_are_found_by_their_names() -> None:
    assert frame_kind_of(converted("chord")) == "chord frame between nodes 1 and 2"
    assert frame_kind_of(converted("buckens")).startswith("mean axes")
    assert frame_kind_of(converted("piston pin")).startswith(
        "tangent frame, fixed to node 2"
    )
    kinds = [mode.kind for mode in natural_modes(converted("chord"))]
    assert kinds == ["bending y"] * 3 + ["axial x"]
    shares = [mode.contribution for mode in natural_modes(converted("chord"))]
    assert sum(shares) == pytest.approx(1)
    text = describe_sid(converted("chord"))
    assert "boundary" in text and "share %" in text


def test_frames_that_cannot_be_are_refused() -> None:
    same = {"type": "chord", "markers": ["crank_pin", "crank_pin"]}
    model = rod(Q4, frame=same)
    with pytest.raises(InputError, match="frame.markers: .* at the same place"):
        FRAMES["chord"](finite_element_model(model), model.frame)
    with pytest.raises(InputError, match="frame.marker: there is no marker 'hub'"):
        rod(Q4, frame={"type": "buckens", "marker": "hub"})


def test_nodes_where_all_modes_vanish_are_named() -> None:
    """Modes of the rod clamped at both ends: a force at the piston pin does nothing."""
    both = {"method": "modal", "modes": 3, "fix": "right"}
    sid = sid_from_model(rod(Q4, reduction=both))
    assert dead_nodes(sid) == ("2",)
    with pytest.raises(InputError, match="the force push acts on node 2 of rod, where"):
        check_moves(sid, 2, "the force push", "rod")
    check_moves(sid, 1, "the joint crank")
    assert dead_nodes(sid_from_model(rod(Q4))) == ()
