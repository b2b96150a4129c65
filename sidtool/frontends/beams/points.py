"""The points of beam elements that carry their mass, and those of their stiffness."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.sid_mass import skew

from ..elements.inertia_points import InertiaPoints
from .element import PLACES, WEIGHTS, Element, Rows
from .material import BeamMaterial

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Particles:
    """Collects the points that carry the mass."""

    def __init__(self, ndof: int) -> None:
        self.ndof = ndof
        self._where: list[Array] = []
        self._masses: list[float] = []
        self._inertias: list[Array] = []
        self._displacement: list[sp.csr_matrix] = []
        self._rotation: list[sp.csr_matrix] = []

    def add(
        self,
        where: Array,
        mass: float,
        inertia: Array,
        displacement: sp.csr_matrix,
        rotation: sp.csr_matrix,
    ) -> None:
        self._where.append(where)
        self._masses.append(mass)
        self._inertias.append(inertia)
        self._displacement.append(displacement)
        self._rotation.append(rotation)

    def distribute(self, element: Element, dofs: Indices, density: float) -> None:
        """Slices of the beam at its Gauss points."""
        pieces = zip(*slices(element, PLACES, WEIGHTS, density), strict=True)
        places = element.frames(PLACES).places
        for rows, place, piece in zip(element.gauss_rows, places, pieces, strict=True):
            self._carry(rows, dofs, place, *piece)

    def lump(self, element: Element, dofs: Indices, density: float) -> None:
        """The two halves of an element, each a rigid piece that its node carries."""
        for end in (0.0, 1.0):
            places = abs(end - PLACES / 2)
            centres, masses, tensors = slices(element, places, WEIGHTS / 2, density)
            mass = masses.sum()
            centre = masses @ centres / mass
            spread = skew(centres - centre)
            tensor = tensors.sum(axis=0) - np.einsum(
                "p,pab,pbc->ac", masses, spread, spread
            )
            place = element.frames(np.array([end])).places[0]
            self._carry(element.rows(end), dofs, place, centre, mass, tensor)

    def _carry(
        self,
        rows: Rows,
        dofs: Indices,
        place: Array,
        centre: Array,
        mass: float,
        tensor: Array,
    ) -> None:
        """A piece that is fixed to the section at a place of an element."""
        arm = skew(centre - place)
        moved = placed(rows.displacement - arm @ rows.rotation, dofs, self.ndof)
        self.add(centre, mass, tensor, moved, placed(rows.rotation, dofs, self.ndof))

    def points(self) -> InertiaPoints:
        return InertiaPoints(
            positions=np.array(self._where),
            masses=np.array(self._masses),
            inertias=np.array(self._inertias),
            displacement=sp.vstack(self._displacement, format="csr"),
            rotation=sp.vstack(self._rotation, format="csr"),
        )


def slices(
    element: Element, places: Array, weights: Array, density: float
) -> tuple[Array, Array, Array]:
    """Centres (p, 3), masses (p,) and central inertias (p, 3, 3) of slices."""
    frames = element.frames(places)
    centres, masses, tensors = [], [], []
    for i, weight in enumerate(weights * element.length):
        p = element.section(places[i])
        arm = p.centre(frames.curvatures[i])
        own = density * weight * np.diag([p.iy + p.iz, p.iy, p.iz])
        mass = density * weight * p.area
        own += mass * skew(arm) @ skew(arm)
        centres.append(frames.places[i] + arm @ frames.axes[i])
        masses.append(mass)
        tensors.append(turned(own, frames.axes[i]))
    return np.array(centres), np.array(masses), np.array(tensors)


class MaterialPoints:
    """Collects the points of `BeamMaterial`."""

    def __init__(self, ndof: int) -> None:
        self._ndof = ndof
        self._rows: list[list[sp.csr_matrix]] = [[], [], []]
        self._weights: list[float] = []
        self._gyration: list[list[float]] = []
        self._curvatures: list[Array] = []

    def add(self, element: Element, dofs: Indices) -> None:
        """The Gauss points of an element."""
        frames = element.frames(PLACES)
        for k, (place, rows) in enumerate(zip(PLACES, element.gauss_rows, strict=True)):
            p = element.section(place)
            turns = frames.axes[k] @ rows.rotation
            for kept, some in zip(
                self._rows, (rows.strains, turns, rows.resultants), strict=True
            ):
                kept.append(placed(some, dofs, self._ndof))
            self._gyration.append([p.iy / p.area, p.iz / p.area])
        self._weights.extend(WEIGHTS * element.length)
        self._curvatures.extend(frames.curvatures)

    def material(self) -> BeamMaterial:
        strains, turns, forces = (sp.vstack(rows, format="csr") for rows in self._rows)
        return BeamMaterial(
            weights=np.array(self._weights),
            strains=strains,
            turns=turns,
            resultants=forces,
            gyration=np.array(self._gyration),
            curvatures=np.array(self._curvatures),
        )


def turned(tensor: Array, axes: Array) -> Array:
    return np.asarray(axes.T @ tensor @ axes)


def placed(rows: Array, dofs: Indices, ndof: int) -> sp.csr_matrix:
    """(r, k) for some degrees of freedom (k,) as (r, ndof)."""
    count = len(rows)
    index = (np.repeat(np.arange(count), len(dofs)), np.tile(dofs, count))
    return sp.csr_matrix((rows.ravel(), index), shape=(count, ndof))
