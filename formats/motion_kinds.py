"""Kinds of motion of elastic coordinates: bending, torsion, extension.

Nodes of a flexible body at which no shape function moves.
"""

import numpy as np
from numpy.typing import NDArray

from .base.errors import InputError
from .base.sid import SID, Node
from .sid_mass import central_inertia
from .storage.cache import cached_by_identity

Array = NDArray[np.float64]
AXES = "xyz"
#: A mode moves along one axis if nothing else reaches this share of the motion.
_SECONDARY_SHARE = 0.5
#: A body is slender if its smallest central inertia is below this share of the largest.
_SLENDERNESS_RATIO = 0.3
#: Part of the body's length over which a node's rotation counts as displacement.
ROTATION_ARM_SHARE = 0.1
#: Relative size below which shape functions and couplings count as zero.
ZERO_MOTION_TOLERANCE = 1e-9
#: What no node shows has no name.
NO_NODE_MOTION = "not seen at the nodes"


@cached_by_identity
def dead_nodes(sid: SID) -> tuple[str, ...]:
    """Ids of nodes where all shape functions vanish though the frame is elsewhere.

    A node at the origin of the body frame rests in it by definition: what acts there
    moves the frame. So does the only place that rests, where a body is held away from
    its origin. At any other such node a force or a joint never deforms the body, as
    happens when modes were computed with the node held.
    """
    if sid.nq == 0 or not sid.nodes:
        return ()
    size = max(np.abs(node.position).max() for node in sid.nodes)
    limits = (
        ZERO_MOTION_TOLERANCE * motion_scale(sid),
        ZERO_MOTION_TOLERANCE * sid.largest_shapes[1],
    )
    resting = [node for node in sid.nodes if _is_at_rest(node, *limits)]
    if not resting:
        return ()
    places = np.array([node.position for node in resting])
    away = np.abs(places).max(axis=1) > ZERO_MOTION_TOLERANCE * size
    if away.all() and np.ptp(places, axis=0).max() <= ZERO_MOTION_TOLERANCE * size:
        return ()
    return tuple(
        node.id for node, is_away in zip(resting, away, strict=True) if is_away
    )


def check_moves(sid: SID, node_id: str | int, what: str, body: str = "") -> None:
    """Whether a load or a joint at a node can deform the body.

    Parameters
    ----------
    what : "the force push", "the joint pin", ...
    body : its name in the scene

    Raises
    ------
    InputError : all shape functions vanish there.
    """
    if str(node_id) in dead_nodes(sid):
        owner = f" of {body}" if body else ""
        raise InputError(
            f"{what} acts on node {node_id}{owner}, where all shape functions vanish: "
            "the body would stay rigid against it",
            expected="shape functions that move the node, for example with the node "
            "among the interfaces of craig_bampton or attachment",
        )


def motion_scale(sid: SID) -> float:
    """Return the size of a large entry of phi [m/[q]], also if no node moves.

    It is the largest one at any node, or the mean displacement that Me implies.
    """
    at_nodes = sid.largest_shapes[0]
    mean = np.sqrt(np.abs(np.diag(sid.Me.m0)).max(initial=0.0) / abs(sid.mass or 1.0))
    return float(max(at_nodes, mean))


def _is_at_rest(node: Node, phi: float, psi: float) -> bool:
    still = np.abs(node.phi.m0).max(initial=0.0) <= phi
    return bool(still and np.abs(node.psi.m0).max(initial=0.0) <= psi)


def motion_kinds(sid: SID) -> tuple[str, ...]:
    """Return the kind of each elastic coordinate: "bending y", "torsion", ..."""
    axis = long_axis(sid)
    return tuple(kind_of_shape(sid, shape, axis) for shape in np.eye(sid.nq))


def named_by_kind(sid: SID) -> dict[str, int]:
    """The number, from 1, of every elastic coordinate by its kind: "bending_y1", the
    first one that bends along y, "bending_y2", ..."""
    names: dict[str, int] = {}
    counts: dict[str, int] = {}
    for number, kind in enumerate(motion_kinds(sid), 1):
        if kind != NO_NODE_MOTION:
            kind_name = kind.replace(" ", "_")
            counts[kind_name] = counts.get(kind_name, 0) + 1
            names[f"{kind_name}{counts[kind_name]}"] = number
    return names


