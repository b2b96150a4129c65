"""Isogeometric analysis: reference frequencies, rates, exact mass, patch test."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModalReduction, ModelFile
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.reduction.body_frames import Frame
from sidtool.reduction.methods import modal_truncation
from tests.places import SLIDER_CRANK

from ..models import annulus, rod, rod_data


def iga(degree: int, elements: tuple[int, int]) -> ModelFile:
    settings = {"type": "iga", "degrees": [degree] * 2, "elements": list(elements)}
    return rod(settings)


def free_hertz(model: ModelFile, count: int) -> np.ndarray:
    """The lowest elastic frequencies of the body that nothing holds."""
    body = finite_element_model(model)
    frame = Frame(np.zeros(3), np.zeros(body.ndof, bool))
    settings = ModalReduction(method="modal", modes=count)
    basis = modal_truncation(body, frame, settings)
    return np.sqrt(np.diag(basis.stiffness)) / (2 * np.pi)


@cache
def converged_free_hertz() -> np.ndarray:
    return free_hertz(iga(8, (20, 2)), 4)


def test_rod_gives_the_reference_numbers() -> None:
    """R1: n = 25, m = 8, p = 7, q = 4; the paper's own IGA row differs."""
    sid = sid_from_model(SLIDER_CRANK / "rod_iga.toml")
    found = np.sqrt(np.diag(sid.Ke.m0)) / (2 * np.pi)
    expected = [31.476, 199.128, 556.698, 1074.421, 1254.913]
    assert_allclose(found, expected, rtol=0, atol=0.5e-3)


def test_mass_is_exact() -> None:
    """3.14 kg and moments of the parabolic rod in closed form."""
    sid = sid_from_model(SLIDER_CRANK / "rod_iga.toml")
    assert sid.mass == pytest.approx(3.14, rel=1e-14)
    assert sid.mdCM.m0[0, 0] == pytest.approx(3.14 / 2, rel=1e-14)
    x, w = np.polynomial.legendre.leggauss(12)
    x, w = (x + 1) / 2, w / 2
    h = 0.12 * ((x - 0.5) ** 2 + 0.25)
    along, across = 78.5 * (w * h * x**2).sum(), 78.5 * (w * h**3 / 12).sum()
    expected = [across, along, along + across]
    assert_allclose(sid.J.m0[:3, 0], expected, rtol=1e-12)


def graded_knots(degree: int, layers: int) -> list[list[float]]:
    """Spans that shrink by half towards the corners of the clamped edge."""
    layer = 0.5 ** np.arange(layers, 0, -1.0)
    along = np.r_[0, 0.1 * layer, np.linspace(0.1, 1, 15)]
    across = np.r_[0, 0.5 * layer, 0.5, 1 - 0.5 * layer[::-1], 1]
    ends = np.zeros(degree), np.ones(degree)
    return [[*ends[0], *inner, *ends[1]] for inner in (along, across)]


def test_clamped_rod_reaches_the_converged_frequencies() -> None:
    """R1, from above; the corners of the clamped edge are singular: grade the knots."""
    converged = np.array([31.475, 199.12, 556.67, 1074.36, 1254.90])
    found = []
    for layers in (2, 5, 8):
        knots = graded_knots(5, layers)
        model = rod({"type": "iga", "degrees": [5, 5], "knots": knots})
        eigenvalues = np.diag(sid_from_model(model).Ke.m0)
        found.append(np.sqrt(eigenvalues) / (2 * np.pi))
    assert_allclose(found[-1], converged, rtol=1.5e-5)
    assert (np.diff(found, axis=0) < 0).all()
    assert (np.diff(found, axis=0)[1] > 0.25 * np.diff(found, axis=0)[0]).all()


