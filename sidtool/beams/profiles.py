"""Values along a beam between stations: piecewise linear, spline or polynomial."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from sidtool.formats.base.taylor import Array


@dataclass(frozen=True)
class Profile:
    """A piecewise polynomial over the fraction of the length of a beam.

    Attributes
    ----------
    edges : (n + 1,) fractions from 0 to 1 between which the pieces hold
    pieces : (n,) polynomials of the fraction
    """

    edges: tuple[float, ...]
    pieces: tuple[Polynomial, ...]

    def __call__(self, fractions: Array) -> Array:
        """Values at fractions (n,)."""
        if len(self.pieces) == 1:
            return np.asarray(self.pieces[0](fractions))
        k = np.searchsorted(self.edges[1:-1], fractions, side="right")
        values = np.zeros(np.shape(fractions))
        for i in np.unique(k):
            values = np.where(k == i, self.pieces[i](fractions), values)
        return values

    def __mul__(self, other: Profile) -> Profile:
        edges = np.union1d(self.edges, other.edges)
        middles = (edges[:-1] + edges[1:]) / 2
        pieces = [self._at(x) * other._at(x) for x in middles.tolist()]
        return Profile(tuple(edges.tolist()), tuple(pieces))

    @property
    def degree(self) -> int:
        return max(piece.degree() for piece in self.pieces)

    @property
    def is_zero(self) -> bool:
        return not any(piece.coef.any() for piece in self.pieces)

    def derivative(self) -> Profile:
        """Return the derivative by the fraction."""
        return Profile(self.edges, tuple(piece.deriv() for piece in self.pieces))

    def integral(self) -> float:
        """From 0 to 1."""
        parts = zip(self.edges, self.edges[1:], self.pieces, strict=False)
        return float(sum(p.integ(lbnd=a)(b) for a, b, p in parts))

    def _at(self, fraction: float) -> Polynomial:
        return self.pieces[int(np.searchsorted(self.edges[1:-1], fraction, "right"))]


def profile(values: float | tuple[float, ...], interpolation: str) -> Profile:
    """Through values at equal steps from start to end; one value holds everywhere."""
    if not isinstance(values, tuple) or len(values) == 1:
        constant = values[0] if isinstance(values, tuple) else values
        return Profile((0.0, 1.0), (Polynomial([constant]),))
    return _INTERPOLATIONS[interpolation](np.array(values, float))


def _linear_profile(values: Array) -> Profile:
    edges = np.linspace(0.0, 1.0, len(values))
    lines = []
    for x, y, slope in zip(
        edges, values, np.diff(values) / np.diff(edges), strict=False
    ):
        lines.append(Polynomial([y - slope * x, slope]))
    return Profile(tuple(edges.tolist()), tuple(lines))


def _spline_profile(values: Array) -> Profile:
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(np.linspace(0.0, 1.0, len(values)), values)
    pieces = [
        Polynomial(terms[::-1])(Polynomial([-float(start), 1.0]))
        for start, terms in zip(spline.x, spline.c.T, strict=False)
    ]
    return Profile(tuple(spline.x.tolist()), tuple(pieces))


def _polynomial_profile(values: Array) -> Profile:
    x = np.linspace(0.0, 1.0, len(values))
    terms = np.linalg.solve(np.vander(x, increasing=True), values)
    return Profile((0.0, 1.0), (Polynomial(terms),))


_INTERPOLATIONS: dict[str, Callable[[Array], Profile]] = {
    "linear": _linear_profile,
    "smooth": _spline_profile,
    "polynomial": _polynomial_profile,
}
