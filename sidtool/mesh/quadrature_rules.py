"""Quadrature on the reference elements: unit cube, simplex, prism and pyramid.

Boxes and prisms take products of rules. Triangles, tetrahedra and pyramids are cones
over their base: the points of the base shrink towards the apex, and the measure with
them as (1 - z)^k over a base of k dimensions. Low degrees of simplices have symmetric
rules of fewer points, all of positive weight.

Sources: A. H. Stroud, "Approximate Calculation of Multiple Integrals", 1971, sections
2.2 to 2.5; D. A. Dunavant, Int. J. Numer. Methods Eng. 21, 1985 (triangles);
N. J. Walkington, "Quadrature on simplices of arbitrary dimension", 2000 (tetrahedra).
"""

from __future__ import annotations

from functools import cache, reduce
from itertools import permutations
from math import factorial, sqrt

import numpy as np

from sidtool.formats.base.taylor import Array

Rule = tuple[Array, Array]

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
