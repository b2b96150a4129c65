"""Stresses of a SID: rows sigma (xx, yy, zz, xy, yz, xz) at its nodes."""

from collections.abc import Iterator
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError
from .sid import SID, Array, Taylor

#: Components in the order of sigma rows.
COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")

#: Default number of the first node that a conversion adds for the peak.
FIRST_PEAK_NODE = 10001
#: (5, 6) the equivalent stress is the length of this times xx, yy, zz, xy, yz, xz.
MISES = np.zeros((5, 6))
MISES[:2, :3] = [[np.sqrt(0.75), -np.sqrt(0.75), 0], [0.5, 0.5, -1]]
MISES[2:, 3:] = np.sqrt(3) * np.eye(3)


def node_stress(sid: SID, node_id: str | int, q: ArrayLike) -> Array:
    """Stress xx, yy, zz, xy, yz, xz at a node, (..., 6) for q (..., nq) [Pa].

    Raises
    ------
    InputError : there is no such node, or it carries no stress.
    """
    sigma = sid.node(node_id).sigma
    if sigma is None:
        listed = ", ".join(stress_nodes(sid)[:8]) or "no node does"
        raise InputError(
            f"node {node_id} carries no stress", expected=f"one that does: {listed}"
        )
    return _stress_of_rows(sigma, q)


def stress_nodes(sid: SID) -> tuple[str, ...]:
    """The ids of the nodes that carry stress."""
    return tuple(node.id for node in sid.nodes if node.sigma is not None)


def has_peak_nodes(sid: SID) -> bool:
    """Whether nodes that carry stress were added for the peak.

    Earlier files of sidtool do not state it; their first such node has the default
    number. Other programs add none.
    """
    if sid.has_peak_nodes is not None:
        return sid.has_peak_nodes
    return bool(sid.written_by) and str(FIRST_PEAK_NODE) in stress_nodes(sid)


def peak_stress(sid: SID, q: ArrayLike) -> Array:
    """The largest von Mises stress over all nodes that carry stress, (...) [Pa].

    Raises
    ------
    InputError : no node does.
    """
    return reduce(np.maximum, _von_mises_of_nodes(sid, q))


def stress_norm(sid: SID, q: ArrayLike) -> Array:
    """The 8-norm of the von Mises stress over all nodes that carry stress, (...) [Pa].

    (sum_i s_i^8 / n)^(1/8) of n nodes: a smooth function of q that lies below the peak
    s by a factor of at most n^(1/8).

    Raises
    ------
    InputError : no node does.
    """
    count = len(stress_nodes(sid))
    total = reduce(np.add, (s**8 for s in _von_mises_of_nodes(sid, q)))
    return np.asarray((total / count) ** 0.125)


def _von_mises_of_nodes(sid: SID, q: ArrayLike) -> Iterator[Array]:
    """Von Mises stress of each node that carries stress, (...) [Pa]."""
    rows = [node.sigma for node in sid.nodes if node.sigma is not None]
    if not rows:
        raise InputError(
            "no node of this body carries stress",
            expected="a body converted with a table [stress]",
        )
    for sigma in rows:
        yield von_mises(_stress_of_rows(sigma, q))


def _stress_of_rows(sigma: Taylor, q: ArrayLike) -> Array:
    q = np.asarray(q, float)
    return sigma.m0[:, 0] + q @ sigma.first_order(q.shape[-1])[:, :, 0]


def von_mises(stress: ArrayLike) -> Array:
    """Equivalent stress of (..., 6): xx, yy, zz, xy, yz, xz."""
    return np.linalg.norm(np.asarray(stress, float) @ MISES.T, axis=-1)
