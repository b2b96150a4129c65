"""A pin stays where the geometry has it, whatever mesh samples the part."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.model import ModelFile
from sidtool.pipeline.model_to_sid import finite_element_model
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import FRAMES
from tests.metamorphic.parts.meshes import quarter_ring

RELIEVED = {"formulation": "incompatible_modes"}
SOLIDS: dict[str, dict[str, Any]] = {
    "iga": {"type": "iga", "degrees": [3, 3, 2], "elements": [2, 5, 1]},
    "hex8": {"type": "hex8", "elements": [3, 8, 1], **RELIEVED},
    "hex20": {"type": "hex20", "elements": [2, 5, 1]},
    "tet4": {"type": "tet4", "elements": [4, 8, 1]},
    "tet10": {"type": "tet10", "elements": [2, 5, 1]},
}
PLANE: dict[str, dict[str, Any]] = {
    "iga": {"type": "iga", "degrees": [3, 3], "elements": [2, 5]},
    "q4": {"type": "q4", "elements": [3, 8], **RELIEVED},
}


def pins(*behind: float) -> dict[str, Any]:
    """On the convex and on the concave face, between nodes, and inside."""
    angles = {
        "outer": ("right", 0.37),
        "middle": ("right", 0.5),
        "bore": ("left", 0.63),
    }
    result: dict[str, Any] = {
        name: {"node": n, "edge": edge, "at": [t, *behind] if behind else t}
        for n, (name, (edge, t)) in enumerate(angles.items(), 2)
    }
    place = [1.3 * np.cos(0.9), 1.3 * np.sin(0.9), *(0.2 * b for b in behind)]
    return result | {"inside": {"node": 9, "position": place}}


def models(radius: float = 1.6) -> dict[str, tuple[ModelFile, str]]:
    """With the name of the one that is exact."""
    result = {}
    for name, settings in SOLIDS.items():
        model = quarter_ring(settings, 1.0, radius, 0.2, markers=pins(0.3))
        result[f"solid {name}"] = (model, "solid iga")
    for name, settings in PLANE.items():
        model = quarter_ring(settings, 1.0, radius, markers=pins())
        result[f"plane {name}"] = (model, "plane iga")
    return result


MODELS = models()


@cache
def sagging(name: str) -> tuple[FiniteElementModel, np.ndarray]:
    """A part, and its displacement (ndof, 1) under gravity along y."""
    model, _ = MODELS[name]
    body = finite_element_model(model)
    frame = FRAMES["tangent"](body, model.frame)
    rigid = body.rigid_body_modes()
    result: np.ndarray = constrained_space(body, frame).static(
        -body.mass @ rigid[:, [1]]
    )
    return body, result


@pytest.mark.parametrize("name", MODELS)
def test_pins_stay_when_the_mesh_is_exchanged(name: str) -> None:
    """They jumped to the nearest node: 0.17 m on a ring of radius 1.6."""
    body, sag = sagging(name)
    reference, right = sagging(MODELS[name][1])
    rigid = body.rigid_body_modes()
    tolerance = 0.4 if "tet4" in name else 0.05
    for marker in body.markers:
        twin = reference.marker(marker.name)
        assert_allclose(marker.position, twin.position, atol=1e-9)
        x, y, z = marker.position
        arm = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
        expected = np.hstack([np.eye(3), arm])
        if body.dimension == 2:
            expected = np.where([[1], [1], [0]], expected[:, [0, 1, 5]], 0)
        assert_allclose(marker.displacement @ rigid, expected, atol=1e-9)
        moved, there = marker.displacement @ sag, twin.displacement @ right
        off = np.linalg.norm(moved - there)
        assert off < tolerance * np.abs(right).max(), marker.name
