"""Body frames: their position, and the motion that vanishes in them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import analytic_norm
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.extremes import first_largest
from sidtool.formats.base.sid import Array
from sidtool.formats.model.reduction import BuckensFrame, ChordFrame, TangentFrame

from ..elements.finite_element_model import (
    FiniteElementModel,
    Indices,
    MarkerRows,
    moving_dofs,
)

#: Conditions fix a frame if no rigid motion satisfies them: smallest relative singular
#: value that counts as non-zero.
_SINGULARITY_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class Frame:
    """A body frame, parallel to the axes of the model.

    Attributes
    ----------
    origin : (3,) in the axes of the model [m]
    held : (ndof,) the degrees of freedom that vanish in this frame
    rows : (3 or 6, ndof) conditions ``rows @ u = 0`` that define the frame of a body
        that is not clamped; None if `held` defines it, or if there is no condition
    supports : whether these conditions also support the body in the computation of
        shape functions
    """

    origin: Array
    held: NDArray[np.bool_]
    rows: Array | None = None
    supports: bool = False

    def without_rigid_motion(self, model: FiniteElementModel, shapes: Array) -> Array:
        """Return shape functions (ndof, n) without the rigid motion of the frame."""
        if self.rows is None:
            return shapes
        rigid = model.rigid_body_modes(self.origin)
        motion = np.linalg.solve(self.rows @ rigid, self.rows @ shapes)
        return shapes - rigid @ motion


def tangent_frame(model: FiniteElementModel, settings: TangentFrame) -> Frame:
    """Return the frame of a marker, whose displacement and rotation vanish.

    Raises
    ------
    InputError : the marker does not lie on the edges that are clamped, or has no
        rotation that a frame could follow.
    """
    marker = model.marker(settings.marker)
    held = held_dofs(model, settings.clamped_edges, "frame.clamp")
    if not settings.clamped_edges:
        return _frame_conditions(model, marker.position, motion_rows(model, marker))
    if not held[moving_dofs(marker.displacement)].all():
        edges = " and ".join(settings.clamped_edges)
        raise InputError(
            f"marker {settings.marker} is not on the clamped edge {edges}",
            place="frame.marker",
            expected="a marker that does not move in its own frame",
        )
    return Frame(origin=marker.position, held=held)


def chord_frame(model: FiniteElementModel, settings: ChordFrame) -> Frame:
    """Return the frame at one marker whose axis points to another marker. Shape
    functions are those of the body on these supports, like a rod between two pins.

    Raises
    ------
    InputError : the markers have the same position.
    """
    first, second = (model.marker(name) for name in settings.markers)
    chord = second.position - first.position
    length = analytic_norm(chord)
    if length.real <= 1e-9 * np.ptp(model.positions.real, axis=0).max():
        raise InputError(
            f"{first.name} and {second.name} are at the same place",
            place="frame.markers",
            expected="two markers at a distance",
        )
    chord = chord / length
    d = model.dimension
    shift = (second.displacement - first.displacement).toarray()
    parts = [
        first.displacement.toarray()[:d],
        perpendicular_directions(chord, d) @ shift,
    ]
    if d == 3:
        parts.append((chord @ first.rotation.toarray())[None])
    return replace(
        _frame_conditions(model, first.position, np.vstack(parts)), supports=True
    )


def perpendicular_directions(direction: Array, dimension: int) -> Array:
    """(1 or 2, 3) orthonormal directions across a unit vector."""
    if dimension == 2:
        return np.array([[-direction[1], direction[0], 0.0]])
    helper = np.eye(3)[first_largest(1.0 - np.abs(direction.real))]
    first = np.cross(direction, helper)
    first = first / analytic_norm(first)
    return np.stack([first, np.cross(direction, first)])


def buckens_frame(model: FiniteElementModel, settings: BuckensFrame) -> Frame:
    """Return the mean-axis frame: shape functions have no linear and no angular
    momentum.
    """
    mass, centre = mass_and_centre(model)
    origin = centre
    if settings.marker is not None:
        origin = model.marker(settings.marker).position
    rows = (model.mass @ model.rigid_body_modes(origin)).T
    return _frame_conditions(model, origin, rows)


def mass_and_centre(model: FiniteElementModel) -> tuple[float, Array]:
    """Mass [kg] and centre of mass (3,) [m]."""
    rigid = model.rigid_body_modes()
    gram = rigid.T @ (model.mass @ rigid)
    d = model.dimension
    mass = gram[0, 0].item()
    if d == 2:
        return mass, np.array([gram[1, 2], -gram[0, 2], 0.0]) / mass
    return mass, np.array([gram[1, 5], gram[2, 3], gram[0, 4]]) / mass


def motion_rows(
    model: FiniteElementModel, marker: MarkerRows, *, rotations: bool = True
) -> Array:
    """Return the rows of a marker's displacements and rotations that can be non-zero.

    Returns
    -------
    (2, 3) to (3, 6) rows by ndof, without rotations if the marker has none.
    """
    plane = model.dimension == 2
    parts = [marker.displacement[:2] if plane else marker.displacement]
    if rotations and marker.rotation.nnz:
        parts.append(marker.rotation[2:] if plane else marker.rotation)
    return sp.vstack(parts).toarray()


def motion_names(
    model: FiniteElementModel, marker: MarkerRows, *, rotations: bool = True
) -> list[str]:
    """Return the names of `motion_rows`: "tip x", "tip rz", ..."""
    plane = model.dimension == 2
    names = ["x", "y"] if plane else ["x", "y", "z"]
    if rotations and marker.rotation.nnz:
        names += ["rz"] if plane else ["rx", "ry", "rz"]
    return [f"{marker.name} {name}" for name in names]


def _known_sets(model: FiniteElementModel) -> str:
    names = ", ".join(model.node_sets)
    return f"one of {names}" if names else "none here, as the body has no sets of nodes"


def set_nodes(model: FiniteElementModel, name: str, place: str) -> Indices:
    """The nodes of an edge or node set.

    Raises
    ------
    InputError : there is no set of this name, or it is empty.
    """
    if name not in model.node_sets:
        raise InputError(
            f"there is no edge or node set {name!r}",
            place=place,
            expected=_known_sets(model),
        )
    nodes = model.node_sets[name]
    if not nodes.size:
        raise InputError(
            f"the set {name!r} holds no node of an element",
            place=place,
            expected="a set with nodes of the body",
        )
    return nodes


def held_dofs(
    model: FiniteElementModel, names: tuple[str, ...], place: str
) -> NDArray[np.bool_]:
    """(ndof,) whether a degree of freedom belongs to some edges or node sets."""
    held = np.zeros(model.ndof, bool)
    for name in names:
        held[model.dofs(set_nodes(model, name, place))] = True
    return held


def clamped_dofs(
    model: FiniteElementModel, frame: Frame, fixed: tuple[str, ...]
) -> NDArray[np.bool_]:
    """Return (ndof,) the degrees of freedom fixed by the frame, edges and node sets.

    Parameters
    ----------
    fixed : names of edges and node sets; markers among them are separate conditions
    """
    known = {marker.name for marker in model.markers}
    sets = tuple(name for name in fixed if name not in known)
    return frame.held | held_dofs(model, sets, "reduction.fix")


def _frame_conditions(model: FiniteElementModel, origin: Array, rows: Array) -> Frame:
    scaled = (rows @ model.rigid_body_modes(origin)).real
    scaled = scaled / np.maximum(np.abs(scaled).max(axis=0), 1e-300)
    sizes = np.linalg.svd(scaled, compute_uv=False)
    count = 3 if model.dimension == 2 else 6
    if len(rows) < count or sizes[-1] <= _SINGULARITY_TOLERANCE * sizes[0]:
        raise InputError(
            "these markers do not determine how the frame turns",
            place="frame",
            expected="markers with a rotation, for example tied to an edge",
        )
    return Frame(origin=origin, held=np.zeros(model.ndof, bool), rows=rows)


#: The frames by the `frame.type` of a model file; one line adds one.
FRAMES: dict[str, Callable[[FiniteElementModel, Any], Frame]] = {
    "tangent": tangent_frame,
    "chord": chord_frame,
    "buckens": buckens_frame,
}
