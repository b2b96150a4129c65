"""Two driven links, stated as moving particles: no SID, no marker and no joint.

A beam of Euler and Bernoulli bends by the functions of a clamped uniform one and
twists; it carries a rigid forearm at an elbow. Both angles are given functions of time,
so the elastic amplitudes are the only unknowns, and of every particle only the place as
a function of them and of time is written down.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from sidtool.formats.base.sid import Array

#: Roots of 1 + cos b cosh b.
ROOTS = (1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349)
#: Of differences in place of derivatives, relative to the unknowns and to time.
STEP = 1e-4


@dataclass(frozen=True)
class Beam:
    """A uniform beam along x; second moments about its y and z axis."""

    length: float
    area: float
    iy: float
    iz: float
    torsion: float
    modulus: float
    shear_modulus: float
    density: float


def clamped(root: float, x: Array) -> tuple[Array, Array]:
    """Bending of a clamped beam of length one, of mean square 1, and its slope."""
    b, sum_ = root * x, (np.sinh(root) - np.sin(root)) / (np.cosh(root) + np.cos(root))
    w = np.cosh(b) - np.cos(b) - sum_ * (np.sinh(b) - np.sin(b))
    slope = np.sinh(b) + np.sin(b) - sum_ * (np.cosh(b) - np.cos(b))
    return w, root * slope


def turned(vectors: Array, places: Array) -> Array:
    """Places turned by rotation vectors, after Rodrigues; both (..., 3)."""
    angle = np.sqrt((vectors**2).sum(axis=-1, keepdims=True)) + 1e-30
    axis = vectors / angle
    across = np.cross(axis, places)
    return np.asarray(
        places + np.sin(angle) * across + (1 - np.cos(angle)) * np.cross(axis, across)
    )


class TwoLinks:
    """Amplitudes q: bending along y, along z, twist; unit modal mass each.

    Parameters
    ----------
    shapes : how many bend along y, along z, and twist
    forearm : its particles' masses (n,) and places (n, 3) from the elbow
    shoulder, elbow : angles about z [rad] as functions of time
    """

    def __init__(
        self,
        beam: Beam,
        shapes: tuple[int, int, int],
        forearm: tuple[Array, Array],
        shoulder: Callable[[float], float],
        elbow: Callable[[float], float],
        gravity: Array,
    ) -> None:
        self.angles, self.gravity, self.length = (shoulder, elbow), gravity, beam.length
        nodes, weights = np.polynomial.legendre.leggauss(12)
        x = np.append(0.5 * (nodes + 1.0), 1.0)
        mass = beam.density * beam.area * beam.length
        displacement, rotation, stiffness = [], [], []
        for axis, count, second in ((1, shapes[0], beam.iz), (2, shapes[1], beam.iy)):
            for root in ROOTS[:count]:
                w, slope = clamped(root, x) / np.sqrt(mass)
                shape, turn = np.zeros((2, len(x), 3))
                shape[:, axis] = w
                turn[:, 3 - axis] = (3 - 2 * axis) * slope / beam.length
                displacement.append(shape)
                rotation.append(turn)
                stiffness.append(
                    root**4 * beam.modulus * second / beam.length**3 / mass
                )
        polar = beam.iy + beam.iz
        for k in range(shapes[2]):
            turn = np.zeros((len(x), 3))
            inertia = beam.density * polar * beam.length
            turn[:, 0] = np.sqrt(2 / inertia) * np.sin((k + 0.5) * np.pi * x)
            displacement.append(np.zeros((len(x), 3)))
            rotation.append(turn)
            wave = (k + 0.5) * np.pi / beam.length
            stiffness.append(
                wave**2 * beam.shear_modulus * beam.torsion / (beam.density * polar)
            )
        self.stiffness = np.array(stiffness)
        self.shape, self.turn = np.array(displacement), np.array(rotation)
        self.axis = np.stack([x * beam.length, 0 * x, 0 * x], axis=-1)
        radii = np.sqrt(2 * np.array([beam.iz, beam.iy]) / beam.area)
        self.corners = np.zeros((4, 3))
        self.corners[:2, 1] = radii[0] * np.array([1, -1])
        self.corners[2:, 2] = radii[1] * np.array([1, -1])
        slices = np.repeat(mass * weights / 2, 4) / 4
        self.masses = np.concatenate([slices, forearm[0]])
        self.forearm = forearm[1]

    def places(self, q: Array, t: Array) -> Array:
        """(..., particles, 3) for amplitudes (..., nq) at times (...)."""
        centres = self.axis + np.einsum("...l,lxa->...xa", q, self.shape)
        turns = np.einsum("...l,lxa->...xa", q, self.turn)
        inner = turns[..., :-1, None, :]
        slices = (
            centres[..., :-1, None, :] + self.corners + np.cross(inner, self.corners)
        )
        slices = slices.reshape(*q.shape[:-1], -1, 3)
        folded = turned(self._about(1, t), self.forearm)
        hand = centres[..., -1:, :] + turned(turns[..., -1:, :], folded)
        return turned(self._about(0, t), np.concatenate([slices, hand], axis=-2))

    def _about(self, which: int, t: Array) -> Array:
        vectors = np.zeros((*np.shape(t), 1, 3))
        vectors[..., 0, 2] = self.angles[which](t)
        return vectors

    def rates(self, t: float, state: Array) -> Array:
        """d'Alembert: m (a - g) . dx/dq of all particles and Ke q are in balance."""
        q, v = np.split(state, 2)
        n, size = len(q), 1e-3
        moves = np.concatenate([np.eye(n) * size, -np.eye(n) * size])
        at = self.places(
            np.concatenate([q + moves, q + v * np.array([[STEP], [0.0], [-STEP]])]),
            np.concatenate([np.full(2 * n, t), [t + STEP, t, t - STEP]]),
        )
        jacobian = (at[:n] - at[n : 2 * n]) / (2 * size)
        bias = (at[-3] - 2 * at[-2] + at[-1]) / STEP**2
        matrix = np.einsum("ipa,p,jpa->ij", jacobian, self.masses, jacobian)
        load = np.einsum("ipa,p,pa->i", jacobian, self.masses, self.gravity - bias)
        return np.concatenate([v, np.linalg.solve(matrix, load - self.stiffness * q)])

    def motion(self, times: Array, rtol: float) -> tuple[Array, Array]:
        """Amplitudes (n, nq) from rest and undeformed, and the last particle (n, 3)."""
        start = np.zeros(2 * len(self.stiffness))
        found = solve_ivp(
            self.rates,
            (times[0], times[-1]),
            start,
            "DOP853",
            times,
            rtol=rtol,
            atol=rtol * 1e-2,
        )
        q = found.y[: len(self.stiffness)].T
        return q, self.places(q, times)[:, -1]
