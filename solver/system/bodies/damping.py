"""Damping matrices of flexible bodies from a policy instead of their SID."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import (
    Damping,
    FrequencyDamping,
    ModalDamping,
    RayleighDamping,
    SidDamping,
)
from sidtool.formats.sid import SID, Array, Taylor

#: Damping ratios of the frequency policy: up to each frequency [Hz], then beyond.
FREQUENCY_STEPS = ((100.0, 0.01), (1000.0, 0.1))
BEYOND = 1.0


def damped(sid: SID, policy: Damping | None, name: str) -> SID:
    """The SID with the damping matrix that a policy makes.

    Raises
    ------
    InputError : wrong number of ratios.
    """
    if policy is None or isinstance(policy, SidDamping) or sid.nq == 0:
        return sid
    return replace(sid, De=Taylor(_matrix(sid, policy, name)))


def _matrix(sid: SID, policy: Damping, name: str) -> Array:
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
        ratios = np.full(len(hertz), BEYOND)
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
