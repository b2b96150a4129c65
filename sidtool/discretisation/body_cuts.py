"""Plane cuts through solid bodies, for section forces.

Cross-sections of the members of a frame, and what lies beyond them.

A cut that separates the frame has section forces by the equilibrium of the part beyond.
Where members form a ring, a cut leaves the frame connected: its section forces are what
the element at the cut exerts on the node there, by its displacements and its loads.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sidtool.formats.base.complex_step import analytic_pinv
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model import ModelFile
from sidtool.formats.model.geometry import PlaneCut

from ..beams.axis import y_direction
from ..beams.element import Indices, rows_without_rounding, scatter_rows
from ..elements.finite_element_model import (
    BodyCut,
    FiniteElementModel,
    MarkerRows,
    moving_dofs,
)
from ..elements.plane_cuts import (
    ElementGroup,
    Plane,
    mesh_groups,
    part_beyond,
    patch_group,
)
from .bar_elements import BarElement
from .marker_couplings import weighted_rigid_motion

#: The part before a plane has no mass if it is below this share of the whole.
_NO_MASS = 1e-12

#: Relative cut-off of singular values of the motion of an end by its node.
_INDEPENDENT = 1e-9


def add_cuts(body: FiniteElementModel, model: ModelFile) -> FiniteElementModel:
    """Add the plane cuts of the model file to a body of solid elements.

    Raises
    ------
    InputError : the body has no solid elements, or a plane does not cut it.
    """
    requested = model.section_forces
    if requested is None or not requested.cuts:
        return body
    if not np.isrealobj(body.positions):  # derivatives of SIDs have no sections
        return body
    groups = list(mesh_groups(body.solids)) if body.solids else []
    if body.patches:
        assert model.material is not None
        groups = [
            patch_group(patch, numbers, continuum, model.material.density)
            for (patch, numbers), continuum in zip(
                body.patches, body.continua, strict=True
            )
        ]
    if not groups:
        raise InputError(
            "is for bodies of solid or plane elements",
            place="section_forces.cuts",
            expected="a body without shells and bars",
        )
    tied = {name for name, marker in model.markers.items() if marker.tie is not None}
    tied |= {name for coupling in body.couplings for name in coupling.markers}
    cuts = []
    for name, cut in requested.cuts.items():
        try:
            cuts.append(_body_cut(body, groups, name, cut, tied))
        except InputError as error:
            raise InputError(
                error.problem,
                place=f"section_forces.cuts.{name}{error.place or ''}",
                expected=error.expected,
            ) from None
    return replace(body, cuts=tuple(cuts))


def _body_cut(
    body: FiniteElementModel,
    groups: list[ElementGroup],
    name: str,
    cut: PlaneCut,
    tied: set[str],
) -> BodyCut:
    plane, axes = _plane_and_axes(body, cut)
    d = body.dimension
    distances = plane.snapped_distances(body.positions)
    chosen = _nearest_piece(body, plane, distances) if cut.nearest else None
    part = part_beyond(groups, body.positions, plane, body.internal_inertia, chosen)
    nodes = np.flatnonzero(part.section.diagonal())
    if not nodes.size:
        raise InputError(
            "this plane does not meet the body",
            place=".point",
            expected="a point of the body, or of a cross-section of it",
        )
    motion = weighted_rigid_motion(body, name, nodes, part.section)
    points = body.inertia_points
    everything = body.scalar_mass
    assert everything is not None
    before = everything.sum() - part.scalar_mass.sum()
    at_start = before <= _NO_MASS * everything.sum()

    def beyond(positions: Array) -> NDArray[np.bool_]:
        """Of positions (k, 3); those in the plane belong to the part, if there is mass
        before it.
        """
        s = plane.snapped_distances(positions[:, :d])
        found = (s > 0) if at_start else (s >= 0)
        if chosen is None:
            return found
        close = np.linalg.norm(body.positions - positions[:, None, :d], axis=2)
        close[:, distances < 0] = np.inf
        return found & chosen[close.argmin(axis=1)]

    if cut.markers is not None:
        markers = cut.markers
    else:
        loaded = [
            _position_of_load(body, m, m.name in tied, plane) for m in body.markers
        ]
        inside = beyond(np.array(loaded))
        markers = tuple(
            m.name
            for m, is_beyond in zip(body.markers, inside, strict=True)
            if is_beyond
        )
    none = np.zeros(0, bool)
    return BodyCut(
        name=name,
        section=motion,
        axes=axes,
        points=none if points is None else beyond(points.positions),
        markers=markers,
        scalar_mass=part.scalar_mass,
        internal_inertia=part.internal_inertia,
    )


def _plane_and_axes(body: FiniteElementModel, cut: PlaneCut) -> tuple[Plane, Array]:
    """The plane, and the axes of the section in rows."""
    d = body.dimension
    for key, vector in (("point", cut.point), ("normal", cut.normal)):
        if len(vector) != d:
            raise InputError(
                f"has {len(vector)} coordinates", place=f".{key}", expected=f"{d}"
            )
    if not np.any(cut.normal):
        raise InputError("is zero", place=".normal", expected="a direction")
    point, normal = np.array(cut.point), np.array(cut.normal)
    plane = Plane.through(body.positions, point, normal)
    if d == 2:
        if cut.y_axis is not None:
            raise InputError("is for bodies in space", place=".y_axis")
        x, y = plane.normal
        return plane, np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])
    try:
        y_axis = y_direction(cut.y_axis, plane.normal)
    except InputError:
        raise InputError(
            "is parallel to the normal", place=".y_axis", expected="another direction"
        ) from None
    return plane, np.array([plane.normal, y_axis, np.cross(plane.normal, y_axis)])


def _position_of_load(
    body: FiniteElementModel, marker: MarkerRows, tied: bool, plane: Plane
) -> Array:
    """(3,) where forces at a marker act on the body: of a tied one its nodes.

    Raises
    ------
    InputError : the plane passes through what the marker is tied to.
    """
    if not tied:
        return marker.position
    dofs = moving_dofs(marker.displacement)
    held = np.isin(body.table, dofs).any(axis=1)
    positions = body.positions[held]
    s = plane.snapped_distances(positions)
    if s.min() < 0 < s.max():
        raise InputError(
            f"the plane passes through the nodes of the tied marker {marker.name}",
            place=".markers",
            expected="the names of the markers beyond the plane, with it or without it",
        )
    return np.pad(positions.mean(axis=0), (0, 3 - body.dimension))


def _nearest_piece(
    body: FiniteElementModel, plane: Plane, distances: Array
) -> NDArray[np.bool_]:
    """(n,) mask of the nodes beyond the plane that are connected with the section
    nearest to the point of the plane.
    """
    beyond = distances > 0
    if not beyond.any():
        raise InputError(
            "nothing lies beyond the plane", place=".nearest", expected="false"
        )
    n = len(body.positions)
    there = body.table >= 0
    owner = np.zeros(body.ndof, np.int64)
    owner[body.table[there]] = np.nonzero(there)[0]
    entries = body.stiffness.tocoo()
    links = [np.column_stack([owner[entries.row], owner[entries.col]])]
    joined = [*body.rigid_sets.values()]
    if body.equations is not None:
        matrix = body.equations.matrix
        joined += [
            owner[matrix.indices[a:b]] for a, b in pairwise(matrix.indptr.tolist())
        ]
    for nodes in joined:
        held = nodes[beyond[nodes]]
        links.append(np.column_stack([held, np.roll(held, 1)]))
    pairs = np.concatenate(links)
    pairs = pairs[beyond[pairs].all(axis=1)]
    graph = sp.csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (n, n))
    _, piece = connected_components(graph, directed=False)
    near = np.linalg.norm(body.positions - plane.point, axis=1)
    nearest = np.where(beyond, near, np.inf).argmin()
    return np.asarray(beyond & (piece == piece[nearest]))


@dataclass(frozen=True, eq=False)
class Connectivity:
    """Nodes and elements as vertices of a graph, joined where an element has its end.

    Attributes
    ----------
    joints : (k, 2) element and node of every end; elements count after the nodes
    count : of vertices
    """

    joints: Indices
    count: int

    def beyond(
        self, element: int, node: int, *, of_element: bool
    ) -> NDArray[np.bool_] | None:
        """(count,) mask of what is connected with one side of a cut between an element
        and a node; None where the other side is, too.

        Parameters
        ----------
        of_element : True for the side of the element, False for that of the node
        """
        kept = ~((self.joints[:, 0] == element) & (self.joints[:, 1] == node))
        i, j = self.joints[kept].T
        graph = sp.csr_matrix((np.ones(len(i)), (i, j)), (self.count, self.count))
        _, part = connected_components(graph, directed=False)
        if part[element] == part[node]:
            return None
        mask: NDArray[np.bool_] = part == part[element if of_element else node]
        return mask


def member_cuts(
    member: str,
    fractions: Mapping[str, float],
    ends: Array,
    elements: Sequence[tuple[BarElement, Indices]],
    vertices: tuple[Sequence[int], Sequence[int]],
    graph: Connectivity,
    owners: Indices,
    markers: Mapping[str, int],
    ndof: int,
    end_motion: Callable[[int, int], tuple[Indices, Array]],
    continued: Mapping[int, Array],
) -> list[BodyCut]:
    """Return the cuts of a member, called MEMBER.SECTION.

    Parameters
    ----------
    fractions : name of a section -> fraction of the length
    ends : (n + 1,) fractions between elements
    vertices : of the n elements, and of the n + 1 nodes
    owners : (p,) vertices of the inertia points
    markers : name of a marker -> its vertex
    end_motion : of the vertex of an element and the number of an end, the rows of the
        element's degrees of freedom that are its node's there, and the motion (6, k) of
        the end by them
    continued : label of a node, its vertex plus 1 -> direction of all its members
    """
    of_elements, of_nodes = vertices
    cuts = []
    for name, at in fractions.items():
        k = int(np.abs(ends - at).argmin())
        before = max(k - 1, 0)
        mask = graph.beyond(of_elements[before], of_nodes[k], of_element=k == 0)
        element, dofs = elements[before]
        place = 0.0 if k == 0 else 1.0
        rows = element.rows(place)
        frames = element.frames(np.array([place]))
        axes = frames.section_axes[0]
        section = MarkerRows(
            name=f"{member}.{name}",
            node=0,
            position=frames.places[0],
            displacement=rows_without_rounding(rows.displacement[0], dofs, ndof),
            rotation=rows_without_rounding(rows.rotation[0], dofs, ndof),
            tangent=continued.get(of_nodes[k] + 1),
        )
        if mask is not None:
            points = mask[owners]
            beyond = tuple(marker for marker, v in markers.items() if mask[v])
            cuts.append(BodyCut(section.name, section, axes, points, beyond))
            continue
        own, motion = end_motion(of_elements[before], 0 if k == 0 else 1)
        jump = analytic_pinv(motion, _INDEPENDENT) @ np.kron(np.eye(2), axes.T)
        if k == 0:  # the node is before the section
            jump = -jump
        cuts.append(
            BodyCut(
                name=section.name,
                section=section,
                axes=axes,
                points=owners == of_elements[before],
                markers=(),
                resultants=scatter_rows(jump.T @ element.stiffness()[own], dofs, ndof),
                jump=sp.csr_matrix(scatter_rows(jump.T, dofs[own], ndof).T),
            )
        )
    return cuts
