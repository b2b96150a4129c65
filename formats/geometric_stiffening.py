"""Geometric stiffening: change of the stiffness of a SID by loads."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .base.sid import SID, Array, by_mode
from .storage.cache import cached_by_identity

_ZERO = (0.0, 0.0, 0.0)
#: Below this share of the stiffness, a change of it is called small.
SIGNIFICANT_CHANGE = 0.01
#: Changes by so many times the stiffness are those of numbers that have gone wrong.
UNBOUNDED_RATIO = 100.0
#: What the SID lacks is made by this, unless its body came as matrices.
REMEDY = "convert the body with a table [stiffening]"
NO_REMEDY = "its body came as matrices, which have none"
#: Rotation stiffens that pulls by more than this part of Me beyond its softening: by
#: 0.19 in the first shape function of a cantilever, 0.13 of a cube held at one side.
_PULLS = 0.05
#: A SID without stiffening terms shows the centrifugal softening only.
_PARTLY = "what other loads do is not known: the SID lacks geometric stiffening"


@cached_by_identity
def has_stiffening(sid: SID) -> bool:
    """Does the SID carry terms that only geometric stiffening puts there?

    These are Ct m1, phi m1 and psi m1, a symmetric part of Cr m1 that is none of its
    errors, and a positive part of the sum of Oe m1 over the axes: kinematics soften.
    """
    return (
        has_second_order_field(sid)
        or stiffens_by_turning(sid)
        or _stiffens_by_rotation(sid)
    )


def has_second_order_field(sid: SID) -> bool:
    """Ct m1, phi m1 or psi m1: displacements of second order of nodes or mass."""
    terms = [sid.Ct, *(t for node in sid.nodes for t in (node.phi, node.psi))]
    return any(term.m1 is not None and term.m1.any() for term in terms)


def stiffens_by_turning(sid: SID) -> bool:
    """Check whether the symmetric part of Cr m1 contains geometric stiffening (K0r).

    Writers that average magnitudes leave such a part, too, and copy it into Ge, where
    no displacement field puts it: Ge_l = Cr1_l - Cr1_l^T, whatever stiffens.
    """
    first = sid.Cr.first_order(sid.nq)
    partner = np.swapaxes(first, 0, 1)
    symmetric = np.abs(first + partner).max(initial=0.0)
    noise = 1e-6 * max(np.abs(first).max(initial=0.0), np.abs(sid.Me.m0).max(initial=0))
    if symmetric <= noise:
        return False
    contradiction = by_mode(sid.Ge.m0, sid.nq) - (first - partner)
    return bool(np.abs(contradiction).max() <= 1e-3 * symmetric)


def _stiffens_by_rotation(sid: SID) -> bool:
    """Check whether Oe m1, summed over rotations about x, y and z, stiffens more than
    it softens.

    Particles leave -2 int phi_k . phi_l. Rotary inertia adds nothing to the sum, since
    a rotated inertia tensor keeps its trace, whatever it does about one axis: sections
    that twist may well be stiffened. The stress of the sum of the loads, 2 rho c, takes
    2 Me back where a shape function is a rigid rotation, and more where it deforms. The
    mean over the shape functions counts, as Oe m1 of coarse meshes has errors.
    """
    total = sid.Oe.first_order(sid.nq)[:, :, :3].sum(axis=2)
    basis = _unit_basis(sid.Me.m0)
    pull = np.trace(basis.T @ total @ basis) / 2
    return bool(pull > _PULLS * basis.shape[1])


@cached_by_identity
def unit_stiffness(sid: SID, nodes: tuple[str, ...] = ()) -> dict[str, Array]:
    """Return the stiffness that each unit load adds to Ke, symmetric in the modes.

    Parameters
    ----------
    nodes : ids of nodes whose forces and moments are requested

    Returns
    -------
    acceleration, angular acceleration : (3, nq, nq) by axis
    rotation : (6, nq, nq) by the products of the angular velocity, in Oe's order
    force N, moment N : (3, nq, nq) by axis, for the nodes N

    Raises
    ------
    InputError : there is no such node.
    """
    nq = sid.nq
    stiffness = {
        "acceleration": np.moveaxis(sid.Ct.first_order(nq), 2, 0),
        "rotation": np.moveaxis(sid.Oe.first_order(nq), 2, 0),
        "angular acceleration": np.moveaxis(sid.Cr.first_order(nq), 2, 0),
    }
    for name in nodes:
        node = sid.node(name)
        stiffness[f"force {name}"] = -np.moveaxis(node.phi.first_order(nq), 1, 0)
        stiffness[f"moment {name}"] = -np.moveaxis(node.psi.first_order(nq), 1, 0)
    return {name: (k + np.swapaxes(k, 1, 2)) / 2 for name, k in stiffness.items()}


def rotation_products(angular_velocity: ArrayLike) -> Array:
    """(..., 6) products of (..., 3) angular velocities, in Oe's order."""
    w = np.asarray(angular_velocity, float)
    x, y, z = np.moveaxis(w, -1, 0)
    return np.stack([x * x, y * y, z * z, x * y, y * z, x * z], axis=-1)


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
    values = {
        "acceleration": np.asarray(acceleration, float),
        "rotation": rotation_products(angular_velocity),
        "angular acceleration": np.asarray(angular_acceleration, float),
    }
    forces, moments = forces or {}, moments or {}
    values |= {f"force {n}": np.asarray(f, float) for n, f in forces.items()}
    values |= {f"moment {n}": np.asarray(m, float) for n, m in moments.items()}
    units = unit_stiffness(sid, tuple({**forces, **moments}))
    parts = [np.tensordot(load, units[name], 1) for name, load in values.items()]
    return np.sum(parts, axis=0)


