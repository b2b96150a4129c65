"""Integration points of beam elements: mass and stiffness."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.taylor import Array
from sidtool.formats.sid_mass import skew

from ..elements.material_points import BeamMaterial, InertiaPoints
from .axis import AxisFrames
from .element import GAUSS_POINTS, GAUSS_WEIGHTS, BeamElement, ElementRows

Indices = NDArray[np.int64]


class RowCollector:
    """Rows of a matrix, a few at a time, by the degrees of freedom that they hold."""

    def __init__(self, ndof: int) -> None:
        self._ndof = ndof
        self._rows: list[Array] = []
        self._dofs: list[Indices] = []

    def add(self, rows: Array, dofs: Indices) -> None:
        """Rows (r, k) of degrees of freedom (k,), of which some may be the same."""
        self._rows.append(rows)
        self._dofs.append(dofs)

    def matrix(self) -> sp.csr_matrix:
        """All of them, (n, ndof)."""
        counts = np.concatenate([np.full(*rows.shape) for rows in self._rows])
        columns = [
            np.tile(dofs, len(rows))
            for rows, dofs in zip(self._rows, self._dofs, strict=True)
        ]
        values = np.concatenate([rows.ravel() for rows in self._rows])
        starts = np.concatenate([[0], np.cumsum(counts)])
        shape = (len(counts), self._ndof)
        row_matrix = sp.csr_matrix(
            (values, np.concatenate(columns), starts), shape=shape
        )
        row_matrix.sum_duplicates()
        return row_matrix


class ParticleCollector:
    """Collects the points that carry the mass."""

    def __init__(self, ndof: int) -> None:
        self.ndof = ndof
        self._where: list[Array] = []
        self._masses: list[float] = []
        self._inertias: list[Array] = []
        self._displacement, self._rotation = RowCollector(ndof), RowCollector(ndof)

    def add(
        self,
        where: Array,
        mass: float,
        inertia: Array,
        displacement: Array,
        rotation: Array,
        dofs: Indices,
    ) -> None:
        """A piece, by rows (3, k) of its motion by degrees of freedom (k,)."""
        self._where.append(where)
        self._masses.append(mass)
        self._inertias.append(inertia)
        self._displacement.add(displacement, dofs)
        self._rotation.add(rotation, dofs)

    def add_slices(self, element: BeamElement, dofs: Indices, density: float) -> None:
        """Slices of the beam at its Gauss points."""
        frames = element.gauss_frames
        pieces = zip(
            *slice_inertia(element, frames, GAUSS_POINTS, GAUSS_WEIGHTS, density),
            strict=True,
        )
        places = frames.places
        for rows, place, piece in zip(element.gauss_rows, places, pieces, strict=True):
            self._add_rigid_piece(rows, dofs, place, *piece)

    def add_half_elements(
        self, element: BeamElement, dofs: Indices, density: float
    ) -> None:
        """The two halves of an element, each a rigid piece that its node carries."""
        for end in (0.0, 1.0):
            places = abs(end - GAUSS_POINTS / 2)
            frames, half = element.frames(places), GAUSS_WEIGHTS / 2
            centres, masses, tensors = slice_inertia(
                element, frames, places, half, density
            )
            mass = masses.sum()
            centre = masses @ centres / mass
            spread = skew(centres - centre)
            tensor = tensors.sum(axis=0) - np.einsum(
                "p,pab,pbc->ac", masses, spread, spread
            )
            place = element.frames(np.array([end])).places[0]
            self._add_rigid_piece(element.rows(end), dofs, place, centre, mass, tensor)

    def _add_rigid_piece(
        self,
        rows: ElementRows,
        dofs: Indices,
        place: Array,
        centre: Array,
        mass: float,
        tensor: Array,
    ) -> None:
        """A piece that is fixed to the section at a place of an element."""
        arm = skew(centre - place)
        moved = rows.displacement - arm @ rows.rotation
        self.add(centre, mass, tensor, moved, rows.rotation, dofs)

    def points(self) -> InertiaPoints:
        return InertiaPoints(
            positions=np.array(self._where),
            masses=np.array(self._masses),
            inertias=np.array(self._inertias),
            displacement=self._displacement.matrix(),
            rotation=self._rotation.matrix(),
        )


def slice_inertia(
    element: BeamElement,
    frames: AxisFrames,
    places: Array,
    weights: Array,
    density: float,
) -> tuple[Array, Array, Array]:
    """Centres (p, 3), masses (p,) and central inertias (p, 3, 3) of slices.

    Parameters
    ----------
    frames : of the element at its fractions `places` (p,)
    """
    centres, masses, tensors = [], [], []
    for i, weight in enumerate(weights * element.length):
        p = element.section(places[i])
        arm = p.centre(frames.curvatures[i])
        own = density * weight * np.diag([p.iy + p.iz, p.iy, p.iz])
        mass = density * weight * p.area
        own += mass * skew(arm) @ skew(arm)
        centres.append(frames.places[i] + arm @ frames.axes[i])
        masses.append(mass)
        tensors.append(rotate_tensor(own, frames.axes[i]))
    return np.array(centres), np.array(masses), np.array(tensors)


class MaterialPointCollector:
    """Collects the points of `BeamMaterial`."""

    def __init__(self, ndof: int) -> None:
        self._rows = [RowCollector(ndof) for _ in range(3)]
        self._weights: list[float] = []
        self._gyration: list[list[float]] = []
        self._curvatures: list[Array] = []

    def add(self, element: BeamElement, dofs: Indices) -> None:
        """The Gauss points of an element."""
        frames = element.gauss_frames
        for k, (place, rows) in enumerate(
            zip(GAUSS_POINTS, element.gauss_rows, strict=True)
        ):
            p = element.section(place)
            turns = frames.axes[k] @ rows.rotation
            for kept, some in zip(
                self._rows, (rows.strains, turns, rows.resultants), strict=True
            ):
                kept.add(some, dofs)
            self._gyration.append([p.iy / p.area, p.iz / p.area])
        self._weights.extend(GAUSS_WEIGHTS * element.length)
        self._curvatures.extend(frames.curvatures)

    def material(self) -> BeamMaterial:
        strains, turns, forces = (rows.matrix() for rows in self._rows)
        return BeamMaterial(
            weights=np.array(self._weights),
            strains=strains,
            turns=turns,
            resultants=forces,
            gyration=np.array(self._gyration),
            curvatures=np.array(self._curvatures),
        )


def rotate_tensor(tensor: Array, axes: Array) -> Array:
    return np.asarray(axes.T @ tensor @ axes)


def scatter_rows(rows: Array, dofs: Indices, ndof: int) -> sp.csr_matrix:
    """(r, k) for some degrees of freedom (k,) as (r, ndof)."""
    count = len(rows)
    index = (np.repeat(np.arange(count), len(dofs)), np.tile(dofs, count))
    return sp.csr_matrix((rows.ravel(), index), shape=(count, ndof))
