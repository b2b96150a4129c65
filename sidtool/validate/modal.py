"""Deflection of a body at its nodes, independent of the basis of shape functions.

A body is described by its natural modes, held in its frame or moving freely. In the
free body each elastic mode carries the rigid motion that balances its momentum, so
that displacements do not depend on the choice of the frame; static deflection then is
that under a load balanced by the inertia of the body (inertia relief).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.sid import SID, Array, Node
from sidtool.formats.sid_mass import central_inertia, coupled_mass_matrix, skew

from .frequencies import free_modes, held_modes, symmetric

Response = NDArray[np.complex128]

# Squared frequencies below this share of the largest are rigid motion.
_ZERO = 1e-12


@dataclass(frozen=True)
class ModalBody:
    """Natural modes of a body at some nodes.

    Attributes
    ----------
    squares : (nq,) squared circular frequencies, ascending
    shapes : (3 n, nq) displacements at the nodes, modes normalised to unit mass
    turns : (3 n, nq) rotations of the nodes times the radius of gyration of the body;
        zero where no node tells any
    damping : (nq, nq) De in the modes
    carried : (3 n, r) displacements at the nodes by the rigid coordinates that move;
        r = 0 for a held body
    rigid : (r, r) mass matrix of these coordinates
    """

    squares: Array
    shapes: Array
    turns: Array
    damping: Array
    carried: Array
    rigid: Array

    @property
    def has_stiffness(self) -> bool:
        """True when no elastic mode is free of stiffness."""
        return bool(self.squares[0] > _ZERO * self.squares[-1])

    def flexibility(self, loads: Sequence[int] | slice = slice(None)) -> Array:
        """Static displacements by unit forces on some rows, (3 n, m) [m/N].

        Needs stiffness.
        """
        return (self.shapes / self.squares) @ self.shapes[loads].T

    def most_flexible(self) -> float:
        """The largest entry of the flexibility, which is on its diagonal."""
        return float((self.shapes**2 / self.squares).sum(axis=1).max(initial=0.0))

    def receptance(self, omega: float, rows: slice = slice(None)) -> Response:
        """Complex displacements of some rows per harmonic force on them [m/N].

        Parameters
        ----------
        omega : circular frequency [rad/s], not zero
        """
        columns = self._columns[rows]
        return columns @ self._per_force(omega) @ columns.T

    def receptance_size(self, omega: float) -> float:
        """Frobenius norm of the receptance of all rows."""
        product = self._gram @ self._per_force(omega)
        return float(np.sqrt(max(0.0, np.trace(product @ np.conj(product)).real)))

    @cached_property
    def _columns(self) -> Array:
        return np.hstack([self.shapes, self.carried])

    @cached_property
    def _gram(self) -> Array:
        return np.asarray(self._columns.T @ self._columns)

    def _per_force(self, omega: float) -> Response:
        """Of the modes and the rigid coordinates, per force on them."""
        impedance = np.diag(self.squares - omega**2) + 1j * omega * self.damping
        nq = len(self.squares)
        found = np.zeros((nq + len(self.rigid),) * 2, complex)
        found[:nq, :nq] = np.linalg.inv(impedance)
        found[nq:, nq:] = -np.linalg.inv(self.rigid) / omega**2
        return found


def held_body(sid: SID, nodes: Sequence[Node]) -> ModalBody:
    """The body with its frame held; needs a positive definite Me and nq > 0."""
    squares, modes = held_modes(sid)
    shapes = _rows([node.phi.m0 for node in nodes], sid.nq) @ modes
    none = np.zeros((len(shapes), 0)), np.zeros((0, 0))
    turns = _gyration(sid) * _rows([node.psi.m0 for node in nodes], sid.nq) @ modes
    return ModalBody(squares, shapes, turns, _damping(sid, modes), *none)


def free_body(sid: SID, nodes: Sequence[Node], rigid: tuple[int, ...]) -> ModalBody:
    """The body that moves in these rigid coordinates; needs `free_motion`, nq > 0."""
    squares, modes = free_modes(sid, rigid)
    moving = list(rigid)
    matrix = coupled_mass_matrix(sid)
    body, coupling = matrix[np.ix_(moving, moving)], matrix[6:][:, moving]
    carried = _rows([_rigid_rows(node)[:, moving] for node in nodes], len(moving))
    balance = np.linalg.solve(body, coupling.T)
    shapes = (
        _rows([node.phi.m0 for node in nodes], sid.nq) - carried @ balance
    ) @ modes
    spin = np.zeros((3, 6))
    spin[:, 3:] = np.eye(3)
    turned = _rows([spin[:, moving] for _ in nodes], len(moving))
    turns = _rows([node.psi.m0 for node in nodes], sid.nq)
    if turns.any():
        turns = turns - turned @ balance
    turns = _gyration(sid) * turns @ modes
    return ModalBody(squares, shapes, turns, _damping(sid, modes), carried, body)


def modal_assurance(here: Array, reference: Array) -> Array:
    """MAC_ij = (x_i . y_j)^2 / (x_i . x_i)(y_j . y_j) of the columns, (n, m).

    R. J. Allemang, D. L. Brown, "A correlation coefficient for modal vector analysis",
    1982. Columns that are zero at these points give 0.
    """
    product = (here.T @ reference) ** 2
    size = np.outer((here**2).sum(axis=0), (reference**2).sum(axis=0))
    return np.divide(product, size, out=np.zeros_like(product), where=size > 0.0)


def subspace_assurance(shape: Array, columns: Array) -> float:
    """Share of a shape (squared) that lies in the span of the columns, 0 ... 1."""
    basis, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, sizes > 1e-9 * sizes.max(initial=0.0)]
    total = float(shape @ shape)
    return float(((basis.T @ shape) ** 2).sum() / total) if total else 0.0


def _rows(blocks: list[Array], columns: int) -> Array:
    return np.concatenate(blocks) if blocks else np.zeros((0, columns))


def _rigid_rows(node: Node) -> Array:
    return np.hstack([np.eye(3), -skew(node.position)])


def _gyration(sid: SID) -> float:
    inertia = np.trace(central_inertia(sid)) if sid.mass > 0.0 else 0.0
    return float(np.sqrt(max(inertia, 0.0) / (2.0 * sid.mass or 1.0)))


def _damping(sid: SID, modes: Array) -> Array:
    return modes.T @ symmetric(sid.De.m0) @ modes
