"""Beams of Euler-Bernoulli and Timoshenko: straight or curved, twisted, tapered."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile, NodeMarker
from sidtool.formats.model.discretisation import BeamDiscretisation
from sidtool.formats.model.geometry import BeamGeometry
from sidtool.formats.sid_mass import skew

from ..elements.inertia_points import InertiaPoints
from ..finite_element_model import FiniteElementModel, MarkerRows, Outline
from ..patches.markers import at_marker, check_length, placed
from .axis import Axis, beam_axis
from .element import PLACES, WEIGHTS, Beam, Element, Rows
from .mass import beam_mass
from .material import BeamMaterial
from .section import section_at

Array = NDArray[np.float64]
#: Positions of markers this near to the axis, relative to its length, are on it: a
#: spline follows a curve only so well.
_ON_LINE, _ON_CURVE = 1e-9, 1e-4


def beam_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file as a beam.

    Raises
    ------
    InputError : the axis is degenerate, a section is unsound, or a marker lies outside.
    """
    geometry, settings, material = model.geometry, model.discretisation, model.material
    assert isinstance(geometry, BeamGeometry) and material is not None
    assert isinstance(settings, BeamDiscretisation)
    axis = beam_axis(geometry)
    e, g = material.youngs_modulus, material.youngs_modulus
    g /= 2 * (1 + material.poissons_ratio)
    beam = Beam(geometry, axis, e, g, settings.theory == "timoshenko")
    ends = np.linspace(0, 1, settings.elements + 1)
    n, ndof = len(ends), 6 * len(ends)
    stiffness = sp.lil_matrix((ndof, ndof))
    particles, points = _Particles(ndof), _MaterialPoints(ndof)
    for i in range(settings.elements):
        element = Element(beam, ends[i], ends[i + 1])
        dofs = slice(6 * i, 6 * i + 12)
        stiffness[dofs, dofs] += element.stiffness()
        points.add(element, i)
        if settings.mass == "lumped":
            particles.lump(element, i, material.density)
        else:
            particles.distribute(element, i, material.density)
    for lump in geometry.masses:
        frames = axis.at(np.array([lump.at]))
        tensor = _turned(np.diag(np.array(lump.inertia, float)), frames.axes[0])
        particles.add(frames.places[0], lump.mass, tensor, *_rows(beam, ends, lump.at))
    markers = []
    for name, marker in placed(model.markers):
        with at_marker(name):
            at = _fraction(marker, axis)
            displacement, rotation = _rows(beam, ends, at)
            frames = axis.at(np.array([at]))
            markers.append(
                MarkerRows(
                    name=name,
                    node=marker.node,
                    position=frames.places[0],
                    displacement=_pruned(displacement),
                    rotation=_pruned(rotation),
                    tangent=frames.axes[0, 0],
                )
            )
    return FiniteElementModel(
        positions=axis.at(ends).places,
        scalar_mass=None,
        stiffness=sp.csr_matrix(stiffness),
        node_sets={"start": np.array([0]), "end": np.array([n - 1])},
        markers=tuple(markers),
        inertia_points=particles.points(),
        dof_table=np.arange(ndof).reshape(n, 6),
        beam_material=points.material(),
        outline=_outline(beam, ends),
        geometry_mass=lambda: beam_mass(geometry, axis, material.density),
    )


def _outline(beam: Beam, ends: Array) -> Outline:
    """Sections as rectangles; of general ones with the same area and moments."""
    halves = []
    for fraction in ends:
        section = section_at(beam.geometry, fraction)
        moments = np.array([section.iz, section.iy])
        halves.append(np.sqrt(3 * moments / section.area))
    return Outline(beam.axis.at(ends).axes[:, 1:], np.array(halves))


