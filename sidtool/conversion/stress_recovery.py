"""Stress recovery: rows sigma of nodes, and points where the peak stress can occur."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.extremes import EQUAL, first_largest
from sidtool.formats.base.sid import SID, Array, Node, Taylor
from sidtool.formats.base.stress import MISES
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.model.reduction import StressRecovery
from sidtool.formats.sid_mass import skew

from ..elements.finite_element_model import (
    BeamStress,
    FiniteElementModel,
    MarkerRows,
)
from ..elements.material_points import (
    stress_components,
    stress_from_gradient,
    stress_rows,
)
from ..geometry.nurbs_patch import breakpoints
from ..isogeometric.iga import sampled_batch
from ..mesh.quadratic_fields import LEVI_CIVITA
from ..reduction.body_frames import Frame, motion_rows
from ..reduction.reduced_basis import ReducedBasis
from .prestress import InitialStress
from .quadrature import NodalAverages, QuadraturePart, quadrature_parts

#: Number of random states of equal energy for the choice of peak points, and of states
#: under random loads: up to so many, of which the least has this part of the energy.
_RANDOM_STATES, _MAX_LOADS, _LEAST_LOAD = 400, 3, 1e-3
#: Loads of less energy than this part of the largest are rounding.
_NOT_FELT = 1e-12
#: Points are added up to this fraction of the peak in every state, or this number of
#: points.
_PEAK_SHARE, _MAX_PEAK_POINTS = 0.99, 100
#: Number of points that are evaluated together, in all states.
_POINTS_PER_BATCH = 2_000


def add_stress_recovery(
    sid: SID,
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    settings: StressRecovery,
    initial: InitialStress | None = None,
    choose: PointChoice | None = None,
) -> SID:
    """Return the SID with sigma rows at its markers and nodes for the peak stress.

    sigma holds xx, yy, zz, xy, yz, xz: m0 the prestress, m1 per elastic coordinate.
    The settings have passed `check_stress`.

    Parameters
    ----------
    choose : function that returns the points of peak stress, default `peak_points`
    """
    nodes = []
    for node in sid.nodes:
        marker = next(m for m in body.markers if str(m.node) == node.id)
        if _needs_stress(marker, settings):
            rows = _marker_stress_rows(body, marker)
            fixed: Array = np.zeros(6)
            if initial is not None:
                fixed = _initial_stress_rows(rows, initial, body.continua[0].transverse)
            sigma = Taylor(fixed[:, None], (rows @ basis.shapes).T[:, :, None])
            node = replace(node, sigma=sigma)
        nodes.append(node)
    if settings.peak_points != 0:
        points = (choose or peak_points)(body, basis, settings.peak_points, initial)
        for number, point in enumerate(points, settings.first_node):
            nodes.append(_stress_node(number, point, frame))
    return replace(sid, nodes=tuple(nodes), has_peak_nodes=settings.peak_points != 0)


def check_stress(
    body: FiniteElementModel, settings: StressRecovery
) -> list[Diagnostic]:
    """Check the requested stress outputs; return notes on those that are not available.

    Raises
    ------
    InputError : a marker has no stress, or the number of a node is used already.
    """
    _check_numbers(body, settings)
    for marker in body.markers:
        if marker.name in (settings.markers or ()) and marker.gradient is None:
            expected = "a marker at a point of the material, not one tied to node sets"
            if body.beam_stress is not None:
                expected = "none: the stress of a beam is that of its peak points"
            raise InputError(
                f"there is no stress at marker {marker.name}",
                place="stress.markers",
                expected=expected,
            )
    markers = [marker for marker in body.markers if _needs_stress(marker, settings)]
    laws = {
        (part.law.tobytes(), part.transverse, part.laws_at) for part in body.continua
    }
    if markers and len(laws) != 1:
        raise InputError(
            "the body has several materials",
            place="stress.markers",
            expected="markers = [] and peak_points, which works for several; stress "
            "at markers needs a body of one material",
        )
    if settings.peak_points == 0 and not markers:
        raise InputError(
            "has no stress: markers are on the axis of a beam or tied to node sets",
            place="stress",
            expected="a marker at a point of the material, or peak_points",
        )
    found = [diagnose("N170")] if settings.peak_points == 0 else []
    if settings.markers is not None or body.beam_stress is not None:
        return found
    silent = [marker.name for marker in body.markers if marker.gradient is None]
    return [*found, *([diagnose("N171", markers=silent)] if silent else [])]


def _check_numbers(body: FiniteElementModel, settings: StressRecovery) -> None:
    """Refuse node numbers of peak points that markers already have."""
    first = settings.first_node
    count = _MAX_PEAK_POINTS if settings.peak_points is None else settings.peak_points
    for marker in body.markers:
        if first <= marker.node < first + count:
            raise InputError(
                f"node {marker.node} belongs to marker {marker.name} already",
                place="stress.first_node",
                expected=f"the first of {count} free node numbers",
            )


def _needs_stress(marker: MarkerRows, settings: StressRecovery) -> bool:
    if settings.markers is None:
        return marker.gradient is not None
    return marker.name in settings.markers


def _marker_stress_rows(
    body: FiniteElementModel, marker: MarkerRows
) -> NDArray[np.float64]:
    assert marker.gradient is not None
    continuum = body.continua[0]
    return stress_rows(marker.gradient, continuum, marker.position).toarray()


def _initial_stress_rows(
    rows: Array, initial: InitialStress, transverse: float
) -> Array:
    uniform = stress_components(initial.uniform, transverse)
    return (rows @ initial.displacement)[:, 0] + uniform


@dataclass(frozen=True, eq=False)
class StressPoint:
    """A point of the body.

    Attributes
    ----------
    position : (3,) in the axes of the model [m]
    phi, psi : (3, nq)
    sigma : (6, nq) stress per elastic coordinate
    initial : (6,) prestress [Pa]
    place : number of its group of points and its row there, see `peak_points`
    """

    position: Array
    phi: Array
    psi: Array
    sigma: Array
    initial: Array
    place: tuple[int, int] = (0, 0)


#: Body, basis, number of points and prestress to points.
PointChoice = Callable[
    [FiniteElementModel, ReducedBasis, int | None, "InitialStress | None"],
    list[StressPoint],
]


def points_at(places: Sequence[tuple[int, int]]) -> PointChoice:
    """Return a choice of the points that `peak_points` has found on another body.

    Parameters
    ----------
    places : of the points on a body with the same mesh
    """

    def choose(
        body: FiniteElementModel,
        basis: ReducedBasis,
        count: int | None,
        initial: InitialStress | None,
    ) -> list[StressPoint]:
        found = {}
        samples = _sample_points(body, basis.shapes, initial)
        for number, sample in enumerate(samples):
            for place in places:
                if place[0] == number:
                    found[place] = replace(sample.point(place[1]), place=place)
        return [found[place] for place in places]

    return choose


def peak_points(
    body: FiniteElementModel,
    basis: ReducedBasis,
    count: int | None = None,
    initial: InitialStress | None = None,
) -> list[StressPoint]:
    """Points among which the largest von Mises stress is, for any state.

    Candidates are quadrature points, nodes of meshes, and points of patches on the
    borders of their knot spans, because bending stress is largest at the surface.
    Stress at nodes is extrapolated from quadrature points; see `NodalAverages`. The
    examined states are every shape function alone, random states in which every shape
    function has the same mean strain energy, and static answers to a few random loads:
    at markers, by accelerations and by rotation. Points are added one by one, each at
    the peak of the state that the points represent worst: `count` of them, or until the
    points have 99 % of the peak in every state, at most 100.

    Raises
    ------
    InputError : the body came without elements.
    """
    nq = basis.shapes.shape[1]
    energy = np.sqrt(np.maximum(np.diag(basis.stiffness).real, 1e-300))
    random = np.random.default_rng(0).standard_normal((nq, _RANDOM_STATES))
    states = np.hstack([np.eye(nq), random]) / energy[:, None]
    states = np.hstack([states, _loaded_states(body, basis)])
    peaks, points = _peak_points_of_states(
        _sample_points(body, basis.shapes, initial), states
    )
    sigma = np.stack([point.sigma.real.T for point in points])
    mises = _von_mises_stress(sigma, states)
    covered = np.zeros(len(peaks))
    chosen: list[int] = []
    while len(chosen) < min(_MAX_PEAK_POINTS if count is None else count, len(points)):
        shares = covered / np.maximum(peaks, 1e-300)
        worst = int(np.argmax(shares <= shares.min() + EQUAL))
        if count is None and shares[worst] >= _PEAK_SHARE:
            break
        fresh = [k for k in range(len(points)) if k not in chosen]
        chosen.append(fresh[first_largest(mises[fresh, worst])])
        covered = np.maximum(covered, mises[chosen[-1]])
    return [points[k] for k in chosen]


def _loaded_states(body: FiniteElementModel, basis: ReducedBasis) -> Array:
    """Elastic coordinates (nq, n) under a few random loads each.

    A bar that is pulled and bent has its peak on one side. In states of all shape
    functions together such points hardly matter.
    """
    motions = [motion_rows(body, m, rotations=m.gradient is None) for m in body.markers]
    inertia = body.mass @ np.hstack([body.rigid_body_modes(), body.linear_fields()])
    loads = np.hstack([inertia, *(np.asarray(rows).T for rows in motions)])
    felt = (basis.shapes.T @ loads).real
    answers = np.linalg.lstsq(basis.stiffness.real, felt, rcond=1e-14)[0]
    energies = np.einsum("ij,ij->j", felt, answers)
    is_felt = energies > _NOT_FELT * energies.max(initial=0.0)
    answers = answers[:, is_felt] / np.sqrt(energies[is_felt])
    random = np.random.default_rng(1)
    size = (answers.shape[1], _RANDOM_STATES)
    order = random.random(size).argsort(axis=0)
    is_acting = order < random.integers(1, _MAX_LOADS + 1, _RANDOM_STATES)
    amplitudes = np.sqrt(_LEAST_LOAD) ** random.random(size)
    return np.asarray(answers @ (is_acting * amplitudes * random.choice([-1, 1], size)))


@dataclass(frozen=True, eq=False)
class _SamplePoints:
    """A group of points: stress (p, nq, 6), and a function that returns each point."""

    sigma: Array
    point: Callable[[int], StressPoint]


def _sample_points(
    body: FiniteElementModel, shapes: Array, initial: InitialStress | None
) -> Iterator[_SamplePoints]:
    """Yield the quadrature points, then the nodes of a mesh or the borders of knot
    spans.
    """
    if body.beam_stress is not None:
        yield _samples_of_beam(body.beam_stress, shapes, initial)
        return
    mesh = None
    if not body.patches:
        mesh = body.drawing_mesh if body.solids is None else body.solids.mesh
    fields, nq = shapes, shapes.shape[1]
    if initial is not None:
        fields = np.hstack([shapes, initial.displacement])
    means = None
    if mesh is not None:
        means = NodalAverages(body, mesh, 9 * fields.shape[1] + 6)
    for part in quadrature_parts(body, _POINTS_PER_BATCH):
        gradients = part.gradients(fields)
        if means is not None:
            means.add(part, _stress_and_rotation(part, gradients, initial))
        yield _samples_of_part(body, part, gradients, fields, nq, initial)
    if means is not None:
        yield from _samples_at_nodes(body, means, fields, nq)
    for part in _knot_span_points(body):
        yield _samples_of_part(body, part, part.gradients(fields), fields, nq, initial)


def _samples_of_beam(
    points: BeamStress, shapes: Array, initial: InitialStress | None
) -> _SamplePoints:
    count, nq = len(points.positions), shapes.shape[1]
    sigma = (points.stress @ shapes).reshape(count, 6, nq)
    phi = (points.displacement @ shapes).reshape(count, 3, nq)
    psi = (points.rotation @ shapes).reshape(count, 3, nq)
    fixed: Array = np.zeros((count, 6))
    if initial is not None:
        fixed = (points.stress @ initial.displacement).reshape(count, 6)

    def point(row: int) -> StressPoint:
        parts = phi[row], psi[row], sigma[row], fixed[row]
        return StressPoint(points.positions[row], *parts)

    return _SamplePoints(np.swapaxes(sigma, 1, 2), point)


def _samples_of_part(
    body: FiniteElementModel,
    part: QuadraturePart,
    gradients: Array,
    fields: Array,
    nq: int,
    initial: InitialStress | None,
) -> _SamplePoints:
    values = _stress_and_rotation(part, gradients, initial)

    def point(row: int) -> StressPoint:
        one = part.single_point(row)
        place = one.values[0] @ body.positions[one.nodes[0]]
        return _stress_point(place, one.displacements(fields)[0], values[row], nq)

    return _SamplePoints(_stress_of_values(values, nq), point)


def _samples_at_nodes(
    body: FiniteElementModel, means: NodalAverages, fields: Array, nq: int
) -> Iterator[_SamplePoints]:
    everywhere, table = means.values(), body.table[:, : body.dimension]

    def sample(start: int) -> _SamplePoints:
        values = everywhere[start : start + _POINTS_PER_BATCH]

        def point(row: int) -> StressPoint:
            node = means.nodes[start + row]
            moved = fields[table[node]]
            return _stress_point(body.positions[node], moved, values[row], nq)

        return _SamplePoints(_stress_of_values(values, nq), point)

    yield from map(sample, range(0, len(everywhere), _POINTS_PER_BATCH))


def _knot_span_points(body: FiniteElementModel) -> Iterator[QuadraturePart]:
    """Points of patches where knot spans meet or end, and halfway between."""
    if not body.patches:
        return
    d = body.dimension
    places = zip(body.patches, body.continua, strict=True)
    for number, ((patch, numbers), continuum) in enumerate(places):
        ends = [breakpoints(knots) for knots in patch.knots]
        axes = tuple(np.sort([*x, *(x[:-1] + x[1:]) / 2]) for x in ends)
        nodes, values, slopes = sampled_batch(patch, axes)
        law = continuum.law
        for start in range(0, len(nodes), _POINTS_PER_BATCH):
            cut = slice(start, start + _POINTS_PER_BATCH)
            if continuum.laws_at is not None:
                there = np.einsum("pm,pmd->pd", values[cut], patch.points[nodes[cut]])
                law = continuum.laws_at(there)
            yield QuadraturePart(
                nodes=numbers[nodes[cut]],
                values=values[cut],
                slopes=slopes[cut],
                weights=np.zeros(len(nodes[cut])),
                law=law,
                transverse=continuum.transverse,
                table=body.table[:, :d],
                continuum=number,
            )


def _stress_and_rotation(
    part: QuadraturePart, gradients: Array, initial: InitialStress | None
) -> Array:
    """(p, 9 k + 6) stresses and rotations by k fields, and the uniform stress."""
    p, k, d, _ = gradients.shape
    six = stress_components(stress_from_gradient(gradients, part.law), part.transverse)
    curl = 0.5 * np.einsum("abc,pkcb->pka", LEVI_CIVITA[:, :d, :d], gradients)
    uniform = np.zeros((p, 6), gradients.dtype)
    if initial is not None:
        uniform[:] = stress_components(initial.uniform, part.transverse)
    return np.hstack([six.reshape(p, 6 * k), curl.reshape(p, 3 * k), uniform])


def _stress_of_values(values: Array, nq: int) -> Array:
    """(p, nq, 6) of `_stress_and_rotation`."""
    return values[:, : 6 * nq].reshape(len(values), nq, 6)


def _peak_points_of_states(
    samples: Iterable[_SamplePoints], states: Array
) -> tuple[Array, list[StressPoint]]:
    """The peak of every state, and the points that have one of these, each once."""
    best = np.full(states.shape[1], -1.0)
    points_by_state: dict[int, StressPoint] = {}
    for number, sample in enumerate(samples):
        mises = _von_mises_stress(sample.sigma.real, states)
        rows = first_largest(mises, axis=0)
        improved = np.flatnonzero(mises.max(axis=0) > (1.0 + EQUAL) * best)
        points = {
            int(row): replace(sample.point(int(row)), place=(number, int(row)))
            for row in set(rows[improved])
        }
        for state in improved:
            row = int(rows[state])
            best[state] = mises[row, state]
            points_by_state[int(state)] = points[row]
    ordered = [points_by_state[state] for state in sorted(points_by_state)]
    return best, list({point.place: point for point in ordered}.values())


def _von_mises_stress(sigma: Array, states: Array) -> Array:
    """(p, s) of stresses (p, n, 6) per elastic coordinate in states (n, s)."""
    parts = np.moveaxis(sigma @ MISES.T, 2, 0) @ states
    return np.sqrt(np.einsum("cps,cps->ps", parts, parts))


def _stress_point(place: Array, moved: Array, values: Array, nq: int) -> StressPoint:
    """Make a point from its position (d,), displacements (d, k) and
    `_stress_and_rotation` of the fields.
    """
    d, k = moved.shape
    position, phi = np.zeros(3, place.dtype), np.zeros((3, nq), moved.dtype)
    position[:d], phi[:d] = place, moved[:, :nq]
    six, curl = values[: 6 * k].reshape(k, 6), values[6 * k : 9 * k].reshape(k, 3)
    fixed = values[9 * k :] + six[nq:].sum(axis=0)
    return StressPoint(position, phi, curl[:nq].T, six[:nq].T, fixed)


def _stress_node(number: int, point: StressPoint, frame: Frame) -> Node:
    origin = (point.position - frame.origin)[:, None]
    return Node(
        id=str(number),
        origin=Taylor(origin, point.phi.T[:, :, None]),
        phi=Taylor(point.phi),
        psi=Taylor(point.psi),
        AP=Taylor(np.eye(3), skew(point.psi.T)),
        sigma=Taylor(point.initial[:, None], point.sigma.T[:, :, None]),
    )
