"""Natural modes of a body at its nodes, and the common nodes and motions of two SIDs.

A body is described by its natural modes, held in its frame or moving freely. In the
free body each elastic mode carries the rigid motion that balances its momentum, so
that displacements do not depend on the choice of the frame; static deflection then is
that under a load balanced by the inertia of the body (inertia relief).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import SID, Array, Node
from sidtool.formats.sid_mass import (
    IN_PLANE,
    SPATIAL,
    central_inertia,
    centre_of_mass,
    coupled_mass_matrix,
    free_motion,
    plane_of_motion,
    skew,
)

from .frequencies import free_modes, held_modes, symmetric_part
from .identity import max_magnitude, rotation_scale, translation_scale

Frame = Literal["mean axis", "attached"]

# Points this close, relative to the size of the body, are the same point.
_SAME_POINT = 1e-6
# Momentum of a shape function below this share of the possible one counts as none.
_NO_MOMENTUM = 1e-6

ResponseFunction = NDArray[np.complex128]
# Squared frequencies below this share of the largest are rigid motion.
_ZERO = 1e-12


@dataclass(frozen=True)
class Pairing:
    """Common nodes and motions of two SIDs whose axes are parallel.

    Attributes
    ----------
    nodes : pairs (node here, node in the reference) at the same material point
    offset : position of a point in the reference less its position here, (3,)
    rigid : rigid coordinates in which both can move freely; None if there are none
    held : whether both describe the deformation in the same body frame
    notes : assumptions and omissions of the comparison
    """

    nodes: tuple[tuple[Node, Node], ...]
    offset: Array
    rigid: tuple[int, ...] | None
    held: bool
    notes: tuple[str, ...]


def frame_kind(sid: SID) -> Frame:
    """Mean axis if no shape function carries momentum, else attached to a point."""
    if sid.nq == 0:
        return "mean axis"
    moving = max_magnitude(sid.Ct.m0) > _NO_MOMENTUM * translation_scale(sid)
    turning = max_magnitude(sid.Cr.m0) > _NO_MOMENTUM * rotation_scale(sid)
    return "attached" if moving or turning else "mean axis"


def body_size(sid: SID) -> float:
    """Return a characteristic length of the body: extent of nodes and of the mass."""
    points = [node.position for node in sid.nodes]
    if sid.mass > 0.0:
        points.append(centre_of_mass(sid))
    extent = float(np.ptp(np.array(points), axis=0).max()) if points else 0.0
    return max(extent, _gyration_tensor(sid))


def pair_sids(here: SID, reference: SID) -> Pairing:
    """Match nodes and motions of two SIDs.

    Nodes match by id if at least two ids are common and differ by one shift of the
    frame's origin; otherwise nodes at equal positions match, whatever their ids.
    """
    notes: list[str] = []
    nodes, offset = _common_nodes(here, reference)
    size = body_size(reference)
    shifted = bool(np.abs(offset).max() > _SAME_POINT * size)
    if shifted:
        text = ", ".join(f"{value:.6g}" for value in offset)
        notes.append(f"the origins of the two body frames differ by ({text})")
    if not nodes:
        notes.append("no common nodes: neither deflections nor shapes are compared")
    kinds = frame_kind(here), frame_kind(reference)
    held = kinds[0] == kinds[1] and (kinds[0] == "mean axis" or not shifted)
    if not held:
        notes.append(
            f"different body frames ({kinds[0]} here, {kinds[1]} in the reference): "
            "only the free body is compared; shape functions cut off count as error"
        )
    rigid = _common_motion(here, reference)
    if rigid is None and here.nq:
        notes.append("one of the bodies cannot move freely: only the held one counts")
    return Pairing(nodes, offset, rigid, held, tuple(notes))


def _gyration_tensor(sid: SID) -> float:
    if not sid.mass > 0.0:
        return 0.0
    return float(np.sqrt(max_magnitude(central_inertia(sid)) / sid.mass))


def _common_nodes(
    here: SID, reference: SID
) -> tuple[tuple[tuple[Node, Node], ...], Array]:
    near = 100.0 * _SAME_POINT * body_size(reference)
    by_id = {node.id: node for node in reference.nodes}
    named = [(node, by_id[node.id]) for node in here.nodes if node.id in by_id]
    if len(named) > 1:
        shifts = np.array([other.position - node.position for node, other in named])
        if np.ptp(shifts, axis=0).max() <= near:
            return tuple(named), shifts.mean(axis=0)
    return tuple(_pair_by_position(here, reference, near)), np.zeros(3)


def _pair_by_position(
    here: SID, reference: SID, near: float
) -> list[tuple[Node, Node]]:
    from scipy.spatial import KDTree  # 50 ms that few validations need

    if not here.nodes or not reference.nodes:
        return []
    points = KDTree([node.position for node in reference.nodes])
    distances, nearest = points.query([n.position for n in here.nodes], p=np.inf)
    return [
        (node, reference.nodes[int(i)])
        for node, i, distance in zip(here.nodes, nearest, distances, strict=True)
        if distance <= near
    ]


def _common_motion(here: SID, reference: SID) -> tuple[int, ...] | None:
    axes = {plane_of_motion(here), plane_of_motion(reference)}
    candidates: list[tuple[int, ...]] = [SPATIAL]
    if len(axes) == 1 and None not in axes:
        candidates.append(IN_PLANE[axes.pop() or 0])
    for rigid in candidates:
        if all(free_motion(sid, rigid).possible for sid in (here, reference)):
            return rigid
    return None


@dataclass(frozen=True)
class ModalBody:
    """Natural modes of a body at some nodes.

    Attributes
    ----------
    squares : (nq,) squared circular frequencies, ascending
    shapes : (3 n, nq) displacements at the nodes, modes normalised to unit mass
    turns : (3 n, nq) rotations of the nodes times the radius of gyration of the body;
        zero for nodes without rotations
    damping : (nq, nq) De in the modes
    rigid_shapes : (3 n, r) displacements at the nodes by the free rigid coordinates;
        r = 0 for a held body
    rigid : (r, r) mass matrix of these coordinates
    """

    squares: Array
    shapes: Array
    turns: Array
    damping: Array
    rigid_shapes: Array
    rigid: Array

    @property
    def has_stiffness(self) -> bool:
        """Return whether every elastic mode has stiffness."""
        return bool(self.squares[0] > _ZERO * self.squares[-1])

    def flexibility(self, loads: Sequence[int] | slice = slice(None)) -> Array:
        """Static displacements by unit forces on some rows, (3 n, m) [m/N].

        Needs stiffness.
        """
        return (self.shapes / self.squares) @ self.shapes[loads].T

    def most_flexible(self) -> float:
        """The largest entry of the flexibility, which is on its diagonal."""
        return float((self.shapes**2 / self.squares).sum(axis=1).max(initial=0.0))

    def receptance(self, omega: float, rows: slice = slice(None)) -> ResponseFunction:
        """Complex displacements of some rows per harmonic force on them [m/N].

        Parameters
        ----------
        omega : circular frequency [rad/s], not zero
        """
        columns = self._columns[rows]
        return columns @ self._per_force(omega) @ columns.T

    def receptance_size(self, omega: float) -> float:
        """Frobenius norm of the receptance of all rows."""
        product = self._gram @ self._per_force(omega)
        return float(np.sqrt(max(0.0, np.trace(product @ np.conj(product)).real)))

    @cached_property
    def _columns(self) -> Array:
        return np.hstack([self.shapes, self.rigid_shapes])

    @cached_property
    def _gram(self) -> Array:
        return np.asarray(self._columns.T @ self._columns)

    def _per_force(self, omega: float) -> ResponseFunction:
        """Return the response of the modes and the rigid coordinates, per force on
        them.
        """
        impedance = np.diag(self.squares - omega**2) + 1j * omega * self.damping
        nq = len(self.squares)
        receptance = np.zeros((nq + len(self.rigid),) * 2, complex)
        receptance[:nq, :nq] = np.linalg.inv(impedance)
        receptance[nq:, nq:] = -np.linalg.inv(self.rigid) / omega**2
        return receptance


def held_body(sid: SID, nodes: Sequence[Node]) -> ModalBody:
    """The body with its frame held; needs a positive definite Me and nq > 0."""
    squares, modes = held_modes(sid)
    shapes = _displacement_rows([node.phi.m0 for node in nodes], sid.nq) @ modes
    none = np.zeros((len(shapes), 0)), np.zeros((0, 0))
    turns = (
        _radius_of_gyration(sid)
        * _displacement_rows([node.psi.m0 for node in nodes], sid.nq)
        @ modes
    )
    return ModalBody(squares, shapes, turns, _modal_damping(sid, modes), *none)


def free_body(sid: SID, nodes: Sequence[Node], rigid: tuple[int, ...]) -> ModalBody:
    """The body that moves in these rigid coordinates; needs `free_motion`, nq > 0."""
    squares, modes = free_modes(sid, rigid)
    moving = list(rigid)
    matrix = coupled_mass_matrix(sid)
    body, coupling = matrix[np.ix_(moving, moving)], matrix[6:][:, moving]
    rigid_rows = _displacement_rows(
        [_rigid_motion_rows(node)[:, moving] for node in nodes], len(moving)
    )
    balance = np.linalg.solve(body, coupling.T)
    shapes = (
        _displacement_rows([node.phi.m0 for node in nodes], sid.nq)
        - rigid_rows @ balance
    ) @ modes
    spin = np.zeros((3, 6))
    spin[:, 3:] = np.eye(3)
    turned = _displacement_rows([spin[:, moving] for _ in nodes], len(moving))
    turns = _displacement_rows([node.psi.m0 for node in nodes], sid.nq)
    if turns.any():
        turns = turns - turned @ balance
    turns = _radius_of_gyration(sid) * turns @ modes
    return ModalBody(
        squares, shapes, turns, _modal_damping(sid, modes), rigid_rows, body
    )


def modal_assurance(here: Array, reference: Array) -> Array:
    """MAC_ij = (x_i . y_j)^2 / (x_i . x_i)(y_j . y_j) of the columns, (n, m).

    R. J. Allemang, D. L. Brown, "A correlation coefficient for modal vector analysis",
    1982. Columns that are zero at these points give 0.
    """
    product = (here.T @ reference) ** 2
    size = np.outer((here**2).sum(axis=0), (reference**2).sum(axis=0))
    return np.divide(product, size, out=np.zeros_like(product), where=size > 0.0)


def subspace_assurance(shape: Array, columns: Array) -> float:
    """Share of a shape (squared) that lies in the span of the columns, 0 ... 1."""
    basis, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, sizes > 1e-9 * sizes.max(initial=0.0)]
    total = float(shape @ shape)
    return float(((basis.T @ shape) ** 2).sum() / total) if total else 0.0


def _displacement_rows(blocks: list[Array], columns: int) -> Array:
    return np.concatenate(blocks) if blocks else np.zeros((0, columns))


def _rigid_motion_rows(node: Node) -> Array:
    return np.hstack([np.eye(3), -skew(node.position)])


def _radius_of_gyration(sid: SID) -> float:
    inertia = np.trace(central_inertia(sid)) if sid.mass > 0.0 else 0.0
    return float(np.sqrt(max(inertia, 0.0) / (2.0 * sid.mass or 1.0)))


def _modal_damping(sid: SID, modes: Array) -> Array:
    return modes.T @ symmetric_part(sid.De.m0) @ modes
