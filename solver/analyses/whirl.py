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

from sidtool.formats.base.sid import Array

from ..spatial import system_arrays as at
from ..system.rotations import to_rotation_matrices
from .dense_equations import DenseEquations
from .multi_blade import BladeGroup
from .reference_axes import axis_angular_velocities, independent_rows

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
    omegas: Array,
    omega: float,
    shape: np.ndarray,
    blades: tuple[BladeGroup, ...] = (),
) -> Whirl:
    """How a mode whirls, of the state evaluated last.

    Parameters
    ----------
    omegas : (bodies, 3)
        The axes in which bodies are seen.
    omega
        Angular frequency there, not negative.
    shape : (n velocities,)
        Complex, in the body frames.
    blades
        Groups of bodies in multi-blade coordinates.
    """
    own = axis_angular_velocities(mechanics)
    parts: list[tuple[float, float, float, str]] = []
    fastest = float(np.linalg.norm(own, axis=1).max(initial=0.0))
    axis = own[np.argmax(np.linalg.norm(own, axis=1))] / fastest if fastest else None
    motions = _body_point_motions(mechanics, shape)
    members = {k for group in blades for k in group.bodies}
    for group in blades:
        parts += _blade_parts(
            mechanics, group, [motions[k] for k in group.bodies], omega
        )
    for k, moves in enumerate(motions):
        if k in members:
            continue
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
    mechanics: DenseEquations,
    group: BladeGroup,
    motions: list[np.ndarray],
    omega: float,
) -> list[tuple[float, float, float, str]]:
    """Harmonics over the azimuth of a mode in multi-blade coordinates.

    Harmonic n of the bodies moves as exp(i (omega t + n psi)): seen from a body its
    frequency is omega + n W, and for n < 0 the pattern goes forward.
    """
    R = to_rotation_matrices(mechanics.system.frames(mechanics.work.frame)["R"])
    own = [moves @ R[k] for k, moves in zip(group.bodies, motions, strict=True)]
    amplitudes = np.fft.fft(own, axis=0)
    parts = []
    for order, moves in zip(group.harmonics, amplitudes, strict=True):
        energy = float(np.sum(np.abs(moves) ** 2)) / len(own)
        direction = "" if order == 0.0 else FORWARD if order < 0.0 else BACKWARD
        rate = 0.0 if 2.0 * abs(order) == len(own) else order * group.speed
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


def _body_point_motions(
    mechanics: DenseEquations, shape: np.ndarray
) -> list[np.ndarray]:
    """Displacements and rotations of the points of each body, in inertial axes, times
    the roots of their inertia, (points, 3)."""
    system = mechanics.system
    size = 2 if system.planar else 3
    rotations = to_rotation_matrices(system.frames(mechanics.work.frame)["R"])
    leads, motions = independent_rows(mechanics), []
    for row, R, body in zip(system.arrays.body, rotations, system.bodies, strict=True):
        u, rd, n = int(row[at.VEL]), int(row[at.RD]), int(row[at.NV])
        if not body.is_scene_body or not leads[min(row[at.VEL], len(leads) - 1)]:
            motions.append(np.zeros((1, 3)))
            continue
        translation, rotation = np.zeros(3, complex), np.zeros(3, complex)
        translation[:size] = shape[u : u + min(size, rd)] if rd else 0.0
        if rd > size:
            rotation[slice(2, 3) if size == 2 else slice(0, 3)] = shape[
                u + size : u + rd
            ]
        q = shape[u + rd : u + n]
        phi, psi = body.sid.shapes
        origins = np.array([node.origin.m0[:, 0] for node in body.sid.nodes])
        J = np.ravel(body.sid.J.m0)[:3]
        if not len(phi) or not len(q):
            phi, psi = np.zeros((1, 3, len(q))), np.zeros((1, 3, len(q)))
            origins = np.atleast_2d(
                np.ravel(body.sid.mdCM.m0) / max(body.sid.mass, 1e-300)
            )
        displacements_ = translation + np.cross(rotation, origins) + phi @ q
        omegas = (rotation + psi @ q) * np.sqrt(np.abs(J))
        axes = np.eye(3) if rd == size else R
        both = np.vstack([np.sqrt(body.sid.mass) * displacements_, omegas])
        motions.append(both @ axes.T / np.sqrt(len(displacements_)))
    return motions