def long_axis(sid: SID) -> int | None:
    """The axis of a slender body, by the spread of its mass, or else of its nodes."""
    moments = _second_moments(sid)
    if moments is None and sid.nodes:
        moments = np.ptp([node.position for node in sid.nodes], axis=0) ** 2
    if moments is None:
        return None
    order = np.argsort(moments)
    return (
        int(order[2])
        if moments[order[1]] < _SLENDERNESS_RATIO * moments[order[2]]
        else None
    )


def _second_moments(sid: SID) -> Array | None:
    """Central integrals of x^2, y^2, z^2 dm; None where the inertia is planar."""
    if sid.mass <= 0:
        return None
    moments = np.diag(_mass_spread(sid))
    return moments if (moments >= -1e-6 * np.abs(moments).max()).all() else None


def _mass_spread(sid: SID) -> Array:
    """(3, 3) central integral of c c^T dm."""
    inertia = central_inertia(sid)
    return np.asarray(np.trace(inertia) / 2 * np.eye(3) - inertia)


def kind_of_shape(sid: SID, shape: Array, long_axis: int | None) -> str:
    """Classify a shape by its largest nodal displacement, or by the effective mass.

    Torsion rotates the nodes about the long axis by more than it displaces them.
    """
    motion = _displacement_squares(sid, shape) + _slope_squares(sid, shape, long_axis)
    if (
        long_axis is not None
        and _twist_square(sid, shape, long_axis) > _SECONDARY_SHARE * motion.sum()
    ):
        return f"torsion {AXES[long_axis]}"
    rotation = np.abs(sid.shapes[1] @ shape).max(initial=0.0)
    if not motion.any():
        return "torsion" if rotation else NO_NODE_MOTION
    axis = int(motion.argmax())
    name = AXES[axis]
    if motion[axis] < _SECONDARY_SHARE * motion.sum():
        return "mixed " + "".join(AXES[a] for a in np.flatnonzero(motion > 0))
    if long_axis is None:
        return f"mainly {name}"
    return f"axial {name}" if axis == long_axis else f"bending {name}"


def _twist_square(sid: SID, shape: Array, long_axis: int) -> float:
    """Square of the motion at the radius of gyration about the long direction."""
    if _second_moments(sid) is None:
        return 0.0
    along = _direction(sid, long_axis)
    about = float(along @ central_inertia(sid) @ along)
    turns = sid.shapes[1] @ shape @ along
    return float(np.square(turns).sum() * about / sid.mass)


def _direction(sid: SID, long_axis: int) -> Array:
    """(3,) the direction in which a slender body is long."""
    if _second_moments(sid) is None:
        return np.eye(3)[long_axis]
    return np.asarray(np.linalg.eigh(_mass_spread(sid))[1][:, 2])


def _coupling(sid: SID, shape: Array) -> Array:
    """(3,) momentum per velocity of a shape; zero where it is rounding."""
    coupling = shape @ sid.Ct.m0
    largest = np.sqrt(abs(sid.mass * (shape @ sid.Me.m0 @ shape)))
    return np.where(np.abs(coupling) > ZERO_MOTION_TOLERANCE * largest, coupling, 0.0)


def node_extent(sid: SID) -> float:
    """The largest extent of the nodes along an axis [m]."""
    places = np.array([node.position for node in sid.nodes]).reshape(-1, 3)
    return float(np.ptp(places, axis=0).max()) if len(places) else 0.0


def _slope_squares(sid: SID, shape: Array, long_axis: int | None) -> Array:
    """Return squares (3,) of the bending that node rotations show where no
    node moves.
    """
    if long_axis is None:
        return np.zeros(3)
    length, along = node_extent(sid), _direction(sid, long_axis)
    sideways = np.cross(sid.shapes[1] @ shape, along)
    return np.asarray(((ROTATION_ARM_SHARE * length * sideways) ** 2).sum(axis=0))


def _displacement_squares(sid: SID, shape: Array) -> Array:
    """(3,) squares of displacements, summed over the nodes; of Ct where they rest."""
    at_nodes = ((sid.shapes[0] @ shape) ** 2).sum(axis=0)
    is_visible = (
        at_nodes.max()
        > (ZERO_MOTION_TOLERANCE * motion_scale(sid) * np.abs(shape).max()) ** 2
    )
    motion = at_nodes if is_visible else _coupling(sid, shape) ** 2
    return np.where(motion > ZERO_MOTION_TOLERANCE * motion.max(), motion, 0.0)
