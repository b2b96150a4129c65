"""The coupled mass matrix of one body, and whether the body can move freely.

Block form of the equations of motion of a body in floating-frame coordinates, see
R. Schwertassek, O. Wallrapp, "Dynamik flexibler Mehrkoerpersysteme", chapter 6:
rows and columns are the acceleration of the frame's origin (3), the angular
acceleration of the frame (3) and the elastic accelerations (nq).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .base.complex_step import numbers
from .base.sid import OE_INDICES, SID, Array, symmetric_3x3
from .storage.cache import cached_by_identity

#: Rigid coordinates of a body that moves in space: x, y, z and rotations about them.
SPATIAL = (0, 1, 2, 3, 4, 5)
#: Rigid coordinates of a body that moves in the plane normal to x, y or z.
IN_PLANE = ((1, 2, 3), (0, 2, 4), (0, 1, 5))
#: (6, 3, 3) coefficients W of the products of omega in omega~ omega~, in Oe's order.
CENTRIFUGAL_PRODUCTS = np.zeros((6, 3, 3))
for _k, (_a, _b) in enumerate(OE_INDICES):
    CENTRIFUGAL_PRODUCTS[_k, _a, _b] += 1
    CENTRIFUGAL_PRODUCTS[_k, _b, _a] += _a != _b
    CENTRIFUGAL_PRODUCTS[_k] -= np.eye(3) * (_a == _b)
CENTRIFUGAL_PRODUCTS.setflags(write=False)

# Central inertias below this fraction of the largest one count as zero; a wire of
# 1 mm by 10 m has 6e-8. The print of J about a distant origin (12 digits) adds its own.
_SINGULAR_INERTIA = 1e-9
_PRINT = 1e-11
# Elastic mass left below this fraction of Me counts as zero: 12 digits, amplified.
_SINGULAR_MODE = 1e-9
# Couplings below this fraction of the matching diagonal entries count as none.
_DECOUPLED = 1e-9


@dataclass(frozen=True)
class FreeMotion:
    """Result of the check that a mass matrix is positive definite.

    Attributes
    ----------
    smallest : the deciding number, dimensionless. The smallest eigenvalue of the
        elastic mass that remains when the frame floats freely, relative to Me; or,
        when the rigid part fails already, its smallest central inertia relative to
        the largest. Positive for a body that can exist.
    reason : empty if positive definite, else one phrase that states what is wrong.
    """

    smallest: float
    reason: str = ""

    @property
    def possible(self) -> bool:
        """True when the mass matrix is positive definite."""
        return not self.reason


def skew(vectors: ArrayLike) -> Array:
    """(..., 3) vectors v as matrices (..., 3, 3) with ``skew(v) @ w = v x w``."""
    v = numbers(vectors)
    matrix = np.zeros((*v.shape, 3), v.dtype)
    matrix[..., 0, 1], matrix[..., 1, 0] = -v[..., 2], v[..., 2]
    matrix[..., 0, 2], matrix[..., 2, 0] = v[..., 1], -v[..., 1]
    matrix[..., 1, 2], matrix[..., 2, 1] = -v[..., 0], v[..., 0]
    return matrix


def cross(a: Array, b: Array) -> Array:
    """(..., 3) cross products; `np.cross` takes several times as long for few rows."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def mean_axes_motion(sid: SID) -> Array:
    """Return the rigid motion (6, nq) with the momenta of each elastic coordinate.

    Translation of the point at the origin, and rotation; mean axes move so relative to
    the frame of the SID. A body without a rotation (a line of mass) has none.
    """
    mass = coupled_mass_matrix(sid)
    motion = np.linalg.lstsq(mass[:6, :6], mass[:6, 6:], rcond=1e-12)[0]
    return motion.astype(np.float64)


def coupled_mass_matrix(sid: SID, q: ArrayLike | None = None) -> Array:
    """[[m I, -md~, Ct^T], [md~, J, Cr^T], [Ct, Cr, Me]], (6 + nq, 6 + nq).

    Parameters
    ----------
    q : (nq,) elastic coordinates to first order in which the blocks are taken;
        the undeformed body by default
    """
    q = np.zeros(sid.nq) if q is None else np.asarray(q, float)
    static = skew(sid.mdCM.at(q)[:, 0])
    translation, rotation = sid.Ct.at(q), sid.Cr.at(q)
    inertia = symmetric_3x3(sid.J.at(q)[:, 0])
    return np.block(
        [
            [sid.mass * np.eye(3), -static, translation.T],
            [static, inertia, rotation.T],
            [translation, rotation, sid.Me.at(q)],
        ]
    )


def centre_of_mass(sid: SID) -> Array:
    """Undeformed centre of mass in the body frame, (3,) [m]; mass must be positive."""
    return sid.mdCM.m0[:, 0] / sid.mass


def central_inertia(sid: SID) -> Array:
    """Undeformed inertia tensor about the centre of mass, (3, 3) [kg m2]."""
    offset = skew(centre_of_mass(sid))
    return symmetric_3x3(sid.J.m0[:, 0]) + sid.mass * offset @ offset


