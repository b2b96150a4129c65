"""Does geometric stiffening matter? What loads do to the stiffness of a SID."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from .sid import SID, Array

_ZERO = (0.0, 0.0, 0.0)


def has_stiffening(sid: SID) -> bool:
    """Does the SID carry terms that only geometric stiffening puts there?

    Besides Ct m1, phi m1 and psi m1 that is the part of Cr m1 that is symmetric in the
    modes. The part in Oe m1 cannot be told from the kinematic one.
    """
    terms = [sid.Ct, *(t for node in sid.nodes for t in (node.phi, node.psi))]
    if any(term.m1 is not None and term.m1.any() for term in terms):
        return True
    first = sid.Cr.first_order(sid.nq)
    symmetric = np.abs(first + np.swapaxes(first, 0, 1)).max(initial=0.0)
    return bool(symmetric > 1e-6 * np.abs(first).max(initial=0.0))


def load_stiffness(
    sid: SID,
    *,
    acceleration: ArrayLike = _ZERO,
    angular_velocity: ArrayLike = _ZERO,
    angular_acceleration: ArrayLike = _ZERO,
    forces: Mapping[str, ArrayLike] | None = None,
    moments: Mapping[str, ArrayLike] | None = None,
) -> Array:
    """The stiffness (nq, nq) that loads add to Ke, all in the body frame [N m/[q]2].

    The centrifugal part holds the kinematic softening too, which every SID has.

    Parameters
    ----------
    acceleration : (3,) of the frame's origin less gravity [m/s^2]
    angular_velocity : (3,) [rad/s]
    angular_acceleration : (3,) [rad/s^2]
    forces, moments : node id -> (3,) acting on the body [N], [N m]

    Raises
    ------
    InputError : there is no such node.
    """
    x, y, z = np.asarray(angular_velocity, float)
    products = np.array([x * x, y * y, z * z, x * y, y * z, x * z])
    nq = sid.nq
    total = sid.Ct.first_order(nq) @ np.asarray(acceleration, float)
    total = total + sid.Oe.first_order(nq) @ products
    turning = sid.Cr.first_order(nq) @ np.asarray(angular_acceleration, float)
    total = total + (turning + turning.T) / 2
    for node_id, force in (forces or {}).items():
        first = sid.node(node_id).phi.first_order(nq)
        total = total - np.einsum("lak,a->lk", first, np.asarray(force, float))
    for node_id, moment in (moments or {}).items():
        first = sid.node(node_id).psi.first_order(nq)
        total = total - np.einsum("lak,a->lk", first, np.asarray(moment, float))
    return (total + total.T) / 2


def stiffening_ratio(
    sid: SID,
    *,
    acceleration: ArrayLike = _ZERO,
    angular_velocity: ArrayLike = _ZERO,
    angular_acceleration: ArrayLike = _ZERO,
    forces: Mapping[str, ArrayLike] | None = None,
    moments: Mapping[str, ArrayLike] | None = None,
) -> float:
    """The largest share of Ke that loads add or take away, over all deformations.

    Below about 0.01 stiffening does not matter; at -1 the body would buckle, and of a
    SID without stiffening terms the centrifugal softening alone tells the order, as the
    square of speed over the lowest frequency.

    Returns
    -------
    The generalised eigenvalue of (load stiffness, Ke) that is largest in magnitude,
    with its sign; 0 for a rigid body. See `load_stiffness` for the arguments.
    """
    if sid.nq == 0:
        return 0.0
    stiffness = load_stiffness(
        sid,
        acceleration=acceleration,
        angular_velocity=angular_velocity,
        angular_acceleration=angular_acceleration,
        forces=forces,
        moments=moments,
    )
    values, vectors = np.linalg.eigh((sid.Ke.m0 + sid.Ke.m0.T) / 2)
    kept = values > 1e-12 * max(values[-1], 1e-300)
    basis = vectors[:, kept] / np.sqrt(values[kept])
    ratios = np.linalg.eigvalsh(basis.T @ stiffness @ basis)
    return float(ratios[np.abs(ratios).argmax()]) if ratios.size else 0.0
