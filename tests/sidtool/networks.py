"""A network of masses and springs, as a SID in any body frame and of any basis.

With as many shape functions as elastic degrees of freedom the SID holds the whole
network, so that everything physical about it is known from its own matrices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, null_space

from sidtool.formats.base.sid import SID, Array, Taylor
from tests.bodies import _blocks, _node, skew

Basis = Callable[["Network"], Array]


@dataclass(frozen=True)
class Network:
    """Masses (n,), positions (n, 3) and stiffness (3n, 3n) [by mass, then axis]."""

    masses: Array
    points: Array
    stiffness: Array
    damping: Array

    @property
    def mass_matrix(self) -> Array:
        """(3n, 3n), diagonal."""
        return np.diag(np.repeat(self.masses, 3))

    @property
    def rigid(self) -> Array:
        """(3n, 6) rigid motions about the origin."""
        return np.vstack([np.hstack([np.eye(3), -skew(p)]) for p in self.points])

    def modes(self) -> tuple[Array, Array]:
        """Squared frequencies and modes of the free network without rigid motions."""
        squares, modes = eigh(self.stiffness, self.mass_matrix)
        return squares[6:], modes[:, 6:]


def random_network(n: int, seed: int) -> Network:
    """Springs that feel no rigid motion; damping proportional to stiffness."""
    rng = np.random.default_rng(seed)
    network = Network(
        masses=rng.uniform(0.5, 2.0, n),
        points=rng.normal(size=(n, 3)),
        stiffness=np.zeros((3 * n, 3 * n)),
        damping=np.zeros((3 * n, 3 * n)),
    )
    elastic = null_space(network.rigid.T)
    springs = rng.normal(size=(3 * n, 3 * n))
    K = 1e4 * elastic @ elastic.T @ springs @ springs.T @ elastic @ elastic.T
    return Network(network.masses, network.points, K, 1e-4 * K)


def mean_axis(network: Network) -> Array:
    """Free modes: they carry no momentum (Buckens frame)."""
    return network.modes()[1]


def clamped(network: Network) -> Array:
    """The first mass rests and six conditions in all hold the frame."""
    held = np.zeros((6, 3 * len(network.masses)))
    held[[0, 1, 2], [0, 1, 2]] = 1.0
    held[[3, 4, 5], [4, 5, 8]] = 1.0
    return null_space(held)


def sid_of(network: Network, basis: Basis, origin: Array | None = None) -> SID:
    """The network in this basis and a frame with this origin; masses are nodes."""
    n = len(network.masses)
    points = network.points - (np.zeros(3) if origin is None else origin)
    shapes = basis(network)
    phi = shapes.reshape(n, 3, -1)
    nq = phi.shape[2]
    return SID(
        mass=float(network.masses.sum()),
        labels=("",) * nq,
        nodes=tuple(
            _node(str(k + 1), points[k], phi[k], np.zeros((3, nq)), None)
            for k in range(n)
        ),
        ksigma=Taylor(np.zeros((nq, 1))),
        Ke=Taylor(shapes.T @ network.stiffness @ shapes),
        De=Taylor(shapes.T @ network.damping @ shapes),
        **_blocks(network.masses, points, phi, None),
    )
