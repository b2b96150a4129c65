"""Natural frequencies of a SID and in its labels; sign of the gravity terms.

The gravity terms Ct m1 and phi m1 have the sign of stiffening:
All of them are one displacement field of second order Phi1: Ct m1 = int Phi1 dm, phi m1
is Phi1 at a node, and Oe m1 holds int Phi1_kl . c dm, which is minus half of 2 Me and
the columns of wx wx, wy wy, wz wz together. In a body whose mass lies to one side of
its origin the component of Phi1 towards the mass weighs like its product with c, so
they have one sign; some writers give Ct m1 and phi m1 the other.
"""

import re

import numpy as np
from scipy.linalg import eigh

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.geometric_stiffening import elastic_basis
from sidtool.formats.sid_mass import SPATIAL, central_inertia, free_modal_mass

_HERTZ = re.compile(r"([-+]?\d+\.?\d*(?:[eEdD][-+]?\d+)?)\s*Hz\b", re.IGNORECASE)

_LARGEST = 1e30

#: The mass lies to one side if its centre is further from the origin than its spread.
_ONE_SIDED_MASS = 1.2
#: Stiffening by rotation below this fraction of Me is negligible.
_MIN_STIFFENING = 0.05
#: Correlation below which a sign is wrong; the same if only nodes are available.
WRONG_SIGN_CORRELATION, _NODE_SIGN_CORRELATION = -0.5, -0.9
_MIN_NODES = 3


def to_hertz(eigenvalues: Array) -> Array:
    """Squared circular frequencies [rad2/s2] as frequencies [Hz]; below zero is 0."""
    return np.sqrt(np.clip(eigenvalues, 0.0, None)) / (2.0 * np.pi)


def held_modes(sid: SID) -> tuple[Array, Array]:
    """Modes of the body whose frame is held: K y = w2 M y with (Ke, Me).

    Returns
    -------
    (nq,) squared circular frequencies, ascending, and (nq, nq) modes in the columns,
    y^T Me y = I. Needs a positive definite Me.
    """
    return eigh(symmetric_part(sid.Ke.m0), symmetric_part(sid.Me.m0))


def free_modes(sid: SID, rigid: tuple[int, ...] = SPATIAL) -> tuple[Array, Array]:
    """Return the elastic modes of the free body, whatever its frame.

    The coupled system of 6 + nq coordinates has the stiffness blkdiag(0, Ke); with the
    rigid motion eliminated its elastic modes are those of (Ke, `free_modal_mass`).
    The coupled mass matrix must be positive definite.

    Returns
    -------
    (nq,) squared circular frequencies and (nq, nq) modes of the elastic coordinates.
    """
    return eigh(symmetric_part(sid.Ke.m0), symmetric_part(free_modal_mass(sid, rigid)))


def label_hertz(sid: SID) -> tuple[Array, Array] | None:
    """Return frequencies in the labels and half of their last digit, each (nq,) [Hz].

    None unless every label holds one that a body can have.
    """
    matches = [_HERTZ.search(label) for label in sid.labels]
    if not matches or any(match is None for match in matches):
        return None
    texts = [match[1] for match in matches if match]
    values = np.array([float(re.sub("[dD]", "e", text)) for text in texts])
    if not np.all(np.abs(values) < _LARGEST):
        return None
    digits = np.array([0.5 * 10.0 ** -_printed_decimals(text) for text in texts])
    return values, digits


def symmetric_part(matrix: Array) -> Array:
    """The symmetric part of a square matrix."""
    return 0.5 * (matrix + matrix.T)


def _printed_decimals(text: str) -> int:
    mantissa, _, exponent = re.sub("[dDE]", "e", text).partition("e")
    return len(mantissa.partition(".")[2]) - max(int(exponent or 0), -30)


def sign_correlation(sid: SID) -> dict[str, float]:
    """Return the correlations of "Ct" and "phi" with Oe, if they have a first order: 1
    to -1.

    Empty if they cannot be determined: another shape of body, or no such terms.
    """
    direction = _direction_to_mass(sid)
    basis = elastic_basis(sid) if sid.nq else np.zeros((0, 0))
    if direction is None or basis.size == 0:
        return {}
    mass = basis.T @ sid.Me.m0 @ basis
    trace = sid.Oe.first_order(sid.nq)[..., :3].sum(axis=2)
    moment = basis.T @ (-(trace + trace.T) / 4 - sid.Me.m0) @ basis
    if np.linalg.norm(moment) <= _MIN_STIFFENING * np.linalg.norm(mass):
        return {}
    at_nodes = np.zeros((sid.nq, sid.nq))
    for node in sid.nodes:
        if node.position @ direction > 0.0:
            first = node.phi.first_order(sid.nq)
            at_nodes += np.einsum("lak,a->lk", first, direction)
    terms = {"Ct": sid.Ct.first_order(sid.nq) @ direction, "phi": at_nodes}
    correlations = {}
    for name, term in terms.items():
        part = basis.T @ (term + term.T) @ basis
        size = np.linalg.norm(part) * np.linalg.norm(moment)
        if size > 0.0:
            correlations[name] = float((part * moment).sum() / size)
    if correlations.get(
        "Ct", WRONG_SIGN_CORRELATION
    ) > WRONG_SIGN_CORRELATION and not _surely_wrong(correlations, sid.nq):
        correlations.pop("phi", None)
    return correlations


def _surely_wrong(correlations: dict[str, float], nq: int) -> bool:
    """Return whether the signs are wrong. A few nodes do not represent the body: if Ct
    m1 is right, their correlation must be more negative.
    """
    return nq >= _MIN_NODES and correlations.get("phi", 0.0) < _NODE_SIGN_CORRELATION


def _direction_to_mass(sid: SID) -> Array | None:
    """Return the direction (3,) from the origin to the centre of mass; None if the mass
    surrounds the origin.
    """
    if not sid.mass > 0.0:
        return None
    centre = sid.mdCM.m0[:, 0] / sid.mass
    distance = float(np.linalg.norm(centre))
    if distance == 0.0:
        return None
    along = centre / distance
    spread = np.trace(central_inertia(sid)) / 2
    if distance < _ONE_SIDED_MASS * np.sqrt(max(spread, 0.0) / sid.mass):
        return None
    return np.asarray(along)
