"""Static answers and modes of constrained bodies from the factors of the body alone."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigh, null_space

from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.reduction.admissible_space import (
    AdmissibleSpace,
    PinnedFactors,
    constrained_space,
)
from sidtool.reduction.body_frames import FRAMES, Frame, motion_rows
from sidtool.reduction.methods import attachment_modes

from ..beams import IGA, beam
from ..bodies import volume_data
from ..models import rod_data

Q4 = {"type": "q4", "elements": [40, 4], "state": "plane_stress"}
HEX = {"type": "hex8", "elements": [14, 2, 1]}


def free(data: dict) -> tuple:
    body = finite_element_model(validate_data(data, ModelFile))
    return body, constrained_space(body, Frame(np.zeros(3), np.zeros(body.ndof, bool)))


@pytest.mark.parametrize("data", [rod_data(Q4), volume_data(HEX)], ids=["q4", "hex8"])
@pytest.mark.parametrize(
    ("names", "rotations"),
    [
        (("crank_pin", "piston_pin"), True),
        (("crank_pin",), True),
        (("crank_pin", "piston_pin"), False),
        (("crank_pin",), False),
    ],
    ids=["two", "one", "two pins", "one pin"],
)
def test_dense_algebra_agrees(
    data: dict, names: tuple[str, ...], rotations: bool
) -> None:
    """The saddle problem in full; what rigid motion is left is balanced."""
    body, space = free(data)
    rows = np.vstack(
        [motion_rows(body, body.marker(n), rotations=rotations) for n in names]
    )
    inner = space.with_constraints(rows)
    stiffness, mass = body.stiffness.toarray(), body.mass.toarray()
    rng = np.random.default_rng(len(rows))
    loads = rng.normal(size=(body.ndof, 2))
    c = inner.constraints
    inside = null_space(c)
    small_k, small_m = (inside.T @ a @ inside for a in (stiffness, mass))
    values, vectors = eigh(small_k, small_m)
    left = inner.rigid.shape[1]
    assert (
        values[left] > 1e-7 * values[left + 5]
        and (np.abs(values[:left]) < 1e-6 * values[left]).all()
    )
    elastic = inside @ vectors[:, left:]
    expected = elastic @ ((elastic.T @ loads) / values[left:, None])
    found = inner.static(loads)
    assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())
    squares, _ = inner.modes(6)
    assert_allclose(squares, values[left : left + 6], rtol=1e-7)
    gaps = rng.normal(size=(len(c), 2))
    moved = inner.static(np.zeros_like(loads), gaps)
    assert_allclose(c @ moved, gaps, atol=1e-9 * np.abs(gaps).max())
    rest = elastic.T @ (stiffness @ moved)
    assert np.abs(rest).max() < 1e-7 * np.abs(elastic.T @ stiffness @ elastic).max()


def test_loads_of_known_conditions_need_no_solution_and_factors_are_freed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Responses to loads at interfaces were computed twice, and factors outlived the
    space until the garbage collector ran."""
    body, outer = free(rod_data(Q4))
    held = motion_rows(body, body.marker("crank_pin"), rotations=True)
    outer = outer.with_constraints(held)
    rows = motion_rows(body, body.marker("piston_pin"), rotations=True)
    loads = np.hstack([np.ones((body.ndof, 1)), 3.0 * rows.T])
    expected = outer.static(loads)
    outer.with_constraints(rows).static(loads[:, :0])
    solved, solve = list[int](), PinnedFactors.solve

    def counted(factors: PinnedFactors, load: Any) -> Any:
        solved.append(load.shape[1])
        return solve(factors, load)

    monkeypatch.setattr(PinnedFactors, "solve", counted)
    found = outer.static(loads)
    assert solved == [1]
    assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    factors = weakref.ref(outer.factors)
    monkeypatch.undo()
    gc.disable()
    try:
        del outer
        assert factors() is None
    finally:
        gc.enable()


@pytest.mark.parametrize("frame", ["tangent", "buckens"])
@pytest.mark.parametrize("method", ["craig_bampton", "herting", "attachment"])
def test_a_body_is_factored_once(
    method: str, frame: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It held two factorisations at once, and sought the modes of one space twice."""
    searched, search = [], AdmissibleSpace._lowest_modes

    def counted(space: AdmissibleSpace, *given: Any) -> tuple:
        searched.append(space)  # kept, so that no other one gets its identity
        return search(space, *given)

    monkeypatch.setattr(AdmissibleSpace, "_lowest_modes", counted)
    interfaces = ["piston_pin"] if frame == "tangent" else ["crank_pin", "piston_pin"]
    settings = {"method": method, "modes": 4, "interfaces": interfaces}
    data = rod_data(Q4, reduction=settings)
    if frame == "buckens":
        data["frame"] = {"type": "buckens"}
    notes: list[str] = []
    sid_from_model(validate_data(data, ModelFile), notes.append)
    assert len([text for text in notes if text.startswith("factorising")]) == 1
    assert searched and len(searched) == len({id(space) for space in searched})


def test_a_centrifugal_mode_is_the_stretch_of_a_bar_that_turns() -> None:
    """u(L) = rho w^2 L^3 / 3 E at the tip of a bar that turns about its root."""
    reduction = {
        "method": "attachment",
        "interfaces": ["root"],
        "inertia_relief": False,
        "centrifugal": True,
    }
    model = beam(IGA, reduction=reduction)
    body = finite_element_model(model)
    frame = FRAMES["tangent"](body, model.frame)
    basis = attachment_modes(body, frame, model.reduction)
    arms = np.zeros(body.ndof)
    arms[body.table[:, 0]] = body.positions[:, 0]
    load = basis.shapes.T @ (body.mass @ arms)
    u = basis.reconstruct(np.linalg.solve(basis.stiffness, load))
    material = model.material
    stretch = material.density / (3.0 * material.youngs_modulus)
    assert_allclose((body.marker("tip").displacement @ u)[0], stretch, rtol=1e-4)


def test_fields_of_turning_bodies_hold_centripetal_accelerations() -> None:
    body = finite_element_model(validate_data(volume_data(HEX), ModelFile))
    origin, spin = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, -3.0])
    found = np.zeros(body.ndof)
    arms = body.positions - origin
    found[body.table[:, :3]] = np.cross(spin, np.cross(spin, arms))
    fields = body.linear_fields(origin)
    parts = np.linalg.lstsq(fields, found, rcond=None)[0]
    assert_allclose(fields @ parts, found, atol=1e-12)