@cached_by_identity
def body_size(sid: SID) -> float:
    """The length of a body [m]: of a bar with its largest moment of inertia, or the
    extent of its nodes if that is more. The place of its frame does not count."""
    if sid.mass == 0.0:
        return 0.0
    centre = sid.mdCM.m0[:, 0] / sid.mass
    moments = symmetric_3x3(sid.J.m0[:, 0])
    steiner = centre @ centre * np.eye(3) - np.outer(centre, centre)
    central = moments / sid.mass - steiner
    second = 0.5 * np.trace(central) * np.eye(3) - central
    length = np.sqrt(12.0 * max(np.linalg.eigvalsh(second)[-1], 0.0))
    places = np.array([centre, *(node.position for node in sid.nodes)])
    return float(max(length, np.linalg.norm(np.ptp(places, axis=0))))


def free_modal_mass(sid: SID, rigid: tuple[int, ...] = SPATIAL) -> Array:
    """Return Me less the share of the floating frame: Me - [Ct Cr] Mr^-1 [Ct Cr]^T,
    (nq, nq).

    With Ke it gives the frequencies of the free body, whatever its frame. `rigid`
    are the free rigid coordinates; their mass matrix Mr must be regular.
    """
    matrix = coupled_mass_matrix(sid)
    moving, elastic = list(rigid), slice(6, None)
    coupling = matrix[elastic][:, moving]
    body = matrix[np.ix_(moving, moving)]
    return sid.Me.m0 - coupling @ np.linalg.solve(body, coupling.T)


@cached_by_identity
def free_motion(sid: SID, rigid: tuple[int, ...] = SPATIAL) -> FreeMotion:
    """Is the coupled mass matrix positive definite when these rigid coordinates move?

    Rows of `rigid` that do not move (out-of-plane ones in a planar scene) are left
    out. All numbers that decide are independent of units and of the modes' basis.
    """
    if not sid.mass > 0.0:
        return FreeMotion(float(sid.mass), "the mass is not positive")
    rigid_part = _definite_rigid_part(sid, rigid)
    if rigid_part.reason or sid.nq == 0:
        return rigid_part
    return _definite_elastic_part(sid, rigid)


def plane_of_motion(sid: SID) -> int | None:
    """Axis normal to the plane that the body's data are confined to, or None.

    In such a body the rotation about this axis, the two displacements across it and
    the elastic coordinates are decoupled from the other rigid coordinates.
    """
    matrix = coupled_mass_matrix(sid)
    size = np.sqrt(np.abs(np.diag(matrix)))
    # A planar file may lack the out-of-plane inertias; the largest one is the scale.
    size[3:6] = size[3:6].max()
    for axis in (2, 1, 0):
        out = [i for i in SPATIAL if i not in IN_PLANE[axis]]
        inside = [i for i in range(len(matrix)) if i not in out]
        coupling = np.abs(matrix[np.ix_(out, inside)])
        if np.all(coupling <= _DECOUPLED * np.outer(size[out], size[inside])):
            return axis
    return None


def _definite_rigid_part(sid: SID, rigid: tuple[int, ...]) -> FreeMotion:
    turning = [i - 3 for i in rigid if i >= 3]
    shifting = [i for i in rigid if i < 3]
    lever = skew(sid.mdCM.m0[:, 0])[np.ix_(shifting, turning)]
    at_origin = symmetric_3x3(sid.J.m0[:, 0])[np.ix_(turning, turning)]
    inertias, axes = np.linalg.eigh(at_origin - lever.T @ lever / sid.mass)
    largest = np.abs(inertias).max()
    smallest = float(inertias[0] / largest) if largest else 0.0
    zero = _SINGULAR_INERTIA * largest + _PRINT * np.abs(at_origin).max()
    if inertias[0] > zero:
        return FreeMotion(smallest)
    direction = np.zeros(3)
    direction[turning] = axes[:, 0]
    about = _axis_in_words(direction)
    if inertias[0] < -zero:
        reason = f"the moment of inertia about the centre of mass is negative{about}"
        return FreeMotion(smallest, reason)
    reason = f"there is no moment of inertia{about}, so the mass matrix is singular"
    return FreeMotion(0.0, reason)


def _axis_in_words(direction: Array) -> str:
    axis = int(np.argmax(np.abs(direction)))
    if abs(direction[axis]) > 0.999:
        return f" about {'xyz'[axis]}"
    parts = ", ".join(f"{value:.2g}" for value in direction)
    return f" about the axis ({parts})"


def _definite_elastic_part(sid: SID, rigid: tuple[int, ...]) -> FreeMotion:
    try:
        factor = np.linalg.inv(np.linalg.cholesky(sid.Me.m0))
    except np.linalg.LinAlgError:
        smallest = float(np.linalg.eigvalsh(sid.Me.m0)[0])
        relative = smallest / np.abs(sid.Me.m0).max() if sid.Me.m0.any() else 0.0
        return FreeMotion(relative, "the modal mass matrix Me is not positive definite")
    left = factor @ free_modal_mass(sid, rigid) @ factor.T
    smallest = float(np.linalg.eigvalsh(left)[0])
    if smallest > _SINGULAR_MODE:
        return FreeMotion(smallest)
    kind = "indefinite" if smallest < -_SINGULAR_MODE else "singular"
    return FreeMotion(
        smallest,
        f"the coupled mass matrix is {kind}: some shape function carries more momentum "
        "than its modal mass allows",
    )
