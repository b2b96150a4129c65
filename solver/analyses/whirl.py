"""Frequencies of whirling motions in inertial axes and in those of a rotor.

Across the axis of rotation a harmonic motion is the sum of a forward and a backward
circular motion. In axes that rotate with W the signed angular frequency w becomes
w - W; motions along and about the axis have the same frequency in both axes.

References
----------
G. Genta: Dynamics of Rotating Systems, 2005, section 2.4.
"""

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.sid_mass import coupled_mass_matrix, mean_axes_motion

from ..spatial import system_arrays as at
from ..system.rotated_markers import to_rotation_matrices
from .dense_equations import DenseEquations
from .multi_blade import BladeGroup
from .reference_axes import independent_rows

FORWARD, BACKWARD = "forward", "backward"
#: Parts of the kinetic energy of a motion that are none; frequencies that are the same,
#: relative to the largest of a motion and its speed.
NO_ENERGY, EQUAL_FREQUENCY = 1e-6, 1e-7


@dataclass(frozen=True)
class Whirl:
    """Of one mode.

    Attributes
    ----------
    inertial_frequencies
        Its angular frequencies in inertial axes [rad/s], that of most energy first.
    rotating_frequency
        That in the axes of the bodies that move, [rad/s].
    direction
        "forward" or "backward" of the first, "" of what moves along or about the axis,
        or does not turn.
    """

    inertial_frequencies: tuple[float, ...]
    rotating_frequency: float
    direction: str


def mode_whirl(
    mechanics: DenseEquations,
    own: Array,
    omegas: Array,
    omega: float,
    shape: np.ndarray,
    blades: tuple[BladeGroup, ...] = (),
) -> Whirl:
    """How a mode whirls, of the state evaluated last.

    Parameters
    ----------
    own : (bodies, 3)
        Angular velocities of the bodies, see `body_axes`.
    omegas : (bodies, 3)
        The axes in which bodies are seen.
    omega
        Angular frequency there, not negative.
    shape : (n velocities,)
        Complex, in the body frames.
    blades
        Groups of bodies in multi-blade coordinates.
    """
    parts: list[tuple[float, float, float, str]] = []
    fastest = float(np.linalg.norm(own, axis=1).max(initial=0.0))
    axis = own[np.argmax(np.linalg.norm(own, axis=1))] / fastest if fastest else None
    coordinates = _body_coordinates(mechanics, shape)
    members = {k for group in blades for k in group.bodies}
    for group in blades:
        own_motions = np.array([coordinates[k] for k in group.bodies])
        sid = mechanics.system.bodies[group.bodies[0]].sid
        parts += _blade_parts(group, own_motions, sid, omega)
    for k, motion in enumerate(coordinates):
        if k in members:
            continue
        moves = _inertial_motions(mechanics, k, motion)
        if axis is None:
            parts.append((float(np.sum(np.abs(moves) ** 2)), omega, omega, ""))
            continue
        axis_rate, body_rate = float(omegas[k] @ axis), float(own[k] @ axis)
        transverse = np.linalg.svd(axis[None])[2][1:]
        if np.cross(*transverse) @ axis < 0.0:
            transverse = transverse[::-1]
        u, w = moves @ transverse[0], moves @ transverse[1]
        parts.append((float(np.sum(np.abs(moves @ axis) ** 2)), omega, omega, ""))
        for sign, circle in ((1.0, u + 1j * w), (-1.0, np.conj(u) + 1j * np.conj(w))):
            rate = sign * omega + axis_rate
            direction = FORWARD if rate > EQUAL_FREQUENCY * fastest else BACKWARD
            direction = direction if abs(rate) > EQUAL_FREQUENCY * fastest else ""
            energy = 0.5 * float(np.sum(np.abs(circle) ** 2))
            parts.append((energy, abs(rate), abs(rate - body_rate), direction))
    return _combine_parts(parts, omega, EQUAL_FREQUENCY * (omega + fastest))


