"""Bilinear quadrilaterals: published frequencies, order, patch test, rigid motion."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.elements.solid_elements import elasticity
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.isogeometric.sampled_patch import grid_quadrilaterals, q4_matrices
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from tests.places import SLIDER_CRANK

from ..models import annulus, rod

FORMULATIONS = ["full_integration", "incompatible_modes"]


def hertz(model: ModelFile) -> np.ndarray:
    return np.sqrt(np.diag(sid_from_model(model).Ke.m0)) / (2 * np.pi)


def q4(elements: tuple[int, int], formulation: str = FORMULATIONS[0]) -> ModelFile:
    return rod({"type": "q4", "elements": elements, "formulation": formulation})


def test_rod_150x10_gives_the_reference_numbers() -> None:
    """R1; the paper's ANSYS row (31.8, 200.6, 560.6, 1082.3, 1254.9) is this mesh."""
    sid = sid_from_model(SLIDER_CRANK / "rod_q4.toml")
    found = np.sqrt(np.diag(sid.Ke.m0)) / (2 * np.pi)
    expected = [31.7011, 200.5533, 560.6341, 1082.3189, 1254.9495]
    assert_allclose(found, expected, rtol=0, atol=0.5e-4)
    assert sid.mass == pytest.approx(3.1400697778, abs=0.5e-10)
    assert sid.J.m0[2, 0] == pytest.approx(1.0995077456, abs=0.5e-10)


def test_bending_frequencies_of_the_clamped_rod_converge_with_order_2() -> None:
    """Towards the converged values of the exact geometry (R1)."""
    converged = np.array([31.475, 199.118, 556.662, 1074.347])
    errors = [hertz(q4((15 * n, n)))[:4] - converged for n in (5, 10)]
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (rates > 1.9).all() and (rates < 2.1).all()
    assert (errors[1] < 8.4e-3 * converged).all()


def test_incompatible_modes_remove_the_shear_locking() -> None:
    converged = np.array([31.475, 199.118, 556.662, 1074.347, 1254.896])
    full, qm6 = (hertz(q4((75, 5), name)) / converged - 1 for name in FORMULATIONS)
    assert (full[:4] > 0.027).all()
    assert (np.abs(qm6) < 4e-3).all() and qm6[0] < 3e-4


def distorted_mesh() -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.linspace(0, 3, 5), np.linspace(0, 2, 4), indexing="ij")
    points = np.stack([x, y], axis=-1)
    points[1:-1, 1:-1] += np.random.default_rng(3).uniform(-0.2, 0.2, (3, 2, 2))
    return points.reshape(-1, 2), grid_quadrilaterals(x.shape)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("state", ["plane_stress", "plane_strain"])
def test_patch_test_on_a_distorted_mesh(formulation: str, state: str) -> None:
    """Constant strain: no force at inner nodes, and the exact energy."""
    points, quads = distorted_mesh()
    law = elasticity(rod().material, state)
    _, stiffness = q4_matrices(
        points,
        quads,
        density=1.0,
        law=law,
        incompatible_modes=formulation == FORMULATIONS[1],
    )
    gradient = np.array([[1e-3, 4e-4], [-2e-4, 7e-4]])
    u = (points @ gradient.T).ravel()
    force = (stiffness @ u).reshape(-1, 2)
    inner = np.ones((5, 4), bool)
    inner[[0, -1]] = inner[:, [0, -1]] = False
    assert np.abs(force[inner.ravel()]).max() < 1e-12 * np.abs(force).max()
    strain = np.array([gradient[0, 0], gradient[1, 1], gradient[0, 1] + gradient[1, 0]])
    assert u @ force.ravel() == pytest.approx(6 * strain @ law @ strain, rel=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_only_motions_without_energy_are_rigid(formulation: str) -> None:
    points, quads = distorted_mesh()
    law = elasticity(rod().material, "plane_stress")
    _, stiffness = q4_matrices(
        points,
        quads,
        density=1.0,
        law=law,
        incompatible_modes=formulation == FORMULATIONS[1],
    )
    eigenvalues = np.linalg.eigvalsh(stiffness.toarray())
    assert (np.abs(eigenvalues[:3]) < 1e-13 * eigenvalues[-1]).all()
    assert eigenvalues[3] > 1e-4 * eigenvalues[-1]


def test_one_layer_of_qm6_bends_like_a_beam_of_plane_stress() -> None:
    """Pure bending of a rectangle: the energy is E I kappa^2 L / 2 exactly."""
    x, y = np.meshgrid(np.linspace(0, 2, 6), [-0.1, 0.1], indexing="ij")
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    material = rod().material
    _, stiffness = q4_matrices(
        points,
        grid_quadrilaterals(x.shape),
        density=1.0,
        law=elasticity(material, "plane_stress"),
        incompatible_modes=True,
    )
    u = np.stack([-points[:, 0] * points[:, 1], points[:, 0] ** 2 / 2], 1).ravel()
    energy = material.youngs_modulus * 0.2**3 / 12 * 2 / 2
    assert u @ (stiffness @ u) / 2 == pytest.approx(energy, rel=1e-11)


def test_plane_strain_is_stiffer_by_the_factor_of_theory() -> None:
    """Slender bending: E / (1 - nu^2) instead of E."""
    mesh = {"type": "q4", "elements": [60, 4]}
    stress, strain = (
        hertz(rod({**mesh, "state": s})) for s in ("plane_stress", "plane_strain")
    )
    assert strain[0] / stress[0] == pytest.approx(1 / np.sqrt(1 - 0.3**2), rel=5e-3)


def test_mass_is_that_of_the_polygon() -> None:
    model = annulus({"type": "q4", "elements": [3, 7]})
    body = finite_element_model(model)
    corners = body.positions[grid_quadrilaterals((4, 8))]
    x, y = corners[..., 0], corners[..., 1]
    shoelace = (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum() / 2
    assert body.scalar_mass.sum() == pytest.approx(785 * shoelace, rel=1e-13)


def test_a_folded_element_is_named() -> None:
    points = np.array([[0, 0], [1, 0], [0.2, 0.2], [0, 1]], float)
    quads = np.array([[0, 1, 2, 3]])
    law = elasticity(rod().material, "plane_stress")
    with pytest.raises(InputError, match="geometry: the map folds or is mirrored near"):
        q4_matrices(points, quads, density=1.0, law=law)
