"""An independent multibody program as a reference for motions: slow and short.

Bodies are particles that move with their shape functions; velocities and equations are
in world axes. Joints are functions of the poses of two markers, which are derived by
complex steps; reactions follow from virtual work. For given states it returns
accelerations and forces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import factorial

Array = np.ndarray
#: (xA, RA, xB, RB, t) -> residuals; complex arguments give derivatives.
Constraint = Callable[..., Array]

TINY = 1e-30
#: Time over which rates of constraints are differenced [s], and weights of order 4.
STEP, WEIGHTS = 1e-4, {1: 2.0 / 3.0, 2: -1.0 / 12.0}


def cross_matrix(v: Array) -> Array:
    zero = 0.0 * v[0]
    return np.array([[zero, -v[2], v[1]], [v[2], zero, -v[0]], [-v[1], v[0], zero]])


def coefficients(square: Any) -> tuple[Any, Any, Any]:
    """sin a / a, (1 - cos a) / a^2 and (a - sin a) / a^3 of a squared angle."""
    if abs(square) > 1e-3:
        a = np.sqrt(square)
        return np.sin(a) / a, (1.0 - np.cos(a)) / square, (a - np.sin(a)) / a**3
    n = np.arange(5)
    powers = (-square) ** n
    return tuple(powers @ (1.0 / factorial(2 * n + k)) for k in (1, 2, 3))


def turned(theta: Array) -> Array:
    """The rotation by a vector (Rodrigues)."""
    s, c, _ = coefficients(theta @ theta)
    K = cross_matrix(theta)
    return np.eye(3) + s * K + c * K @ K


def tangent(theta: Array) -> Array:
    """T with w = T dtheta/dt, w in the axes that theta turns."""
    _, c, d = coefficients(theta @ theta)
    K = cross_matrix(theta)
    return np.eye(3) + c * K + d * K @ K


@dataclass(eq=False)
class Body:
    """Particles (k,) at places (k, 3) with shape functions (k, 3, n); see `rigid`.

    x, R : where its frame starts
    """

    masses: Array
    places: Array
    shapes: Array
    stiffness: Array
    damping: Array
    x: Array = field(default_factory=lambda: np.zeros(3))
    R: Array = field(default_factory=lambda: np.eye(3))

    @property
    def n(self) -> int:
        return self.shapes.shape[2]


def rigid(mass: float, inertia: Array, centre: Array) -> Body:
    """Six particles on the axes of inertia, (3, 3) about the centre, and one there."""
    moments, axes = np.linalg.eigh(inertia)
    second = moments.sum() / 2.0 - moments  # integrals of the squares along the axes
    masses, places = [0.0], [np.zeros(3)]
    for along, axis in zip(second, axes.T, strict=True):
        arm = np.sqrt(2.0 * along / mass)
        masses += [along / (2.0 * arm**2)] * 2
        places += [arm * axis, -arm * axis]
    masses[0] = mass - sum(masses)
    empty = np.zeros((0, 0))
    shapes = np.zeros((len(masses), 3, 0))
    return Body(np.array(masses), np.array(places) + centre, shapes, empty, empty)


@dataclass(frozen=True, eq=False)
class Marker:
    """A place (3,), axes (3, 3) and shape functions (3, n); none is the ground."""

    body: Body | None
    place: Array
    axes: Array
    shapes: Array
    turns: Array


@dataclass(frozen=True, eq=False)
class State:
    """Of one body: place, axes, velocity and angular velocity in world axes."""

    x: Array
    R: Array
    q: Array
    v: Array
    w: Array
    dq: Array

    def moved(self, time: float) -> State:
        """With its velocities for a time."""
        R = turned(time * self.w) @ self.R
        q = self.q + time * self.dq
        return State(self.x + time * self.v, R, q, self.v, self.w, self.dq)


@dataclass(frozen=True, eq=False)
class Pose:
    """Of a marker: Jacobians (3, nu) of its velocities; accelerations without u'."""

    x: Array
    R: Array
    v: Array
    w: Array
    Jx: Array
    Jw: Array
    ax: Array
    aw: Array


