"""Beam element from the exact static solution, and points of mass and stiffness."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from sidtool.formats.base.complex_step import number_type, without_rounding
from sidtool.formats.base.sid import Array
from sidtool.formats.sid_mass import skew

from ..elements.material_points import BeamMaterial, InertiaPoints
from .axis import Axis, AxisFrames
from .cross_section import Section
from .station_section import StationSection

_X, _W = np.polynomial.legendre.leggauss(4)
#: Gauss points in [0, 1] and their weights.
GAUSS_POINTS, GAUSS_WEIGHTS = (_X + 1) / 2, _W / 2
_CUTS = np.concatenate([[0.0], GAUSS_POINTS, [1.0]])

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BeamProperties:
    """The beam that elements are parts of.

    Attributes
    ----------
    section : by the fraction of its length
    e, g : Young's and the shear modulus [Pa]; without effect on sections at stations
    shear : whether cross-sections shear (Timoshenko)
    """

    section: Callable[[float], Section | StationSection]
    axis: Axis
    e: float
    g: float
    shear: bool


class ElementRows(NamedTuple):
    """Rows of the motion of an element at n positions, by its degrees of freedom.

    Attributes
    ----------
    displacement, rotation : (n, 3, 12) in the axes of the model
    strains, resultants : (n, 6, 12) in those of the section: stretch, shears xy and
        xz, twist, curvatures about y and z; N, Qy, Qz, T, My, Mz
    """

    displacement: Array
    rotation: Array
    strains: Array
    resultants: Array


@dataclass(frozen=True, eq=False)
class BeamElement:
    """The part of a beam between two fractions of its length."""

    beam: BeamProperties
    first: float
    last: float

    @property
    def length(self) -> float:
        """[m]"""
        return (self.last - self.first) * self.beam.axis.length

    def frames(self, places: Array) -> AxisFrames:
        """Return the frames at fractions (n,) of the element."""
        return self.beam.axis.at(self.first + places * (self.last - self.first))

    def section(self, place: float) -> Section | StationSection:
        """Return the section at a fraction of the element."""
        fraction = self.first + place * (self.last - self.first)
        return self.beam.section(fraction)

    def rows(self, place: float) -> ElementRows:
        """Return the rows at one fraction of the element."""
        return self.rows_at(np.array([place]), self.frames(np.array([place])))

    def rows_at(self, places: Array, frames: AxisFrames) -> ElementRows:
        """Return the rows at fractions (n,) of the element with given frames."""
        covered = self._flexibilities_before(places)
        back = translate_motion(frames.places - self._ends[1])
        motion = back @ covered @ self._forces
        motion[:, :, :6] += translate_motion(frames.places - self._ends[0])
        resultants = self._resultants(frames) @ self._forces
        strains = self._compliances(places, frames) @ resultants
        return ElementRows(motion[:, :3], motion[:, 3:], strains, resultants)

    @cached_property
    def gauss_frames(self) -> AxisFrames:
        """Return the frames at `GAUSS_POINTS`."""
        return self.frames(GAUSS_POINTS)

    @cached_property
    def gauss_rows(self) -> ElementRows:
        """Return the rows at `GAUSS_POINTS`."""
        return self.rows_at(GAUSS_POINTS, self.gauss_frames)

    def stiffness(self) -> Array:
        """(12, 12) in the axes of the model."""
        total = self._end_motion.T @ self._forces
        return np.asarray((total + total.T) / 2)

    @cached_property
    def _ends(self) -> Array:
        return self.frames(np.array([0.0, 1.0])).places

    @cached_property
    def _end_motion(self) -> Array:
        """(6, 12) motion of the end relative to the start as a rigid body."""
        return np.hstack([-translate_motion(self._ends[1] - self._ends[0]), np.eye(6)])

    @cached_property
    def _forces(self) -> Array:
        """(6, 12) forces and moments at the end."""
        return np.asarray(
            np.linalg.solve(self._flexibilities_before(np.ones(1))[0], self._end_motion)
        )

    @cached_property
    def _parts(self) -> Array:
        """(6, 6, 6) flexibilities of what lies before `_CUTS`."""
        parts = self._flexibilities(_CUTS[:-1], _CUTS[1:])
        return np.concatenate([np.zeros((1, 6, 6)), np.cumsum(parts, axis=0)])

    def _flexibilities_before(self, places: Array) -> Array:
        """(n, 6, 6) flexibilities of what lies before fractions (n,) of the element."""
        cuts = np.minimum(np.searchsorted(_CUTS, places.real), len(_CUTS) - 1)
        between = _CUTS[cuts] != places
        found = self._parts[cuts].astype(number_type(self._parts, places))
        if between.any():
            ends = places[between]
            found[between] = self._flexibilities(np.zeros(len(ends)), ends)
        return np.asarray(found)

    def _flexibilities(self, starts: Array, ends: Array) -> Array:
        """(n, 6, 6) of n parts: motion of the end by forces and moments there."""
        sizes = (ends - starts)[:, None]
        places = (starts[:, None] + sizes * GAUSS_POINTS).ravel()
        frames = self.frames(places)
        weights = (sizes * GAUSS_WEIGHTS * self.length).reshape(-1, 1, 1)
        b = self._resultants(frames)
        work = b.swapaxes(1, 2) @ (weights * self._compliances(places, frames)) @ b
        return np.asarray(work.reshape(len(starts), -1, 6, 6).sum(axis=1))

    def _resultants(self, frames: AxisFrames) -> Array:
        """(n, 6, 6) in the sections, of forces and moments at the end."""
        moved = translate_motion(self._ends[1] - frames.places).swapaxes(1, 2)
        turned = frames.axes @ moved[:, :3], frames.axes @ moved[:, 3:]
        return np.concatenate(turned, axis=1)

    def _compliances(self, places: Array, frames: AxisFrames) -> Array:
        """(n, 6, 6) strains of resultants."""
        beam, bent = self.beam, frames.curvatures
        sections = [self.section(place) for place in places.tolist()]
        if (bent == bent[0]).all() and all(one is sections[0] for one in sections):
            sections = sections[:1]  # a uniform beam
        compliances = [
            section.compliance(beam.e, beam.g, curvatures, beam.shear)
            for section, curvatures in zip(sections, bent, strict=False)
        ]
        return np.broadcast_to(compliances, (len(places), 6, 6))


def translate_motion(arm: Array) -> Array:
    """(..., 6, 6) motion of points fixed at arms (..., 3) from one: of its motion."""
    result = np.zeros((*arm.shape[:-1], 6, 6), arm.dtype)
    result[..., range(6), range(6)] = 1.0
    result[..., :3, 3:] = -skew(arm)
    return result


class RowCollector:
    """Rows of a matrix, a few at a time, by the degrees of freedom that they hold."""

    def __init__(self, ndof: int) -> None:
        self._ndof = ndof
        self._rows: list[Array] = []
        self._dofs: list[Indices] = []

    def add(self, rows: Array, dofs: Indices) -> None:
        """Rows (..., k) of degrees of freedom (k,), of which some may be the same."""
        self._rows.append(rows.reshape(-1, len(dofs)))
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
        self._masses: list[ArrayLike] = []
        self._inertias: list[Array] = []
        self._arms: list[Array] = []
        self._tangents: list[Array] = []
        self._displacement, self._rotation = RowCollector(ndof), RowCollector(ndof)

    def add(
        self,
        where: Array,
        masses: ArrayLike,
        inertias: Array,
        displacement: Array,
        rotation: Array,
        dofs: Indices,
        arms: Array | None = None,
        tangents: Array | None = None,
    ) -> None:
        """Pieces (p, ...), by rows (p, 3, k) of their motion by dofs (k,).

        Parameters
        ----------
        where, masses, inertias, arms, tangents : as in `InertiaPoints`; arms and
            tangents are zero by default
        """
        self._arms.append(np.zeros(where.shape) if arms is None else arms)
        self._tangents.append(np.zeros(where.shape) if tangents is None else tangents)
        self._where.append(where)
        self._masses.append(masses)
        self._inertias.append(inertias)
        self._displacement.add(displacement, dofs)
        self._rotation.add(rotation, dofs)

    def add_slices(self, element: BeamElement, dofs: Indices, density: float) -> None:
        """Slices of the beam at its Gauss points."""
        frames = element.gauss_frames
        slices = slice_inertia(element, frames, GAUSS_POINTS, GAUSS_WEIGHTS, density)
        self._add_rigid_pieces(element.gauss_rows, dofs, frames, *slices)

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
            at_end = element.frames(np.array([end]))
            piece = centre[None], mass[None], tensor[None]
            self._add_rigid_pieces(element.rows(end), dofs, at_end, *piece)

    def _add_rigid_pieces(
        self,
        rows: ElementRows,
        dofs: Indices,
        frames: AxisFrames,
        centres: Array,
        masses: Array,
        tensors: Array,
    ) -> None:
        """Pieces (p, ...) that are fixed to sections of an element."""
        arms, tangents = centres - frames.places, frames.axes[:, 0]
        moved = rows.displacement - skew(arms) @ rows.rotation
        arms = arms - np.einsum("pa,pa->p", arms, tangents)[:, None] * tangents
        motion = moved, rows.rotation, dofs
        self.add(centres, masses, tensors, *motion, arms, tangents)

    @property
    def count(self) -> int:
        """How many points there are so far."""
        return sum(map(len, self._where))

    def points(self) -> InertiaPoints:
        return InertiaPoints(
            positions=np.concatenate(self._where),
            masses=np.concatenate(self._masses),
            inertias=np.concatenate(self._inertias),
            displacement=self._displacement.matrix(),
            rotation=self._rotation.matrix(),
            arms=np.concatenate(self._arms),
            tangents=np.concatenate(self._tangents),
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
        section = element.section(places[i])
        mass, arm, tensor = section.inertia(density, frames.curvatures[i])
        centres.append(frames.places[i] + arm @ frames.axes[i])
        masses.append(weight * mass)
        tensors.append(rotate_tensor(weight * tensor, frames.axes[i]))
    return np.array(centres), np.array(masses), np.array(tensors)


class MaterialPointCollector:
    """Collects the points of `BeamMaterial`."""

    def __init__(self, ndof: int) -> None:
        self._rows = [RowCollector(ndof) for _ in range(3)]
        self._weights: list[float] = []
        self._stress_moments: list[Array] = []
        self._curvatures: list[Array] = []

    def add(self, element: BeamElement, dofs: Indices) -> None:
        """The Gauss points of an element."""
        frames, rows = element.gauss_frames, element.gauss_rows
        turns = frames.axes @ rows.rotation
        for kept, some in zip(
            self._rows, (rows.strains, turns, rows.resultants), strict=True
        ):
            kept.add(some, dofs)
        sections = map(element.section, GAUSS_POINTS.tolist())
        self._stress_moments.extend(each.stress_moments for each in sections)
        self._weights.extend(GAUSS_WEIGHTS * element.length)
        self._curvatures.extend(frames.curvatures)

    def material(self) -> BeamMaterial:
        strains, turns, forces = (rows.matrix() for rows in self._rows)
        return BeamMaterial(
            weights=np.array(self._weights),
            strains=strains,
            turns=turns,
            resultants=forces,
            stress_moments=np.array(self._stress_moments),
            curvatures=np.array(self._curvatures),
        )


def rotate_tensor(tensor: Array, axes: Array) -> Array:
    return np.asarray(axes.T @ tensor @ axes)


def scatter_rows(rows: Array, dofs: Indices, ndof: int) -> sp.csr_matrix:
    """(r, k) for some degrees of freedom (k,) as (r, ndof)."""
    count = len(rows)
    index = (np.repeat(np.arange(count), len(dofs)), np.tile(dofs, count))
    return sp.csr_matrix((rows.ravel(), index), shape=(count, ndof))


def rows_without_rounding(rows: Array, dofs: Indices, ndof: int) -> sp.csr_matrix:
    """As `scatter_rows`, without entries that are rounding."""
    scattered = scatter_rows(rows, dofs, ndof)
    scattered.data = without_rounding(scattered.data, 1e-14)
    scattered.sum_duplicates()
    scattered.eliminate_zeros()
    return scattered


def assemble(parts: Sequence[tuple[Array, Indices]], ndof: int) -> sp.csr_matrix:
    """(ndof, ndof) sum of symmetric matrices (k, k) at degrees of freedom (k,)."""
    if not parts:
        return sp.csr_matrix((ndof, ndof))
    i = np.concatenate([np.repeat(dofs, len(dofs)) for _, dofs in parts])
    j = np.concatenate([np.tile(dofs, len(dofs)) for _, dofs in parts])
    values = np.concatenate([(k + k.T).ravel() / 2 for k, _ in parts])
    return sp.csr_matrix((values, (i, j)), shape=(ndof, ndof))
