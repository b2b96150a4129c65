"""Mass and centre beside those of the geometry: exact weights, telling meshes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.elements.mass_properties import geometry_mass_notes, mesh_moments
from sidtool.elements.solid_mesh import mesh_matrices
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.geometry.nurbs_patch import patch_from_model
from sidtool.geometry.patch_evaluation import patch_moments
from sidtool.mesh.reference_elements import ELEMENT_KINDS
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from tests.codes import with_code
from tests.metamorphic.parts.meshes import (
    STEEL,
    block,
    dimension,
    quarter_ring,
    ring,
    state,
    turned,
)

from ..models import rod_data


def reweighted(model: ModelFile, ratio: float, along: int) -> ModelFile:
    """The same shape run through at another speed: weights in a geometric series."""
    weights = np.array(model.geometry.weights)
    series = ratio ** np.linspace(0, 1, weights.shape[along])
    shape = [-1 if i == along else 1 for i in range(weights.ndim)]
    weights = weights * series.reshape(shape)
    geometry = model.geometry.model_copy(update={"weights": weights.tolist()})
    return model.model_copy(update={"geometry": geometry})


@pytest.mark.parametrize(
    ("ratio", "along"),
    [(1.0, 0), (100.0, 0), (100.0, 1), (0.02, 0), (0.02, 1)],
)
@pytest.mark.parametrize("width", [None, 0.3])
def test_mass_of_a_ring_whatever_its_weights(
    ratio: float, along: int, width: float | None
) -> None:
    """7 % of the mass was missing at a ratio of 100."""
    settings = {"type": "iga", "degrees": [2, 2], "elements": [2, 1]}
    if width:
        settings = {"type": "iga", "degrees": [2, 2, 1], "elements": [1, 2, 1]}
    model = reweighted(quarter_ring(settings, 1.0, 1.6, width), ratio, along)
    body = finite_element_model(model)
    assert model.material is not None
    area, thick = np.pi / 4 * (1.6**2 - 1), width or 0.1
    mass = model.material.density * area * thick
    assert body.scalar_mass is not None
    weights = np.asarray(body.scalar_mass.sum(axis=0)).ravel()
    assert weights.sum() == pytest.approx(mass, rel=1e-9)
    centre = (1.6**3 - 1) / 3 / area
    found = (weights @ body.positions / weights.sum())[:2]
    assert_allclose(found, centre, rtol=1e-9)
    second = body.positions.T @ body.scalar_mass @ body.positions
    polar = model.material.density * thick * np.pi / 8 * (1.6**4 - 1)
    assert second[0, 0] + second[1, 1] == pytest.approx(polar, rel=1e-9)
    assert geometry_mass_notes(body) == ()


def test_moments_of_a_patch_from_its_sides() -> None:
    for width in (None, 0.3):
        settings: Any = {"type": "iga", "degrees": [2, 2], "elements": [1, 1]}
        if width:
            settings = {"type": "iga", "degrees": [2, 2, 1], "elements": [1, 1, 1]}
        model = reweighted(quarter_ring(settings, 1.0, 1.6, width), 50.0, 1)
        volume, first = patch_moments(patch_from_model(model.geometry))
        thick = width or 1.0
        assert volume == pytest.approx(np.pi / 4 * (1.6**2 - 1) * thick, rel=1e-12)
        assert_allclose(first[:2], (1.6**3 - 1) / 3 * thick, rtol=1e-12)
        if width:
            assert first[2] == pytest.approx(volume * width / 2, rel=1e-12)


@pytest.mark.parametrize("kind", ELEMENT_KINDS)
def test_moments_of_a_mesh_from_its_faces(kind: str) -> None:
    """Of a bent block with bowed edges, by volume and by surface: two rules."""
    d = dimension(kind)
    size = (1.0, 1.0, 0.4)[:d]
    mesh = block(kind, (2, 3, 2)[:d], size, seed=1, bend=ring(1.0, 0.6, 1.3))
    mesh = turned(mesh, 4)
    materials = {None: STEEL}
    mass, _ = mesh_matrices(mesh, materials, state(kind), thickness=0.2)
    weights = np.asarray(mass.sum(axis=0)).ravel()
    if d == 3:
        weights /= 0.2
    found, first = mesh_moments(mesh, materials, 0.2 if d == 2 else 1.0)
    assert found == pytest.approx(weights.sum(), rel=1e-11)
    assert_allclose(first, weights @ mesh.positions, rtol=1e-10)


@pytest.mark.parametrize("share", [0.5, 1 + 1e-5])
def test_a_wrong_mass_is_refused(share: float) -> None:
    """Whatever is wrong with an element: half its mass would not pass."""
    settings = {"type": "iga", "degrees": [2, 2], "elements": [2, 2]}
    body = finite_element_model(quarter_ring(settings, 1.0, 1.6))
    assert body.scalar_mass is not None
    wrong = replace(body, scalar_mass=body.scalar_mass * share)
    with pytest.raises(InputError, match="does not have the mass of its geometry"):
        geometry_mass_notes(wrong)


def test_coarse_meshes_note_their_mass_error() -> None:
    """Chords of 90, 4.5 and 0.9 degrees; the note states the missing mass."""
    for count in (2, 20, 100):
        model = quarter_ring({"type": "q4", "elements": [2, count]}, 1.0, 1.6)
        u, weight = np.linspace(0.0, 1.0, count + 1), 2.0 * np.sqrt(0.5)
        middle = weight * u * (1.0 - u)
        angles = np.diff(np.arctan2(u**2 + middle, (1.0 - u) ** 2 + middle))
        expected = np.sin(angles).sum() / (np.pi / 2.0) - 1.0
        found = with_code(sid_from_model(model), "N150")
        assert bool(found) == (expected < -1e-3)
        for note in found:
            assert note.data["mass"] == pytest.approx(expected, rel=1e-6)


def test_the_rod_s_mass_is_its_drawing_s() -> None:
    model = validate_data(rod_data(), ModelFile)
    assert finite_element_model(model).diagnostics == ()
    assert geometry_mass_notes(finite_element_model(model)) == ()