@dataclass(eq=False)
class Scene:
    """Bodies, joints by name, and loads that add to the generalised forces (nu,)."""

    bodies: list[Body]
    gravity: Array
    joints: dict[str, tuple[Marker, Marker, Constraint]] = field(default_factory=dict)
    loads: list[Callable[[Scene, float, list[State], Array], None]] = field(
        default_factory=list
    )

    def __post_init__(self) -> None:
        counts = [6 + body.n for body in self.bodies]
        self.nu = sum(counts)
        self.first = dict(zip(self.bodies, np.cumsum([0, *counts[:-1]]), strict=True))

    def pose(self, marker: Marker, states: list[State]) -> Pose:
        if marker.body is None:
            z, J = np.zeros(3), np.zeros((3, self.nu))
            return Pose(marker.place, marker.axes, z, z, J, J, z, z)
        s, i = states[self.bodies.index(marker.body)], self.first[marker.body]
        theta, rate = marker.turns @ s.q, marker.turns @ s.dq
        arm, T = s.R @ (marker.place + marker.shapes @ s.q), tangent(theta)
        Jx, Jw = np.zeros((3, self.nu)), np.zeros((3, self.nu))
        own = slice(i + 6, i + 6 + marker.body.n)
        Jx[:, i : i + 3], Jx[:, i + 3 : i + 6] = np.eye(3), -cross_matrix(arm)
        Jw[:, i + 3 : i + 6] = np.eye(3)
        Jx[:, own], Jw[:, own] = s.R @ marker.shapes, s.R @ T @ marker.turns
        bent, turning = s.R @ (marker.shapes @ s.dq), s.R @ (T @ rate)
        dT = np.imag(tangent(theta + 1j * TINY * rate)) / TINY
        return Pose(
            s.x + arm,
            s.R @ turned(theta) @ marker.axes,
            s.v + np.cross(s.w, arm) + bent,
            s.w + turning,
            Jx,
            Jw,
            np.cross(s.w, np.cross(s.w, arm)) + 2.0 * np.cross(s.w, bent),
            np.cross(s.w, turning) + s.R @ (dT @ rate),
        )

    def measured(
        self, a: Marker, b: Marker, of: Constraint, t: float, states: list[State]
    ) -> tuple[Array, Array, Array, Array]:
        """Values, rates, derivatives by u (n, nu), and by xA, turn A, xB, turn B."""
        A, B = self.pose(a, states), self.pose(b, states)
        value = np.atleast_1d(of(A.x, A.R, B.x, B.R, t))
        D = np.zeros((len(value), 12))
        for k, e in enumerate(1j * TINY * np.eye(3)):
            turn = cross_matrix(e)
            D[:, k] = np.imag(of(A.x + e, A.R, B.x, B.R, t))
            D[:, 3 + k] = np.imag(of(A.x, A.R + turn @ A.R, B.x, B.R, t))
            D[:, 6 + k] = np.imag(of(A.x, A.R, B.x + e, B.R, t))
            D[:, 9 + k] = np.imag(of(A.x, A.R, B.x, B.R + turn @ B.R, t))
        D /= TINY
        J = D @ np.vstack([A.Jx, A.Jw, B.Jx, B.Jw])
        by_time = np.imag(of(A.x, A.R, B.x, B.R, t + 1j * TINY)) / TINY
        rate = D @ np.concatenate([A.v, A.w, B.v, B.w]) + by_time
        return value, rate, J, D

    def accelerations(
        self, t: float, states: list[State]
    ) -> tuple[Array, dict[str, Array]]:
        """u' (nu,), and by joint (12,): force and moment on its first marker, and on
        its second."""
        M, f = self._bodies(states)
        for load in self.loads:
            load(self, t, states, f)
        rows, right, parts = [], [], {}
        for name, (a, b, of) in self.joints.items():
            _, _, J, D = self.measured(a, b, of, t, states)
            change = np.zeros(len(J))
            for k, weight in WEIGHTS.items():
                for h in (k * STEP, -k * STEP):
                    there = [s.moved(h) for s in states]
                    rate = self.measured(a, b, of, t + h, there)[1]
                    change += np.sign(h) * weight * rate / STEP
            parts[name] = slice(len(right), len(right) + len(J)), D
            rows.append(J)
            right += list(-change)
        C = np.vstack(rows)
        whole = np.block([[M, -C.T], [C, np.zeros((len(C), len(C)))]])
        found = np.linalg.solve(whole, np.concatenate([f, right]))
        multipliers = found[self.nu :]
        return found[: self.nu], {n: multipliers[p] @ D for n, (p, D) in parts.items()}

    def _bodies(self, states: list[State]) -> tuple[Array, Array]:
        M, f = np.zeros((self.nu, self.nu)), np.zeros(self.nu)
        for body, s in zip(self.bodies, states, strict=True):
            i = self.first[body]
            own = slice(i, i + 6 + body.n)
            for m, c, shapes in zip(body.masses, body.places, body.shapes, strict=True):
                arm, bent = s.R @ (c + shapes @ s.q), s.R @ (shapes @ s.dq)
                J = np.hstack([np.eye(3), -cross_matrix(arm), s.R @ shapes])
                known = np.cross(s.w, np.cross(s.w, arm)) + 2.0 * np.cross(s.w, bent)
                M[own, own] += m * J.T @ J
                f[own] += m * J.T @ (self.gravity - known)
            f[i + 6 : own.stop] -= body.stiffness @ s.q + body.damping @ s.dq
        return M, f


