"""Shape functions do not depend on rounding, and so not on the processor."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

from sidtool.discretisation.registry import finite_element_model
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.extremes import first_largest
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.reduction.body_frames import FRAMES
from sidtool.reduction.methods import REDUCTIONS

from ..models import Q4, rod_data

#: Both pins of the rod hold the frame: two of the four loads there act on supports.
CHORD: dict[str, Any] = {
    "frame": {"type": "chord", "markers": ["crank_pin", "piston_pin"]},
    "reduction": {
        "method": "attachment",
        "interfaces": ["crank_pin", "piston_pin"],
        "rotations": False,
        "modes": 4,
    },
}
SIDE = 0.02


def square_part(length: float, counts: list[int]) -> dict[str, Any]:
    """A bar or plate along x and y or z whose free modes come in pairs."""
    data = rod_data({"type": "hex8", "elements": counts})
    low, high = -0.5, 0.5
    data["geometry"] = {
        "type": "nurbs_volume",
        "degrees": [1, 1, 1],
        "knots": [[0, 0, 1, 1]] * 3,
        "control_points": [
            [[[x, y, z] for z in (low * SIDE, high * SIDE)] for y in (low, high)]
            for x in (low * length, high * length)
        ],
    }
    data["markers"] = {
        "first": {"node": 1, "edge": "left", "at": [0.5, 0.5]},
        "second": {"node": 2, "edge": "right", "at": [0.5, 0.5]},
    }
    data["frame"] = {"type": "buckens"}
    data["reduction"] = {"method": "modal", "modes": 9}
    return dict(data)


def perturbed(body: FiniteElementModel, seed: int) -> FiniteElementModel:
    """The body with another rounding of its stiffness matrix."""
    random = np.random.default_rng(seed)
    upper = sp.triu(body.stiffness, format="csr")
    upper.data *= 1.0 + 4e-16 * random.integers(-1, 2, len(upper.data))
    whole = upper + sp.triu(upper, 1).T
    return replace(body, stiffness=sp.csr_matrix(whole))


@pytest.mark.parametrize(
    "data",
    [rod_data(Q4, **CHORD), square_part(1.0, [6, 6, 1])],
    ids=["loads on supports", "pairs of plate modes"],
)
def test_another_rounding_of_the_stiffness_gives_the_same_basis(
    data: dict[str, Any],
) -> None:
    model = validate_data(data, ModelFile)
    body = finite_element_model(model)
    found = []
    for seed in range(4):
        other = perturbed(body, seed) if seed else body
        frame = FRAMES[model.frame.type](other, model.frame)
        basis = REDUCTIONS[model.reduction.method](other, frame, model.reduction)
        motions = [marker.displacement @ basis.shapes for marker in body.markers]
        found.append((basis.frequencies, np.array(motions)))
    for frequencies, motions in found[1:]:
        assert_allclose(frequencies, found[0][0], rtol=1e-8)
        assert_allclose(motions, found[0][1], atol=1e-6 * np.abs(found[0][1]).max())


def test_the_first_of_equal_numbers_is_their_largest() -> None:
    assert first_largest([1.0, 3.0, 3.0 + 1e-12]) == 1
    assert first_largest([1.0, 3.0, 3.1]) == 2
    assert list(first_largest(np.array([[2.0, 1.0], [2.0 + 1e-13, 5.0]]), axis=0)) == [
        0,
        1,
    ]
