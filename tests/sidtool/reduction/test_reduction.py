"""Reduction: the eigen-solver, modal truncation, signs, frames."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from numpy.testing import assert_allclose

from sidtool.eigensolvers import projected_matrix
from sidtool.eigensolvers.eigenpairs import free_body_shift, lowest_eigenpairs
from sidtool.eigensolvers.projected_matrix import (
    ProjectedMatrix,
    products_of_magnitudes,
)
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModalReduction, ModelFile, TangentFrame
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.reduction.body_frames import FRAMES, Frame, tangent_frame
from sidtool.reduction.methods import REDUCTIONS, ReducedBasis, orient_shapes
from tests.steel_bars import bar_data

from ..models import DISCRETISATIONS, Q4, rod, rod_data

TANGENT = TangentFrame(type="tangent", marker="crank_pin", clamp="left")
COARSE = {"type": "q4", "elements": [40, 4]}


@pytest.fixture(scope="module")
def body() -> FiniteElementModel:
    return finite_element_model(rod(COARSE))


@pytest.fixture(scope="module")
def basis(body: FiniteElementModel) -> ReducedBasis:
    return reduced(body, 5)


def reduced(body: FiniteElementModel, modes: int) -> ReducedBasis:
    settings = ModalReduction(method="modal", modes=modes)
    return REDUCTIONS["modal"](body, FRAMES["tangent"](body, TANGENT), settings)


def test_a_projected_matrix_has_the_entries_of_its_products(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 20 displacements 12 are coordinates, two more coordinates move the others."""
    monkeypatch.setattr(projected_matrix, "_ENTRIES_AT_A_TIME", 40)
    random = np.random.default_rng(0)
    whole = random.normal(size=(20, 20)) * (random.uniform(size=(20, 20)) < 0.3)
    whole += whole.T
    transform = np.zeros((20, 14))
    transform[np.flatnonzero(np.arange(20) % 5 < 3), np.arange(12)] = 1.0
    transform[np.arange(20) % 5 >= 3, 12:] = random.normal(size=(8, 2))
    matrix = ProjectedMatrix(sp.csr_matrix(transform), sp.csr_matrix(whole))
    expected, vectors = transform.T @ whole @ transform, random.normal(size=(14, 3))
    assert_allclose(matrix.tocsr().toarray(), expected, atol=1e-13)
    assert_allclose(matrix @ vectors, expected @ vectors, atol=1e-12)
    for any_matrix in (matrix, sp.csr_matrix(expected)):
        found = products_of_magnitudes(any_matrix, vectors)
        assert_allclose(found, np.abs(expected) @ vectors, atol=1e-12)


def test_sparse_eigenpairs_are_those_of_lapack(body: FiniteElementModel) -> None:
    free = np.flatnonzero(~tangent_frame(body, TANGENT).held)
    k, m = (matrix[free][:, free] for matrix in (body.stiffness, body.mass))
    values, vectors = lowest_eigenpairs(k, m, 12)
    n = free.size
    inverse = scipy.linalg.eigh(  # the large ones of the inverse problem are exact
        m.toarray(), k.toarray(), eigvals_only=True, subset_by_index=[n - 12, n - 1]
    )
    dense = 1 / inverse[::-1]
    assert_allclose(values, dense, rtol=1e-8)
    assert_allclose(vectors.T @ (m @ vectors), np.eye(12), atol=1e-13)
    residual = k @ vectors - (m @ vectors) * values
    assert np.abs(residual).max() < 1e-7 * np.abs(k @ vectors).max()


def test_the_same_matrices_give_the_same_vectors(body: FiniteElementModel) -> None:
    first, second = (reduced(body, 5).shapes for _ in range(2))
    assert (first == second).all()


