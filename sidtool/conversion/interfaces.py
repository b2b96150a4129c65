"""Markers tied to many nodes: RBE2 (rigid) and RBE3 (distributing).

Both markers move as the rigid motion that fits the nodes best in the least-squares
sense; loads spread over the nodes by the transposed rows. A rigid tie also makes the
nodes one rigid piece. The fit weighs by the mass matrix of unit density of the surface
that the nodes span, in the plane by that of their edges, so that a force spreads as a
uniform traction; nodes that span nothing weigh alike. The rows are the first order of
that fit; what `marker_motion` adds for stiffening is the second.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile, NodeMarker
from sidtool.formats.model.reduction import Tie

from ..frontends.finite_element_model import (
    FiniteElementModel,
    Indices,
    MarkerRows,
    carried,
)
from ..frontends.patches.markers import at_marker, check_length
from ..frontends.surface import Surface
from ..geometry.cylinder import Cylinder, fitted_cylinder

Array = NDArray[np.float64]

#: Nodes do not tell a rotation if its share in the fit is below this.
_FLAT = 1e-12
#: Places this close are one, of the extent of the nodes; and a marker this far from the
#: axis of its cylinder is told, of the radius.
_SAME, _OFF_AXIS = 1e-6, 1e-4


def tied(body: FiniteElementModel, model: ModelFile) -> FiniteElementModel:
    """The body with the markers of the model file that are tied to node sets.

    Raises
    ------
    InputError : a node set does not exist, or does not tell how its marker turns, or is
        no cylinder and its marker should stand on the axis.
    """
    if not any(marker.tie for marker in model.markers.values()):
        return body
    placed = {marker.name: marker for marker in body.markers}
    markers: list[MarkerRows] = []
    rigid = dict(body.rigid_sets)
    notes: list[str] = []
    for name, settings in model.markers.items():
        if settings.tie is None:
            markers.append(placed[name])
            continue
        held = _held(body, settings.tie, f"markers.{name}.tie.to")
        with at_marker(name):
            if name in placed:
                place = _Place(placed[name].position, "as given")
            else:
                place = _place(body, settings, held)
            rows = _fitted_rows(body, name, settings.node, held)
        markers.append(carried(rows, place.position))
        notes += _notes(body, name, settings.tie, held, place)
        known = any(np.array_equal(held.nodes, own) for own in rigid.values())
        if settings.tie.type == "rigid" and not known:
            rigid[name] = held.nodes
    return replace(
        body,
        markers=tuple(markers),
        rigid_sets=rigid,
        notes=(*body.notes, *notes),
    )


def fitted_to(
    body: FiniteElementModel,
    name: str,
    nodes: Indices,
    weights: sp.csr_matrix | None = None,
) -> MarkerRows:
    """The motion of the centre of some nodes by their weights (n, n), alike if None.

    Raises
    ------
    InputError : they do not tell how it turns.
    """
    n = len(body.positions)
    mass = weights
    if mass is None:
        mass = sp.csr_matrix((np.ones(nodes.size), (nodes, nodes)), shape=(n, n))
    share = np.asarray(mass.sum(axis=0)).ravel()
    place = share @ body.positions / share.sum()
    centre = np.pad(place, (0, 3 - body.dimension))
    try:
        return _fitted_rows(body, name, 0, _Held(nodes, None, mass, centre))
    except InputError as error:
        raise InputError(f"{name}: {error.problem}", expected=error.expected) from None


@dataclass(frozen=True, eq=False)
class _Held:
    """What a tie holds: nodes, the surface that they span, and its mass matrix.

    Nodes without a surface have the identity for a mass matrix.
    """

    nodes: Indices
    surface: Surface | None
    mass: sp.csr_matrix
    centre: Array


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a tied marker is, (3,), and why."""

    position: Array
    reason: str


def _held(body: FiniteElementModel, tie: Tie, place: str) -> _Held:
    nodes, n = _nodes(body, tie, place), len(body.positions)
    surface = body.surface(tie.names)
    if surface is None or not surface.mass.nnz:
        mass = sp.csr_matrix((np.ones(nodes.size), (nodes, nodes)), shape=(n, n))
    else:
        mass = surface.mass
    share = np.asarray(mass.sum(axis=0)).ravel()
    centre = share @ body.positions / share.sum()
    return _Held(nodes, surface, mass, np.pad(centre, (0, 3 - body.dimension)))


