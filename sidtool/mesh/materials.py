"""Anisotropic linear elastic materials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sidtool.formats.base.complex_step import analytic_norm, number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model import Material

#: Pairs of axes in the order of `continuum.VOIGT`.
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
#: Rows of a law in the plane x y, and the others.
_IN_PLANE, _OUT_OF_PLANE = (0, 1, 3), (2, 4, 5)
#: Smallest stiffness of a strain relative to the largest that is not rounding.
_DEFINITE_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class AnisotropicMaterial:
    """A linear elastic material by its elasticity matrix.

    Attributes
    ----------
    law : (6, 6) stresses xx, yy, zz, xy, yz, xz per strain xx, yy, zz, 2 xy, 2 yz,
        2 xz, in the axes of the body [Pa]
    density : [kg/m^3]
    """

    law: Array
    density: float

    @property
    def moduli(self) -> Array:
        """(3,) Young's moduli along the axes of the body [Pa]."""
        moduli: Array = 1 / np.diag(np.linalg.inv(self.law))[:3]
        return moduli

    @property
    def in_plane(self) -> Array:
        """(3, 3) stresses xx, yy, xy per strain where all others are zero [Pa]."""
        in_plane_block, free = (
            np.ix_(_IN_PLANE, _IN_PLANE),
            np.ix_(_OUT_OF_PLANE, _OUT_OF_PLANE),
        )
        mixed = self.law[np.ix_(_IN_PLANE, _OUT_OF_PLANE)]
        across = np.linalg.solve(self.law[free], mixed.T)
        return np.asarray(self.law[in_plane_block] - mixed @ across, float)

    def scaled(
        self, stress: float, density: float, length: float = 1.0
    ) -> AnisotropicMaterial:
        """In other units."""
        return replace(self, law=self.law * stress, density=self.density * density)

    def turned(self, axes: ArrayLike) -> AnisotropicMaterial:
        """The material whose own axes x, y, z are the rows of a rotation matrix."""
        return replace(self, law=_rotate_law(self.law, np.asarray(axes, float)))


@dataclass(frozen=True, eq=False)
class CylindricalMaterial(AnisotropicMaterial):
    """A material whose axes are the radius, the circumference and the axis of a
    cylinder.

    Attributes
    ----------
    law : in these axes, in the order of `AnisotropicMaterial`
    start, axis : (3,) a point of the axis [m] and its direction, of length 1
    """

    start: Array
    axis: Array

    def laws_at(self, places: Array) -> Array:
        """(..., 6, 6) in the axes of the body at places (..., 3) [m].

        Raises
        ------
        InputError : a position lies on the axis.
        """
        arms = places - self.start
        radial = arms - (arms @ self.axis)[..., None] * self.axis
        radii = analytic_norm(radial, axis=-1, keepdims=True)
        if (radii.real <= 1e-9 * np.abs(arms).max()).any():
            raise InputError(
                "cylindrical material axes are not defined on their axis",
                expected="material beside it",
            )
        radial = radial / radii
        around = np.cross(np.broadcast_to(self.axis, radial.shape), radial)
        along = np.broadcast_to(self.axis, radial.shape)
        return _rotate_law(self.law, np.stack([radial, around, along], axis=-2))

    def scaled(
        self, stress: float, density: float, length: float = 1.0
    ) -> CylindricalMaterial:
        law, density = self.law * stress, self.density * density
        return replace(self, law=law, density=density, start=self.start * length)


def laws_of_material(material: ElasticMaterial) -> Callable[[Array], Array] | None:
    """Return the laws at positions of a material with varying axes, else None."""
    return material.laws_at if isinstance(material, CylindricalMaterial) else None


def _rotate_law(law: Array, axes: Array) -> Array:
    """(..., 6, 6) a law (6, 6) whose own axes are the rows of axes (..., 3, 3)."""
    turn = np.zeros((*axes.shape[:-2], 6, 6), number_type(axes))
    for row, (a, b) in enumerate(_PAIRS):
        for column, (i, j) in enumerate(_PAIRS):
            pair = axes[..., i, a] * axes[..., j, b]
            other = axes[..., j, a] * axes[..., i, b]
            turn[..., row, column] = pair if i == j else pair + other
    return np.asarray(turn @ law @ np.swapaxes(turn, -1, -2))


#: What elements are made of.
ElasticMaterial = Material | AnisotropicMaterial


def orthotropic_law(values: ArrayLike) -> Array:
    """The law of E1, E2, E3, nu12, nu13, nu23, G12, G13, G23.

    nu12 is the contraction along 2 under tension along 1.

    Raises
    ------
    InputError : a modulus is not positive.
    """
    e1, e2, e3, nu12, nu13, nu23, g12, g13, g23 = np.asarray(values, float)
    if min(e1, e2, e3, g12, g13, g23) <= 0:
        raise InputError(
            "a modulus of an orthotropic material is not above zero",
            expected="E1, E2, E3, nu12, nu13, nu23, G12, G13, G23",
        )
    compliance = np.diag([1 / e1, 1 / e2, 1 / e3, 1 / g12, 1 / g23, 1 / g13])
    for (i, j), share in (
        ((0, 1), -nu12 / e1),
        ((0, 2), -nu13 / e1),
        ((1, 2), -nu23 / e2),
    ):
        compliance[i, j] = compliance[j, i] = share
    check_positive_definite(compliance)
    law: Array = np.linalg.inv(compliance)
    return (law + law.T) / 2


def check_positive_definite(law: Array) -> None:
    """Check that every strain has positive energy.

    Raises
    ------
    InputError : a strain has no positive energy.
    """
    is_definite = bool((np.diag(law) > 0).all())
    if is_definite:
        sizes = np.sqrt(np.diag(law))
        values = np.linalg.eigvalsh(law / sizes / sizes[:, None])
        is_definite = bool(values[0] > _DEFINITE_TOLERANCE * values[-1])
    if not is_definite:
        raise InputError(
            "an anisotropic material has a strain that takes no energy",
            expected="constants whose matrix is positive definite",
        )