@pytest.mark.parametrize("frame", ["tangent", "buckens"])
@pytest.mark.parametrize("modes", [1, 3, 6])
def test_modes_of_one_frequency_are_those_along_the_axes(
    frame: str, modes: int
) -> None:
    """A square bar bends in y and z at the same frequency. An odd number of modes cuts
    a pair, of which that in y stays: a planar scene can have it."""
    frames = {"tangent": {"type": "tangent", "marker": "root", "clamp": "start"}}
    data = bar_data(modes=modes, frame=frames.get(frame, {"type": frame}))
    sid = sid_from_model(validate_data(data, ModelFile))
    moved = np.abs(sid.node(2).phi.m0[1:])
    assert (moved.min(axis=0) < 1e-6 * moved.max(axis=0)).all()
    assert (moved.argmax(axis=0) == np.arange(modes) % 2).all()


@pytest.mark.parametrize("elements", [[12, 2], [60, 6]])
def test_a_free_body_is_never_factored_unshifted(elements: list[int]) -> None:
    """The elastic modes of LAPACK, without the three rigid motions."""
    body = finite_element_model(rod({"type": "q4", "elements": elements}))
    frame = Frame(np.zeros(3), np.zeros(body.ndof, bool))
    settings = ModalReduction(method="modal", modes=3)
    basis = REDUCTIONS["modal"](body, frame, settings)
    dense = scipy.linalg.eigvalsh(
        body.stiffness.toarray(), body.mass.toarray(), subset_by_index=[0, 5]
    )
    assert (np.abs(dense[:3]) < 1e-7 * dense[3]).all()
    assert_allclose(np.diag(basis.stiffness), dense[3:], rtol=1e-7)


def test_the_shift_belongs_to_the_body_not_to_the_mesh() -> None:
    shifts = []
    for elements in ([40, 4], [80, 8]):
        body = finite_element_model(rod({"type": "q4", "elements": elements}))
        shifts.append(free_body_shift(body.stiffness, body.mass, body.positions))
    first_elastic = (2 * np.pi * 148.5) ** 2
    assert_allclose(shifts[1], shifts[0], rtol=0.1)
    assert first_elastic < -shifts[0] < 100 * first_elastic


def test_modes_are_mass_normalised_and_vanish_where_held(
    body: FiniteElementModel, basis: ReducedBasis
) -> None:
    gram = basis.shapes.T @ (body.mass @ basis.shapes)
    assert_allclose(gram, np.eye(5), atol=1e-13)
    projected = basis.shapes.T @ (body.stiffness @ basis.shapes)
    assert_allclose(projected, basis.stiffness, atol=1e-8 * projected.max())
    assert (basis.shapes[body.dofs(body.node_sets["left"])] == 0).all()
    assert_allclose(basis.reconstruct([0, 2, 0, 0, 0]), 2 * basis.shapes[:, 1])


def test_labels_contain_number_and_frequency(basis: ReducedBasis) -> None:
    hertz = np.sqrt(basis.stiffness[0, 0]) / (2 * np.pi)
    assert basis.labels[0] == f"Eigen Mode    1 :{hertz:13.3f} Hz"
    assert len(basis.labels) == 5


def test_modes_are_positive_at_the_last_marker_that_moves(
    body: FiniteElementModel, basis: ReducedBasis
) -> None:
    pin = body.marker("piston_pin").displacement @ basis.shapes
    assert (pin[1, :4] > 0.5).all() and pin[0, 4] > 0.5
    flipped = orient_shapes(basis.shapes * [-1, 1, -1, 1, -1], body)
    assert (flipped == basis.shapes).all()


def test_the_order_of_the_markers_decides_only_among_those_that_move() -> None:
    markers = {
        "piston_pin": {"node": 2, "edge": "right", "at": 0.5},
        "crank_pin": {"node": 1, "edge": "left", "at": 0.5},
    }
    body = finite_element_model(rod(COARSE, markers=markers))
    pin = body.marker("piston_pin").displacement @ reduced(body, 5).shapes
    assert (pin[1, :4] > 0.5).all() and pin[0, 4] > 0.5


def test_without_a_marker_that_moves_the_largest_component_is_positive() -> None:
    markers = {"crank_pin": {"node": 1, "edge": "left", "at": 0.5}}
    body = finite_element_model(rod(COARSE, markers=markers))
    shapes = reduced(body, 3).shapes
    largest = shapes[np.abs(shapes).argmax(axis=0), range(3)]
    assert (largest > 0).all()