@cached_by_identity
def elastic_basis(sid: SID) -> Array:
    """(nq, n) deformations of elastic energy 1/2 each, free of what Ke cannot hold."""
    return _unit_basis(sid.Ke.m0)


def _unit_basis(matrix: Array) -> Array:
    """(nq, n) vectors on which the matrix is the identity, none where it is zero."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    is_positive = values > 1e-12 * max(values.max(initial=0.0), 1e-300)
    return vectors[:, is_positive] / np.sqrt(values[is_positive])


def stiffening_ratio(
    sid: SID,
    *,
    acceleration: ArrayLike = _ZERO,
    angular_velocity: ArrayLike = _ZERO,
    angular_acceleration: ArrayLike = _ZERO,
    forces: Mapping[str, ArrayLike] | None = None,
    moments: Mapping[str, ArrayLike] | None = None,
) -> float:
    """Return the largest share of Ke that loads add or remove, over all deformations.

    Small below about 0.01, unless near a resonance; at -1 the body would buckle. For a
    SID without stiffening terms the centrifugal softening alone gives the order, as the
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
    basis = elastic_basis(sid)
    ratios = np.linalg.eigvalsh(basis.T @ stiffness @ basis)
    return float(ratios[np.abs(ratios).argmax()]) if ratios.size else 0.0


@dataclass(frozen=True)
class LoadStiffening:
    """Largest change of the stiffness of a body by loads.

    Attributes
    ----------
    ratio : see `stiffening_ratio`; of all loads together
    load : the dominant load, in words; empty if there is none
    carried : the SID has stiffening terms, else only rotation is considered
    diverges : deformations grow without bound while these loads last
    time : of these loads [s]
    axial : the load is a rotation about an axis along which the body stretches, or
        about which its sections whirl: geometric stiffening does not counteract it
    inertia : the largest share of its kinetic energy by which second-order
        displacements change that of a deformation; 0 before a run
    alone : the ratio by that load without the others; None if it is not known
    from_matrices : the body has no elements that could be stiffened
    """

    ratio: float = 0.0
    load: str = ""
    carried: bool = False
    diverges: bool = False
    time: float = 0.0
    axial: bool = False
    inertia: float = 0.0
    alone: float | None = None
    from_matrices: bool = False

    @property
    def lacks_stiffening(self) -> bool:
        """Is geometric stiffening missing in the SID, where a load asks for it?"""
        return not self.carried and not self.axial

    @property
    def remedy(self) -> str:
        """What adds geometric stiffening, as a sentence."""
        remedy = NO_REMEDY if self.from_matrices else REMEDY
        return f"{remedy[0].upper()}{remedy[1:]}."

    def sentence(self, when: str = "") -> str:
        """How much loads change the stiffness, and whether the SID carries it all.

        when : of the loads, in words
        """
        share = f"{_percent(self.ratio)} of the stiffness by {self._cause}{when}"
        lacks = self.lacks_stiffening
        remedy = NO_REMEDY if self.from_matrices else REMEDY
        if self.diverges and abs(self.ratio) > UNBOUNDED_RATIO:
            return (
                f"diverges{when}: deformed without bound, where loads and stiffness "
                "are those of no body"
            )
        if self.diverges and self.axial:
            return (
                f"diverges, {share} about its long axis: between critical speeds of "
                "the shaft"
            )
        if self.diverges and lacks:
            return (
                f"diverges, {share}: the SID lacks the geometric stiffening that "
                f"outweighs the centrifugal softening; {remedy}"
            )
        if self.diverges:
            return f"buckles, {share}: these loads are more than the body can bear"
        if abs(self.ratio) < SIGNIFICANT_CHANGE:
            if not self.carried:
                amount = f"small, at most {share}" if self.load else "none"
                return f"softening by rotation {amount}; {_PARTLY}"
            amount = f"at most {share}" if self.load else "none by these loads"
            if not self.inertia:
                return f"stiffening small, {amount}"
            inertia = f"at most {100 * self.inertia:.2g} % of the elastic inertia"
            if self.inertia < SIGNIFICANT_CHANGE:
                return f"stiffening small, {amount}, {inertia}"
            return f"stiffening may matter and is in the SID, {amount}, but {inertia}"
        if self.axial:
            return f"centrifugal forces change {share} about its long axis"
        if self.carried:
            return f"stiffening matters and is in the SID, {share}"
        return f"stiffening matters and the SID lacks it, {share}; {remedy}"

    @property
    def _cause(self) -> str:
        """The load, or all of them and the part of that one, where others count."""
        if self.alone is None or _percent(self.alone) == _percent(self.ratio):
            return self.load
        return f"all loads, {_percent(self.alone)} by {self.load} alone"


def _percent(share: float) -> str:
    return f"{100 * share:+.3g} %"