def unit(v: Any) -> Array:
    return np.asarray(v, float) / np.linalg.norm(v)


def perpendicular_pair(n: Array) -> tuple[Array, Array]:
    """Return two axes perpendicular to another one."""
    a = unit(np.cross(n, np.eye(3)[np.argmin(np.abs(n))]))
    return a, np.cross(n, a)


def coincidence_residual(xA: Array, RA: Array, xB: Array, RB: Array, t: Any) -> Array:
    return xB - xA


def same_axes(xA: Array, RA: Array, xB: Array, RB: Array, t: Any) -> Array:
    R = RA.T @ RB
    return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0


def parallel(n: Array) -> Constraint:
    a, b = perpendicular_pair(n)
    return lambda xA, RA, xB, RB, t: np.array(
        [(RA @ a) @ (RB @ n), (RA @ b) @ (RB @ n)]
    )


def across(n: Array) -> Constraint:
    a, b = perpendicular_pair(n)
    return lambda xA, RA, xB, RB, t: np.array(
        [(RA @ a) @ (xB - xA), (RA @ b) @ (xB - xA)]
    )


def along(n: Array) -> Constraint:
    return lambda xA, RA, xB, RB, t: np.array([(RA @ n) @ (xB - xA)])


def perpendicular(a: Array, b: Array) -> Constraint:
    return lambda xA, RA, xB, RB, t: np.array([(RA @ a) @ (RB @ b)])


def angle(n: Array) -> Constraint:
    """How far B is turned about an axis of A, within half a turn."""
    a, b = perpendicular_pair(n)

    def of(xA: Array, RA: Array, xB: Array, RB: Array, t: Any) -> Array:
        c, s = (RA @ a) @ (RB @ a), (RA @ b) @ (RB @ a)
        value = np.arctan2(np.real(s), np.real(c))
        slope = np.real(c) * np.imag(s) - np.real(s) * np.imag(c)
        return np.array([value + 1j * slope / (np.real(c) ** 2 + np.real(s) ** 2)])

    return of


def distance(xA: Array, RA: Array, xB: Array, RB: Array, t: Any) -> Array:
    return np.array([np.sqrt((xB - xA) @ (xB - xA))])


def together(*parts: Constraint) -> Constraint:
    return lambda *poses: np.concatenate([part(*poses) for part in parts])
