"""Derivatives of eigenpairs by Nelson's method, of equal eigenvalues as subspaces.

For K v = lambda M v with v^T M v = 1 and conditions C v = 0 of multipliers m,

    (K - lambda M) v + C^T m = 0,
    d(lambda) = v^T (dK - lambda dM) v + 2 m^T dC v,
    (K - lambda M) u + C^T dm = -(dK - lambda dM - d(lambda) M) v - dC^T m,
    C u = -dC v,
    dv = u - v (v^T M u + v^T dM v / 2).

The singular matrix becomes regular by u = 0 in the component where v is largest (R.
Nelson, "Simplified calculation of eigenvector derivatives", AIAA J. 14, 1976). Its
factors serve for the derivatives by all variables.

Of equal eigenvalues with eigenvectors V, any rotation is one, so that a derivative
exists of their space only. The gauge is symmetric: V^T M dV = -V^T dM V / 2. The
stiffness V^T K V of the reduced body then changes by the full block with the entries
v_i^T dK v_j - (lambda_i + lambda_j) / 2 v_i^T dM v_j.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import Numbers
from sidtool.formats.base.sid import Array

from .factorisation import indefinite_factors

Indices = NDArray[np.int64]

#: Eigenvalues that differ by less, relative to their size, are differentiated together.
CLUSTER_GAP = 1e-6
#: Entries beside the diagonal below this share of it are rounding.
_MIXED = 1e-6
#: Residual from which on a solution is refined: factors have no other pivots than those
#: on the diagonal.
_RESIDUAL = 1e-12


def clusters(values: Array) -> list[Indices]:
    """Return the numbers of ascending eigenvalues in groups of nearly equal ones."""
    apart = np.diff(values) > CLUSTER_GAP * np.abs(values[1:])
    return np.split(np.arange(len(values)), np.flatnonzero(apart) + 1)


def symmetric_eigenpairs(matrix: Numbers) -> tuple[Numbers, Numbers]:
    """Return eigenvalues and eigenvectors of a symmetric matrix that may carry a step.

    Inside a group of nearly equal eigenvalues, the vectors change in directions outside
    of the group only.
    """
    values, vectors = scipy.linalg.eigh(matrix.real)
    if not np.iscomplexobj(matrix):
        return values, vectors
    change = vectors.T @ matrix.imag @ vectors
    gaps = values[None, :] - values[:, None]
    for group in clusters(values):
        gaps[np.ix_(group, group)] = np.inf
    steps = np.diag(change)
    return values + 1j * steps, vectors + 1j * (vectors @ (change / gaps))


def modal_stiffness(matrix: Any, values: Numbers, vectors: Numbers) -> Numbers:
    """Return V^T K V of eigenvectors: diagonal, but for the step of clusters.

    Parameters
    ----------
    matrix : (n, n) K
    values : (m,) eigenvalues
    vectors : (n, m)
    """
    stiffness = np.diag(values)
    if np.iscomplexobj(values):
        for group in clusters(values.real):
            if len(group) > 1:
                own = vectors[:, group]
                block = np.asarray(own.T @ (matrix @ own)).imag
                main = np.diag(values[group].real)
                stiffness[np.ix_(group, group)] = main + 1j * (block + block.T) / 2
    return stiffness


class EigenpairDerivatives:
    """Derivatives of some eigenpairs of a pencil by changes of its matrices.

    Parameters
    ----------
    stiffness, mass : (n, n)
    constraints : (k, n) conditions
    values : (m,) ascending
    vectors : (n, m) mass-normalised
    places : (n, d) position of each unknown, for the order of elimination
    """

    def __init__(
        self,
        stiffness: sp.csr_matrix,
        mass: sp.csr_matrix,
        constraints: Array,
        values: Array,
        vectors: Array,
        places: Array | None = None,
    ) -> None:
        self._places = places
        self._stiffness, self._mass = stiffness, mass
        self._constraints = constraints
        self.values, self.vectors = values, vectors
        self._groups = clusters(values)

    @cached_property
    def _solvers(self) -> list[_PinnedSolver]:
        return [
            _PinnedSolver(
                sp.csr_matrix(self._stiffness - self.values[g].mean() * self._mass),
                self._constraints,
                self.vectors[:, g],
                self._places,
            )
            for g in self._groups
        ]

    @cached_property
    def _momenta(self) -> Array:
        return np.asarray(self._mass @ self.vectors)

    @cached_property
    def _multipliers(self) -> Array:
        """(k, m) forces of the conditions."""
        rows = self._constraints
        forces = self._momenta * self.values - self._stiffness @ self.vectors
        return np.linalg.lstsq(rows @ rows.T, rows @ forces, rcond=None)[0]

    def by(
        self, stiffness: sp.csr_matrix, mass: sp.csr_matrix, constraints: Array
    ) -> tuple[Array, Array]:
        """Return the derivatives (m,) of the values and (n, m) of the vectors.

        Parameters
        ----------
        stiffness, mass : (n, n) derivatives of the matrices
        constraints : (k, n) derivatives of the conditions
        """
        v, values = self.vectors, self.values
        loads = stiffness @ v - (mass @ v) * values
        moved = -(constraints @ v)
        if len(constraints):
            loads = loads + constraints.T @ self._multipliers
        slopes = np.einsum("ij,ij->j", v, loads)
        if len(constraints):
            slopes -= np.einsum("kj,kj->j", moved, self._multipliers)
        changes = np.zeros_like(v)
        for group, solver in zip(self._groups, self._solvers, strict=True):
            own, momenta = v[:, group], self._momenta[:, group]
            inside = own.T @ loads[:, group]
            if len(constraints):
                inside -= self._multipliers[:, group].T @ moved[:, group]
            load = momenta @ inside - loads[:, group]
            found = solver.solve(load, moved[:, group])
            found = found - own @ (momenta.T @ found)
            if len(group) > 1:  # the members differ a little
                rest = values[group] - values[group].mean()
                more = (self._mass @ found) * rest
                none = np.zeros((len(moved), len(group)))
                found = found + solver.solve(more - momenta @ (own.T @ more), none)
                found = found - own @ (momenta.T @ found)
            changes[:, group] = found - own @ (own.T @ (mass @ own)) / 2
        return slopes, changes

    def is_mixed(
        self, count: int, stiffness: sp.csr_matrix, mass: sp.csr_matrix
    ) -> bool:
        """Return whether changes mix the first eigenvectors with others of a cluster.

        The space of the first ones has no derivative then.

        Parameters
        ----------
        count : number of the first eigenvectors
        """
        kept, others = self.vectors[:, :count], self.vectors[:, count:]
        values = self.values[:count]
        loads = stiffness @ kept - (mass @ kept) * values
        block = np.abs(others.T @ loads).max(initial=0.0)
        parts = np.abs(np.einsum("ij,ij->j", kept, stiffness @ kept))
        parts += values * np.abs(np.einsum("ij,ij->j", kept, mass @ kept))
        return bool(block > _MIXED * parts.max(initial=0.0))


class _PinnedSolver:
    """Solves (K - lambda M) u + C^T m = f, C u = c where a few components are zero.

    There are as many of them as eigenvectors of lambda; the loads do no work on these.
    """

    def __init__(
        self, matrix: sp.csr_matrix, rows: Array, vectors: Array, places: Array | None
    ) -> None:
        n, count = vectors.shape
        _, _, order = scipy.linalg.qr(vectors.T, mode="economic", pivoting=True)
        self._pins = np.asarray(order[:count])
        free = np.ones(n)
        free[self._pins] = 0.0
        keep = sp.diags_array(free)
        size = float(np.abs(matrix.diagonal()).mean())
        pinned = keep @ matrix @ keep + size * sp.diags_array(1.0 - free)
        self._matrix = sp.csr_matrix(pinned)
        self._factors = indefinite_factors(self._matrix, places)
        self._rows = rows * free
        self._answers = self._without_conditions(self._rows.T)
        self._flexibility = self._rows @ self._answers

    def solve(self, loads: Array, moved: Array) -> Array:
        """Return u (n, m) for f (n, m) and c (k, m)."""
        loads = loads.copy()
        loads[self._pins] = 0.0
        found = self._without_conditions(loads)
        if not len(self._rows):
            return found
        gap = self._rows @ found - moved
        return found - self._answers @ np.linalg.solve(self._flexibility, gap)

    def _without_conditions(self, loads: Array) -> Array:
        """Return the solution for loads alone, refined."""
        if not loads.shape[1]:
            return np.zeros(loads.shape)
        found = self._factors.solve(np.ascontiguousarray(loads))
        rest = loads - self._matrix @ found
        if np.abs(rest).max() > _RESIDUAL * np.abs(loads).max():
            found = found + self._factors.solve(np.ascontiguousarray(rest))
        return np.asarray(found)
