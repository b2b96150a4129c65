"""Markers tied to many nodes: RBE2 (rigid) and RBE3 (distributing), to second order.

Both markers move as the rigid motion that fits the nodes best in the least-squares
sense; loads spread over the nodes by the transposed rows. A rigid tie also makes the
nodes one rigid piece. The fit is weighted by the mass matrix of unit density of the
surface that the nodes span, in the plane by that of their edges, so that a force
spreads as a uniform traction. Nodes that span nothing have equal weights. The rows are
the first order of that fit; `second_order_rows` is the second, for geometric
stiffening.

The rows D and H of a marker give its displacement t = D u and its small rotation theta
= H u. The motion of a marker in a finite displacement u is the rigid motion after whose
removal the rows vanish: for a tie the best fit to its nodes, for a gradient the
rotation of its polar decomposition. At the distance r from the marker the displacement
without that motion is, to second order,

    u - t - theta x r - theta x (u - t) + theta x (theta x r) / 2

and D and H of it vanish. With first-order t and theta in products,

    t = D u - D f,    theta = H u - H f,    f = theta x (u - t - theta x r / 2)

A load on the rows does the work of D u and H u, which is too much by that of f. Of a
marker at one point D f = 0, and H f is a product of strain and rotation. Of a tie both
hold products of two rotations: in a plane D f at a distance from the tie's centroid, in
space H f as well.

The points of a cross-section of a beam have f = theta x (theta x r) / 2. A bending
moment does its work along the beam and a torsional one across it, in equal parts along
both axes of the section, so that H f = (e . theta) theta x e / 2 with the tangent e.

Nodes of a rigid tie have the second-order displacement f of their piece; the forces
that hold the piece together do work on it.

Source: the fit to nodes is that of B. K. P. Horn, H. M. Hilden, S. Negahdaripour,
"Closed-form solution of absolute orientation using orthonormal matrices", J. Opt. Soc.
Am. A 5, 1988; expanded here.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from sidtool.formats.base.complex_step import number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.model import ModelFile, NodeMarker
from sidtool.formats.model.reduction import Tie

from ..elements.faces import Surface
from ..elements.finite_element_model import (
    FiniteElementModel,
    Indices,
    MarkerRows,
    offset_marker,
)
from ..elements.markers import check_length, name_marker_in_errors
from ..elements.material_points import InertiaPoints
from ..geometry.cylinder_fit import Cylinder, fitted_cylinder
from ..mesh.connections import Coupling, PointMass
from ..mesh.quadratic_fields import LEVI_CIVITA

#: Nodes determine no rotation if its share in the fit is below this.
_ROTATION_TOLERANCE = 1e-12
#: Positions this close are equal, relative to the extent of the nodes; a marker this
#: far from the axis of its cylinder gets a note, relative to the radius.
_SAME_POSITION_TOLERANCE, _AXIS_TOLERANCE = 1e-6, 1e-4


def add_rigid_couplings(
    body: FiniteElementModel, model: ModelFile
) -> FiniteElementModel:
    """Add the markers of the model file that are tied to node sets.

    Raises
    ------
    InputError : a node set does not exist, does not determine the rotation of its
    marker,
        or is no cylinder although its marker should be on the axis.
    """
    if not any(marker.tie for marker in model.markers.values()):
        return body
    placed = {marker.name: marker for marker in body.markers}
    markers: list[MarkerRows] = []
    rigid = dict(body.rigid_sets)
    found: list[Diagnostic] = []
    for name, settings in model.markers.items():
        if settings.tie is None:
            markers.append(placed[name])
            continue
        held = _tied_nodes(body, settings.tie, f"markers.{name}.tie.to")
        with name_marker_in_errors(name):
            if name in placed:
                place = _TiePosition(placed[name].position, "as given")
            else:
                place = _tie_position(body, settings, held)
            rows = _weighted_rows(body, name, settings.node, held)
        markers.append(offset_marker(rows, place.position))
        found += _tie_notes(body, name, settings.tie, held, place)
        known = any(np.array_equal(held.nodes, own) for own in rigid.values())
        if settings.tie.type == "rigid" and not known:
            rigid[name] = held.nodes
    return replace(
        body,
        markers=tuple(markers),
        rigid_sets=rigid,
        diagnostics=(*body.diagnostics, *found),
    )


def weighted_rigid_motion(
    body: FiniteElementModel,
    name: str,
    nodes: Indices,
    weights: sp.csr_matrix | None = None,
) -> MarkerRows:
    """Return the weighted rigid motion of nodes at their centre.

    Parameters
    ----------
    weights : (n, n) weights of the nodes, equal if None

    Raises
    ------
    InputError : the nodes do not determine the rotation.
    """
    n = len(body.positions)
    mass = weights
    if mass is None:
        mass = sp.csr_matrix((np.ones(nodes.size), (nodes, nodes)), shape=(n, n))
    share = np.asarray(mass.sum(axis=0)).ravel()
    place = share @ body.positions / share.sum()
    centre = np.pad(place, (0, 3 - body.dimension))
    try:
        return _weighted_rows(body, name, 0, _TiedNodes(nodes, None, mass, centre))
    except InputError as error:
        raise InputError(f"{name}: {error.problem}", expected=error.expected) from None


@dataclass(frozen=True, eq=False)
class _TiedNodes:
    """Nodes of a tie, the surface that they span, and its mass matrix.

    Nodes without a surface have the identity for a mass matrix.
    """

    nodes: Indices
    surface: Surface | None
    mass: sp.csr_matrix
    centre: Array


@dataclass(frozen=True, eq=False)
class _TiePosition:
    """Position (3,) of a tied marker, its reason, and the numbers in that."""

    position: Array
    reason: str
    numbers: Mapping[str, float] = field(default_factory=dict)


def _tied_nodes(body: FiniteElementModel, tie: Tie, place: str) -> _TiedNodes:
    nodes, n = _nodes_of_tie(body, tie, place), len(body.positions)
    surface = body.surface(tie.names)
    if surface is None or not surface.mass.nnz:
        mass = sp.csr_matrix((np.ones(nodes.size), (nodes, nodes)), shape=(n, n))
    else:
        mass = surface.mass
    share = np.asarray(mass.sum(axis=0)).ravel()
    centre = share @ body.positions / share.sum()
    return _TiedNodes(nodes, surface, mass, np.pad(centre, (0, 3 - body.dimension)))


def _tie_position(
    body: FiniteElementModel, settings: NodeMarker, held: _TiedNodes
) -> _TiePosition:
    d = body.dimension
    if settings.position is not None:
        check_length(settings.position, d, "position")
        return _TiePosition(np.pad(settings.position, (0, 3 - d)), "as given")
    if settings.at == "axis":
        cylinder = _fit_cylinder(body, held)
        reason = f"on the axis of a cylinder of radius {cylinder.radius:.6g} m"
        if cylinder.miss > _AXIS_TOLERANCE * cylinder.radius:
            reason += f", which they miss by up to {cylinder.miss:.2g} m"
        numbers = {"radius": cylinder.radius, "deviation": cylinder.miss}
        return _TiePosition(np.pad(cylinder.centre, (0, 3 - d)), reason, numbers)
    what = "nodes" if held.surface is None else "surface"
    return _TiePosition(held.centre, f"in the centre of its {what}")


def _fit_cylinder(body: FiniteElementModel, held: _TiedNodes) -> Cylinder:
    if held.surface is None:
        return fitted_cylinder(body.positions[held.nodes], np.zeros((3, 3)))
    return fitted_cylinder(held.surface.points, held.surface.normals)


def _tie_notes(
    body: FiniteElementModel, name: str, tie: Tie, held: _TiedNodes, place: _TiePosition
) -> Iterator[Diagnostic]:
    """Yield the distance of a marker from its nodes, and nodes without load (N136 to
    N138).
    """
    own = body.positions.real[held.nodes]
    size, count = float(np.ptp(own, axis=0).max()), len(own)
    mean = np.pad(own.mean(axis=0), (0, 3 - body.dimension))
    gap = float(np.linalg.norm(place.position.real - mean))
    if gap > _SAME_POSITION_TOLERANCE * size:
        yield diagnose(
            "N136",
            f"marker {name}",
            position=format_position(place.position.real, size),
            gap=gap,
            count=count,
            reason=place.reason,
            remedy=_cylinder_hint(body, held, place),
            **place.numbers,
        )
    if tie.type == "rigid":
        return
    if held.surface is None:
        yield diagnose("N137", f"marker {name}")
    idle = count - np.count_nonzero(held.mass.diagonal()[held.nodes])
    if idle:
        yield diagnose("N138", f"marker {name}", idle=int(idle), count=count)


def _cylinder_hint(
    body: FiniteElementModel, held: _TiedNodes, place: _TiePosition
) -> str:
    """Return a note on a marker in the centre of an incomplete cylinder."""
    if place.position is not held.centre:
        return ""
    try:
        cylinder = _fit_cylinder(body, held)
    except InputError:
        return ""
    gap = np.linalg.norm((cylinder.centre - place.position[: body.dimension]).real)
    if cylinder.arc < np.pi or gap < _AXIS_TOLERANCE * cylinder.radius:
        return ""
    return f'The axis of the cylinder is {gap:.3g} m away: at = "axis" puts it there.'


def format_position(position: Array, size: float) -> str:
    """Format a position [m]; coordinates that are rounding beside a size are zero."""
    shown_position = np.where(np.abs(position) < 1e-9 * size, 0.0, position)
    return f"({', '.join(f'{x:.6g}' for x in shown_position)}) m"


def _nodes_of_tie(body: FiniteElementModel, tie: Tie, place: str) -> Indices:
    missing = [name for name in tie.names if name not in body.node_sets]
    if missing:
        raise InputError(
            f"there is no edge or node set {missing[0]!r}",
            place=place,
            expected=f"one of {', '.join(body.node_sets)}",
        )
    return np.unique(np.concatenate([body.node_sets[name] for name in tie.names]))


def _weighted_rows(
    body: FiniteElementModel, name: str, node: int, held: _TiedNodes
) -> MarkerRows:
    """Return the rows of the motion of the centre of the coupled nodes."""
    d = body.dimension
    dofs = body.table[held.nodes, :d].ravel()
    dofs = dofs[dofs >= 0]
    metric = _displacement_metric(body, held.mass)[dofs][:, dofs]
    rigid = body.rigid_body_modes(held.centre)[dofs]
    momentum = metric @ rigid
    gram = rigid.T @ momentum
    scale = np.sqrt(np.maximum(np.diag(gram.real), 1e-300))
    scaled = gram.real / np.outer(scale, scale)
    if np.linalg.eigvalsh(scaled)[0] < _ROTATION_TOLERANCE:
        raise InputError(
            "these nodes do not determine how the marker turns",
            place="tie.to",
            expected="nodes in more places: not one point, and in space not one line",
        )
    fit = np.zeros((6, body.ndof), gram.dtype)
    which = np.array([0, 1, 5] if d == 2 else range(6))
    fit[which[:, None], dofs] = np.linalg.solve(gram, momentum.T)
    rows = sp.csr_matrix(fit)
    return MarkerRows(name, node, held.centre, rows[:3], rows[3:])


def _displacement_metric(
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


def add_couplings(body: FiniteElementModel) -> FiniteElementModel:
    """Add the couplings and point masses of its file to a body.

    Raises
    ------
    InputError : the nodes of a coupling do not determine the rotation of its reference
        point.
    """
    if not body.couplings and not body.point_masses:
        return body
    points = {c.name: _coupling_reference(body, c) for c in body.couplings}
    markers = {name: points[c.name] for c in body.couplings for name in c.markers}
    moved = tuple(
        replace(markers[m.name], name=m.name, node=m.node) if m.name in markers else m
        for m in body.markers
    )
    result = replace(
        body,
        markers=moved,
        pieces=tuple(points[c.name] for c in body.couplings if c.rigid),
        rigid_sets={c.name: c.nodes for c in body.couplings if c.rigid},
    )
    if not body.point_masses:
        return result
    return replace(result, inertia_points=_point_mass_particles(body, points))


def _coupling_reference(body: FiniteElementModel, coupling: Coupling) -> MarkerRows:
    rows = weighted_rigid_motion(body, coupling.name, coupling.nodes, coupling.weights)
    return rows if coupling.position is None else offset_marker(rows, coupling.position)


def _point_mass_particles(
    body: FiniteElementModel, points: dict[str, MarkerRows]
) -> InertiaPoints:
    rows = [_mass_motion(body, mass, points) for mass in body.point_masses]
    return InertiaPoints(
        positions=np.array([row.position for row in rows]),
        masses=np.array([mass.mass for mass in body.point_masses]),
        inertias=np.array([mass.inertia for mass in body.point_masses]),
        displacement=sp.csr_matrix(sp.vstack([row.displacement for row in rows])),
        rotation=sp.csr_matrix(sp.vstack([row.rotation for row in rows])),
    )


def _mass_motion(
    body: FiniteElementModel, mass: PointMass, points: dict[str, MarkerRows]
) -> MarkerRows:
    """Rows of the motion of the centre of a mass."""
    if mass.coupling is not None:
        point = points[mass.coupling]
        return offset_marker(point, point.position + mass.offset)
    assert mass.node is not None
    d = body.dimension
    dofs = body.table[mass.node, :d]
    shape = (3, body.ndof)
    rows = sp.csr_matrix((np.ones(d), (np.arange(d), dofs)), shape=shape)
    position = np.pad(body.positions[mass.node], (0, 3 - d))
    return MarkerRows("mass", 0, position, rows, sp.csr_matrix(shape))


def second_order_rows(
    body: FiniteElementModel, marker: MarkerRows, shapes: Array
) -> tuple[Array, Array]:
    """Return the second order that the rows of a marker contain beyond its motion.

    The displacement is D Phi q - q^T E q / 2 with the first E, the rotation vector
    H Phi q - q^T E q / 2 with the second.

    Parameters
    ----------
    shapes : (ndof, nq)

    Returns
    -------
    two of (3, nq, nq), symmetric in the shape functions [m], [rad]
    """
    dofs = np.union1d(marker.displacement.indices, marker.rotation.indices)
    nodes = np.flatnonzero(np.isin(body.table[:, :3], dofs).any(axis=1))
    rows = np.vstack([marker.displacement.toarray(), marker.rotation.toarray()])
    work = _second_order_work(body, marker, nodes, shapes, rows.T)
    shift, turn = work[:3], work[3:]
    if marker.tangent is not None:
        turn = turn + _second_order_rows_of_section(
            marker.tangent, marker.rotation @ shapes
        )
    return shift, turn


def _second_order_rows_of_section(tangent: Array, turn: Array) -> Array:
    """(3, nq, nq) from H f of a cross-section that turns by turn (3, nq)."""
    crossed = np.einsum("abc,bk,c->ak", LEVI_CIVITA, turn, tangent)
    pairs = np.einsum("ak,l->akl", crossed, tangent @ turn)
    return (pairs + np.swapaxes(pairs, 1, 2)) / 2


def second_order_work_of_ties(
    body: FiniteElementModel, forces: Array, shapes: Array
) -> Array:
    """Return the work of forces on second-order displacements of nodes of all rigid
    ties.

    Parameters
    ----------
    forces : (ndof, n) [N]
    shapes : (ndof, nq)

    Returns
    -------
    (n, nq, nq), symmetric in the shape functions; half of q^T . q is the work [N m]
    """
    nq = shapes.shape[1]
    total = np.zeros((forces.shape[1], nq, nq), number_type(forces, shapes))
    for name, nodes in body.rigid_sets.items():
        total += _second_order_work(body, body.marker(name), nodes, shapes, forces)
    return total


def _second_order_work(
    body: FiniteElementModel,
    marker: MarkerRows,
    nodes: Indices,
    shapes: Array,
    forces: Array,
) -> Array:
    """Return (n, nq, nq), twice the work of forces (ndof, n) on the displacements f of
    nodes.

    A force times theta x a is theta times the moment of the force on the arm a.
    """
    shift, turn = marker.displacement @ shapes, marker.rotation @ shapes
    r = np.zeros((nodes.size, 3), number_type(body.positions, marker.position))
    r[:, : body.dimension] = body.positions[nodes]
    r -= marker.position
    half = np.einsum("bca,cl,pa->pbl", LEVI_CIVITA, turn, r) / 2
    arms = _field_at_nodes(body, nodes, shapes) - shift - half
    at_nodes = _field_at_nodes(body, nodes, forces)
    pairs = np.einsum("pcl,pan->clan", arms, at_nodes, optimize=True)
    moments = np.einsum("bca,clan->nbl", LEVI_CIVITA, pairs)
    work = np.einsum("bk,nbl->nkl", turn, moments)
    return work + np.swapaxes(work, 1, 2)


def _field_at_nodes(body: FiniteElementModel, nodes: Indices, fields: Array) -> Array:
    """(p, 3, n) of the fields (ndof, n): zero where a node has no such motion."""
    numbers = body.table[nodes, :3]
    return np.where((numbers >= 0)[..., None], fields[numbers], 0.0)
