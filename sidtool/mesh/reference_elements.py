"""Shape functions and quadrature of the solid elements.

Quadrature on the reference elements: unit cube, simplex, prism and pyramid.

Boxes and prisms take products of rules. Triangles, tetrahedra and pyramids are cones
over their base: the points of the base shrink towards the apex, and the measure with
them as (1 - z)^k over a base of k dimensions. Low degrees of simplices have symmetric
rules of fewer points, all of positive weight.

Sources: A. H. Stroud, "Approximate Calculation of Multiple Integrals", 1971, sections
2.2 to 2.5; D. A. Dunavant, Int. J. Numer. Methods Eng. 21, 1985 (triangles);
N. J. Walkington, "Quadrature on simplices of arbitrary dimension", 2000 (tetrahedra).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, reduce
from itertools import permutations, product
from math import factorial, prod, sqrt

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

Exponents = tuple[int, ...]

_SQUARE = ((0, 1), (1, 2), (2, 3), (3, 0))
_TRIANGLE = ((0, 1), (1, 2), (2, 0))
#: By the name without its number: pairs of corners that are edges.
_EDGES: dict[str, tuple[tuple[int, int], ...]] = {
    "tri": _TRIANGLE,
    "quad": _SQUARE,
    "tet": (*_TRIANGLE, (0, 3), (1, 3), (2, 3)),
    "hex": (
        *_SQUARE,
        *((a + 4, b + 4) for a, b in _SQUARE),
        *((i, i + 4) for i in range(4)),
    ),
    "wedge": (
        *_TRIANGLE,
        *((a + 3, b + 3) for a, b in _TRIANGLE),
        *((i, i + 3) for i in range(3)),
    ),
    "pyramid": (*_SQUARE, *((i, 4) for i in range(4))),
}
#: Faces by their corners, counter-clockwise seen from outside.
_FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "tet": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hex": (
        (0, 3, 2, 1),
        (4, 5, 6, 7),
        *((a, b, b + 4, a + 4) for a, b in _SQUARE),
    ),
    "wedge": (
        (0, 2, 1),
        (3, 4, 5),
        *((a, b, b + 3, a + 3) for a, b in _TRIANGLE),
    ),
    "pyramid": ((0, 3, 2, 1), *((a, b, 4) for a, b in _SQUARE)),
}
_QUAD = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
_SIMPLEX = np.vstack([np.zeros((1, 3)), np.eye(3)])

#: In pyramids beside the complete space of the order: powers of x, y and 1 - z.
_RATIONAL = {1: ((1, 1, -1),), 2: ((1, 1, -1), (2, 1, -1), (1, 2, -1))}
Rule = tuple[Array, Array]


def _layers(corners: Array) -> Array:
    return np.vstack([np.insert(corners, 2, z, axis=1) for z in (0.0, 1.0)])


_CORNERS = {
    "tri": _SIMPLEX[:3, :2],
    "quad": _QUAD,
    "tet": _SIMPLEX,
    "hex": _layers(_QUAD),
    "wedge": _layers(_SIMPLEX[:3, :2]),
    "pyramid": np.vstack([np.insert(_QUAD, 2, 0.0, axis=1), [[0, 0, 1]]]),
}


def _complete_polynomial(order: int) -> Callable[[Exponents], bool]:
    return lambda e: sum(e) <= order


def _serendipity_polynomial(order: int) -> Callable[[Exponents], bool]:
    return lambda e: max(e) <= order and sum(k for k in e if k > 1) <= order


def _prism_polynomial(order: int) -> Callable[[Exponents], bool]:
    return lambda e: (
        max(e[0] + e[1], e[2]) <= order and sum(e) <= 2 * order - (order > 1)
    )


_SPACES = {
    "tri": _complete_polynomial,
    "quad": _serendipity_polynomial,
    "tet": _complete_polynomial,
    "hex": _serendipity_polynomial,
    "wedge": _prism_polynomial,
    "pyramid": _complete_polynomial,
}

#: Name -> order, and the degrees to which the quadratures of stiffness and mass are
#: exact. The mass is exact on distorted elements and those with curved edges, too.
_DEFINITIONS: dict[str, tuple[int, int, int]] = {
    "tri3": (1, 2, 2),
    "tri6": (2, 4, 6),
    "quad4": (1, 3, 5),
    "quad8": (2, 5, 7),
    "tet4": (1, 2, 2),
    "tet10": (2, 5, 7),
    "hex8": (1, 3, 5),
    "hex20": (2, 5, 9),
    "wedge6": (1, 2, 5),
    "wedge15": (2, 4, 9),
    "pyramid5": (1, 3, 5),
    "pyramid13": (2, 5, 9),
}
ELEMENT_KINDS = tuple(_DEFINITIONS)
#: Linear elements that cannot bend at constant volume.
LINEAR_KINDS = tuple(kind for kind, (order, _, _) in _DEFINITIONS.items() if order == 1)


def quadratic_kind(kind: str) -> str:
    """The quadratic element of the same shape as a linear one."""
    shape = shape_of(kind)
    return next(k for k in ELEMENT_KINDS if shape_of(k) == shape and k != kind)


@dataclass(frozen=True, eq=False)
class ReferenceElement:
    """An element at its quadrature points and anywhere else.

    Attributes
    ----------
    nodes : (m, d) positions of the nodes
    corners : number of corner nodes, the first ones
    points, weights : (g, d), (g,) of the quadrature
    values, gradients : (g, m), (g, m, d) at those points
    """

    name: str
    nodes: Array
    corners: int
    points: Array
    weights: Array
    values: Array
    gradients: Array

    @property
    def dimension(self) -> int:
        """Dimension of the element."""
        return self.nodes.shape[1]

    def at(self, points: Array) -> tuple[Array, Array]:
        """Values (g, m) and gradients (g, m, d) at other points (g, d)."""
        return _tabulate(self.name, points)

    def excess(self, points: Array) -> Array:
        """How far reference points (..., d) lie outside; at most 0 inside."""
        shape, flat, last = shape_of(self.name), points[..., :2], points[..., -1]
        beyond = [-points.min(axis=-1)]
        if shape in ("tri", "tet"):
            beyond.append(points.sum(axis=-1) - 1)
        elif shape == "wedge":
            beyond += [flat.sum(axis=-1) - 1, last - 1]
        elif shape == "pyramid":
            beyond.append(flat.max(axis=-1) + last - 1)
        else:
            beyond.append(points.max(axis=-1) - 1)
        return np.max(beyond, axis=0)

    def clamped(self, point: Array) -> Array:
        """Return a reference point of the element near an outside one."""
        shape, inside = shape_of(self.name), np.clip(point, 0, 1)
        if shape in ("tri", "tet"):
            return inside / max(1.0, inside.sum())
        if shape == "wedge":
            inside[:2] /= max(1.0, inside[:2].sum())
        elif shape == "pyramid":
            inside[:2] = np.minimum(inside[:2], 1 - inside[2])
        return inside


def shape_of(kind: str) -> str:
    """The name without the number of nodes."""
    return kind.rstrip("0123456789")


def element_edges(kind: str) -> list[tuple[int, int, int]]:
    """The corners of every edge and the node in its middle, -1 for none."""
    corners = len(_CORNERS[shape_of(kind)])
    middle = {edge: corners + i for i, edge in enumerate(edge_nodes(kind))}
    return [(a, b, middle.get((a, b), -1)) for a, b in _EDGES[shape_of(kind)]]


def element_faces(kind: str, corners: int) -> list[tuple[int, ...]]:
    """The faces of a solid element with so many corners, by their corners."""
    faces = _FACES.get(shape_of(kind), ())
    return [face for face in faces if len(face) == corners]


def edge_nodes(kind: str) -> tuple[tuple[int, int], ...]:
    """The pairs of corners between which the further nodes of an element lie."""
    return _EDGES[shape_of(kind)] if _DEFINITIONS[kind][0] == 2 else ()


@cache
def reference_element(kind: str, integral: str = "stiffness") -> ReferenceElement:
    """The element of that name, one of `ELEMENT_KINDS`.

    Parameters
    ----------
    integral : "stiffness", "stress" or "mass", for which the quadrature is
    """
    _, stiffness, mass = _DEFINITIONS[kind]
    degree = mass if integral == "mass" else stiffness
    points, weights = quadrature_rule(shape_of(kind), degree)
    values, gradients = _tabulate(kind, points)
    corners = len(_CORNERS[shape_of(kind)])
    return ReferenceElement(
        kind, _node_coordinates(kind), corners, points, weights, values, gradients
    )


@cache
def _node_coordinates(kind: str) -> Array:
    corners = _CORNERS[shape_of(kind)]
    return np.vstack(
        [corners, *((corners[a] + corners[b]) / 2 for a, b in edge_nodes(kind))]
    )


@cache
def _shape_exponents(kind: str) -> NDArray[np.int64]:
    """(m, d) powers whose span the shape functions are."""
    shape, order = shape_of(kind), _DEFINITIONS[kind][0]
    dimension = _CORNERS[shape].shape[1]
    member = _SPACES[shape](order)
    powers = [e for e in product(range(order + 1), repeat=dimension) if member(e)]
    return np.array([*powers, *(_RATIONAL[order] if shape == "pyramid" else ())])


@cache
def _shape_coefficients(kind: str) -> Array:
    """(m, m) of the powers (rows) in the shape functions (columns): whole numbers."""
    values, _ = _power_products(kind, _node_coordinates(kind))
    coefficients: Array = np.rint(np.linalg.inv(values))
    return coefficients


def _tabulate(kind: str, points: Array) -> tuple[Array, Array]:
    values, slopes = _power_products(kind, points)
    coefficients = _shape_coefficients(kind)
    gradients = np.empty((*values.shape, len(slopes)), values.dtype)
    for i, slope in enumerate(slopes):
        gradients[:, :, i] = slope @ coefficients
    return values @ coefficients, gradients


def _power_products(kind: str, points: Array) -> tuple[Array, list[Array]]:
    """Products of powers (g, m) at points and their d derivatives (g, m).

    At the apex of a pyramid, where the gradient depends on the direction, it is that
    on the line to the middle of the base.
    """
    bases = points.T
    if shape_of(kind) == "pyramid":
        height = np.maximum(1 - points[:, 2], 1e-14)
        bases = np.array([*points[:, :2].T, height])
        bases[:2, height < 1e-12] = 0.5e-14
    powers, derivatives = [], []
    for base, axis in zip(bases, _axis_powers(kind), strict=True):
        table = np.empty((len(base), len(axis.exponents)), base.dtype)
        for k, exponent in enumerate(axis.exponents):
            table[:, k] = base**exponent
        powers.append(table[:, axis.place])
        derivatives.append(axis.factors * table[:, axis.lowered_place])
    slopes = [
        np.asarray(prod([*powers[:i], derivative, *powers[i + 1 :]]))
        for i, derivative in enumerate(derivatives)
    ]
    return np.asarray(prod(powers)), slopes


@dataclass(frozen=True, eq=False)
class _AxisPowers:
    """Powers of one coordinate in the shape functions: each is computed once, because
    that takes most of the time.

    Attributes
    ----------
    exponents : those of the powers and of their derivatives, without repetition
    place, lowered_place : (m,) where those of the powers and of the derivatives are
    factors : (m,) of the derivatives
    """

    exponents: list[float]
    place: NDArray[np.int64]
    lowered_place: NDArray[np.int64]
    factors: Array


@cache
def _axis_powers(kind: str) -> list[_AxisPowers]:
    """For each coordinate; the third one of a pyramid is the distance from its apex."""
    axes = []
    for i, powers in enumerate(_shape_exponents(kind).T):
        lowered = np.where(powers != 0, powers - 1, 0)
        exponents, places = np.unique([powers, lowered], return_inverse=True)
        place, lowered_place = places.reshape(2, -1)
        sign = -1.0 if shape_of(kind) == "pyramid" and i == 2 else 1.0
        numbers = [float(e) for e in exponents]
        axes.append(_AxisPowers(numbers, place, lowered_place, sign * powers))
    return axes


_SQUARED = sqrt(38 - 44 * sqrt(2 / 5))
_ROOT = sqrt(213125 - 53320 * sqrt(10))
#: Dimension and degree -> barycentric coordinates of one point of every orbit, and the
#: weight of each of its points; the weights sum to 1.
_SYMMETRIC: dict[tuple[int, int], tuple[tuple[tuple[float, ...], float], ...]] = {
    (2, 2): (((1 / 6, 1 / 6, 2 / 3), 1 / 3),),
    (2, 4): tuple(
        ((a, a, 1 - 2 * a), w)
        for a, w in (
            ((8 - sqrt(10) + _SQUARED) / 18, (620 + _ROOT) / 3720),
            ((8 - sqrt(10) - _SQUARED) / 18, (620 - _ROOT) / 3720),
        )
    ),
    (3, 2): ((((5 - sqrt(5)) / 20,) * 3 + ((5 + 3 * sqrt(5)) / 20,), 1 / 4),),
    (3, 5): (
        *(
            ((a, a, a, 1 - 3 * a), w)
            for a, w in (
                (0.31088591926330060980, 0.11268792571801585080),
                (0.092735250310891226402, 0.073493043116361949544),
            )
        ),
        (
            (0.045503704125649649492,) * 2 + (0.454496295874350350508,) * 2,
            0.042546020777081466438,
        ),
    ),
}


@cache
def gauss_legendre(count: int) -> Rule:
    """Points (count,) in [-1, 1] and weights of Gauss's rule, to be read only."""
    rule = np.polynomial.legendre.leggauss(count)
    for array in rule:
        array.setflags(write=False)
    return rule


