"""Rigid motions of a mechanism, whose eigenvalues are known exactly.

A motion without constraint, stiffness and preload against it has the eigenvalue 0; in
axes that rotate with angular velocity W, a displacement that is constant in inertial
axes has +-i W. Most of them are double, as such a motion may continue at constant
speed, so that rounding of the matrix moves them by its square root. Therefore they are
computed from the mechanism and deflated from the matrix.

References
----------
G. H. Golub, C. F. Van Loan: Matrix Computations, section 7.1.3.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space as kernel, orth

from sidtool.formats.base.sid import Array

from ..spatial import system_arrays as at
from ..system import work_arrays
from ..system.characteristic_sizes import coordinate_sizes
from .dense_equations import DenseEquations, null_space
from .reference_axes import EQUAL_ANGULAR_VELOCITY, axis_angular_velocities
from .state_matrix import SmallMotions

#: What acts against a rigid motion is less than this part of what spin could do, and
#: preload by the displacements of this motion relative to the sizes of coordinates, or
#: than this part of the largest entries of the matrix, which is rounding.
FREE_MOTION, ROUNDING = 1e-6, 1e-13
#: A free rotor sags by less than this multiple of its rigid motion, of one radian about
#: an axis to which all of it is near.
SMALL_SAG = 10.0
#: Of the eigenvalue of its second half, likewise.
SECOND_EIGENVALUE = 1e-9


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenvalues (n,), vectors (size, n) and which are rigid motions, (n,)."""

    values: np.ndarray
    vectors: np.ndarray
    rigid: np.ndarray


def unstressed_motions(
    mechanics: DenseEquations, z: Array, v: Array, keep_laws: bool = True
) -> Array:
    """Scaled tangents (n, r) that keep constraints, elastic coordinates, and the
    measures of all forces that depend on them.

    Parameters
    ----------
    keep_laws : whether control laws count, whose measures may change together so that
        their values stay
    """
    system, scale = mechanics.system, mechanics.scale
    mechanics.evaluate(z, v)
    a, multipliers = mechanics.accelerations()
    C, work = mechanics.jacobian, mechanics.work
    work_arrays.linearise(system, work, mechanics.t, z, v, a * scale, multipliers)
    constraints = [C]
    for row, body in zip(system.arrays.body, system.bodies, strict=True):
        is_elastic = (
            slice(row[at.RD], row[at.NV]) if body.is_scene_body else slice(None)
        )
        constraints.append(
            np.eye(len(v))[row[at.VEL] : row[at.VEL] + row[at.NV]][is_elastic]
        )
    for force in system.arrays.force:
        if not keep_laws and max(force[at.F_CODE], force[at.F_OWNER]) >= 0:
            continue
        slopes = np.zeros((1, len(v)))
        for marker, first in ((at.F_A, at.F_SEG_A), (at.F_B, at.F_SEG_B)):
            if force[at.F_KIND] >= at.COORDINATE_MEASURE or force[first] < 0:
                continue
            b = system.arrays.body[system.arrays.marker[force[marker], at.M_BODY]]
            entries = work.Gp[force[first] : force[first] + b[at.NV]]
            slopes[0, b[at.VEL] : b[at.VEL] + b[at.NV]] += entries
        if slopes.any():
            constraints.append(slopes * scale)
    mechanics.evaluate(z, v)
    return null_space(np.vstack(constraints))


def spectrum(mechanics: DenseEquations, small: SmallMotions) -> Spectrum:
    """Eigenvalues of the matrix of small motions, those of rigid motions exact."""
    matrix, motion, z, v = small.matrix, small.free_directions, small.z, small.v
    n_positions = len(matrix) - motion.shape[1]
    free, with_laws = (
        motion[:, :n_positions].T @ unstressed_motions(mechanics, z, v, keep_laws)
        for keep_laws in (True, False)
    )
    rates = np.linalg.norm(small.omegas, axis=1)
    mechanics.evaluate(z, v)
    own = np.linalg.norm(axis_angular_velocities(mechanics), axis=1)
    tolerance_, rates_ = EQUAL_ANGULAR_VELOCITY * own.max(initial=0.0), list[float]()
    for rate in sorted(map(float, rates), reverse=True):
        if rate > tolerance_ and (not rates_ or rates_[-1] - rate > tolerance_):
            rates_.append(rate)
    sizes = coordinate_sizes(mechanics.system) / mechanics.scale
    force = mechanics.force_size(z)
    mechanics.evaluate(z, v)
    fastest = float(own.max(initial=0.0))
    rounding = ROUNDING * float(np.abs(matrix).max(initial=0.0))

    def preload(motions: np.ndarray) -> Array:
        """What forces could do against motions (n_positions, k) by their displacements
        relative to the sizes of coordinates, (k,)."""
        moved = np.abs(motion[:, :n_positions] @ motions) / sizes[:, None]
        return np.asarray(force * moved.max(axis=0, initial=0.0))

    candidates: list[tuple[Array, Callable[[np.ndarray], Array]]] = [
        (free, lambda x: FREE_MOTION * (fastest**2 + preload(x)) + rounding)
    ]
    if with_laws.shape[1] > free.shape[1]:
        candidates.append((with_laws, lambda x: np.full(x.shape[1], rounding)))
    known: list[tuple[complex, np.ndarray]] = []
    for value in (0.0, *(1j * x for x in rates_)):
        eigenvectors = max(
            (
                _resting_states(matrix, motions, n_positions, value, limit)
                for motions, limit in candidates
            ),
            key=lambda states: states.shape[1],
        )
        if eigenvectors.size:
            known.append((value, np.asarray(orth(eigenvectors))))
            if value:
                known.append((-value, known[-1][1].conj()))
    if not known:
        values, vectors = np.linalg.eig(matrix)
        return Spectrum(values, vectors, np.zeros(len(values), bool))
    strongest = max(preload(x[:n_positions]).max(initial=0.0) for _, x in known)
    return _deflated_spectrum(matrix, known, SECOND_EIGENVALUE, fastest, strongest)


