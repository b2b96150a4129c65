"""Nodes of a flexible body at which no shape function moves."""

import numpy as np

from .base.errors import InputError
from .base.sid import SID, Node
from .storage.cache import cached_by_identity

#: Relative size below which a shape function counts as zero.
_ZERO_SHAPE_TOLERANCE = 1e-9


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
        _ZERO_SHAPE_TOLERANCE * motion_scale(sid),
        _ZERO_SHAPE_TOLERANCE * sid.largest_shapes[1],
    )
    resting = [node for node in sid.nodes if _is_at_rest(node, *limits)]
    if not resting:
        return ()
    places = np.array([node.position for node in resting])
    away = np.abs(places).max(axis=1) > _ZERO_SHAPE_TOLERANCE * size
    if away.all() and np.ptp(places, axis=0).max() <= _ZERO_SHAPE_TOLERANCE * size:
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
