"""Natural frequencies that a SID implies, and those that its labels tell."""

from __future__ import annotations

import re

import numpy as np
from scipy.linalg import eigh

from sidtool.formats.sid import SID, Array
from sidtool.formats.sid_mass import SPATIAL, free_modal_mass

_HERTZ = re.compile(r"([-+]?\d+\.?\d*(?:[eEdD][-+]?\d+)?)\s*Hz\b", re.IGNORECASE)

_LARGEST = 1e30


def hertz(eigenvalues: Array) -> Array:
    """Squared circular frequencies [rad2/s2] as frequencies [Hz]; below zero is 0."""
    return np.sqrt(np.clip(eigenvalues, 0.0, None)) / (2.0 * np.pi)


def held_modes(sid: SID) -> tuple[Array, Array]:
    """Modes of the body whose frame is held: K y = w2 M y with (Ke, Me).

    Returns
    -------
    (nq,) squared circular frequencies, ascending, and (nq, nq) modes in the columns,
    y^T Me y = I. Needs a positive definite Me.
    """
    return eigh(symmetric(sid.Ke.m0), symmetric(sid.Me.m0))


def free_modes(sid: SID, rigid: tuple[int, ...] = SPATIAL) -> tuple[Array, Array]:
    """Elastic modes of the body that moves freely, whatever its frame.

    The coupled system of 6 + nq coordinates has the stiffness blkdiag(0, Ke); with the
    rigid motion eliminated its elastic modes are those of (Ke, `free_modal_mass`).
    The coupled mass matrix must be positive definite.

    Returns
    -------
    (nq,) squared circular frequencies and (nq, nq) modes of the elastic coordinates.
    """
    return eigh(symmetric(sid.Ke.m0), symmetric(free_modal_mass(sid, rigid)))


def label_hertz(sid: SID) -> tuple[Array, Array] | None:
    """Frequencies in the labels and half of their last printed digit, each (nq,) [Hz].

    None unless every label tells one, and one that a body can have.
    """
    found = [_HERTZ.search(label) for label in sid.labels]
    if not found or any(match is None for match in found):
        return None
    texts = [match[1] for match in found if match]
    values = np.array([float(re.sub("[dD]", "e", text)) for text in texts])
    if not np.all(np.abs(values) < _LARGEST):
        return None
    digits = np.array([0.5 * 10.0 ** -_decimals(text) for text in texts])
    return values, digits


def symmetric(matrix: Array) -> Array:
    """The symmetric part of a square matrix."""
    return 0.5 * (matrix + matrix.T)


def _decimals(text: str) -> int:
    mantissa, _, exponent = re.sub("[dDE]", "e", text).partition("e")
    return len(mantissa.partition(".")[2]) - max(int(exponent or 0), -30)
