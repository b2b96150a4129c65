"""Frames of beams that a model file describes."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice, pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sidtool.formats.base.complex_step import number_type, numbers
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import diagnose
from sidtool.formats.model import ModelFile
from sidtool.formats.model.beams import BeamGeometry
from sidtool.formats.model.discretisation import BeamDiscretisation
from sidtool.formats.model.frames import FrameGeometry, FrameSpring

from ..beams.beam_model import beam_mass, beam_properties, element_ends
from ..beams.cross_section import Profile
from ..beams.element import (
    BeamProperties,
    MaterialPointCollector,
    ParticleCollector,
    assemble,
    scatter_rows,
)
from ..beams.stress_points import StressCollector
from ..elements.finite_element_model import (
    BodyCut,
    FiniteElementModel,
    GeometryMass,
    MarkerRows,
)
from ..elements.markers import markers_with_position, name_marker_in_errors
from ..mesh.connections import RawSpring
from ..mesh.imported_mesh import ImportedMesh, RawMass
from ..mesh.mesh import Mesh
from ..mesh.unit_systems import unit_system
from .bar_elements import Bar, BarElement, bar_outline
from .bar_nodes import bar_nodes, node_sets
from .body_cuts import Connectivity, member_cuts
from .structure import (
    Structure,
    add_bar_mass,
    check_mechanism,
    markers_without_rotation,
    without_unsupported,
)
from .structure_elements import merge_particles

Indices = NDArray[np.int64]

#: Fractions of the length as near as this are the same.
_SAME_PLACE = 1e-9
#: Number of pieces of a member in pictures, at least.
_PIECES = 12
_SI = unit_system("SI")
_DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
#: What is expected of the members of a frame.
_HELD = "members that hold each other, or fewer releases"
_NO_STIFFENING = diagnose(
    "N129",
    limit="springs add no geometric stiffness",
    remedy="Use members where the loads pass.",
)


@dataclass(frozen=True, eq=False)
class Member:
    """A member of a frame.

    Attributes
    ----------
    name : in the model file
    geometry : as a single beam
    beam, per_length, density : its sections, mass per length, and density of sections
    ends : (n + 1,) fractions between elements
    nodes : (n + 1,) labels of the nodes there
    """

    name: str
    geometry: BeamGeometry
    beam: BeamProperties
    per_length: Profile
    density: float
    ends: Array
    nodes: tuple[int, ...]


def frame_model(model: ModelFile) -> FiniteElementModel:
    """Return the body of a model file whose geometry is a frame.

    Raises
    ------
    InputError : a member is degenerate, points are not connected, or the frame is a
        mechanism.
    """
    geometry, settings = model.geometry, model.discretisation
    assert isinstance(geometry, FrameGeometry)
    assert isinstance(settings, BeamDiscretisation)
    _check_connected(geometry)
    labels = {name: k for k, name in enumerate(geometry.points, 1)}
    members = _members(model, geometry, settings, labels)
    structure = _structure(geometry, members, labels)
    marked = {labels[m.point] for m in model.markers.values() if m.point is not None}
    structure, unsupported = without_unsupported(structure, lambda _: marked)
    nodes, ndof = structure.nodes, structure.ndof
    particles, points = ParticleCollector(ndof), MaterialPointCollector(ndof)
    stress = StressCollector(ndof) if model.stress else None
    parts: list[tuple[Array, Indices]] = []
    elements: dict[str, list[tuple[BarElement, Indices]]] = {}
    bars = iter(structure.bars)
    for member in members:
        own = elements[member.name] = []
        for bar in islice(bars, len(member.nodes) - 1):
            element, dofs = structure.bar_element(bar)
            own.append((element, dofs))
            parts.append((element.stiffness(), dofs))
            points.add(element, dofs)
            if settings.mass == "lumped":
                particles.add_half_elements(element, dofs, bar.density)
            else:
                add_bar_mass(particles, bar, element, dofs)
            if stress is not None:
                stress.add(element, dofs, member.geometry)
    inertia = [particles.points()]
    if (masses := structure.point_masses()) is not None:
        inertia.append(masses)
    others, _ = structure.other_elements()
    stiffness = sp.csr_matrix(others + assemble(parts, ndof))
    used = np.flatnonzero((nodes.table >= 0).any(axis=1))
    markers = _markers(model, structure, labels, elements)
    cuts = _cuts(model, structure, members, elements, labels, particles.count)
    body = FiniteElementModel(
        positions=nodes.mesh.positions[used],
        scalar_mass=None,
        stiffness=stiffness,
        node_sets=node_sets(nodes, used, {}),
        markers=markers,
        inertia_points=merge_particles(inertia),
        dof_table=nodes.table[used],
        beam_material=points.material(),
        bar_ends=structure.bar_ends(),
        outlines=lambda: tuple(
            bar_outline(*pair, ndof, -(-_PIECES // len(own)))
            for own in elements.values()
            for pair in own
        ),
        beam_stress=None if stress is None else stress.stress(),
        cuts=cuts,
        diagnostics=(
            *([_NO_STIFFENING] if geometry.springs and model.stiffening else []),
            *unsupported,
            *markers_without_rotation(markers),
        ),
        geometry_mass=lambda: _frame_mass(geometry, members),
    )
    if np.isrealobj(stiffness.data) and np.isrealobj(body.positions):
        check_mechanism(body, "geometry.members", _HELD)
    return body


@contextmanager
def _name_member(name: str) -> Iterator[None]:
    """Name a member in errors of its geometry."""
    try:
        yield
    except InputError as error:
        key = (error.place or "geometry").removeprefix("geometry")
        raise InputError(
            error.problem,
            place=f"geometry.members.{name}{key}",
            expected=error.expected,
        ) from None


def _members(
    model: ModelFile,
    geometry: FrameGeometry,
    settings: BeamDiscretisation,
    labels: Mapping[str, int],
) -> list[Member]:
    asked = model.section_forces
    found, next_label = [], len(labels) + 1
    for name, given in geometry.members.items():
        own = geometry.member_geometry(name)
        material = geometry.materials.get(given.material or "", model.material)
        if given.sections is not None:
            material = None
        with _name_member(name):
            beam, per_length, density = beam_properties(own, material, settings.theory)
        cut = asked is not None and (asked.members is None or name in asked.members)
        cuts = list(asked.fractions.values()) if asked and cut else []
        count = given.elements or settings.elements
        own_markers = (m.at for m in model.markers.values() if m.member == name)
        loaded = [at for at in own_markers if not isinstance(at, str | tuple | None)]
        ends = element_ends(own, beam.axis, per_length, count, cuts, loaded)
        inner = range(next_label, next_label + len(ends) - 2)
        next_label += len(inner)
        nodes = (labels[given.start], *inner, labels[given.end])
        found.append(Member(name, own, beam, per_length, density, ends, nodes))
    return found


def _structure(
    geometry: FrameGeometry, members: list[Member], labels: Mapping[str, int]
) -> Structure:
    places = [numbers(place) for place in geometry.points.values()]
    bars = []
    for member in members:
        given = geometry.members[member.name]
        there = member.beam.axis.at(member.ends).places
        places += list(there[1:-1])
        last = len(member.nodes) - 2
        for k, (a, b) in enumerate(pairwise(member.ends.tolist())):
            released = (
                given.releases.start if k == 0 else (),
                given.releases.end if k == last else (),
            )
            bars.append(
                Bar(
                    label=f"member {member.name}",
                    nodes=(member.nodes[k], member.nodes[k + 1]),
                    place=f"geometry.members.{member.name}",
                    ends=there[k : k + 2],
                    beam=member.beam,
                    density=member.density,
                    first=a,
                    last=b,
                    pins=(_pins(released[0]), _pins(released[1])),
                )
            )
    rows = {name: np.array([k - 1]) for name, k in labels.items()}
    mesh = Mesh(np.array(places), (), rows, np.arange(1, len(places) + 1))
    imported = ImportedMesh(
        mesh,
        masses=tuple(
            RawMass(
                labels[mass.point],
                mass.mass,
                f"geometry.masses[{k}]",
                mass.offset,
                (*mass.inertia, 0.0, 0.0, 0.0),
            )
            for k, mass in enumerate(geometry.masses)
        ),
        springs=tuple(
            _spring(geometry, name, spring, labels)
            for name, spring in geometry.springs.items()
        ),
    )
    nodes = bar_nodes(imported, bars, mesh)
    return Structure(imported, tuple(bars), nodes, _SI, {})


def _pins(released: tuple[str, ...]) -> tuple[int, ...]:
    return tuple(sorted({_DIRECTIONS.index(name) + 1 for name in released}))


def _spring(
    geometry: FrameGeometry, name: str, spring: FrameSpring, labels: Mapping[str, int]
) -> RawSpring:
    first, last = (numbers(geometry.points[point]) for point in spring.points)
    place, given = f"geometry.springs.{name}", spring.stiffness
    a, b = (labels[point] for point in spring.points)
    if not isinstance(given, tuple):
        along = last - first
        length = np.sqrt(along @ along)
        if not length.real > 0:
            raise InputError(
                "has no direction between points at one place",
                place=f"{place}.stiffness",
                expected="six numbers along and about x, y, z",
            )
        axes = np.zeros((3, 3), number_type(along))
        axes[0] = along / length
        return RawSpring(0, (a, b), place, (axes, axes), (given,), None, (0, 0))
    axes, centre = np.eye(3), (first + last) / 2
    return RawSpring(0, (a, b), place, (axes, axes), given, centre)


def _check_connected(geometry: FrameGeometry) -> None:
    """Check that every point is held, and that members and springs make one body.

    Raises
    ------
    InputError : they do not.
    """
    number = {name: k for k, name in enumerate(geometry.points)}
    pairs = [(m.start, m.end) for m in geometry.members.values()]
    pairs += [spring.points for spring in geometry.springs.values()]
    i, j = np.array([[number[n] for n in pair] for pair in pairs]).T
    shape = (len(number),) * 2
    count, part = connected_components(
        sp.csr_matrix((np.ones(len(i)), (i, j)), shape), directed=False
    )
    if count == 1:
        return
    smallest = np.argmin(np.bincount(part))
    names = [name for name, k in number.items() if part[k] == smallest]
    if len(names) == 1:
        raise InputError(
            f"no member or spring holds point {names[0]}",
            place=f"geometry.points.{names[0]}",
            expected="points at ends of members",
        )
    listed = ", ".join(names[:5]) + (" and others" if names[5:] else "")
    raise InputError(
        f"the members make {count} parts that are not connected; one has the points "
        f"{listed}",
        place="geometry.members",
        expected="one connected body",
    )


def _markers(
    model: ModelFile,
    structure: Structure,
    labels: Mapping[str, int],
    elements: Mapping[str, list[tuple[BarElement, Indices]]],
) -> tuple[MarkerRows, ...]:
    assert isinstance(model.geometry, FrameGeometry)
    nodes, ndof, markers = structure.nodes, structure.ndof, list[MarkerRows]()
    tangent: Array | None
    for name, marker in markers_with_position(model.markers):
        with name_marker_in_errors(name):
            if marker.member is not None:
                assert not isinstance(marker.at, str | tuple | None)
                found = _point_of_member(elements[marker.member], marker.at)
                move, turn, place, dofs, tangent = found
                if marker.at in (0.0, 1.0):
                    member = model.geometry.members[marker.member]
                    point = member.end if marker.at else member.start
                    tangent = structure.continued.get(labels[point])
            else:
                assert marker.point is not None
                label = labels[marker.point]
                place = nodes.place(label)
                motion, dofs = nodes.motion(label, place)
                move, turn = motion[:3], motion[3:]
                tangent = structure.continued.get(label)
            shift, rotation = (scatter_rows(part, dofs, ndof) for part in (move, turn))
            markers.append(
                MarkerRows(name, marker.node, place, shift, rotation, tangent=tangent)
            )
    return tuple(markers)


def _point_of_member(
    elements: list[tuple[BarElement, Indices]], at: float
) -> tuple[Array, Array, Array, Indices, Array]:
    """Rows (3, k) of displacement and rotation, position, degrees of freedom, and the
    direction of the member.
    """
    element, dofs = next(
        (
            pair
            for pair in elements
            if np.real(at) < np.real(pair[0].last) - _SAME_PLACE
        ),
        elements[-1],
    )
    where = (at - element.first) / (element.last - element.first)
    rows = element.rows(where)
    frames = element.frames(np.array([where]))
    place, tangent = frames.places[0], frames.axes[0, 0]
    return rows.displacement[0], rows.rotation[0], place, dofs, tangent


def _cuts(
    model: ModelFile,
    structure: Structure,
    members: list[Member],
    elements: Mapping[str, list[tuple[BarElement, Indices]]],
    labels: Mapping[str, int],
    particles: int,
) -> tuple[BodyCut, ...]:
    """Return the cross-sections of [section_forces].

    Parameters
    ----------
    particles : inertia points of all elements, as many of each
    """
    asked, geometry = model.section_forces, model.geometry
    if asked is None:
        return ()
    assert isinstance(geometry, FrameGeometry)
    n, bars = len(structure.nodes.row), structure.bars
    joined = [[label - 1 for label in bar.nodes] for bar in bars]
    joined += [
        [labels[point] - 1 for point in spring.points]
        for spring in geometry.springs.values()
    ]
    pairs = [(n + k, node) for k, ends in enumerate(joined) for node in ends]
    graph = Connectivity(np.array(pairs), n + len(joined))
    owners = np.concatenate(
        [
            np.repeat(n + np.arange(len(bars)), particles // len(bars)),
            np.array([labels[mass.point] - 1 for mass in geometry.masses], np.int64),
        ]
    )
    first: dict[str, int] = {}
    count = n
    for member in members:
        first[member.name] = count
        count += len(member.nodes) - 1
    by_name = {member.name: member for member in members}
    markers = {}
    for name, marker in model.markers.items():
        if marker.point is not None:
            markers[name] = labels[marker.point] - 1
        elif marker.member is not None:
            assert not isinstance(marker.at, str | tuple | None)
            member = by_name[marker.member]
            number = _element_at(member.ends, marker.at)
            markers[name] = (
                member.nodes[-1] - 1 if number is None else first[member.name] + number
            )

    def end_motion(vertex: int, end: int) -> tuple[Indices, Array]:
        bar = bars[vertex - n]
        (first, start), (last, stop) = (
            structure.nodes.motion(node, place)
            for node, place in zip(bar.nodes, bar.ends, strict=True)
        )
        count = len(start)
        if end == 0:
            return np.arange(count), first
        return np.arange(count, count + len(stop)), last

    cuts: list[BodyCut] = []
    for member in members:
        if asked.members is not None and member.name not in asked.members:
            continue
        of_elements = range(
            first[member.name], first[member.name] + len(member.nodes) - 1
        )
        of_nodes = [label - 1 for label in member.nodes]
        cuts += member_cuts(
            member.name,
            asked.fractions,
            member.ends,
            elements[member.name],
            (of_elements, of_nodes),
            graph,
            owners,
            markers,
            structure.ndof,
            end_motion,
            structure.continued,
        )
    return tuple(cuts)


def _element_at(ends: Array, at: float) -> int | None:
    """Return the number of the element at a fraction; at a cut that beyond it, None
    at the end of the member.
    """
    place = int(np.searchsorted(np.real(ends), np.real(at) + _SAME_PLACE)) - 1
    return max(place, 0) if place < len(ends) - 1 else None


def _frame_mass(geometry: FrameGeometry, members: list[Member]) -> GeometryMass:
    """Return the mass and first moments of all members and lumped masses."""
    parts = [
        beam_mass(m.geometry, m.beam.axis, m.per_length, m.beam.section)
        for m in members
    ]
    mass = sum(part.mass for part in parts)
    first = sum((part.first for part in parts), np.zeros(3))
    for lump in geometry.masses:
        mass += lump.mass
        place = numbers(geometry.points[lump.point]) + numbers(lump.offset)
        first = first + lump.mass * place
    return GeometryMass(mass, first, sampled=any(part.sampled for part in parts))
