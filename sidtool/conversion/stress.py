"""Stress recovery: sigma rows of nodes, and the points where the peak can be."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.model.reduction import StressRecovery
from sidtool.formats.sid import SID, Array, Node, Taylor
from sidtool.formats.sid_mass import skew
from sidtool.formats.stress import MISES

from ..frontends.elements.continuum import stress_from_gradient, stress_rows, stress_six
from ..frontends.finite_element_model import FiniteElementModel, MarkerRows
from ..reduction.basis import ReducedBasis
from ..reduction.frames import Frame
from .prestress import InitialStress
from .quadrature import QuadraturePart, quadrature
from .vectors import LEVI_CIVITA

#: Random states of equal energy that the peak points are chosen from.
_STATES = 400
#: Quadrature points that are looked at together, in all states.
_POINTS = 2_000
_SILENT = (
    "no stress is told at {}: tied to node sets; a marker at a point of the material "
    "tells it"
)


def with_stress(
    sid: SID,
    body: FiniteElementModel,
    frame: Frame,
    basis: ReducedBasis,
    settings: StressRecovery,
    initial: InitialStress | None = None,
) -> SID:
    """The SID with sigma rows at its markers, and with nodes for the peak.

    sigma holds xx, yy, zz, xy, yz, xz: m0 the prestress, m1 per elastic coordinate.
    The settings have passed `check_stress`.
    """
    nodes = []
    for node in sid.nodes:
        marker = next(m for m in body.markers if str(m.node) == node.id)
        if _wanted(marker, settings):
            rows = _rows(body, marker)
            fixed = np.zeros(6)
            if initial is not None:
                fixed = _initial(rows, initial, body.continua[0].transverse)
            sigma = Taylor(fixed[:, None], (rows @ basis.shapes).T[:, :, None])
            node = replace(node, sigma=sigma)
        nodes.append(node)
    if settings.peak_points:
        points = peak_points(body, basis, settings.peak_points, initial)
        for number, point in enumerate(points, settings.first_node):
            nodes.append(_node(number, point, frame))
    return replace(sid, nodes=tuple(nodes))


def check_stress(body: FiniteElementModel, settings: StressRecovery) -> list[str]:
    """Whether a body can tell the stress that is asked for; sentences on what is not.

    Raises
    ------
    InputError : a marker has no stress, or the number of a node is taken.
    """
    _check_numbers(body, settings)
    for marker in body.markers:
        if marker.name in (settings.markers or ()) and marker.gradient is None:
            raise InputError(
                f"there is no stress at marker {marker.name}",
                place="stress.markers",
                expected="a marker at a point of the material, not one tied to node "
                "sets",
            )
    told = [marker for marker in body.markers if _wanted(marker, settings)]
    laws = {
        (part.law.tobytes(), part.transverse, part.laws_at) for part in body.continua
    }
    if told and len(laws) != 1:
        raise InputError(
            "the body has several materials",
            place="stress.markers",
            expected="markers = [] and peak_points, which works for several; stress "
            "at markers needs a body of one material",
        )
    if not settings.peak_points and not told:
        raise InputError(
            "tells no stress: all markers are tied to node sets",
            place="stress",
            expected="a marker at a point of the material, or peak_points",
        )
    if settings.markers is not None:
        return []
    silent = [marker.name for marker in body.markers if marker.gradient is None]
    return [_SILENT.format(", ".join(silent))] if silent else []


def _check_numbers(body: FiniteElementModel, settings: StressRecovery) -> None:
    """Raises node numbers of peak points that markers have."""
    first = settings.first_node
    for marker in body.markers:
        if first <= marker.node < first + settings.peak_points:
            raise InputError(
                f"node {marker.node} belongs to marker {marker.name} already",
                place="stress.first_node",
                expected=f"the first of {settings.peak_points} free node numbers",
            )


def _wanted(marker: MarkerRows, settings: StressRecovery) -> bool:
    if settings.markers is None:
        return marker.gradient is not None
    return marker.name in settings.markers


def _rows(body: FiniteElementModel, marker: MarkerRows) -> NDArray[np.float64]:
    assert marker.gradient is not None
    continuum = body.continua[0]
    return stress_rows(marker.gradient, continuum, marker.position).toarray()


def _initial(rows: Array, initial: InitialStress, transverse: float) -> Array:
    uniform = stress_six(initial.uniform, transverse)
    return (rows @ initial.displacement)[:, 0] + uniform


@dataclass(frozen=True, eq=False)
class StressPoint:
    """A point inside the body.

    Attributes
    ----------
    position : (3,) in the axes of the model [m]
    phi, psi : (3, nq)
    sigma : (6, nq) stress per elastic coordinate
    initial : (6,) prestress [Pa]
    """

    position: Array
    phi: Array
    psi: Array
    sigma: Array
    initial: Array


def peak_points(
    body: FiniteElementModel,
    basis: ReducedBasis,
    count: int,
    initial: InitialStress | None = None,
) -> list[StressPoint]:
    """Quadrature points among which the largest von Mises stress is, for any state.

    Tried are every shape function alone and random states in which every shape
    function has the same strain energy on average. Points are taken one by one, each
    where the peak of the state that is worst served so far is.

    Raises
    ------
    InputError : the body came without elements.
    """
    nq = basis.shapes.shape[1]
    energy = np.sqrt(np.maximum(np.diag(basis.stiffness), 1e-300))
    random = np.random.default_rng(0).standard_normal((nq, _STATES))
    states = np.hstack([np.eye(nq), random]) / energy[:, None]
    peaks, points = _peaks(quadrature(body, _POINTS), basis.shapes, states)
    sigma = np.stack([_sigma(one, basis.shapes)[0] for one in points])
    mises = _mises(sigma, states)
    covered = np.zeros(len(peaks))
    chosen: list[int] = []
    while len(chosen) < min(count, len(points)):
        worst = int((covered / np.maximum(peaks, 1e-300)).argmin())
        fresh = [k for k in range(len(points)) if k not in chosen]
        chosen.append(max(fresh, key=lambda k: mises[k, worst]))
        covered = np.maximum(covered, mises[chosen[-1]])
    return [_point(body, basis, points[k], initial) for k in chosen]


def _peaks(
    parts: Iterable[QuadraturePart], shapes: Array, states: Array
) -> tuple[Array, list[QuadraturePart]]:
    """The peak of every state, and the points that have one of these, each once."""
    best = np.full(states.shape[1], -1.0)
    found: dict[int, tuple[tuple[int, int], QuadraturePart]] = {}
    for number, part in enumerate(parts):
        mises = _mises(_sigma(part, shapes), states)
        rows = mises.argmax(axis=0)
        for state in np.flatnonzero(mises.max(axis=0) > best):
            row = int(rows[state])
            best[state] = mises[row, state]
            found[int(state)] = ((number, row), part.only(row))
    places = dict(found[state] for state in sorted(found))
    return best, list(places.values())


def _mises(sigma: Array, states: Array) -> Array:
    """(p, s) of stresses (p, n, 6) per elastic coordinate in states (n, s)."""
    parts = np.moveaxis(sigma @ MISES.T, 2, 0) @ states
    return np.sqrt(np.einsum("cps,cps->ps", parts, parts))


def _sigma(part: QuadraturePart, shapes: Array) -> Array:
    """(p, n, 6)."""
    stress = stress_from_gradient(part.gradients(shapes), part.law)
    return stress_six(stress, part.transverse)


def _point(
    body: FiniteElementModel,
    basis: ReducedBasis,
    one: QuadraturePart,
    initial: InitialStress | None,
) -> StressPoint:
    d, nq = body.dimension, basis.shapes.shape[1]
    position = np.zeros(3)
    position[:d] = one.values[0] @ body.positions[one.nodes[0]]
    phi = np.zeros((3, nq))
    phi[:d] = one.displacements(basis.shapes)[0]
    gradient = np.zeros((nq, 3, 3))
    gradient[:, :d, :d] = one.gradients(basis.shapes)[0]
    psi = 0.5 * np.einsum("abc,ncb->an", LEVI_CIVITA, gradient)
    fixed = np.zeros(6)
    if initial is not None:
        fixed = _sigma(one, initial.displacement)[0, 0]
        fixed = fixed + stress_six(initial.uniform, one.transverse)
    return StressPoint(position, phi, psi, _sigma(one, basis.shapes)[0].T, fixed)


def _node(number: int, point: StressPoint, frame: Frame) -> Node:
    origin = (point.position - frame.origin)[:, None]
    return Node(
        id=str(number),
        origin=Taylor(origin, point.phi.T[:, :, None]),
        phi=Taylor(point.phi),
        psi=Taylor(point.psi),
        AP=Taylor(np.eye(3), skew(point.psi.T)),
        sigma=Taylor(point.initial[:, None], point.sigma.T[:, :, None]),
    )