def quadrature_rule(shape: str, degree: int) -> Rule:
    """Points (g, d) and weights (g,) that sum to the volume of the reference element.

    Parameters
    ----------
    shape : "line", "tri", "quad", "tet", "hex", "wedge" or "pyramid"
    degree : up to which polynomials are integrated exactly: the total degree on
        simplices, the degree in every direction of a product
    """
    line = _line_rule(degree)
    if shape == "line":
        return line
    square = _product_rule(line, line)
    if shape == "quad":
        return square
    if shape == "hex":
        return _product_rule(square, line)
    if shape == "pyramid":
        return _cone_rule(square, degree)
    if shape == "wedge":
        return prism_rule(degree, degree)
    return _simplex_rule(2 if shape == "tri" else 3, degree)


def prism_rule(triangle: int, axis: int) -> Rule:
    """Return the rule on a wedge with these degrees in its triangle and along
    its axis.
    """
    return _product_rule(_simplex_rule(2, triangle), _line_rule(axis))


def _line_rule(degree: int) -> Rule:
    points, weights = gauss_legendre(degree // 2 + 1)
    return (points[:, None] + 1) / 2, weights / 2


def _product_rule(first: Rule, second: Rule) -> Rule:
    """The second one runs fastest."""
    (a, v), (b, w) = first, second
    points = np.hstack([np.repeat(a, len(b), axis=0), np.tile(b, (len(a), 1))])
    return points, np.outer(v, w).ravel()


def _cone_rule(base: Rule, degree: int) -> Rule:
    """A rule on the points ((1 - z) x, z) with x in the base and z from 0 to 1."""
    k = base[0].shape[1]
    from scipy.special import roots_jacobi

    roots, weights = roots_jacobi(degree // 2 + 1, k, 0)
    points, products = _product_rule(
        base, ((roots[:, None] + 1) / 2, weights / 2 ** (k + 1))
    )
    points[:, :k] *= 1 - points[:, k:]
    return points, products


def _simplex_rule(d: int, degree: int) -> Rule:
    if (d, degree) not in _SYMMETRIC:
        return reduce(_cone_rule, [degree] * (d - 1), _line_rule(degree))
    points, weights = [], []
    for barycentric, weight in _SYMMETRIC[d, degree]:
        orbit = sorted(set(permutations(barycentric)))
        points += [point[:d] for point in orbit]
        weights += [weight / factorial(d)] * len(orbit)
    return np.array(points), np.array(weights)
