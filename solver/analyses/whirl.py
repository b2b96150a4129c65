"""Frequencies of whirling motions in inertial axes and in those of a rotor.

Across the axis of rotation a harmonic motion is the sum of two circular ones, in the
direction of the rotation and against it. Axes that turn with W see that of signed
angular frequency w as w - W; motions along and about the axis are the same in both
(G. Genta, Dynamics of Rotating Systems, 2005, section 2.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..system.bodies.embedded import matrices
from .axes import independent_rows, spins_of_bodies
from .mechanics import Mechanics

FORWARD, BACKWARD = "forward", "backward"
#: Parts of the kinetic energy of a motion that are none; frequencies that are the same,
#: relative to the largest of a motion and its speed.
NOTHING, SAME = 1e-6, 1e-7


@dataclass(frozen=True)
class Whirl:
    """Of one mode.

    inertial : its angular frequencies in inertial axes [rad/s], that of most energy
        first
    rotating : that in the axes of the bodies that move, [rad/s]
    direction : "forward" or "backward" of the first, "" of what moves along or about
        the axis, or does not turn
    """

    inertial: tuple[float, ...]
    rotating: float
    direction: str


def whirl_of(
    mechanics: Mechanics, spins: Array, omega: float, shape: np.ndarray
) -> Whirl:
    """How a mode whirls, of the state evaluated last.

    spins : (bodies, 3) of the axes in which bodies are seen
    omega : angular frequency there, not negative
    shape : (n velocities,) complex, in the body frames
    """
    own = spins_of_bodies(mechanics)
    parts: list[tuple[float, float, float, str]] = []
    fastest = float(np.linalg.norm(own, axis=1).max(initial=0.0))
    axis = own[np.argmax(np.linalg.norm(own, axis=1))] / fastest if fastest else None
    for k, moves in enumerate(_motions(mechanics, shape)):
        if axis is None:
            parts.append((float(np.sum(np.abs(moves) ** 2)), omega, omega, ""))
            continue
        seen, turns = float(spins[k] @ axis), float(own[k] @ axis)
        across = np.linalg.svd(axis[None])[2][1:]
        if np.cross(*across) @ axis < 0.0:
            across = across[::-1]
        u, w = moves @ across[0], moves @ across[1]
        parts.append((float(np.sum(np.abs(moves @ axis) ** 2)), omega, omega, ""))
        for sign, circle in ((1.0, u + 1j * w), (-1.0, np.conj(u) + 1j * np.conj(w))):
            rate = sign * omega + seen
            way = FORWARD if rate > SAME * fastest else BACKWARD
            way = way if abs(rate) > SAME * fastest else ""
            energy = 0.5 * float(np.sum(np.abs(circle) ** 2))
            parts.append((energy, abs(rate), abs(rate - turns), way))
    return _summed(parts, omega, SAME * (omega + fastest))


def _summed(
    parts: list[tuple[float, float, float, str]], omega: float, same: float
) -> Whirl:
    total = sum(part[0] for part in parts)
    groups: list[list[tuple[float, float, float, str]]] = []
    for part in sorted(parts, reverse=True):
        if part[0] <= NOTHING * total:
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


def _motions(mechanics: Mechanics, shape: np.ndarray) -> list[np.ndarray]:
    """Displacements and rotations of the points of each body, in inertial axes, times
    the roots of their inertia, (points, 3)."""
    system = mechanics.system
    size = 2 if system.planar else 3
    turns = matrices(system.frames(mechanics.work.frame)["R"])
    leads, found = independent_rows(mechanics), []
    for row, R, body in zip(system.arrays.body, turns, system.bodies, strict=True):
        u, rd, n = int(row[at.VEL]), int(row[at.RD]), int(row[at.NV])
        if not body.of_scene or not leads[min(row[at.VEL], len(leads) - 1)]:
            found.append(np.zeros((1, 3)))
            continue
        place, turn = np.zeros(3, complex), np.zeros(3, complex)
        place[:size] = shape[u : u + min(size, rd)] if rd else 0.0
        if rd > size:
            turn[slice(2, 3) if size == 2 else slice(0, 3)] = shape[u + size : u + rd]
        q = shape[u + rd : u + n]
        phi, psi = body.sid.shapes
        origins = np.array([node.origin.m0[:, 0] for node in body.sid.nodes])
        J = np.ravel(body.sid.J.m0)[:3]
        if not len(phi) or not len(q):
            phi, psi = np.zeros((1, 3, len(q))), np.zeros((1, 3, len(q)))
            origins = np.atleast_2d(
                np.ravel(body.sid.mdCM.m0) / max(body.sid.mass, 1e-300)
            )
        moves = place + np.cross(turn, origins) + phi @ q
        spins = (turn + psi @ q) * np.sqrt(np.abs(J))
        turned = np.eye(3) if rd == size else R
        both = np.vstack([np.sqrt(body.sid.mass) * moves, spins])
        found.append(both @ turned.T / np.sqrt(len(moves)))
    return found
