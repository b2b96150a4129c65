"""The algebra of plane and space: the plane is space without its third axis."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import Array
from sidtool.solver.compiler.kernels import entry
from sidtool.solver.compiler.types import void
from sidtool.solver.compiler.vectors import Rotation, SymmetricMatrix, Vector
from sidtool.solver.spatial import algebra
from sidtool.solver.spatial.system_arrays import F1

ANGLE = 0.7
COSINE, SINE = np.cos(ANGLE), np.sin(ANGLE)
IN_PLANE = Rotation(COSINE, SINE)
IN_SPACE = Rotation(COSINE, -SINE, 0.0, SINE, COSINE, 0.0, 0.0, 0.0, 1.0)


def embedded(value: Any) -> Any:
    """A value of the plane as one of space."""
    if isinstance(value, SymmetricMatrix):
        return SymmetricMatrix(0.0, 0.0, value[0], 0.0, 0.0, 0.0)
    if isinstance(value, Rotation):
        return IN_SPACE
    if isinstance(value, Vector):
        return Vector(*value, 0.0) if len(value) == 2 else Vector(0.0, 0.0, *value)
    return value


def seen_in_plane(value: Any, like: Any) -> Any:
    """What of a value of space there is in the plane."""
    if isinstance(value, SymmetricMatrix):
        return (value[2],)
    if isinstance(value, Vector):
        return value[:2] if len(like) == 2 else value[2:]
    return value


a, b, w, u = Vector(0.3, -1.2), Vector(2.0, 0.4), Vector(0.9), Vector(-0.6)
J = SymmetricMatrix(1.7)
CASES = [
    (algebra.cross, (a, b)),
    (algebra.cross, (w, a)),
    (algebra.cross, (a, w)),
    (algebra.cross, (w, u)),
    (algebra.dot, (a, b)),
    (algebra.dot, (w, u)),
    (algebra.rotate, (IN_PLANE, a)),
    (algebra.rotate, (IN_PLANE, w)),
    (algebra.rotate_inverse, (IN_PLANE, a)),
    (algebra.inertia_times, (J, w)),
    (algebra.omega_product, (J, w)),
    (algebra.omega_gradient, (J, w)),
    (algebra.inertia_second_derivative, (J,)),
    (algebra.inertia_term, (a, b, 0.8)),
]


@pytest.mark.parametrize(("formula", "values"), CASES)
def test_the_plane_is_a_part_of_space(
    formula: Callable[..., Any], values: tuple[Any, ...]
) -> None:
    found = formula(*values)
    expected = formula(*map(embedded, values))
    assert found == pytest.approx(seen_in_plane(expected, found), rel=1e-14)


def skew(x: Array) -> Array:
    return np.cross(x, np.eye(3)).T


def random_values(seed: int) -> tuple[Vector, Vector, SymmetricMatrix]:
    x, y, j = np.split(np.random.default_rng(seed).normal(size=12), [3, 6])
    return Vector(*x), Vector(*y), SymmetricMatrix(*j)


@pytest.mark.parametrize("seed", range(3))
def test_formulas_of_space_are_those_of_matrices(seed: int) -> None:
    x, y, j = random_values(seed)
    X, Y = skew(np.array(x)), skew(np.array(y))
    K = np.array([[j[0], j[3], j[4]], [j[3], j[1], j[5]], [j[4], j[5], j[2]]])
    assert algebra.cross(x, y) == pytest.approx(np.cross(x, y))
    assert algebra.inertia_times(j, x) == pytest.approx(K @ np.array(x))
    square = 0.3 * (X @ Y + Y @ X)
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    assert algebra.inertia_term(x, y, 0.3) == pytest.approx([square[p] for p in pairs])
    out = np.zeros(20)
    algebra.add_double_cross(out, 2, 5, x, y, x)
    assert out[2:17].reshape(3, 5)[:, :3] == pytest.approx(X @ Y)
    quaternion = Vector(*np.random.default_rng(seed).normal(size=4))
    R = np.reshape(algebra.rotation_from_quaternion(quaternion), (3, 3))
    assert np.linalg.inv(R) == pytest.approx(R.T, abs=1e-13)
    S = np.reshape(IN_SPACE, (3, 3))
    whole = algebra.rotation_product(Rotation(*R.ravel()), IN_SPACE)
    assert np.reshape(whole, (3, 3)) == pytest.approx(R @ S)
    assert np.reshape(
        algebra.rotation_product_transposed(whole, IN_SPACE), (3, 3)
    ) == pytest.approx(R)


def test_the_gradient_of_a_row_of_oe_by_complex_steps() -> None:
    x, _, j = random_values(4)
    steps = (Vector(*(np.array(x) + 1e-30j * e)) for e in np.eye(3))
    slopes = [algebra.omega_product(j, step).imag / 1e-30 for step in steps]
    assert algebra.omega_gradient(j, x) == pytest.approx(slopes, rel=1e-14)


@entry(void(F1, F1))
def in_machine_code(numbers, out):  # type: ignore[no-untyped-def]
    x = algebra.load(algebra.direction(0.0, 0.0), numbers, 0)
    y = algebra.load(x, numbers, 2)
    turned = algebra.rotate(algebra.planar_rotation(numbers[4], numbers[5]), x)
    total = 2.0 * turned - y + numbers[0] * algebra.unit(x, 1)
    algebra.store(out, 0, total)
    algebra.add_row(out, 0, -x)
    algebra.store(out, 2, algebra.cross(algebra.cross(x, y), y))
    out[4] = algebra.dot(x, y)
    algebra.add_double_cross(out, 5, 2, x, y, x)


def test_machine_code_computes_what_python_does() -> None:
    numbers, out = np.array([0.3, -1.2, 2.0, 0.4, COSINE, SINE]), np.zeros(9)
    in_machine_code(numbers, out)
    turned = algebra.rotate(IN_PLANE, a)
    total = 2.0 * turned - b + numbers[0] * Vector(0.0, 1.0) - a
    expected = np.zeros(9)
    algebra.store(expected, 0, total)
    algebra.store(expected, 2, algebra.cross(algebra.cross(a, b), b))
    expected[4] = algebra.dot(a, b)
    algebra.add_double_cross(expected, 5, 2, a, b, a)
    assert out == pytest.approx(expected, rel=1e-14)