@pytest.mark.parametrize("degree", [2, 3])
def test_frequencies_of_the_free_rod_converge_with_order_2p(degree: int) -> None:
    """The modes of the free rod are smooth: eigenvalues converge with order 2 p."""
    reference = converged_free_hertz()
    errors = [
        free_hertz(iga(degree, (n, n // 10)), 4) - reference for n in (10, 20, 40)
    ]
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (rates > 2 * degree - 0.1).all()
    assert_allclose(rates[-1], 2 * degree, atol=0.45)


def test_q4_on_the_free_rod_converges_with_order_2_to_the_same_values() -> None:
    meshes = [{"type": "q4", "elements": [15 * n, n]} for n in (5, 10)]
    errors = [free_hertz(rod(mesh), 4) - converged_free_hertz() for mesh in meshes]
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert_allclose(rates, 2, atol=0.03)


@pytest.mark.parametrize("degrees", [[3, 2], [7, 4], [2, 5]])
def test_patch_test_on_the_curved_rod(degrees: list[int]) -> None:
    """Constant strain is represented, without force at inner control points."""
    model = rod({"type": "iga", "degrees": degrees, "elements": [6, 3]})
    body = finite_element_model(model)
    gradient = np.array([[1e-3, 4e-4], [-2e-4, 7e-4]])
    u = (body.positions @ gradient.T).ravel()
    force = (body.stiffness @ u).reshape(-1, 2)
    edges = [body.node_sets[name] for name in ("left", "right", "bottom", "top")]
    inner = np.setdiff1d(np.arange(len(force)), np.concatenate(edges))
    assert np.abs(force[inner]).max() < 1e-11 * np.abs(force).max()
    e, nu = 2.1e11, 0.3
    exx, eyy, exy = gradient[0, 0], gradient[1, 1], gradient[0, 1] + gradient[1, 0]
    density = e / (1 - nu**2) * (exx**2 + eyy**2 + 2 * nu * exx * eyy)
    density += e / (2 * (1 + nu)) * exy**2
    assert u @ force.ravel() == pytest.approx(3.14 / 7850 * density, rel=1e-12)


def test_the_free_rod_has_three_rigid_motions() -> None:
    body = finite_element_model(iga(4, (8, 2)))
    eigenvalues = np.linalg.eigvalsh(body.stiffness.toarray())
    assert (np.abs(eigenvalues[:3]) < 1e-13 * eigenvalues[-1]).all()
    x, y = body.positions.T
    turn = np.stack([-y, x], axis=1).ravel()
    assert np.abs(body.stiffness @ turn).max() < 1e-13 * eigenvalues[-1]


def test_a_quarter_annulus_has_the_mass_of_a_quarter_annulus() -> None:
    """Rational weights: exact up to the quadrature, which converges at once."""
    exact = 7850 * 0.1 * np.pi / 4 * (2**2 - 1**2)
    inertia = 7850 * 0.1 * np.pi / 8 * (2**4 - 1**4)
    errors = []
    for n in (1, 2, 4, 8):
        settings = {"type": "iga", "degrees": [1, 2], "elements": [1, n]}
        body = finite_element_model(annulus(settings))
        errors.append(abs(body.scalar_mass.sum() / exact - 1))
        polar = (body.positions * (body.scalar_mass @ body.positions)).sum()
        assert polar == pytest.approx(inertia, rel=max(1e-13, 3 * errors[-1]))
    assert errors[0] < 1e-4 and errors[-1] < 1e-13


def test_frequencies_do_not_depend_on_the_way_of_refinement() -> None:
    """The same space, named by functions, elements or knots."""
    knots = [[0.0] * 4 + [0.25, 0.5, 0.75] + [1.0] * 4, [0.0] * 3 + [0.5] + [1.0] * 3]
    ways = ({"elements": [4, 2]}, {"functions": [7, 4]}, {"knots": knots})
    frequencies = [
        np.diag(sid_from_model(rod({"type": "iga", "degrees": [3, 2], **way})).Ke.m0)
        for way in ways
    ]
    assert_allclose(frequencies[1], frequencies[0], rtol=1e-11)
    assert_allclose(frequencies[2], frequencies[0], rtol=1e-11)


def test_the_range_of_the_knots_does_not_matter() -> None:
    settings = {"type": "iga", "degrees": [3, 2], "elements": [4, 2]}
    data = rod_data(settings)
    data["geometry"]["knots"] = [[2, 2, 2, 5, 5, 5], [-1, -1, 0, 0]]
    model = rod(settings, geometry=data["geometry"])
    assert_allclose(
        sid_from_model(model).Ke.m0, sid_from_model(rod(settings)).Ke.m0, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"functions": [7, 3], "degrees": [7, 4]}, r"discretisation.functions\[0\]: 7"),
        ({"elements": [4, 2], "degrees": [1, 1]}, "direction u: degree 1 cannot rep"),
        (
            {"knots": [[0, 0, 0, 0.5, 1, 1], [0, 0, 1, 1]], "degrees": [2, 1]},
            r"discretisation.knots\[0\]: has the end knot 1 2 times; expected 3 times",
        ),
        (
            {"knots": [[0, 0, 0, 0.7, 0.5, 1, 1, 1], [0, 0, 1, 1]], "degrees": [2, 1]},
            r"discretisation.knots\[0\]: decreases",
        ),
    ],
)
def test_a_basis_that_does_not_fit_is_named(settings: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        sid_from_model(rod({"type": "iga", **settings}))
