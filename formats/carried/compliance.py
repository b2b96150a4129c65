"""The static compliance of a body by its shape functions."""

from __future__ import annotations

import numpy as np

from ..sid import SID, Array
from ..sid_mass import coupled_mass_matrix, mean_axes_motion, skew
from .shares import Carried

#: Forces and moments.
_KINDS = (slice(0, 3), slice(3, 6))


def compliances(sid: SID, free: bool) -> tuple[dict[str, Array], Array]:
    """Displacements along and rotations about the body axes under unit loads.

    Parameters
    ----------
    free : the loads are balanced by the inertia of a free body, whose displacements
        carry no momentum

    Returns
    -------
    node id -> (6,) [m/N, rad/(N m)], and (6,) the work [J] of the inertia of the body
    when its frame is accelerated along and about its axes

    Raises
    ------
    numpy.linalg.LinAlgError : Ke is singular.
    """
    inverse = np.linalg.inv(np.linalg.cholesky(sid.Ke.m0))
    inertia = coupled_mass_matrix(sid)[:6, 6:]
    rigid = np.zeros_like(inertia)
    if free:
        rigid, inertia = mean_axes_motion(sid), rigid

    def work(rows: Array) -> Array:
        return np.asarray(((rows @ inverse.T) ** 2).sum(axis=1))

    at_nodes = {}
    for node in sid.nodes:
        moved = rigid[:3] - skew(node.position) @ rigid[3:]
        shapes = np.vstack([node.phi.m0 - moved, node.psi.m0 - rigid[3:]])
        at_nodes[node.id] = work(shapes)
    return at_nodes, work(inertia)


def still_carried(sid: SID, small: SID) -> Carried | None:
    """What a SID with fewer shape functions carries of the full body."""
    if sid.carried is None or not small.nq:
        return None
    try:
        before, inertia = compliances(sid, sid.carried.free)
        after, less = compliances(small, sid.carried.free)
    except np.linalg.LinAlgError:
        return None
    shares = {
        name: tuple(map(_product, row, *pairs))
        for name, row in sid.carried.shares.items()
        if name in before
        for pairs in [(after[name], before[name])]
    }
    return Carried(sid.carried.free, shares, _lost(sid.carried.lost, inertia, less))


def _product(share: float | None, after: float, before: float) -> float | None:
    return None if share is None or not before else share * float(after / before)


def full_inertia(lost: tuple[float, ...], inertia: Array) -> Array:
    """The work of inertia (6,) of the full body, of which some is `lost`."""
    full = inertia.copy()
    for kind in _KINDS:
        missing = np.array(lost[kind])
        largest = (inertia[kind] / np.maximum(1.0 - missing, 1e-300)).max()
        full[kind] += missing * largest
    return full


def _lost(lost: tuple[float, ...], inertia: Array, less: Array) -> tuple[float, ...]:
    return lost_inertia(full_inertia(lost, inertia), less) if lost else ()


def lost_inertia(full: Array, carried: Array) -> tuple[float, ...]:
    """What of the work (6,) of the full body is not carried; see `Carried.lost`."""
    largest = np.repeat([full[kind].max() for kind in _KINDS], 3)
    missing = np.clip(full - carried, 0.0, None)
    return tuple((missing / np.where(largest > 0.0, largest, 1.0)).tolist())
