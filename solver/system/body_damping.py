"""Damping of a body: the matrix De of a SID for the damping that a scene asks for."""

from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array, Taylor
from sidtool.formats.scene import (
    Damping,
    FrequencyDamping,
    ModalDamping,
    RayleighDamping,
    SidDamping,
)
from sidtool.formats.storage.cache import cached_by_identity

from .sid_packing import symmetrise

#: Damping ratios of the frequency policy: up to each frequency [Hz], then beyond.
FREQUENCY_STEPS = ((100.0, 0.01), (1000.0, 0.1))
DEFAULT_RATIO = 1.0


def sid_with_damping(sid: SID, policy: Damping | None, name: str) -> SID:
    """The SID with the damping matrix that a policy makes.

    Raises
    ------
    InputError
        Wrong number of ratios.
    """
    if policy is None or isinstance(policy, SidDamping) or sid.nq == 0:
        return sid
    return replace(sid, De=Taylor(_damping_matrix(sid, policy, name)))


def _damping_matrix(sid: SID, policy: Damping, name: str) -> Array:
    if isinstance(policy, RayleighDamping):
        return policy.alpha * sid.Me.m0 + policy.beta * sid.Ke.m0
    frequencies, modes = natural_modes(sid)
    ratios = _ratios(policy, frequencies / (2.0 * np.pi), name)
    weighted = sid.Me.m0 @ modes
    return (weighted * (2.0 * ratios * frequencies)) @ weighted.T


def natural_modes(sid: SID) -> tuple[Array, Array]:
    """Angular frequencies [rad/s], growing, and modes of Me and Ke, mass-normalised."""
    from scipy.linalg import eigh

    squares, modes = eigh(sid.Ke.m0, sid.Me.m0)
    return np.sqrt(np.maximum(squares, 0.0)), modes


def _ratios(policy: Damping, hertz: Array, name: str) -> Array:
    if isinstance(policy, FrequencyDamping):
        ratios = np.full(len(hertz), DEFAULT_RATIO)
        for limit, ratio in reversed(FREQUENCY_STEPS):
            ratios[hertz <= limit] = ratio
        return ratios
    assert isinstance(policy, ModalDamping)
    if len(policy.ratio) not in (1, len(hertz)):
        raise InputError(
            f"has {len(policy.ratio)} ratios",
            place=f"bodies.{name}.damping.ratio",
            expected=f"one, or {len(hertz)} for the modes of the SID",
        )
    return np.broadcast_to(np.array(policy.ratio), hertz.shape)


@cached_by_identity
def displacement_amplitudes(sid: SID, axes: int) -> Array:
    """Largest displacement that is known per unit of each elastic coordinate, (nq,).

    At a node, but no less than the mean over the mass of the body: nodes may lie where
    a shape function hardly moves.
    """
    if sid.nq == 0 or sid.mass == 0.0:
        return np.ones(sid.nq)
    mean = np.sqrt(np.maximum(np.diag(sid.Me.m0), 1e-300) / sid.mass)
    sizes = [np.linalg.norm(node.phi.m0[:axes], axis=0) for node in sid.nodes]
    return np.max([mean, *sizes], axis=0)


@cached_by_identity
def coordinate_frequencies(sid: SID) -> Array:
    """Angular frequency of each elastic coordinate alone [rad/s], (nq,)."""
    mass = np.maximum(np.diag(sid.Me.m0), 1e-300)
    return np.sqrt(np.maximum(np.diag(sid.Ke.m0), 0.0) / mass)


@cached_by_identity
def squared_frequencies(sid: SID) -> Array:
    """Squares of the angular frequencies of the modes of (Ke, Me), growing, (nq,)
    [rad2/s2]; of single coordinates if Me is no mass matrix."""
    stiffness, mass = symmetrise(sid.Ke.m0), symmetrise(sid.Me.m0)
    try:
        half = np.linalg.inv(np.linalg.cholesky(mass))
    except np.linalg.LinAlgError:
        return np.sort(coordinate_frequencies(sid) ** 2)
    return np.asarray(np.linalg.eigvalsh(half @ stiffness @ half.T))