class _Particles:
    """Collects the points that carry the mass."""

    def __init__(self, ndof: int) -> None:
        self._ndof = ndof
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

    def distribute(self, element: Element, i: int, density: float) -> None:
        """Slices of the beam at its Gauss points."""
        slices = zip(*_slices(element, PLACES, WEIGHTS, density), strict=True)
        places = element.frames(PLACES).places
        for rows, place, piece in zip(element.gauss_rows, places, slices, strict=True):
            self._carry(rows, i, place, *piece)

    def lump(self, element: Element, i: int, density: float) -> None:
        """The two halves of an element, each a rigid piece that its node carries."""
        for end in (0.0, 1.0):
            places = abs(end - PLACES / 2)
            centres, masses, tensors = _slices(element, places, WEIGHTS / 2, density)
            mass = masses.sum()
            centre = masses @ centres / mass
            spread = skew(centres - centre)
            tensor = tensors.sum(axis=0) - np.einsum(
                "p,pab,pbc->ac", masses, spread, spread
            )
            place = element.frames(np.array([end])).places[0]
            self._carry(element.rows(end), i, place, centre, mass, tensor)

    def _carry(
        self,
        rows: Rows,
        i: int,
        place: Array,
        centre: Array,
        mass: float,
        tensor: Array,
    ) -> None:
        """A piece that is fixed to the section at a place of element i."""
        arm = skew(centre - place)
        moved = _placed(rows.displacement - arm @ rows.rotation, i, self._ndof)
        self.add(centre, mass, tensor, moved, _placed(rows.rotation, i, self._ndof))

    def points(self) -> InertiaPoints:
        return InertiaPoints(
            positions=np.array(self._where),
            masses=np.array(self._masses),
            inertias=np.array(self._inertias),
            displacement=sp.vstack(self._displacement, format="csr"),
            rotation=sp.vstack(self._rotation, format="csr"),
        )


def _slices(
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
        tensors.append(_turned(own, frames.axes[i]))
    return np.array(centres), np.array(masses), np.array(tensors)


class _MaterialPoints:
    """Collects the points of `BeamMaterial`."""

    def __init__(self, ndof: int) -> None:
        self._ndof = ndof
        self._rows: list[list[sp.csr_matrix]] = [[], [], []]
        self._weights: list[float] = []
        self._gyration: list[list[float]] = []
        self._curvatures: list[Array] = []

    def add(self, element: Element, i: int) -> None:
        """The Gauss points of element i."""
        frames = element.frames(PLACES)
        for k, (place, rows) in enumerate(zip(PLACES, element.gauss_rows, strict=True)):
            p = element.section(place)
            turns = frames.axes[k] @ rows.rotation
            for kept, some in zip(
                self._rows, (rows.strains, turns, rows.resultants), strict=True
            ):
                kept.append(_placed(some, i, self._ndof))
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


def _turned(tensor: Array, axes: Array) -> Array:
    return np.asarray(axes.T @ tensor @ axes)


def _placed(rows: Array, i: int, ndof: int) -> sp.csr_matrix:
    """(r, 12) for the degrees of freedom of element i as (r, ndof)."""
    count = len(rows)
    columns = np.tile(np.arange(6 * i, 6 * i + 12), count)
    index = (np.repeat(np.arange(count), 12), columns)
    return sp.csr_matrix((rows.ravel(), index), shape=(count, ndof))


def _rows(beam: Beam, ends: Array, at: float) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Displacement and rotation at a fraction of the length."""
    i = min(int(np.searchsorted(ends, at, side="right")) - 1, len(ends) - 2)
    place = float((at - ends[i]) / (ends[i + 1] - ends[i]))
    rows = Element(beam, ends[i], ends[i + 1]).rows(place)
    ndof = 6 * len(ends)
    return _placed(rows.displacement, i, ndof), _placed(rows.rotation, i, ndof)


def _pruned(rows: sp.csr_matrix) -> sp.csr_matrix:
    rows.data[np.abs(rows.data) < 1e-14] = 0
    rows.eliminate_zeros()
    return rows


def _fraction(marker: NodeMarker, axis: Axis) -> float:
    if marker.edge is not None:
        return 0.0 if marker.edge == "start" else 1.0
    if marker.parameters is not None:
        check_length(marker.parameters, 1, "parameters")
        return marker.parameters[0]
    if marker.position is None:
        raise InputError("is for meshes", place="mesh_node", expected="another place")
    check_length(marker.position, 3, "position")
    fraction, distance = axis.nearest(np.array(marker.position))
    if distance > (_ON_LINE if axis.straight else _ON_CURVE) * axis.length:
        raise InputError(
            "lies off the axis of the beam",
            place="position",
            expected="a point between start and end",
        )
    return fraction
