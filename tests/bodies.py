"""Bodies made of particles: every SID block straight from its definition.

A body is a cloud of point masses m_p at c_p with shape functions Phi_p, so that each
integral of the format is a finite sum and every exact identity of the format holds to
rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sidtool.formats.base.sid import (
    J_INDICES,
    OE_INDICES,
    SID,
    Array,
    Node,
    Taylor,
    axis_major,
)


def skew(vectors: Array) -> Array:
    """(..., 3) vectors as (..., 3, 3) cross-product matrices."""
    x, y, z = np.moveaxis(np.asarray(vectors, float), -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def centrifugal_matrices() -> Array:
    """W_k, (6, 3, 3): skew(w) skew(w) = sum_k W_k Omega_k in the order of Oe."""
    unit = np.eye(3)
    products = [np.outer(unit[a], unit[b]) for a, b in OE_INDICES]
    diagonal = [product - unit for product in products[:3]]
    return np.array(diagonal + [product + product.T for product in products[3:]])


def particle_body(
    nq: int,
    n_particles: int,
    planar: bool = False,
    seed: int = 0,
    nodes: int = 2,
    stiffening: bool = False,
) -> SID:
    """A SID of a cloud of particles, consistent; Me = I and Ke is diagonal.

    Parameters
    ----------
    nq : number of elastic coordinates
    n_particles : point masses; the coupled mass matrix is positive definite when they
        have more than nq + 6 degrees of freedom (planar: nq + 3) and are not collinear
    planar : positions and shape functions in the plane z = 0, rotations about z
    nodes : the first particles that become nodes "1", "2", ...; at most n_particles
    stiffening : adds a second-order displacement field and so the geometric parts of
        Ct, Cr, Oe and of phi at the nodes, and such a field of rotations, psi
    """
    cloud, omega = particle_cloud(nq, n_particles, planar, seed, stiffening)
    return cloud.sid(np.diag(omega**2), np.diag(2.0 + 4e-5 * omega**2), nodes)


def particle_cloud(
    nq: int, n_particles: int, planar: bool, seed: int, stiffening: bool
) -> tuple[Cloud, Array]:
    """The particles of a `particle_body`, and its angular frequencies (nq,)."""
    rng = np.random.default_rng(seed)
    masses = rng.uniform(0.1, 1.0, n_particles)
    c = rng.normal(size=(n_particles, 3))
    phi = rng.normal(size=(n_particles, 3, nq))
    psi = rng.normal(size=(n_particles, 3, nq))
    phi1 = rng.normal(size=(n_particles, 3, nq, nq)) if stiffening and nq else None
    if phi1 is not None:
        phi1 = phi1 + np.swapaxes(phi1, 2, 3)
    for field in (c, phi) if phi1 is None else (c, phi, phi1):
        field[:, 2] *= 0.0 if planar else 1.0
    psi[:, :2] *= 0.0 if planar else 1.0
    phi = phi @ orthonormal(masses, phi)
    omega = 2 * np.pi * np.sort(rng.uniform(10.0, 1000.0, nq))
    psi1 = rng.normal(size=(n_particles, 3, nq, nq)) if phi1 is not None else None
    if psi1 is not None:
        psi1 = psi1 + np.swapaxes(psi1, 2, 3)
        psi1[:, :2] *= 0.0 if planar else 1.0
    return Cloud(masses, c, phi, psi, phi1, psi1), omega


@dataclass(frozen=True, eq=False)
class Cloud:
    """Particles whose displacement is phi q + phi1 q q / 2, rotation likewise.

    Attributes
    ----------
    masses : (n,)
    c : (n, 3) undeformed positions
    phi, psi : (n, 3, nq)
    phi1, psi1 : (n, 3, nq, nq), symmetric in the last two
    """

    masses: Array
    c: Array
    phi: Array
    psi: Array
    phi1: Array | None = None
    psi1: Array | None = None

    def sid(self, Ke: Array, De: Array, nodes: int) -> SID:
        """The body; its first particles become the nodes "1", "2", ..."""
        nq = self.phi.shape[-1]
        frequencies = np.sqrt(np.maximum(np.diag(Ke), 0.0))
        blocks: dict[str, Any] = _blocks(self.masses, self.c, self.phi, self.phi1)
        return SID(
            mass=float(self.masses.sum()),
            labels=tuple(_label(mode, value) for mode, value in enumerate(frequencies)),
            nodes=tuple(
                _node(
                    str(p + 1),
                    self.c[p],
                    self.phi[p],
                    self.psi[p],
                    None if self.phi1 is None else self.phi1[p],
                    None if self.psi1 is None else self.psi1[p],
                )
                for p in range(nodes)
            ),
            title=f"{len(self.masses)} particles",
            ksigma=Taylor(np.zeros((nq, 1))),
            Ke=Taylor(Ke),
            De=Taylor(De),
            **blocks,
        )

    def at(self, p: int) -> Cloud:
        """The particle p alone."""
        one = slice(p, p + 1)
        first = None if self.phi1 is None else self.phi1[one]
        turn = None if self.psi1 is None else self.psi1[one]
        rest = self.phi[one], self.psi[one], first, turn
        return Cloud(self.masses[one], self.c[one], *rest)


def orthonormal(masses: Array, phi: Array) -> Array:
    """(nq, nq) combinations of shape functions for which Me is the identity."""
    gram = np.einsum("p,pai,paj->ij", masses, phi, phi)
    combined: Array = np.linalg.inv(np.linalg.cholesky(gram)).T
    return combined


def _label(mode: int, omega: float) -> str:
    return f"Eigen Mode{mode + 1:5d} :{omega / (2 * np.pi):13.3f} Hz"


def _blocks(
    masses: Array, c: Array, phi: Array, phi1: Array | None
) -> dict[str, Taylor]:
    """The table of theory, section 4, term by term; p particle, a b axes, i l modes."""
    modes = np.moveaxis(phi, -1, 1)
    position, shape, w = skew(c), skew(modes), centrifugal_matrices()
    j0 = -np.einsum("p,pab,pbc->ac", masses, position, position)
    c4 = np.einsum("p,pab,plbc->lac", masses, position, shape)
    j1 = -(c4 + np.swapaxes(c4, 1, 2))
    ct0, ct1 = np.einsum("p,pai->ia", masses, phi), None
    cr0 = np.einsum("p,pia->ia", masses, np.cross(c[:, None], modes))
    swept = np.einsum(
        "p,plia->lia", masses, np.cross(modes[:, :, None], modes[:, None])
    )
    oe0 = np.einsum("p,pai,kab,pb->ik", masses, phi, w, c)
    cr1, oe1 = swept, np.einsum("p,pai,kab,pbl->lik", masses, phi, w, phi)
    if phi1 is not None:
        lever = np.cross(c[:, None, None], np.moveaxis(phi1, 1, -1))
        ct1 = np.einsum("p,pakl->lka", masses, phi1)
        cr1 = cr1 + np.einsum("p,pila->lia", masses, lever)
        oe1 = oe1 + np.einsum("p,pail,kab,pb->lik", masses, phi1, w, c)
    blocks = {
        "mdCM": Taylor((masses @ c)[:, None], ct0[:, :, None]),
        "J": Taylor(_six(j0)[:, None], _six(j1)[:, :, None]),
        "Ct": Taylor(ct0, ct1),
        "Cr": Taylor(cr0, cr1),
        "Me": Taylor(np.einsum("p,pai,paj->ij", masses, phi, phi)),
        "Gr": Taylor(axis_major(-2 * c4)),
        "Ge": Taylor(axis_major(2 * swept)),
        "Oe": Taylor(oe0, oe1),
    }
    if phi.shape[-1]:
        return blocks
    return {name: Taylor(block.m0) for name, block in blocks.items()}


def _six(tensors: Array) -> Array:
    rows, columns = np.transpose(J_INDICES)
    return tensors[..., rows, columns]


def _node(
    name: str,
    c: Array,
    phi: Array,
    psi: Array,
    phi1: Array | None,
    psi1: Array | None = None,
) -> Node:
    elastic = bool(phi.size)
    # m1(a, l, k) = Phi1_kl(a)
    by_force, by_moment = (
        None if term is None else np.moveaxis(term, -1, 0) for term in (phi1, psi1)
    )
    return Node(
        id=name,
        origin=Taylor(c[:, None], phi.T[:, :, None] if elastic else None),
        phi=Taylor(phi, by_force),
        psi=Taylor(psi, by_moment),
        AP=Taylor(np.eye(3), skew(psi.T) if elastic else None),
    )
