"""Cross-sections of beams, their stiffness, and values that vary along the axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache, partial
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from sidtool.formats.base.complex_step import analytic_abs, number_type, numbers
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model.beams import (
    BeamGeometry,
    GeneralSection,
    RectangularSection,
)
from sidtool.formats.sid_mass import skew

from ..mesh.reference_elements import gauss_legendre
from .section_shapes import named_properties

#: Sections are smaller than this [m].
LARGEST_SECTION = 1e9
#: Gauss points per direction of a rectangle, and terms of its warping.
_POINTS, _TERMS = 10, 6
#: Terms of the series of torsion of a rectangle, of which the first left out is 3e-9.
_TORSION_TERMS = 25


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
        if self.is_constant:
            return np.asarray(self.pieces[0].coef[0] + np.zeros_like(fractions))
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
    def is_constant(self) -> bool:
        return len(self.pieces) == 1 and len(self.pieces[0].coef) == 1

    @property
    def is_zero(self) -> bool:
        return not any(piece.coef.any() for piece in self.pieces)

    @cached_property
    def derivative(self) -> Profile:
        """The derivative by the fraction."""
        return Profile(self.edges, tuple(piece.deriv() for piece in self.pieces))

    def integral(self) -> float:
        """From 0 to 1."""
        parts = zip(self.edges, self.edges[1:], self.pieces, strict=False)
        return float(sum(p.integ(lbnd=a)(b) for a, b, p in parts))

    def at(self, fraction: float) -> Any:
        """Return the value at one fraction."""
        return self._at(fraction)(fraction)

    def _at(self, fraction: float) -> Polynomial:
        return self.pieces[int(np.searchsorted(self.edges[1:-1], fraction, "right"))]


def profile(values: float | tuple[float, ...], interpolation: str) -> Profile:
    """Through values at equal steps from start to end; one value holds everywhere."""
    if not isinstance(values, tuple) or len(values) == 1:
        constant = values[0] if isinstance(values, tuple) else values
        return Profile((0.0, 1.0), (Polynomial([constant]),))
    return _INTERPOLATIONS[interpolation](numbers(values))


def _linear_profile(values: Array) -> Profile:
    return linear_profile(np.linspace(0.0, 1.0, len(values)), values)


def linear_profile(fractions: Array, values: Array) -> Profile:
    """Straight lines through values at ascending fractions; two at one are a step."""
    apart = np.diff(fractions) > 0
    starts = fractions[:-1][apart]
    slopes = np.diff(values)[apart] / np.diff(fractions)[apart]
    lines = [
        Polynomial([y - slope * x, slope])
        for x, y, slope in zip(starts, values[:-1][apart], slopes, strict=True)
    ]
    return Profile((*starts.tolist(), float(fractions[-1])), tuple(lines))


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


@dataclass(frozen=True)
class Section:
    """Properties of a cross-section in its principal axes, see `GeneralSection`.

    Attributes
    ----------
    sides : of a rectangle [m]
    shear_coupling : shear area of the force along one axis by shear along the other,
        over the area
    shear_centre : (2,) y, z from the centroid [m]
    third_moments : integrals of yyy, yyz, yzz, zzz [m^5]
    """

    area: float
    iy: float
    iz: float
    torsion: float
    shear_y: float
    shear_z: float
    sides: tuple[float, float] | None = None
    shear_coupling: float = 0.0
    shear_centre: tuple[float, float] = (0.0, 0.0)
    third_moments: tuple[float, float, float, float] = (0.0,) * 4

    @property
    def stress_moments(self) -> Array:
        """(3, 3) as of `BeamMaterial`; rods have no moments."""
        own = np.array([self.iz, 0.0, self.iy]) / self.area
        third, zero = np.array(self.third_moments), np.zeros(3)
        about_y = third[1:] / self.iy if self.iy else zero
        about_z = -third[:3] / self.iz if self.iz else zero
        return np.stack([own, about_y, about_z])

    def inertia(self, density: float, curvatures: Array) -> tuple[float, Array, Array]:
        """Mass per length [kg/m], its centre (3,) [m] in the axes of the section, and
        its tensor (3, 3) about the centre [kg m].
        """
        arm = self.centre(curvatures)
        mass = density * self.area
        tensor = density * np.diag([self.iy + self.iz, self.iy, self.iz])
        return mass, arm, tensor + mass * skew(arm) @ skew(arm)

    def compliance(self, e: float, g: float, curvatures: Array, shear: bool) -> Array:
        """(6, 6) strains of resultants about the centroid, see `law`.

        Parameters
        ----------
        shear : whether cross-sections shear (Timoshenko)

        Raises
        ------
        InputError : the section reaches the centre of curvature of the axis.
        """
        return _section_compliance(self, e, g, tuple(curvatures.tolist()), shear)

    @property
    def halves(self) -> Array:
        """(2,) half the sides, along y and z, of the rectangle with the same area and
        moments; of the square where these are not known [m]."""
        squares = 3 * np.array([self.iz, self.iy]) / self.area
        return np.asarray(np.sqrt(np.where(squares.real > 0, squares, self.area / 4)))

    def law(self, e: float, g: float, curvatures: Array) -> Array:
        """(6, 6) resultants N, Qy, Qz, T, My, Mz of strains in their order.

        T is the moment about the shear centre, and shears are those of the line of
        shear centres; see `about_centroid`.

        Strains: stretch, shears xy and xz, twist, curvatures about y and z. A fibre at
        (y, z) of a beam of curvatures (t, ky, kz) has the length 1 + z ky - y kz, and
        its strain is the product of (1, t e, z, -y) and the stretch, the twist and the
        two curvatures, divided by that length (Winkler); t e is what the warping of
        the section makes of pre-twist, e = z dw/dy - y dw/dz with Saint-Venant's
        warping function w. Of e a general section knows the mean only, the polar
        moment less the torsion constant.
        """
        bending = self.area, self.iy, self.iz, self.torsion
        shears = self.shear_y, self.shear_z
        result = np.zeros((6, 6), number_type(e, g, *bending, *shears, *curvatures))
        axial = np.ix_([0, 3, 4, 5], [0, 3, 4, 5])
        moments = self._of_rectangle if self.sides else self._of_general
        result[axial] = e * moments(np.asarray(curvatures))
        result[3, 3] += g * self.torsion
        result[1, 1], result[2, 2] = (
            g * self.area * share for share in (self.shear_y, self.shear_z)
        )
        result[1, 2] = result[2, 1] = g * self.area * self.shear_coupling
        return result

    def about_centroid(self, compliance: Array) -> Array:
        """Return a compliance (6, 6) by resultants about the centroid.

        Parameters
        ----------
        compliance : by resultants of which T is about the shear centre: with forces
            through the centroid it is T + z Qy - y Qz
        """
        y, z = self.shear_centre
        if not (y or z):
            return compliance
        moved = np.eye(6, dtype=number_type(y, z))
        moved[3, 1:3] = z, -y
        return np.asarray(moved.T @ compliance @ moved)

    def centre(self, curvatures: Array) -> Array:
        """(3,) of the mass of a slice: a bent one is longer outside [m]."""
        _, ky, kz = curvatures
        return np.array([0.0, -kz * self.iz, ky * self.iy]) / self.area

    def _of_general(self, curvatures: Array) -> Array:
        twist, ky, kz = curvatures
        mean = twist * (self.iy + self.iz - self.torsion) / self.area
        stretch = self.area + ky**2 * self.iy + kz**2 * self.iz
        bend = np.array([-ky * self.iy, -kz * self.iz])
        result = np.diag([stretch, mean**2 * self.area, self.iy, self.iz])
        result[0, 1] = result[1, 0] = mean * self.area
        result[0, 2:] = result[2:, 0] = bend
        return result

    def _of_rectangle(self, curvatures: Array) -> Array:
        assert self.sides is not None
        (height, width), (twist, ky, kz) = self.sides, curvatures
        x, w = gauss_legendre(_POINTS)
        y, z = (a.ravel() for a in np.meshgrid(height / 2 * x, width / 2 * x))
        area = np.multiply.outer(w, w).ravel() * self.area / 4
        length = 1 + z * ky - y * kz
        slanted = twist * _warping_slope(y, z, height, width) if twist else 0 * y
        strains = np.stack([np.ones_like(y), slanted, z, -y])
        return np.asarray((strains * area / length) @ strains.T)


@lru_cache(maxsize=4096)
def _section_compliance(
    section: Section, e: float, g: float, curvatures: tuple[float, ...], shear: bool
) -> Array:
    bent = np.array(curvatures[1:])
    halves = np.sqrt(3 * np.array([section.iy, section.iz]) / section.area)
    if float(halves.real @ np.abs(bent.real)) >= 1:
        radius = 1 / np.linalg.norm(bent.real)
        raise InputError(
            f"is larger than the radius of the axis, {radius:.3g} m",
            place="geometry.section",
            expected="a section that does not reach the centre of curvature",
        )
    compliance: Array = np.asarray(
        np.linalg.inv(section.law(e, g, np.array(curvatures)))
    )
    if not shear:
        compliance[[1, 2]] = 0.0
        compliance[:, [1, 2]] = 0.0
    compliance = section.about_centroid(compliance)
    compliance.setflags(write=False)
    return compliance


def _warping_slope(y: Array, z: Array, height: float, width: float) -> Array:
    """z dw/dy - y dw/dz of the warping function w of a rectangle.

    w = -y z + 8 b^2 / pi^3 sum (-1)^((n - 1) / 2) / n^3 sinh(n pi y / b) /
    cosh(n pi h / 2 b) sin(n pi z / b), n odd, h along y and b along z (Timoshenko and
    Goodier, Theory of Elasticity, section 109).
    """
    n = 2 * np.arange(_TERMS)[:, None] + 1
    k = n * np.pi / width
    sign = (-1) ** ((n - 1) // 2) * 8 / np.pi**2 / n**2 * width
    size = analytic_abs(y)
    near = np.exp(k * (size - height / 2)) / (1 + np.exp(-k * height))
    mirrored = np.exp(-2 * k * size)
    sinh, cosh = np.sign(y.real) * near * (1 - mirrored), near * (1 + mirrored)
    along_y = -z + (sign * cosh * np.sin(k * z)).sum(axis=0)
    along_z = -y + (sign * sinh * np.cos(k * z)).sum(axis=0)
    return np.asarray(z * along_y - y * along_z)


def section_at(
    geometry: BeamGeometry, fraction: float, poissons_ratio: float = 0.0
) -> Section:
    """The cross-section at a fraction of the length.

    Named sections have properties of `section_shapes`; Poisson's ratio enters the shear
    of circles and tubes. The torsion constant of a rectangle is that of a series.

    Raises
    ------
    InputError : a size is not positive there, or contradicts another one.
    """
    section = geometry.section
    assert section is not None
    if isinstance(section, GeneralSection):
        torsion = section.torsion or section.iy + section.iz
        shear = section.shear_y, section.shear_z
        return Section(section.area, section.iy, section.iz, torsion, *shear)
    if not isinstance(section, RectangularSection):
        named = named_properties(section, poissons_ratio)
        return Section(
            named.area,
            named.iy,
            named.iz,
            named.torsion,
            named.shear_y,
            named.shear_z,
            shear_coupling=named.shear_coupling,
            shear_centre=named.shear_centre,
            third_moments=named.third_moments,
        )
    h, w = (_side_at(geometry, name, fraction) for name in ("height", "width"))
    larger = max(h.real, w.real)
    if not larger < LARGEST_SECTION:
        raise InputError(
            f"is {larger:g} m at {fraction.real:.3g} of the length",
            place="geometry.section",
            expected=f"a section below {LARGEST_SECTION:g} m",
        )
    torsion = _torsion_of_rectangle(h, w)
    return Section(h * w, h * w**3 / 12, w * h**3 / 12, torsion, 5 / 6, 5 / 6, (h, w))


def sections_along(
    geometry: BeamGeometry, poissons_ratio: float
) -> Callable[[float], Section]:
    """Return the cross-section by the fraction of the length, see `section_at`.

    A uniform beam has one object everywhere.

    Raises
    ------
    InputError : the section of a uniform beam is unsound.
    """
    sides: list[Profile] = []
    if isinstance(geometry.section, RectangularSection):
        sides = [side_profile(geometry, name) for name in ("height", "width")]
    if all(side.is_constant for side in sides):
        uniform = section_at(geometry, 0.0, poissons_ratio)
        return lambda fraction: uniform
    return cache(partial(section_at, geometry, poissons_ratio=poissons_ratio))


def _torsion_of_rectangle(h: Any, w: Any) -> Any:
    """Return the torsion constant of de Saint-Venant's theory, by its series.

    S. P. Timoshenko, J. N. Goodier: Theory of Elasticity, section 109.
    """
    a, b = (h, w) if h.real > w.real else (w, h)
    odd = np.arange(1, 2 * _TORSION_TERMS, 2)
    total = np.sum(np.tanh(0.5 * np.pi * odd * (a / b)) / odd**5)
    return a * b**3 * (1 / 3 - 64 / np.pi**5 * (b / a) * total)


def _side_at(geometry: BeamGeometry, name: str, fraction: float) -> Any:
    value = side_profile(geometry, name).at(fraction)
    if value.real <= 0:
        raise InputError(
            f"becomes {value.real:.3g} at {fraction.real:.3g} of the length",
            place=f"geometry.section.{name}",
            expected='values that stay positive, as with interpolation = "linear"',
        )
    return value


def side_profile(geometry: BeamGeometry, name: str) -> Profile:
    """The height or the width of a rectangular section along a beam [m]."""
    return _positive_sides(getattr(geometry.section, name), geometry.interpolation)


_positive_sides = lru_cache(maxsize=64)(profile)


def section_turn(geometry: BeamGeometry) -> float:
    """Return the angle of the principal axes of a named section from its y axis.

    It counts from y towards z [rad].
    """
    section = geometry.section
    if section is None or isinstance(section, GeneralSection | RectangularSection):
        return 0.0
    return named_properties(section, 0.0).turn
