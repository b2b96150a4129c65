"""Bodies for the kernels: the data of a SID, packed for planar or spatial equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.kinds_of_motion import named_by_kind
from sidtool.formats.scene import (
    KIND,
    Body,
    RigidBody,
    SceneFile,
    SidBody,
    as_3d,
    position_3d,
    rotation,
)
from sidtool.formats.sid import (
    J_INDICES,
    SID,
    Array,
    Node,
    Taylor,
    rigid_node,
    rigid_sid,
)
from sidtool.formats.sid_files import read_sid
from sidtool.formats.sid_subset import kept_indices, with_shape_functions
from sidtool.formats.storage.kept import kept

from ...equations.blocks import HEAD, ROWS, SQUARES
from ...space.layout import (
    DIAGONAL_DE,
    DIAGONAL_KE,
    DIAGONAL_ME,
    HAS_CR1,
    HAS_CT1,
    HAS_KE1,
    HAS_OE1,
    HAS_QUADRATIC_J,
    STIFFENED,
)
from .blocks import cr1, ct1, has_second_order, oe1, without_turning
from .damping import damped
from .first_order import check_first_order, cubic_stiffness
from .free_shapes import FreeShapes, free_shapes
from .held_frames import with_frame_node
from .mean_axes import MeanAxes, mean_axes
from .rigid_bodies import rigid_part
from .unstiffened import without_stiffening

#: Couplings in Me and De below this part of its diagonal are rounding.
ROUNDING = 1e-13


@dataclass(frozen=True)
class BodyData:
    """One body of a compiled scene.

    sid : its Standard Input Data; a rigid body has no elastic coordinates
    rotates : False for a point mass, whose orientation never changes
    quadratic_inertia : keep the term of J that is quadratic in q; stiffened bodies
        always do
    nodes : marker name to node id
    numbers : (nq,) of the elastic coordinates, from 1, as in the SID that was given
    of_scene : False for the ground, and for what carries a state of a law, see `laws`
    starts_at : that state at the start
    given : the SID that was given, of which elastic coordinates have their names
    """

    name: str
    sid: SID
    rotates: bool
    quadratic_inertia: bool
    nodes: Mapping[str, str]
    numbers: tuple[int, ...] = ()
    of_scene: bool = True
    starts_at: float = 0.0
    given: SID | None = None

    def node(self, marker: str) -> Node:
        """The node behind a marker name; no name is the origin of a rigid body."""
        return self.sid.node(self.nodes.get(marker, marker))

    def elastic_numbers(self, quantity: str, place: str) -> list[int]:
        """Numbers of the elastic coordinates that qN, bending_yN, q*, ... stand for.

        Raises
        ------
        InputError : the body has no such coordinate.
        """
        kind = KIND.fullmatch(quantity)
        if kind is not None:
            return [self._number_of(kind[2], place)]
        prefix = "vq" if quantity.startswith("v") else "q"
        number = quantity.removeprefix(prefix)
        if number == "*":
            return list(self.numbers)
        if int(number) not in self.numbers:
            raise InputError(
                f"{self.name} has {len(self.numbers)} elastic coordinates",
                place=place,
                expected=listed_numbers(self.numbers, prefix),
            )
        return [int(number)]

    def _number_of(self, kind: str, place: str) -> int:
        """Of the elastic coordinate that is called so by its kind."""
        known = named_by_kind(self.given or self.sid)
        kept = {name: k for name, k in known.items() if k in self.numbers}
        if kind in kept:
            return kept[kind]
        listed = ", ".join(kept)
        raise InputError(
            f"{self.name} has no elastic coordinate {kind}",
            place=place,
            expected=f"one of {listed}" if listed else "another output",
        )


def listed_numbers(numbers: Sequence[int], prefix: str) -> str:
    """ "q1 to q5", or "q1, q3" where some are left out."""
    names = [f"{prefix}{k}" for k in numbers]
    whole = list(numbers) == list(range(1, len(names) + 1))
    if len(names) > 1 and whole:
        return f"{names[0]} to {names[-1]}"
    return ", ".join(names) or "another name"


def read_sids(
    scene: SceneFile, folder: Path, sids: Mapping[str, SID]
) -> dict[str, SID]:
    """The SIDs of all bodies that have one, by name; given ones replace files.

    Raises
    ------
    InputError : a SID cannot be read.
    """
    found = {}
    for name, body in scene.sid_bodies.items():
        if name not in sids and not body.sid:
            raise InputError(
                f"{body.model} is a model that has to be converted first",
                place=f"bodies.{name}.model",
                expected="a command of sidtool, which converts it, or a SID",
            )
        found[name] = sids[name] if name in sids else read_sid(folder / body.sid)
    return found


def body_data(name: str, body: Body, sids: Mapping[str, SID], planar: bool) -> BodyData:
    """The data of one body of a scene; see `read_sids`.

    Raises
    ------
    InputError : its SID lacks a node that a marker names.
    """
    if isinstance(body, SidBody):
        return _flexible_body(name, body, sids[name], planar)
    return _rigid_body(name, body, planar)


def _flexible_body(name: str, body: SidBody, sid: SID, planar: bool) -> BodyData:
    for marker, node in body.markers.items():
        try:
            sid.node(node)
        except InputError as error:
            raise InputError(
                f"{error.problem} in {body.sid}",
                place=f"bodies.{name}.markers.{marker}",
                expected=error.expected,
            ) from None
    nodes, place, given = dict(body.markers), f"bodies.{name}", sid
    kept = kept_indices(body.shape_functions, sid.nq, f"{place}.shape_functions")
    if body.rigid:
        sid, kept = rigid_part(sid), ()
    else:
        check_first_order(sid, body.sid, f"{place}.sid")
        sid = damped(sid, body.damping, name)
        if not body.geometric_stiffening:
            stiffening = f"{place}.geometric_stiffening"
            sid = without_stiffening(sid, planar, stiffening)
        sid = with_shape_functions(sid, kept)
    sid = with_frame_node(sid) if body.frame == "held" else sid
    numbers = tuple(k + 1 for k in kept)
    return BodyData(
        name, sid, True, body.quadratic_inertia, nodes, numbers, given=given
    )


def _rigid_body(name: str, body: RigidBody, planar: bool) -> BodyData:
    centre = as_3d(body.centre_of_mass)
    inertia = np.zeros((3, 3)) if body.inertia is None else _tensor(body.inertia)
    steiner = body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    nodes = [rigid_node("", np.zeros(3))]
    for marker, placement in body.markers.items():
        nodes.append(rigid_node(marker, position_3d(placement), rotation(placement)))
    sid = rigid_sid(body.mass, centre, inertia + steiner, tuple(nodes))
    rotates = body.inertia is not None or bool(centre.any())
    return BodyData(name, sid, rotates, False, {})


def _tensor(inertia: object) -> Array:
    """zz alone (planar), principal values, or a full tensor, as (3, 3)."""
    values = np.asarray(inertia, float)
    if values.ndim == 0:
        return np.diag([0.0, 0.0, float(values)])
    return np.diag(values) if values.ndim == 1 else values


@kept
def flags(sid: SID, quadratic_inertia: bool) -> int:
    """Which optional terms the equations of a SID have, and shapes of its matrices."""
    plain, nq, stiffened = without_turning(sid), sid.nq, has_second_order(sid)
    applies = {
        HAS_CR1: plain.Cr.first_order(nq).any(),
        HAS_OE1: plain.Oe.first_order(nq).any(),
        HAS_CT1: sid.Ct.first_order(nq).any(),
        HAS_QUADRATIC_J: quadratic_inertia and plain.Oe.first_order(nq).any(),
        HAS_KE1: sid.Ke.first_order(nq).any(),
        DIAGONAL_ME: is_diagonal(elastic_mass(sid)) and not stiffened,
        STIFFENED: stiffened,
        DIAGONAL_KE: is_diagonal(sid.Ke.m0),
        DIAGONAL_DE: is_diagonal(damping_matrix(sid)),
    }
    return sum(bit for bit, needed in applies.items() if needed)


def _ke1(sid: SID) -> list[Array]:
    """The first-order term of Ke, if there is one; see `cubic_stiffness`."""
    return [cubic_stiffness(sid)] if sid.Ke.first_order(sid.nq).any() else []


def shapes_of_stiffened(sid: SID, planar: bool) -> tuple[MeanAxes, FreeShapes]:
    """What the inertia of a stiffened body is made of; zero for others."""
    if has_second_order(sid):
        axes = mean_axes(sid, ct1(sid), cr1(sid), oe1(sid), planar)
        return axes, free_shapes(sid, elastic_mass(sid), cr1(sid), planar)
    n, zero = (sid.nq, sid.nq), np.zeros((3, 3))
    bows, slopes = np.zeros((*n, 3, 3)), np.zeros((sid.nq, 3, 3))
    axes = MeanAxes(np.zeros((sid.nq, 3)), zero, slopes, bows, np.zeros((3, *n)))
    return axes, FreeShapes(np.zeros(n), np.zeros((3, *n)))


@kept
def pack(whole: SID, planar: bool) -> Array:
    """The reals of a body in the order of `equations.blocks`."""
    sid, nq = without_turning(whole), whole.nq
    turning = cr1(sid)
    axes, free = shapes_of_stiffened(whole, planar)
    pairs = [(2, 2)] if planar else J_INDICES
    move, turn = slice(2 if planar else 3), slice(2 if planar else 0, 3)
    pair = slice(2, 3) if planar else slice(6)
    values: dict[str, Any] = {
        "mass": sid.mass,
        "mdCM": sid.mdCM.m0[move, 0],
        "J0": sid.J.m0[pair, 0],
        "H0": [axes.inertia[a, b] for a, b in pairs],
        "Ct0": sid.Ct.m0.T[move],
        "Cr0": sid.Cr.m0.T[turn],
        "J1": sid.J.first_order(nq)[:, pair, 0].T,
        "Oe0": sid.Oe.m0.T[pair],
        "ksigma": sid.ksigma.m0[:, 0],
        "tilt": axes.tilt.T[turn],
        "slope": [axes.slopes[:, a, b] for a, b in pairs],
        "Ke": sid.Ke.m0,
        "De": damping_matrix(whole),
        "Cr1": turning[turn],
        "Ge": (turning - turning.transpose(0, 2, 1))[turn],
        "Oe1": oe1(sid)[pair],
        "Ct1": ct1(sid)[move],
        "coupling": axes.coupling[turn],
        "bow": [axes.bows[:, :, a, b] for a, b in pairs],
        "free_turning": free.turning[turn],
        "free_mass": free.mass,
    }
    names = [*HEAD, *ROWS, *SQUARES]
    blocks = [*(values[name] for name in names), *_ke1(sid)]
    return np.concatenate([np.ravel(block) for block in blocks])


def pack_spatial_marker(node: Node) -> Array:
    """Position, orientation (rows), Phi and Psi of a marker in space."""
    frame, shapes = rotation_part(node.AP.m0), shape_functions(node, planar=False)
    return np.concatenate([node.position, frame.ravel(), shapes.ravel()])


def rotation_part(matrix: Array) -> Array:
    """The rotation nearest to a matrix."""
    left, _, right = np.linalg.svd(matrix)
    return left @ right


def pack_planar_marker(node: Node, angle: float) -> Array:
    """Position, angle, Phi (x then y) and Psi of a marker in the plane."""
    place = [*node.position[:2], angle]
    return np.concatenate([place, shape_functions(node, planar=True).ravel()])


def shape_functions(node: Node, planar: bool) -> Array:
    """Phi and Psi of a marker at q = 0, as rows: x y and z, or all six."""
    if planar:
        return np.vstack([node.phi.m0[:2], node.psi.m0[2:]])
    return np.vstack([node.phi.m0, node.psi.m0])


def pack_stiffening(shapes: Taylor, rows: slice) -> Array:
    """m1 of Phi or Psi as (row, k, l), symmetric in k and l; empty for none."""
    if shapes.m1 is None or not shapes.m1[:, rows].any():
        return np.zeros(0)
    term = np.moveaxis(shapes.m1[:, rows], 1, 0)
    return (0.5 * (term + term.transpose(0, 2, 1))).ravel()


@kept
def elastic_mass(sid: SID) -> Array:
    """Me, symmetric; diagonal where it is so but for rounding."""
    return _without_rounding(symmetric(sid.Me.m0))


@kept
def damping_matrix(sid: SID) -> Array:
    """De; diagonal where it is so but for rounding."""
    return _without_rounding(sid.De.m0)


def _without_rounding(matrix: Array) -> Array:
    diagonal = np.diag(matrix)
    size = np.sqrt(np.abs(np.outer(diagonal, diagonal)))
    coupled = np.abs(matrix - np.diag(diagonal)) > ROUNDING * size
    return matrix if coupled.any() else np.diag(diagonal)


def is_diagonal(matrix: Array) -> bool:
    return not (matrix - np.diag(np.diag(matrix))).any()


def symmetric(matrix: Array) -> Array:
    """The symmetric part of a matrix."""
    return 0.5 * (matrix + matrix.T)


@kept
def amplitudes(sid: SID, axes: int) -> Array:
    """Largest displacement that is known per unit of each elastic coordinate, (nq,).

    At a node, but no less than the mean over the mass of the body: nodes may lie where
    a shape function hardly moves.
    """
    if sid.nq == 0 or sid.mass == 0.0:
        return np.ones(sid.nq)
    mean = np.sqrt(np.maximum(np.diag(sid.Me.m0), 1e-300) / sid.mass)
    sizes = [np.linalg.norm(node.phi.m0[:axes], axis=0) for node in sid.nodes]
    return np.max([mean, *sizes], axis=0)


@kept
def frequencies(sid: SID) -> Array:
    """Angular frequency of each elastic coordinate alone [rad/s], (nq,)."""
    mass = np.maximum(np.diag(sid.Me.m0), 1e-300)
    return np.sqrt(np.maximum(np.diag(sid.Ke.m0), 0.0) / mass)


@kept
def modal_squares(sid: SID) -> Array:
    """Squares of the angular frequencies of the modes of (Ke, Me), growing, (nq,)
    [rad2/s2]; of single coordinates if Me is no mass matrix."""
    stiffness, mass = symmetric(sid.Ke.m0), symmetric(sid.Me.m0)
    try:
        half = np.linalg.inv(np.linalg.cholesky(mass))
    except np.linalg.LinAlgError:
        return np.sort(frequencies(sid) ** 2)
    return np.asarray(np.linalg.eigvalsh(half @ stiffness @ half.T))


def quaternion(matrix: Array) -> Array:
    """Unit quaternions (..., 4), scalar first, scalar >= 0, of rotation matrices
    (..., 3, 3)."""
    m = np.moveaxis(matrix, (-2, -1), (0, 1))
    wx, wy, wz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    candidates = np.array(
        [
            [1 + m[0, 0] + m[1, 1] + m[2, 2], wx, wy, wz],
            [wx, 1 + m[0, 0] - m[1, 1] - m[2, 2], xy, xz],
            [wy, xy, 1 - m[0, 0] + m[1, 1] - m[2, 2], yz],
            [wz, xz, yz, 1 - m[0, 0] - m[1, 1] + m[2, 2]],
        ]
    )
    largest = np.argmax(np.diagonal(candidates), axis=-1)
    best = np.take_along_axis(candidates, largest[None, None], axis=0)[0]
    best = np.moveaxis(best / np.linalg.norm(best, axis=0), 0, -1)
    return np.where(best[..., :1] < 0.0, -best, best)
