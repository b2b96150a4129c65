"""How far and how fast elastic coordinates vibrate."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import SID, Array
from sidtool.formats.storage.kept import kept

from .packing import symmetric


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
