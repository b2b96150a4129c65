"""The equations of one flexible body by Lagrange's recipe, from its kinetic energy.

Complex steps through a mass matrix that is written down from the SID and from the
particles of the body: nothing here is shared with the kernels or with `mean_axes`. Only
bodies with geometric stiffening have this energy, eq. (24).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import expm

from sidtool.formats.base.sid import SID, Array
from tests.bodies import Cloud

STEP = 1e-30
#: Oe column of each entry (xx, yy, zz, xy, xz, yz) of J, and its weight.
COLUMNS, WEIGHTS = [0, 1, 2, 3, 5, 4], [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]
PLANE = [0, 1, 5]


def skew(v: Any) -> Any:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def tensor(six: Any) -> Any:
    return six[np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])]


def taylor(function: Any, direction: Array) -> Array:
    """Coefficients of a function along a line, by Cauchy's integral."""
    circle = 0.1 * np.exp(2j * np.pi * np.arange(16) / 16)
    values = np.array([function(z * direction) for z in circle])
    coefficients = np.fft.fft(values, axis=0)[:4].real / 16
    return coefficients / 0.1 ** np.arange(4).reshape(-1, *[1] * (values.ndim - 1))


@dataclass(eq=False)
class Lagrangian:
    """T = xi.M(q) xi / 2 of a body, xi = (v, omega, q'), in the plane or in space."""

    sid: SID
    cloud: Cloud
    planar: bool

    @property
    def axes(self) -> list[int]:
        return PLANE if self.planar else list(range(6))

    def first_moment(self, q: Any) -> Any:
        sid = self.sid
        half = 0.5 * np.einsum("lka,k,l->a", sid.Ct.first_order(sid.nq), q, q)
        return sid.mdCM.m0[:, 0] + sid.Ct.m0.T @ q + half

    @property
    def turns(self) -> list[int]:
        return [2] if self.planar else [0, 1, 2]

    @cached_property
    def fitted(self) -> tuple[Array, Array]:
        """Rigid motions of least squares of the shape functions, (3 or 6, nq), and what
        they leave of them, (n, 3, nq)."""
        m, c, phi = self.cloud.masses, self.cloud.c, self.cloud.phi
        motions = np.zeros((len(m), 3, 6))
        motions[:, :, :3] = np.eye(3)
        motions[:, :, 3:] = [-skew(place) for place in c]
        root = np.sqrt(m)[:, None, None]
        left = (root * motions[:, :, self.axes]).reshape(3 * len(m), -1)
        right = (root * phi).reshape(3 * len(m), -1)
        found = np.linalg.lstsq(left, right, rcond=None)[0]
        return found, (right - left @ found).reshape(phi.shape) / root

    def free_shapes(self) -> tuple[Array, Array]:
        """Shape functions without rigid motions; places about the centre of mass."""
        m, c = self.cloud.masses, self.cloud.c
        return self.fitted[1], c - m @ c / m.sum()

    @cached_property
    def tilt(self) -> Array:
        """Rotations of least squares of the shape functions, (nq, 3)."""
        return self.fitted[0][-len(self.turns) :].T @ np.eye(3)[self.turns]

    def inertia(self, q: Any) -> Any:
        """Moments of inertia in axes turned by the tilt, not yet expanded."""
        sid, md = self.sid, self.first_moment(q)
        J = sid.J.m0[:, 0] + sid.J.first_order(sid.nq)[:, :, 0].T @ q
        oe1 = sid.Oe.first_order(sid.nq)[:, :, COLUMNS] * np.array(WEIGHTS)
        whole = tensor(J - np.einsum("lka,k,l->a", oe1, q, q))
        turn = expm(skew(q @ self.tilt))
        return turn.T @ (whole + skew(md) @ skew(md) / sid.mass) @ turn

    def coupling(self, q: Any) -> Any:
        """Angular momentum of the rates about the centre of mass, in those axes, less
        that of the tilt."""
        sid = self.sid
        Ct = sid.Ct.m0 + np.einsum("lka,l->ka", sid.Ct.first_order(sid.nq), q)
        Cr = sid.Cr.m0 + np.einsum("lka,l->ka", sid.Cr.first_order(sid.nq), q)
        spin = Cr - np.cross(self.first_moment(q) / sid.mass, Ct)
        return spin @ expm(skew(q @ self.tilt)) - self.tilt @ self.inertia(q)

    @cached_property
    def expansion(self) -> tuple[Array, Array, Array]:
        """Of `inertia` to second and of `coupling` to first order."""
        unit = np.eye(self.sid.nq)
        first = np.array([taylor(self.inertia, e)[1] for e in unit])
        second = np.array(
            [[taylor(self.inertia, e + f)[2] for e in unit] for f in unit]
        )
        own = np.array([taylor(self.inertia, e)[2] for e in unit])
        second = 0.5 * (second - own[:, None] - own[None])
        rows = np.array([taylor(self.coupling, e)[1] for e in unit])
        return first, second, rows

    def mass(self, q: Any) -> Any:
        sid, turns, n = self.sid, self.turns, self.sid.nq
        first, second, rows = self.expansion
        Ct = sid.Ct.m0 + np.einsum("lka,l->ka", sid.Ct.first_order(n), q)
        md, first_md = self.first_moment(q), sid.Ct.m0.T @ q
        added = md - sid.mdCM.m0[:, 0]
        # What of higher order leaves J and, but for the tilt, Cr without it.
        bow = np.einsum("klab,k,l->ab", second, q, q)
        moved = skew(added) @ skew(added) - skew(first_md) @ skew(first_md)
        swept = (np.cross(added, Ct) - np.cross(first_md, sid.Ct.m0)) / sid.mass
        H = self.inertia(np.zeros(n)).real + np.einsum("kab,k->ab", first, q) + bow
        H = H + moved / sid.mass
        H, theta = H[np.ix_(turns, turns)], skew(q @ self.tilt)
        seen = (np.eye(3) - theta + 0.5 * theta @ theta)[np.ix_(turns, turns)]
        kick = np.einsum("lka,l->ka", rows, q) - swept - self.tilt @ bow
        kick = kick[:, turns]
        tilt = self.tilt[:, turns] + np.linalg.solve(H, kick.T).T
        rotation = np.hstack([np.zeros((len(turns), 3)), seen, tilt.T])
        centre = np.hstack([np.eye(3), -skew(md)[:, turns] / sid.mass, Ct.T / sid.mass])
        M = sid.mass * centre.T @ centre + rotation.T @ H @ rotation
        r = 3 + len(turns)
        M[r:, r:] += self.free_mass(q)
        keep = [a for a in range(r) if a in self.axes or a > 2] + list(range(r, r + n))
        return M[np.ix_(keep, keep)]

    def free_mass(self, q: Any) -> Any:
        """Elastic mass of rates without momentum and angular momentum."""
        turns, m, (shapes, arm) = self.turns, self.cloud.masses, self.free_shapes()
        u = np.einsum("pal,l->pa", shapes, q)
        A = np.einsum("p,pka->ka", m, np.cross(u[:, None], np.moveaxis(shapes, 2, 1)))
        N = np.einsum("p,pab,pcb->ac", m, *[np.array([skew(c) for c in arm])] * 2)
        N = N + np.einsum("p,pa,pa->", m, u, u) * np.eye(3)
        A, N = A[:, turns], N[np.ix_(turns, turns)]
        E = np.einsum("p,pak,pal->kl", m, shapes, shapes)
        return E - A @ np.linalg.solve(N, A.T)

    def unbalance(self, q: Array, xi: Array, rate: Array, gravity: Array) -> Array:
        """Lagrange's and Euler's equations, with gravity (3,) in the body frame."""
        sid, axes = self.sid, self.axes
        n = len(axes)
        rates = xi[n:]
        momentum = self.mass(q) @ xi
        change = self.mass(q) @ rate
        change += np.imag(self.mass(q + 1j * STEP * rates) @ xi) / STEP
        weight = np.array(
            [*(sid.mass * gravity), *np.cross(self.first_moment(q), gravity)]
        )
        p, v = np.zeros(6), np.zeros(6)
        p[axes], v[axes] = momentum[:n], xi[:n]
        turned = np.cross(v[3:], p[:3])
        spun = np.cross(v[3:], p[3:]) + np.cross(v[:3], p[:3])
        found = [change[:n] + np.array([*turned, *spun])[axes] - weight[axes]]
        slope = np.zeros(sid.nq)
        for k in range(sid.nq):
            moved = q + 1j * STEP * np.eye(sid.nq)[k]
            energy = 0.5 * xi @ self.mass(moved) @ xi + gravity @ self.first_moment(
                moved
            )
            slope[k] = np.imag(energy) / STEP
        elastic = sid.ksigma.m0[:, 0] + sid.Ke.m0 @ q + sid.De.m0 @ rates
        return np.concatenate([*found, change[n:] - slope + elastic])
