"""Whether a discretised body has the mass and the centre of its geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError

from ..geometry.measure import patch_moments
from ..geometry.patch import NurbsPatch
from .finite_element_model import FiniteElementModel

Array = NDArray[np.float64]

#: Differences of mass, and of the centre relative to the size, that are refused where
#: the discretisation is exact, and told where it samples the geometry.
_EXACT, _TOLD = 1e-6, 1e-3


@dataclass(frozen=True, eq=False)
class GeometryMass:
    """What a body should have, by integrals over its surface.

    Attributes
    ----------
    mass : [kg]
    first : (d,) first moments [kg m]
    sampled : whether the mesh only approximates the geometry
    """

    mass: float
    first: Array
    sampled: bool = False


def patch_mass(
    patches: list[NurbsPatch], density: float, *, sampled: bool = False
) -> GeometryMass:
    """Of patches with this mass per volume, in the plane per area."""
    moments = [patch_moments(patch) for patch in patches]
    mass = density * sum(volume for volume, _ in moments)
    first = density * np.sum([first for _, first in moments], axis=0)
    return GeometryMass(mass, first, sampled)


def compared_with_geometry(body: FiniteElementModel) -> tuple[str, ...]:
    """Sentences on how far mass and centre are from those of the geometry.

    Raises
    ------
    InputError : the discretisation is exact, and they differ.
    """
    if body.geometry_mass is None:
        return ()
    expected = body.geometry_mass()
    mass, centre = _mass_and_centre(body)
    size = np.ptp(body.positions, axis=0).max()
    off = mass / expected.mass - 1
    moved = float(np.linalg.norm(centre - expected.first / expected.mass))
    worst = max(abs(off), moved / size)
    text = f"mass {100 * off:+.3g} %, centre {moved:.3g} m away"
    if expected.sampled:
        if worst <= _TOLD:
            return ()
        return (
            f"the mesh differs from its geometry ({text}): more elements follow it",
        )
    if worst > _EXACT:
        raise InputError(
            f"the discretised body does not have the mass of its geometry ({text})",
            place="discretisation",
            expected="more elements where weights differ much, or weights of like size",
        )
    return ()


def _mass_and_centre(body: FiniteElementModel) -> tuple[float, Array]:
    """Of the continuum; of a body of beams from the momenta of rigid motions."""
    if body.scalar_mass is not None:
        weights = np.asarray(body.scalar_mass.sum(axis=0)).ravel()
        return float(weights.sum()), weights @ body.positions / weights.sum()
    rigid = body.rigid_body_modes()
    momenta = rigid[:, :3].T @ (body.mass @ rigid)
    mass = float(np.trace(momenta[:, :3])) / 3.0
    # a rotation about e moves the centre c by e x c
    arms = momenta[:, 3:] / mass
    return mass, np.array([arms[1, 2], arms[2, 0], arms[0, 1]])
