"""Stresses that a SID tells: sigma rows xx, yy, zz, xy, yz, xz at its nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError
from .sid import SID, Array


def node_stress(sid: SID, node_id: str | int, q: ArrayLike) -> Array:
    """Stress xx, yy, zz, xy, yz, xz at a node, (..., 6) for q (..., nq) [Pa].

    Raises
    ------
    InputError : there is no such node, or it carries no stress.
    """
    sigma = sid.node(node_id).sigma
    if sigma is None:
        carriers = ", ".join(stress_nodes(sid)[:8]) or "no node does"
        raise InputError(
            f"node {node_id} carries no stress", expected=f"one that does: {carriers}"
        )
    first = sigma.first_order(sid.nq)[:, :, 0]
    return sigma.m0[:, 0] + np.asarray(q, float) @ first


def stress_nodes(sid: SID) -> tuple[str, ...]:
    """The ids of the nodes that carry stress."""
    return tuple(node.id for node in sid.nodes if node.sigma is not None)


def peak_stress(sid: SID, q: ArrayLike) -> Array:
    """The largest von Mises stress over all nodes that carry stress, (...) [Pa].

    Raises
    ------
    InputError : no node does.
    """
    names = stress_nodes(sid)
    if not names:
        raise InputError(
            "no node of this body carries stress", expected="a table [stress]"
        )
    return np.max([von_mises(node_stress(sid, name, q)) for name in names], axis=0)


def von_mises(stress: ArrayLike) -> Array:
    """Equivalent stress of (..., 6): xx, yy, zz, xy, yz, xz."""
    xx, yy, zz, xy, yz, xz = np.moveaxis(np.asarray(stress, float), -1, 0)
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.sqrt(normal / 2 + 3 * (xy**2 + yz**2 + xz**2))
