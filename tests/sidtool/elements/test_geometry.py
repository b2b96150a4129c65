"""Geometry: B-spline bases, exact refinement, rational arcs, points by position."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose
from scipy.interpolate import BSpline

from sidtool.formats.base.errors import InputError
from sidtool.geometry.nurbs_patch import (
    NurbsPatch,
    evaluate_grid,
    gauss_points,
    greville_points,
    local_basis,
    local_basis_from_left,
    open_uniform_knots,
    patch_from_model,
    point_basis,
    refine_patch,
    side_nodes,
)
from sidtool.geometry.patch_evaluation import locate, may_be_inside

from ..models import IGA, annulus, rod

GRID = (np.linspace(0, 1, 23), np.linspace(0, 1, 17))


@cache
def patches() -> dict[str, NurbsPatch]:
    return {
        "rod": patch_from_model(rod().geometry),
        "annulus": patch_from_model(annulus(IGA).geometry),
    }


@pytest.mark.parametrize("degree", [1, 2, 3, 7, 12])
def test_local_basis_is_that_of_scipy(degree: int) -> None:
    knots = np.sort(np.r_[open_uniform_knots(degree, 5), 0.4 * (degree > 1)])
    knots = knots if degree > 1 else open_uniform_knots(1, 5)
    count = len(knots) - degree - 1
    x = np.r_[np.linspace(0, 1, 41)]
    basis = local_basis(knots, degree, x)
    spline = BSpline(knots, np.eye(count), degree)
    columns = basis.first[:, None] + np.arange(degree + 1)
    rows = np.arange(len(x))[:, None]
    assert_allclose(basis.values, spline(x)[rows, columns], atol=1e-14)
    expected = spline(x, nu=1)[rows, columns]
    assert_allclose(basis.derivatives, expected, atol=1e-11)
    assert_allclose(basis.values.sum(axis=1), 1, rtol=1e-14)
    assert_allclose(basis.derivatives.sum(axis=1), 0, atol=1e-11)


def test_one_sided_derivatives_at_a_corner_of_the_basis() -> None:
    knots = open_uniform_knots(1, 4)
    right = local_basis(knots, 1, [0.5])
    left = local_basis_from_left(knots, 1, [0.5])
    assert (right.first[0], left.first[0]) == (2, 1)
    assert_allclose(right.derivatives, [[-4, 4]])
    assert_allclose(left.derivatives, [[-4, 4]])
    assert_allclose(left.values, [[0, 1]], atol=1e-15)


def test_gauss_points_integrate_polynomials_exactly_in_every_span() -> None:
    points, weights = gauss_points(np.array([0, 0, 0, 0.3, 0.3, 1, 1, 1]), 4)
    for power in range(8):
        assert_allclose((weights * points**power).sum(), 1 / (power + 1), rtol=1e-14)


def test_greville_points_give_the_identity() -> None:
    knots = open_uniform_knots(4, 6)
    identity = BSpline(knots, greville_points(knots, 4), 4)
    x = np.linspace(0, 1, 31)
    assert_allclose(identity(x), x, atol=1e-15)


@pytest.mark.parametrize("name", ["rod", "annulus"])
@pytest.mark.parametrize("raised", [(0, 0), (1, 2), (5, 3), (8, 8)])
def test_refinement_leaves_the_geometry_unchanged(
    name: str, raised: tuple[int, int]
) -> None:
    patch = patches()[name]
    degrees = (patch.degrees[0] + raised[0], patch.degrees[1] + raised[1])
    knots = (open_uniform_knots(degrees[0], 7), open_uniform_knots(degrees[1], 3))
    fine = refine_patch(patch, degrees, knots)
    assert fine.shape == (degrees[0] + 7, degrees[1] + 3)
    assert_allclose(evaluate_grid(fine, GRID), evaluate_grid(patch, GRID), atol=1e-13)


def test_refinement_keeps_the_smoothness_of_inner_knots() -> None:
    corner = NurbsPatch(
        degrees=(1, 1),
        knots=(np.array([0, 0, 0.5, 1, 1]), np.array([0.0, 0, 1, 1])),
        control_points=np.array(
            [[[0, 0], [0, 1]], [[1, 0.2], [1, 1]], [[2, 0], [2, 1]]], float
        ),
        weights=np.array([[1, 1], [2, 1], [1, 3]], float),
    )
    target = np.array([0, 0, 0, 0.25, 0.5, 0.5, 1, 1, 1])
    fine = refine_patch(corner, (2, 2), (target, open_uniform_knots(2, 2)))
    assert_allclose(evaluate_grid(fine, GRID), evaluate_grid(corner, GRID), atol=1e-14)
    with pytest.raises(InputError, match="inner knot 0.5 1 times.*expected it 2 times"):
        refine_patch(
            corner, (2, 2), (open_uniform_knots(2, 2), open_uniform_knots(2, 2))
        )
    with pytest.raises(InputError, match="direction v: degree 0 cannot represent"):
        refine_patch(corner, (1, 0), corner.knots)


def test_a_circular_arc_is_exact() -> None:
    fine = refine_patch(
        patches()["annulus"],
        (2, 5),
        (open_uniform_knots(2, 3), open_uniform_knots(5, 9)),
    )
    radius = np.linalg.norm(evaluate_grid(fine, GRID), axis=-1)
    assert_allclose(radius, np.broadcast_to(1 + GRID[0][:, None], radius.shape))


@pytest.mark.parametrize("name", ["rod", "annulus"])
@given(u=st.floats(0, 1), v=st.floats(0, 1))
@settings(max_examples=30)
def test_point_basis_agrees_with_the_grid_and_its_differences(
    name: str, u: float, v: float
) -> None:
    patch = patches()[name]
    basis = point_basis(patch, [u, v])
    point = basis.values @ patch.points[basis.nodes]
    grid = evaluate_grid(patch, (np.array([u]), np.array([v])))[0, 0]
    assert_allclose(point, grid, atol=1e-14)
    assert_allclose(basis.gradients.sum(axis=0), 0, atol=1e-13)
    jacobian = patch.points[basis.nodes].T @ basis.gradients
    h = 1e-6
    ends = np.clip([u - h, u + h], 0, 1)
    slope = np.diff(evaluate_grid(patch, (ends, np.array([v])))[:, 0], axis=0)[0]
    assert_allclose(jacobian[:, 0], slope / np.diff(ends), atol=1e-4)


@pytest.mark.parametrize("name", ["rod", "annulus"])
@given(u=st.floats(0, 1), v=st.floats(0, 1))
@settings(max_examples=30)
def test_locate_inverts_the_map(name: str, u: float, v: float) -> None:
    patch = patches()[name]
    target = evaluate_grid(patch, (np.array([u]), np.array([v])))[0, 0]
    found = locate(patch, target)
    again = evaluate_grid(patch, (found[:1], found[1:]))[0, 0]
    assert_allclose(again, target, atol=1e-9)
    assert may_be_inside(patch, target[None]).all()


def test_points_in_the_bore_are_far_from_the_ring() -> None:
    bore = np.array([[0.0, 0.0], [0.5, 0.5], [0.85, 0.0]])
    assert not may_be_inside(patches()["annulus"], bore).any()


def test_locate_names_the_nearest_point_of_the_body() -> None:
    with pytest.raises(InputError, match=r"\(0.5, 0.1\) lies outside.*\(0.5, 0.015\)"):
        locate(patches()["rod"], [0.5, 0.1])


def test_sides_are_where_their_names_say() -> None:
    patch = patches()["rod"]
    points = patch.points
    assert_allclose(points[side_nodes(patch, 0, 0)][:, 0], 0)
    assert_allclose(points[side_nodes(patch, 0, 1)][:, 0], 1)
    assert (points[side_nodes(patch, 1, 1)][:, 1] >= 0).all()
    assert (points[side_nodes(patch, 1, 0)][:, 1] <= 0).all()


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_basis_functions_are_those_of_scipy(degree: int) -> None:
    knots = np.array([0.0] * (degree + 1) + [0.2, 0.5] + [0.7] * degree)
    knots = np.append(knots, [1.0] * (degree + 1))
    points = np.append(np.linspace(0, 1, 37), 0.2)
    splines = BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    basis = local_basis(knots, degree, points)
    own = basis.first[:, None] + np.arange(degree + 1)
    for found, expected in (
        (basis.values, splines(points)),
        (basis.derivatives, splines.derivative()(points)),
    ):
        whole = np.zeros_like(expected)
        np.put_along_axis(whole, own, found, 1)
        assert_allclose(whole, expected, atol=1e-12)
