"""Markers: rows that evaluate position, displacement and rotation at a point."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.pipeline.model_to_sid import finite_element_model

from ..models import DISCRETISATIONS, annulus, rod

PLACES: dict[str, Any] = {
    "corner": {"node": 1, "edge": "left", "at": 0.0},
    "side": {"node": 2, "edge": "top", "at": 0.37},
    "inside": {"node": 3, "parameters": [0.5, 0.5]},
    "found": {"node": 4, "position": [0.31, 0.007]},
}


@pytest.fixture(params=DISCRETISATIONS)
def body(request: pytest.FixtureRequest) -> FiniteElementModel:
    frame = {"type": "tangent", "marker": "corner", "clamp": "left"}
    settings = DISCRETISATIONS[request.param]
    return finite_element_model(rod(settings, markers=PLACES, frame=frame))


def test_positions_are_where_the_markers_are(body: FiniteElementModel) -> None:
    assert_allclose(body.marker("corner").position, [0, -0.03, 0], atol=1e-15)
    assert_allclose(body.marker("inside").position, [0.5, 0, 0], atol=1e-15)
    found = body.marker("found").position
    assert_allclose(found[:2], [0.31, 0.007], atol=2e-5)
    half_height = 0.06 * ((0.37 - 0.5) ** 2 + 0.25)
    assert_allclose(body.marker("side").position, [0.37, half_height, 0], atol=4e-5)


@pytest.mark.parametrize("name", PLACES)
def test_a_linear_displacement_is_evaluated_exactly(
    body: FiniteElementModel, name: str
) -> None:
    gradient = np.array([[0.3, -0.7], [1.1, 0.2]])
    u = (body.positions @ gradient.T + [5, -6]).ravel()
    marker = body.marker(name)
    expected = np.append(gradient @ marker.position[:2] + [5, -6], 0)
    assert_allclose(marker.displacement @ u, expected, rtol=1e-13)
    turn = (gradient[1, 0] - gradient[0, 1]) / 2
    assert_allclose(marker.rotation @ u, [0, 0, turn], rtol=1e-10, atol=1e-12)


def test_rotation_is_the_mean_of_the_elements_that_meet(
    body: FiniteElementModel,
) -> None:
    """Symmetric about the axis: no rotation there, whatever each side says."""
    _, y = body.positions.T
    u = np.stack([np.zeros_like(y), np.zeros_like(y)], axis=1)
    u[:, 0] = y**2
    assert_allclose(body.marker("inside").rotation @ u.ravel(), 0, atol=1e-12)


def test_edges_are_named_sets_of_nodes() -> None:
    body = finite_element_model(annulus(DISCRETISATIONS["iga"] | {"degrees": [1, 2]}))
    assert_allclose(body.positions[body.node_sets["foot"]][:, 1], 0, atol=1e-15)
    assert set(body.node_sets) == {"left", "right", "bottom", "top", "foot", "inner"}
    assert (body.node_sets["inner"] == body.node_sets["left"]).all()


@pytest.mark.parametrize(
    ("marker", "message"),
    [
        ({"node": 9, "position": [0.5, 0.02]}, r"markers.odd: .* outside the geometry"),
        ({"node": 9, "position": [-0.1, 0.0]}, r"markers.odd: .* outside the geometry"),
    ],
)
def test_a_marker_outside_is_refused(marker: dict, message: str) -> None:
    frame = {"type": "tangent", "marker": "corner", "clamp": "left"}
    model = rod(markers=PLACES | {"odd": marker}, frame=frame)
    with pytest.raises(InputError, match=message):
        finite_element_model(model)
