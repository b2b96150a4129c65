"""Have Ct m1 and phi m1 the sign of stiffening? Beside the centrifugal stiffening.

All of them are one displacement field of second order Phi1: Ct m1 = int Phi1 dm, phi m1
is Phi1 at a node, and Oe m1 holds int Phi1_kl . c dm, which is minus half of 2 Me and
the columns of wx wx, wy wy, wz wz together. In a body whose mass lies to one side of
its origin the component of Phi1 towards the mass weighs like its product with c, so
they have one sign; some writers give Ct m1 and phi m1 the other.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import SID, Array
from sidtool.formats.sid_mass import central_inertia
from sidtool.formats.stiffening import elastic_basis

#: The mass lies to one side if its centre is further from the origin than its spread.
_ONE_SIDED = 1.2
#: Stiffening by rotation below this share of Me is none.
_NONE = 0.05
#: Correlation at which a sign is wrong, and where only the nodes speak.
WRONG, _FAR_OFF = -0.5, -0.9
_ENOUGH = 3


def agreement(sid: SID) -> dict[str, float]:
    """Correlation of "Ct" and "phi", where they have a first order, with Oe: 1 to -1.

    Empty where nothing can be told: another shape of body, or no such terms.
    """
    direction = _to_the_mass(sid)
    basis = elastic_basis(sid) if sid.nq else np.zeros((0, 0))
    if direction is None or basis.size == 0:
        return {}
    mass = basis.T @ sid.Me.m0 @ basis
    trace = sid.Oe.first_order(sid.nq)[..., :3].sum(axis=2)
    moment = basis.T @ (-(trace + trace.T) / 4 - sid.Me.m0) @ basis
    if np.linalg.norm(moment) <= _NONE * np.linalg.norm(mass):
        return {}
    at_nodes = np.zeros((sid.nq, sid.nq))
    for node in sid.nodes:
        if node.position @ direction > 0.0:
            first = node.phi.first_order(sid.nq)
            at_nodes += np.einsum("lak,a->lk", first, direction)
    terms = {"Ct": sid.Ct.first_order(sid.nq) @ direction, "phi": at_nodes}
    found = {}
    for name, term in terms.items():
        part = basis.T @ (term + term.T) @ basis
        size = np.linalg.norm(part) * np.linalg.norm(moment)
        if size > 0.0:
            found[name] = float((part * moment).sum() / size)
    if found.get("Ct", WRONG) > WRONG and not _surely_wrong(found, sid.nq):
        found.pop("phi", None)
    return found


def _surely_wrong(found: dict[str, float], nq: int) -> bool:
    """A few nodes are no mean of the body: with Ct m1 right they must be far off."""
    return nq >= _ENOUGH and found.get("phi", 0.0) < _FAR_OFF


def _to_the_mass(sid: SID) -> Array | None:
    """(3,) from the origin to the centre of mass; None if mass lies to all sides."""
    if not sid.mass > 0.0:
        return None
    centre = sid.mdCM.m0[:, 0] / sid.mass
    distance = float(np.linalg.norm(centre))
    if distance == 0.0:
        return None
    along = centre / distance
    spread = np.trace(central_inertia(sid)) / 2
    if distance < _ONE_SIDED * np.sqrt(max(spread, 0.0) / sid.mass):
        return None
    return np.asarray(along)