def _resting_states(
    matrix: Array,
    motions: Array,
    n_positions: int,
    value: complex,
    tolerances: Callable[[np.ndarray], Array],
) -> np.ndarray:
    """States (size, k) of some motions (n_positions, r) that have an eigenvalue: what
    acts against each is below the tolerance of this motion."""
    if not motions.size:
        return np.zeros((len(matrix), 0))
    states = np.zeros((len(matrix), motions.shape[1]), complex)
    states[:n_positions] = motions
    states[n_positions : 2 * n_positions] = (
        value * motions - matrix[:n_positions, :n_positions] @ motions
    )
    if value == 0.0:
        states = _with_sag(matrix, states)
    _, strains, right = np.linalg.svd(matrix @ states - value * states)
    limits = tolerances(motions @ right.conj().T)
    none = [
        k for k in range(len(right)) if k >= len(strains) or strains[k] <= limits[k]
    ]
    return np.asarray(states @ right[none].conj().T)


def _with_sag(matrix: Array, states: np.ndarray) -> np.ndarray:
    """Rigid motions with the small displacements that let their residual vanish.

    A rotor under its weight that does not rest in its equilibrium rotates freely, but
    its acceleration turns in the axes of the bodies. Motions that take more than a
    small displacement are resisted, and stay as they are.
    """
    others = kernel(states.conj().T)
    shift = np.linalg.lstsq(matrix @ others, -matrix @ states, rcond=1e-10)[0]
    sizes = np.linalg.norm(shift, axis=0) / np.linalg.norm(states, axis=0)
    return np.asarray(states + others @ np.where(sizes < SMALL_SAG, shift, 0.0))


def _deflated_spectrum(
    matrix: Array,
    known: list[tuple[complex, np.ndarray]],
    second: float,
    fastest: float,
    preload: float,
) -> Spectrum:
    """The spectrum of a real matrix with known eigenvalues and vectors, in pairs.

    What is left is a real matrix, too: its eigenvalues are real or exact pairs. Of each
    known one a second one may be near, which belongs to the same motion.
    """
    first = np.hstack([vectors for _, vectors in known])
    first = np.asarray(orth(np.hstack([first.real, first.imag]), rcond=1e-8))
    complement = np.asarray(kernel(first.T))
    own = first.T @ matrix @ first
    coupled = first.T @ matrix @ complement
    values, inner_vectors = np.linalg.eig(complement.T @ matrix @ complement)
    is_kept = np.ones(len(values), bool)
    tolerance = FREE_MOTION * (fastest + np.sqrt(preload))
    tolerance += second * float(np.abs(values).max(initial=0.0))
    for value, vectors in known:
        order = np.argsort(np.where(is_kept, np.abs(values - value), np.inf))
        for k in order[: vectors.shape[1]]:
            if is_kept[k] and abs(values[k] - value) <= tolerance:
                is_kept[k] = False
    columns = []
    for k in np.flatnonzero(is_kept):
        shift = own - values[k] * np.eye(len(own))
        along = np.linalg.lstsq(shift, -coupled @ inner_vectors[:, k], rcond=None)[0]
        columns.append(complement @ inner_vectors[:, k] + first @ along)
    rigid = [(value, x) for value, vectors in known for x in vectors.T]
    return Spectrum(
        np.array([*(value for value, _ in rigid), *values[is_kept]], complex),
        np.array([*(x for _, x in rigid), *columns], complex).T,
        np.arange(len(rigid) + int(is_kept.sum())) < len(rigid),
    )
