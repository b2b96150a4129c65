"""Bodies of Euler-Bernoulli and Timoshenko beams."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import numbers
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model import Material, ModelFile, NodeMarker
from sidtool.formats.model.beams import BeamGeometry, GeneralSection, RectangularSection
from sidtool.formats.model.discretisation import BeamDiscretisation

from ..elements.finite_element_model import (
    BeamOutline,
    BodyCut,
    FiniteElementModel,
    GeometryMass,
    MarkerRows,
)
from ..elements.markers import (
    check_length,
    markers_with_position as with_places,
    name_marker_in_errors,
)
from ..mesh.reference_elements import gauss_legendre
from .axis import Axis, beam_axis
from .cross_section import (
    Profile,
    Section,
    profile,
    section_at,
    sections_along,
    side_profile,
)
from .element import (
    BeamElement,
    BeamProperties,
    ElementRows,
    MaterialPointCollector,
    ParticleCollector,
    RowCollector,
    assemble,
    rotate_tensor,
    rows_without_rounding,
)
from .station_section import StationSection, station_sections
from .stress_points import StressCollector

#: Degree of the area profile up to which mass and moments are exact.
EXACT_AREA_DEGREE = 6
#: Gauss points of a panel of an axis, and the least number of panels.
_POINTS, _PANELS = 16, 32

Indices = NDArray[np.int64]
_SHEAR_AREAS = {"shear_y", "shear_z"}
#: Positions of markers this near to the axis, relative to its length, are on it: a
#: spline follows a curve only so well.
_ON_LINE, _ON_CURVE = 1e-9, 1e-4
#: Fractions of the length as near as this are the same.
_SAME_PLACE = 1e-9
#: Elements do not end at a marker that is nearer than this to another end, relative to
#: the length of an element.
_LEAST_ELEMENT = 0.01
#: Least number of pieces that pictures draw a beam in.
_SECTIONS = 48


def beam_mass(
    geometry: BeamGeometry,
    axis: Axis,
    per_length: Profile,
    section: Callable[[float], Section | StationSection],
) -> GeometryMass:
    """Return mass and first moments of a beam from its mass per length and its lumps.

    Parameters
    ----------
    per_length : mass per length over the fraction of the length [kg/m]
    section : of unit density, by the fraction of the length
    """
    mass = axis.length * per_length.integral()
    x, w = gauss_legendre(_POINTS)
    edges = np.union1d(np.linspace(0.0, 1.0, _PANELS + 1), per_length.edges)
    sizes = np.diff(edges)[:, None]
    at = (edges[:-1, None] + sizes * (x + 1) / 2).ravel()
    weights = axis.length * (sizes * w / 2).ravel() * per_length(at)
    frames = axis.at(at)
    first = weights @ frames.places
    eccentric = not axis.straight or geometry.sections is not None
    for i, fraction in enumerate(at if eccentric else ()):
        _, arm, _ = section(fraction).inertia(1.0, frames.curvatures[i])
        first += weights[i] * arm @ frames.axes[i]
    for lump in geometry.masses:
        mass += lump.mass
        first += lump.mass * axis.at(np.array([lump.at])).places[0]
    sampled = not axis.straight or per_length.degree > EXACT_AREA_DEGREE
    return GeometryMass(mass, first, sampled=sampled)


def _area(geometry: BeamGeometry) -> Profile:
    """The cross-section over the fraction of the length."""
    if not isinstance(geometry.section, RectangularSection):
        return profile(section_at(geometry, 0.0).area, "linear")
    return side_profile(geometry, "height") * side_profile(geometry, "width")


def beam_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file as a beam.

    Raises
    ------
    InputError : the axis is degenerate, a section is unsound, or a marker lies outside.
    """
    geometry, settings = model.geometry, model.discretisation
    assert isinstance(geometry, BeamGeometry)
    assert isinstance(settings, BeamDiscretisation)
    found = beam_properties(geometry, model.material, settings.theory)
    beam, per_length, density = found
    axis = beam.axis
    cuts = model.section_forces.fractions if model.section_forces else {}
    named, places = dict(with_places(model.markers)), dict[str, float]()
    for name, marker in named.items():
        with name_marker_in_errors(name):
            places[name] = _marker_fraction(marker, axis)
    loaded = [*places.values(), *(lump.at for lump in geometry.masses)]
    ends = element_ends(
        geometry, axis, per_length, settings.elements, list(cuts.values()), loaded
    )
    n, ndof = len(ends), 6 * len(ends)
    particles, points = ParticleCollector(ndof), MaterialPointCollector(ndof)
    elements = [BeamElement(beam, *pair) for pair in pairwise(ends)]
    matrices = [(e.stiffness(), _element_dofs(i)) for i, e in enumerate(elements)]
    stiffness = assemble(matrices, ndof)
    stiffness.eliminate_zeros()
    stress = StressCollector(ndof) if model.stress else None
    for i, element in enumerate(elements):
        if stress is not None:
            stress.add(element, _element_dofs(i), geometry)
        points.add(element, _element_dofs(i))
        if settings.mass == "lumped":
            particles.add_half_elements(element, _element_dofs(i), density)
        else:
            particles.add_slices(element, _element_dofs(i), density)
    middles = np.repeat((ends[1:] + ends[:-1]) / 2, particles.count // len(elements))
    along = np.append(middles, [lump.at for lump in geometry.masses])
    for lump in geometry.masses:
        frames = axis.at(np.array([lump.at]))
        tensor = rotate_tensor(np.diag(numbers(lump.inertia)), frames.section_axes[0])
        rows, dofs = _marker_rows(beam, ends, lump.at)
        move = (rows.displacement, rows.rotation, dofs)
        particles.add(frames.places, [lump.mass], tensor[None], *move)
    markers = []
    for name, at in places.items():
        rows, dofs = _marker_rows(beam, ends, at)
        frames = axis.at(np.array([at]))
        markers.append(
            MarkerRows(
                name=name,
                node=named[name].node,
                position=frames.places[0],
                displacement=rows_without_rounding(rows.displacement[0], dofs, ndof),
                rotation=rows_without_rounding(rows.rotation[0], dofs, ndof),
                tangent=frames.axes[0, 0],
            )
        )
    return FiniteElementModel(
        positions=axis.at(ends).places,
        scalar_mass=None,
        stiffness=stiffness,
        node_sets={"start": np.array([0]), "end": np.array([n - 1])},
        markers=tuple(markers),
        inertia_points=particles.points(),
        dof_table=np.arange(ndof).reshape(n, 6),
        beam_material=points.material(),
        outlines=lambda: (_outline(beam, elements, ndof),),
        beam_stress=None if stress is None else stress.stress(),
        cuts=tuple(
            _cut(beam, ends, name, at, along, places) for name, at in cuts.items()
        ),
        geometry_mass=lambda: beam_mass(geometry, axis, per_length, beam.section),
    )


def beam_properties(
    geometry: BeamGeometry, material: Material | None, theory: str | None
) -> tuple[BeamProperties, Profile, float]:
    """Return the beam, its mass per length, and the density of its sections.

    Parameters
    ----------
    material : None for sections at stations
    theory : of [discretisation]; without it cross-sections shear where they state
        their shear stiffness

    Raises
    ------
    InputError : the axis is degenerate, or a section is unsound.
    """
    axis = beam_axis(geometry)
    if geometry.sections is not None:
        stations = station_sections(geometry, axis.length)
        axis = replace(axis, twist=stations.twist)
        shear = _shears(theory, stations.at(0.0).sheared is not None)
        return BeamProperties(stations.at, axis, 0.0, 0.0, shear), stations.mass, 1.0
    assert material is not None
    e, nu = material.youngs_modulus, material.poissons_ratio
    section = sections_along(geometry, nu)
    stated = isinstance(
        geometry.section, GeneralSection
    ) and not _SHEAR_AREAS.isdisjoint(geometry.section.model_fields_set)
    shear = _shears(theory, stated)
    beam = BeamProperties(section, axis, e, e / (2 * (1 + nu)), shear)
    per_length = _area(geometry) * profile(material.density, "linear")
    return beam, per_length, material.density


def _shears(theory: str | None, stated: bool) -> bool:
    """Whether cross-sections shear, which state a shear stiffness or do not."""
    return stated if theory is None else theory == "timoshenko"


def _sides(geometry: BeamGeometry) -> list[Profile]:
    if not isinstance(geometry.section, RectangularSection):
        return []
    return [side_profile(geometry, name) for name in ("height", "width")]


def element_ends(
    geometry: BeamGeometry,
    axis: Axis,
    per_length: Profile,
    elements: int,
    cuts: list[float],
    loaded: Sequence[float] = (),
) -> Array:
    """(n + 1,) fractions between elements.

    Between two places that are ends elements have equal lengths. Such places are
    stations, as the section or its twist has corners there, cuts for section forces,
    and places of markers and masses: a force inside of an element stretches and twists
    it by too little.
    """
    profiles = [per_length, axis.twist, *_sides(geometry)]
    stations = np.unique(np.concatenate([*(one.edges for one in profiles), cuts]))
    stations = stations[np.append(True, np.diff(stations) > 1e-12)]
    for at in loaded:
        inside = 0 < np.real(at) < 1
        if inside and np.abs(stations - at).min() > _LEAST_ELEMENT / elements:
            stations = np.sort(np.append(stations, at))
    parts = [
        np.linspace(a, b, max(1, round(elements * (b - a).real)), endpoint=False)
        for a, b in pairwise(stations.tolist())
    ]
    return np.concatenate([*parts, [1.0]])


def _outline(
    beam: BeamProperties, elements: list[BeamElement], ndof: int
) -> BeamOutline:
    """Return the outline in segments that resolve the bending waves."""
    pieces = -(-_SECTIONS // len(elements))
    shares = np.arange(pieces) / pieces
    starts = [e.first + shares * (e.last - e.first) for e in elements]
    fractions = np.concatenate([*starts, [1.0]])
    frames = beam.axis.at(fractions)
    halves = np.array([beam.section(fraction).halves for fraction in fractions])
    motion = RowCollector(ndof)
    for i, element in enumerate(elements):
        places = np.arange(pieces + (i == len(elements) - 1)) / pieces
        rows = element.rows_at(places, element.frames(places))
        both = np.hstack([rows.displacement, rows.rotation])
        motion.add(both, _element_dofs(i))
    return BeamOutline(frames.places, frames.axes[:, 1:], halves, motion.matrix())


def _cut(
    beam: BeamProperties,
    ends: Array,
    name: str,
    at: float,
    along: Array,
    places: Mapping[str, float],
) -> BodyCut:
    """The cross-section at a fraction of the length.

    What is at the section belongs to the part beyond it, except for the start of the
    beam.

    Parameters
    ----------
    along : (p,) fractions of the inertia points
    places : fractions of the markers
    """
    least = at - _SAME_PLACE if at > 0 else _SAME_PLACE
    rows, dofs = _marker_rows(beam, ends, at)
    frames, ndof = beam.axis.at(np.array([at])), 6 * len(ends)
    section = MarkerRows(
        name=name,
        node=0,
        position=frames.places[0],
        displacement=rows_without_rounding(rows.displacement[0], dofs, ndof),
        rotation=rows_without_rounding(rows.rotation[0], dofs, ndof),
        tangent=frames.axes[0, 0],
    )
    beyond = tuple(marker for marker, place in places.items() if place.real > least)
    return BodyCut(name, section, frames.section_axes[0], along.real > least, beyond)


def _marker_rows(
    beam: BeamProperties, ends: Array, at: float
) -> tuple[ElementRows, Indices]:
    """Return rows at a fraction of the length, and the degrees of freedom there."""
    i = min(int(np.searchsorted(ends.real, at.real, side="right")) - 1, len(ends) - 2)
    at_end = at == ends[i + 1]  # a quotient of complex numbers may round to less
    place = 1.0 if at_end else (at - ends[i]) / (ends[i + 1] - ends[i])
    return BeamElement(beam, ends[i], ends[i + 1]).rows(place), _element_dofs(i)


def _element_dofs(i: int) -> Indices:
    """Return the degrees of freedom of element i."""
    return np.arange(6 * i, 6 * i + 12)


def _marker_fraction(marker: NodeMarker, axis: Axis) -> float:
    if marker.edge is not None:
        return 0.0 if marker.edge == "start" else 1.0
    if marker.parameters is not None:
        check_length(marker.parameters, 1, "parameters")
        return marker.parameters[0]
    if marker.position is None:
        raise InputError("is for meshes", place="mesh_node", expected="another place")
    check_length(marker.position, 3, "position")
    fraction, distance = axis.nearest(numbers(marker.position))
    length = np.real(axis.length)
    if distance > (_ON_LINE if axis.straight else _ON_CURVE) * length:
        raise InputError(
            "lies off the axis of the beam",
            place="position",
            expected="a point between start and end",
        )
    return fraction