def test_more_modes_than_degrees_of_freedom_are_refused() -> None:
    body = finite_element_model(rod({"type": "q4", "elements": [2, 1]}))
    assert reduced(body, 8).shapes.shape == (12, 8)
    with pytest.raises(InputError, match="reduction.modes: 9 modes .* at most 8"):
        reduced(body, 9)


@pytest.mark.parametrize("n", [10, 1000])
@pytest.mark.parametrize("broken", ["stiffness", "mass"])
def test_matrices_of_no_body_are_refused(n: int, broken: str) -> None:
    """Dense and sparse: infinite stiffness, negative mass."""
    stiffness, mass = sp.eye_array(n, format="csr"), sp.eye_array(n, format="csr")
    if broken == "stiffness":
        stiffness = stiffness * np.inf
    else:
        mass = -mass
    with pytest.raises(InputError, match="the eigenproblem has no solution"):
        lowest_eigenpairs(stiffness, mass, 3)


@pytest.mark.parametrize("name", DISCRETISATIONS)
def test_the_tangent_frame_sits_at_its_marker(name: str) -> None:
    body = finite_element_model(rod(DISCRETISATIONS[name]))
    frame = tangent_frame(body, TANGENT)
    assert_allclose(frame.origin, 0, atol=1e-15)
    assert frame.held.sum() == 2 * body.node_sets["left"].size


def test_a_frame_whose_marker_moves_is_refused() -> None:
    body = finite_element_model(rod(Q4))
    wrong = TangentFrame(type="tangent", marker="piston_pin", clamp="left")
    with pytest.raises(InputError, match="frame.marker: .* not on the clamped edge"):
        tangent_frame(body, wrong)
    both = TangentFrame(type="tangent", marker="piston_pin", clamp=("left", "right"))
    assert_allclose(tangent_frame(body, both).origin, [1, 0, 0])


@pytest.mark.parametrize("height", [0.0, 1e-12])
def test_a_point_cannot_clamp_a_body(height: float) -> None:
    """A triangle, its left edge collapsed: no rotation to hold there."""
    data = rod_data()
    data["geometry"]["control_points"][0] = [[0, -height], [0, height]]
    data["geometry"]["control_points"][1] = [[0.5, -0.1], [0.5, 0.1]]
    with pytest.raises(InputError, match="markers.crank_pin: the geometry degenerates"):
        finite_element_model(rod(Q4, geometry=data["geometry"]))


@pytest.mark.parametrize("end", [[1.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.6, 0.7, 0.0]])
def test_signs_between_two_pins_are_those_of_other_meshes(end: list[float]) -> None:
    """Both ends turn as far, and neither moves: the first one turns positively."""
    section = {"shape": "rectangle", "height": 0.01, "width": 0.02}
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": 2e11, "poissons_ratio": 0.3, "density": 8e3},
        "geometry": {
            "type": "beam",
            "start": 3 * [0.0],
            "end": end,
            "section": section,
        },
        "frame": {"type": "chord", "markers": ["a", "b"]},
        "markers": {
            "a": {"node": 1, "parameters": [0.0]},
            "b": {"node": 2, "parameters": [1.0]},
        },
        "reduction": {"method": "modal", "modes": 5},
    }
    for elements in (6, 8, 12, 16, 24):
        mesh = {"type": "beam", "elements": elements}
        model = validate_data(data | {"discretisation": mesh}, ModelFile)
        body = finite_element_model(model)
        frame = FRAMES["chord"](body, model.frame)
        shapes = REDUCTIONS["modal"](body, frame, model.reduction).shapes
        turns = body.marker("a").rotation @ shapes
        sizes = np.abs(turns).max(axis=0)
        assert (sizes > 0.1 * np.abs(shapes).max(axis=0)).all()
        first = np.argmax(np.abs(turns) > (1.0 - 1e-6) * sizes, axis=0)
        assert (turns[first, range(5)] > 0.0).all()