def _blade_parts(
    group: BladeGroup, motions: np.ndarray, sid: SID, omega: float
) -> list[tuple[float, float, float, str]]:
    """Harmonics over the azimuth of a mode in multi-blade coordinates.

    Harmonic n of the bodies moves as exp(i (omega t + n psi)): seen from a body its
    frequency is omega + n W, and for n < 0 the pattern goes forward.

    Parameters
    ----------
    motions : (N, 6 + nq)
        Of the bodies, see `_body_coordinates`.
    sid
        Of all of them.
    """
    amplitudes, mass = np.fft.fft(motions, axis=0), coupled_mass_matrix(sid)
    parts = []
    for order, moves in zip(group.harmonics, amplitudes, strict=True):
        energy = float((moves.conj() @ mass @ moves).real) / len(motions)
        direction = "" if order == 0.0 else FORWARD if order < 0.0 else BACKWARD
        rate = 0.0 if 2.0 * abs(order) == len(motions) else order * group.speed
        direction = direction if rate else ""
        parts.append((energy, omega, abs(omega + rate), direction))
    return parts


def _combine_parts(
    parts: list[tuple[float, float, float, str]], omega: float, same: float
) -> Whirl:
    total = sum(part[0] for part in parts)
    groups: list[list[tuple[float, float, float, str]]] = []
    for part in sorted(parts, reverse=True):
        if part[0] <= NO_ENERGY * total:
            continue
        group = next((g for g in groups if abs(g[0][1] - part[1]) <= same), None)
        if group is None:
            groups.append([part])
        else:
            group.append(part)
    if not groups:
        return Whirl((omega,), omega, "")
    groups.sort(key=lambda group: -sum(part[0] for part in group))
    leading = groups[0][0]
    rates = tuple(0.0 if g[0][1] <= same else g[0][1] for g in groups)
    return Whirl(rates, leading[2], leading[3])


def _body_coordinates(mechanics: DenseEquations, shape: np.ndarray) -> list[np.ndarray]:
    """Of each body displacement and rotation of its frame, and elastic coordinates,
    (6 + nq,), in its axes, zero for massless auxiliary bodies and for bodies with
    prescribed motion.
    """
    system = mechanics.system
    size = 2 if system.planar else 3
    leads, found = independent_rows(mechanics), []
    for row, body in zip(system.arrays.body, system.bodies, strict=True):
        u, rd, n = int(row[at.VEL]), int(row[at.RD]), int(row[at.NV])
        motion = np.zeros(6 + n - rd, complex)
        if body.is_scene_body and leads[min(u, len(leads) - 1)]:
            motion[: min(size, rd)] = shape[u : u + min(size, rd)]
            if rd > size:
                first = 5 if size == 2 else 3
                motion[first:6] = shape[u + size : u + rd]
            motion[6:] = shape[u + rd : u + n]
        found.append(motion)
    return found


def _inertial_motions(
    mechanics: DenseEquations, k: int, motion: np.ndarray
) -> np.ndarray:
    """Displacements and rotations of a body in inertial axes, times the roots of its
    inertia.

    The points are the mean one of the momenta, which does not depend on where nodes
    are, and the nodes.

    Parameters
    ----------
    k : number of the body
    motion : (6 + nq,) displacement and rotation of its frame, and elastic coordinates,
        in its axes, see `_body_coordinates`

    Returns
    -------
    (2 * points, 3), displacements above rotations
    """
    system = mechanics.system
    row, sid = system.arrays.body[k], system.bodies[k].sid
    translation, rotation, q = motion[:3], motion[3:6], motion[6:]
    origins = (np.ravel(sid.mdCM.m0) / max(sid.mass, 1e-300))[None]
    moved, turned = np.zeros((1, 3), complex), np.zeros((1, 3), complex)
    if len(q):
        phi, psi = sid.shapes
        mean = mean_axes_motion(sid) @ q
        moved[0] = mean[:3] + np.cross(mean[3:], origins[0])
        turned[0] = mean[3:]
        if len(phi):
            nodes = np.array([node.origin.m0[:, 0] for node in sid.nodes])
            origins = np.vstack([origins, nodes])
            moved, turned = np.vstack([moved, phi @ q]), np.vstack([turned, psi @ q])
    displacements_ = translation + np.cross(rotation, origins) + moved
    omegas = (rotation + turned) * np.sqrt(np.abs(np.ravel(sid.J.m0)[:3]))
    both = np.vstack([np.sqrt(sid.mass) * displacements_, omegas]) / np.sqrt(
        len(displacements_)
    )
    if row[at.RD] == (2 if system.planar else 3):
        return both
    R = to_rotation_matrices(system.frames(mechanics.work.frame)["R"])[k]
    return np.asarray(both @ R.T)
