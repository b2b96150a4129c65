"""Static compliance of a body by its shape functions."""

import numpy as np

from .base.sid import SID, Array, ComplianceShares
from .sid_mass import coupled_mass_matrix, mean_axes_motion, skew


def unit_load_compliances(sid: SID, free: bool) -> tuple[dict[str, Array], Array]:
    """Displacements along and rotations about the body axes under unit loads.

    Parameters
    ----------
    free : the loads are balanced by the inertia of a free body, whose displacements
        carry no momentum

    Returns
    -------
    node id -> (6,) [m/N, rad/(N m)], and (9,) the work [J] of the inertia of the body
    when its frame is accelerated along and about its axes, and when it rotates steadily
    about them, each by the unit of `inertia_load_scales`; zero if `free`

    Raises
    ------
    numpy.linalg.LinAlgError : Ke is singular.
    """
    inverse = np.linalg.inv(np.linalg.cholesky(sid.Ke.m0))
    inertia = np.vstack([coupled_mass_matrix(sid)[:6, 6:], sid.Oe.m0[:, :3].T])
    inertia *= inertia_load_scales(sid.mass, sid.J.m0[:3, 0])[:, None]
    rigid = np.zeros((6, sid.nq))
    if free:
        rigid, inertia = mean_axes_motion(sid), np.zeros_like(inertia)

    def work(rows: Array) -> Array:
        return np.asarray(((rows @ inverse.T) ** 2).sum(axis=1))

    at_nodes = {}
    for node in sid.nodes:
        motion = rigid[:3] - skew(node.position) @ rigid[3:]
        shapes = np.vstack([node.phi.m0 - motion, node.psi.m0 - rigid[3:]])
        at_nodes[node.id] = work(shapes)
    return at_nodes, work(inertia)


def inertia_load_scales(mass: float, moments: Array) -> Array:
    """Units (9,) of the loads by which the inertia of a body is compared.

    Accelerations [m/s2], angular accelerations [rad/s2] and squares of angular
    velocities [rad2/s2], of about one acceleration in the body: 1 and 1 / r with the
    largest radius of gyration r about the origin.

    Parameters
    ----------
    mass, moments : [kg], about axes through the origin (n,) [kg m2]
    """
    largest = float(moments.max(initial=0.0))
    scale = np.sqrt(mass / largest) if largest > 0.0 else 1.0
    return np.repeat([1.0, scale, scale], 3)


def remaining_compliance_shares(sid: SID, small: SID) -> ComplianceShares | None:
    """Return the compliance shares of a SID with fewer shape functions."""
    if sid.carried is None or not small.nq:
        return None
    try:
        before, inertia = unit_load_compliances(sid, sid.carried.free)
        after, less = unit_load_compliances(small, sid.carried.free)
    except np.linalg.LinAlgError:
        return None
    shares = {
        name: tuple(map(_share_product, row, *pairs))
        for name, row in sid.carried.shares.items()
        if name in before
        for pairs in [(after[name], before[name])]
    }
    lost: tuple[float, ...] = ()
    if sid.carried.knows_inertia:
        full = inertia_work_of_full_body(sid.carried.lost, inertia)
        lost = missing_inertia_shares(full, less)
    return ComplianceShares(sid.carried.free, shares, lost)


def _share_product(share: float | None, after: float, before: float) -> float | None:
    return None if share is None or not before else share * float(after / before)


def inertia_work_of_full_body(lost: tuple[float, ...], inertia: Array) -> Array:
    """The work of inertia (9,) of the full body, of which some is `lost`."""
    missing = np.array(lost)
    largest = (inertia / np.maximum(1.0 - missing, 1e-300)).max()
    return np.asarray(inertia + missing * largest)


def missing_inertia_shares(full: Array, carried: Array) -> tuple[float, ...]:
    """Return the missing shares of the work (9,) under own inertia, see
    `ComplianceShares.lost`.
    """
    missing = np.clip(full - carried, 0.0, None)
    return tuple((missing / (full.max() or 1.0)).tolist())