def _place(body: FiniteElementModel, settings: NodeMarker, held: _Held) -> _Place:
    d = body.dimension
    if settings.position is not None:
        check_length(settings.position, d, "position")
        return _Place(np.pad(settings.position, (0, 3 - d)), "as given")
    if settings.at == "axis":
        cylinder = _cylinder(body, held)
        reason = f"on the axis of a cylinder of radius {cylinder.radius:.6g} m"
        if cylinder.miss > _OFF_AXIS * cylinder.radius:
            reason += f", which they miss by up to {cylinder.miss:.2g} m"
        return _Place(np.pad(cylinder.centre, (0, 3 - d)), reason)
    what = "nodes" if held.surface is None else "surface"
    return _Place(held.centre, f"in the centre of its {what}")


def _cylinder(body: FiniteElementModel, held: _Held) -> Cylinder:
    if held.surface is None:
        return fitted_cylinder(body.positions[held.nodes], np.zeros((3, 3)))
    return fitted_cylinder(held.surface.points, held.surface.normals)


def _notes(
    body: FiniteElementModel, name: str, tie: Tie, held: _Held, place: _Place
) -> Iterator[str]:
    """How far a marker is from the mean of its nodes, and what bears nothing."""
    own = body.positions[held.nodes]
    size, count = float(np.ptp(own, axis=0).max()), len(own)
    mean = np.pad(own.mean(axis=0), (0, 3 - body.dimension))
    gap = float(np.linalg.norm(place.position - mean))
    if gap > _SAME * size:
        where = described(place.position, size)
        yield (
            f"marker {name} stands at {where}, {place.reason}; the mean of its "
            f"{count} nodes is {gap:.3g} m away{_hint(body, held, place)}"
        )
    if tie.type == "rigid":
        return
    if held.surface is None:
        yield f"the nodes of marker {name} span no face or edge: each weighs alike"
    idle = count - np.count_nonzero(held.mass.diagonal()[held.nodes])
    if idle:
        yield (
            f"{idle} of the {count} nodes of marker {name} belong to no face or edge "
            "that the others span: they bear no load"
        )


def _hint(body: FiniteElementModel, held: _Held, place: _Place) -> str:
    """What a marker in the centre of most of a cylinder is told."""
    if place.position is not held.centre:
        return ""
    try:
        cylinder = _cylinder(body, held)
    except InputError:
        return ""
    gap = np.linalg.norm(cylinder.centre - place.position[: body.dimension])
    if cylinder.arc < np.pi or gap < _OFF_AXIS * cylinder.radius:
        return ""
    return f', and that of the cylinder {gap:.3g} m: at = "axis" puts it there'


def described(position: Array, size: float) -> str:
    """A place for the user [m]; what is rounding beside a size is zero."""
    told = np.where(np.abs(position) < 1e-9 * size, 0.0, position)
    return f"({', '.join(f'{x:.6g}' for x in told)}) m"


def _nodes(body: FiniteElementModel, tie: Tie, place: str) -> Indices:
    missing = [name for name in tie.names if name not in body.node_sets]
    if missing:
        raise InputError(
            f"there is no edge or node set {missing[0]!r}",
            place=place,
            expected=f"one of {', '.join(body.node_sets)}",
        )
    return np.unique(np.concatenate([body.node_sets[name] for name in tie.names]))


def _fitted_rows(
    body: FiniteElementModel, name: str, node: int, held: _Held
) -> MarkerRows:
    """The rows of the motion of the centre of what is held."""
    d = body.dimension
    dofs = body.table[held.nodes, :d].ravel()
    dofs = dofs[dofs >= 0]
    metric = _on_displacements(body, held.mass)[dofs][:, dofs]
    rigid = body.rigid_body_modes(held.centre)[dofs]
    momentum = metric @ rigid
    gram = rigid.T @ momentum
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    if np.linalg.eigvalsh(gram / np.outer(scale, scale))[0] < _FLAT:
        raise InputError(
            "these nodes do not tell how the marker turns",
            place="tie.to",
            expected="nodes in more places: not one point, and in space not one line",
        )
    fit = np.zeros((6, body.ndof))
    which = np.array([0, 1, 5] if d == 2 else range(6))
    fit[which[:, None], dofs] = np.linalg.solve(gram, momentum.T)
    rows = sp.csr_matrix(fit)
    return MarkerRows(name, node, held.centre, rows[:3], rows[3:])


def _on_displacements(
    body: FiniteElementModel, weights: sp.csr_matrix
) -> sp.csr_matrix:
    """A metric of nodes as one of all displacement components, (ndof, ndof)."""
    entries = weights.tocoo()
    total = sp.csr_matrix((body.ndof, body.ndof))
    for axis in range(body.dimension):
        i, j = body.table[entries.row, axis], body.table[entries.col, axis]
        there = (i >= 0) & (j >= 0)
        part = (entries.data[there], (i[there], j[there]))
        total = total + sp.csr_matrix(part, shape=total.shape)
    return sp.csr_matrix(total)
