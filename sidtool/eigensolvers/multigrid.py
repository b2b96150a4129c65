"""Static responses and modes of large solids without factors.

Conjugate gradients and LOBPCG, preconditioned by one cycle of multigrid. Quadratic
elements first go to a level of their corners, which the nodes in the middle of edges
follow. Smoothed aggregation (PyAMG), which takes the rigid motions as what coarse
levels have to represent, makes the other levels. Memory and time grow about in
proportion to the number of equations, those of factors of solids as its power 4/3 and
its square.

Unknowns that move many nodes, those of rigid pieces, are eliminated: with the matrix A
in parts of the nodes (n) and of the others (o), ``W = A_nn^-1 A_no`` from one response
each and ``S = A_oo - A_on W``, the inverse is

    [1  -W] [A_nn^-1     ] [  1   ]
    [    1] [        S^-1] [-W^T 1]

Sources: P. Vanek, J. Mandel, M. Brezina, "Algebraic multigrid by smoothed aggregation
for second and fourth order elliptic problems", Computing 56, 1996; J. Lottes, "Optimal
polynomial smoothers for multigrid V-cycles", Numer. Linear Algebra Appl. 30, 2023
(Chebyshev polynomials of the fourth kind); A. Knyazev, "Toward the optimal
preconditioned eigensolver: locally optimal block preconditioned conjugate gradient
method", SIAM J. Sci. Comput. 23 (2), 2001.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.storage.operating_system import processors

from .lanczos import Accuracy, Pencil
from .projected_matrix import products_of_magnitudes
from .slepc import ProgressCounter, notify

Indices = NDArray[np.int64]
Function = Callable[[Array], Array]

#: Error of a response in the energy norm, relative to the response, as one cycle of
#: multigrid finds it from the residual.
_ENERGY_ERROR = 1e-10
_MOST_ITERATIONS = 400
_NO_CONVERGENCE = (
    f"no convergence in {_MOST_ITERATIONS} cycles of multigrid; other engines"
)
_NO_CONVERGENCE += " have factors"
#: Unknowns that move many nodes, each of which costs a response.
_MOST_OTHERS = 200
#: Nodes and aggregates of the coarsest level, which is solved directly.
_COARSEST = 500
#: Products with the matrix per smoothing: the degree of the polynomial.
_DEGREE = 2
#: Power iterations for the largest eigenvalue, and the room above what they find.
_POWER_ITERATIONS, _ROOM = 15, 1.1
#: Entries of a matrix whose rows several threads share.
_WORTH_THREADS = 200_000
#: Error of modes in the energy norm. That of an eigenvalue is its square.
_MODE_ERROR = 1e-8
#: Error of modes that the rounding of the stiffness may leave.
_WORST_ERROR = 1e-5
#: Modes do not move on at this share of their goal, which is this share of the error
#: of eigenvalues that is allowed.
_MARGIN = 0.1
#: Square of the size of a direction, relative to the largest, that depends on others.
_DEPENDENT = 1e-12


@dataclass(frozen=True, eq=False)
class NodalUnknowns:
    """What multigrid knows about the n unknowns beside their matrix.

    Attributes
    ----------
    node, axis : (n,) the displacement that each unknown is; node -1 for those that
        move many nodes
    motions : (n, 3 or 6) the unknowns in rigid motions of the body
    middles : (3, m) nodes in the middle of edges of elements, and the ends of these
    """

    node: Indices
    axis: Indices
    motions: Array
    middles: Indices

    def in_order(self, order: Indices) -> NodalUnknowns:
        """The same unknowns in another order."""
        parts = self.node[order], self.axis[order], self.motions[order]
        return NodalUnknowns(*parts, self.middles)

    @property
    def dimension(self) -> int:
        """Dimension of the space."""
        return 2 if self.motions.shape[1] == 3 else 3


class MultigridFactors:
    """Levels of multigrid in place of factors of a symmetric positive definite matrix.

    Attributes
    ----------
    order : (n,) the unknowns with neighbours close together: products with many columns
        take half the time
    levels : of the matrix in that order
    diagonal : (n,) of the matrix
    """

    def __init__(self, matrix: sp.csr_matrix, unknowns: NodalUnknowns) -> None:
        """
        Raises
        ------
        InputError : too many unknowns are no displacements of nodes.
        """
        others = int((unknowns.node < 0).sum())
        if others > _MOST_OTHERS:
            raise InputError(
                f"multigrid is for solids and plane elements: {others} of "
                f"{len(unknowns.node)} unknowns are no displacements of nodes",
                place="--engine",
                expected=f"at most {_MOST_OTHERS}, or another engine",
            )
        self.diagonal = matrix.diagonal()
        self.order = reverse_cuthill_mckee(matrix, symmetric_mode=True)
        self.levels = Levels(
            in_order(matrix, self.order), unknowns.in_order(self.order)
        )

    def solve(self, load: Array) -> Array:
        """A^-1 b for b (n,) or (n, k).

        Raises
        ------
        RuntimeError : the iteration does not converge.
        """
        columns = np.asarray(load.reshape(len(load), -1), float)
        answer = np.empty(columns.shape)
        answer[self.order] = self.levels.solve(columns[self.order])
        return answer.reshape(load.shape)


def in_order(matrix: sp.csr_matrix, order: Indices) -> sp.csr_matrix:
    """A symmetric matrix (n, n) in another order of its unknowns."""
    return matrix[order][:, order].sorted_indices()


class Levels:
    """Levels of multigrid for a symmetric positive definite matrix A.

    Attributes
    ----------
    product : x (n, k) -> A x
    """

    def __init__(self, matrix: sp.csr_matrix, unknowns: NodalUnknowns) -> None:
        self._others = np.flatnonzero(unknowns.node < 0)
        self._matrix, self.product = matrix, _products(matrix)
        self._cycle = _cycle_of(matrix, unknowns)

    def precondition(self, load: Array) -> Array:
        """About A^-1 b for b (n, k), symmetric and positive: a cycle of multigrid."""
        if not self._others.size:
            return self._cycle(load)
        coupled, inverse = self._elimination
        inner = self._on_nodes(load)
        others = inverse @ (load[self._others] - coupled.T @ inner)
        answer = self._cycle(inner) - coupled @ others
        answer[self._others] = others
        return answer

    def solve(self, load: Array) -> Array:
        """A^-1 b for b (n, k).

        Raises
        ------
        RuntimeError : the iteration does not converge.
        """
        return _conjugate_gradients(self.product, self.precondition, load)

    @cached_property
    def _elimination(self) -> tuple[Array, Array]:
        """W (n, o), with zeros for the others themselves, and S^-1 (o, o)."""
        notify(f"static responses: {self._others.size}, of rigid pieces")
        columns = self._matrix[:, self._others].toarray()
        loads = self._on_nodes(columns)
        coupled = _conjugate_gradients(
            lambda x: self._on_nodes(self.product(x)), self._cycle, loads
        )
        rest = columns[self._others] - loads.T @ coupled
        return coupled, np.linalg.inv((rest + rest.T) / 2)

    def _on_nodes(self, load: Array) -> Array:
        inner = load.copy()
        inner[self._others] = 0.0
        return inner


def _products(matrix: sp.csr_matrix) -> Function:
    """A function x (n, k) -> A x; several threads share the rows of a large matrix."""
    count = processors() if matrix.nnz >= _WORTH_THREADS else 1
    if count == 1:
        return matrix.__matmul__
    cuts = np.searchsorted(matrix.indptr, np.linspace(0, matrix.nnz, count + 1)[1:-1])
    bounds = [0, *cuts.tolist(), matrix.shape[0]]
    parts = [_shared_rows(matrix, *ends) for ends in pairwise(bounds)]

    def product(columns: Array) -> Array:
        with ThreadPoolExecutor(count) as pool:
            return np.concatenate(list(pool.map(lambda rows: rows @ columns, parts)))

    return product


def _shared_rows(matrix: sp.csr_matrix, low: int, high: int) -> sp.csr_matrix:
    """Rows low to high - 1 in the memory of the matrix."""
    starts = matrix.indptr[low : high + 1]
    part = slice(starts[0], starts[-1])
    rows = sp.csr_matrix((high - low, matrix.shape[1]), dtype=matrix.dtype)
    rows.data, rows.indices = matrix.data[part], matrix.indices[part]
    rows.indptr = starts - starts[0]
    return rows


def _conjugate_gradients(
    product: Function, precondition: Function, load: Array
) -> Array:
    """A^-1 b for b (n, k), all columns side by side.

    Raises
    ------
    RuntimeError : the iteration does not converge, or A is not positive definite.
    """
    answer = np.zeros(load.shape)
    columns = np.flatnonzero(load.any(axis=0))
    found, residual = answer[:, columns], load[:, columns]
    direction = precondition(residual)
    work = _dot(residual, direction)
    energy = np.zeros(columns.size)
    for _ in range(_MOST_ITERATIONS):
        done = work <= _ENERGY_ERROR**2 * energy
        if done.any():
            answer[:, columns[done]] = found[:, done]
            columns, work, energy = columns[~done], work[~done], energy[~done]
            found, residual, direction = (
                np.ascontiguousarray(x[:, ~done]) for x in (found, residual, direction)
            )
        if not columns.size:
            return answer
        forces = product(direction)
        stiffness = _dot(direction, forces)
        if not ((stiffness > 0.0) & (work > 0.0)).all():
            raise RuntimeError("the matrix is not positive definite")
        step = work / stiffness
        energy += step * work
        found += step * direction
        forces *= step
        residual -= forces
        image = precondition(residual)
        before, work = work, _dot(residual, image)
        direction *= work / before
        direction += image
    raise RuntimeError(_NO_CONVERGENCE)


def _dot(a: Array, b: Array) -> Array:
    """(k,) the products of the columns of two arrays (n, k)."""
    return np.einsum("ij,ij->j", a, b)


@dataclass(frozen=True, eq=False)
class _Level:
    """A level of multigrid.

    Attributes
    ----------
    product : x (n, k) -> A x
    inverse : (n, n) inverses of the blocks of the nodes, D^-1
    largest : of the eigenvalues of D^-1 A
    prolongation : (n, m) displacements that the next level represents
    """

    product: Function
    inverse: sp.csr_matrix
    largest: float
    prolongation: sp.csr_matrix

    def corrected(self, load: Array, coarse: Function) -> Array:
        """About A^-1 b for b (n, k): a smoothing, the next levels, a smoothing."""
        answer, step, rest = self._smoothing(load)
        rest = rest - self.product(step)
        change = self.prolongation @ coarse(self.prolongation.T @ rest)
        rest -= self.product(change)
        answer += change
        answer += self._smoothing(rest)[0]
        return answer

    def corrected_twice(self, load: Array, coarse: Function) -> Array:
        """About A^-1 b by a second correction for what the first one leaves.

        The levels below cost little, and inexact ones cost the finest one iterations.
        """
        answer = self.corrected(load, coarse)
        answer += self.corrected(load - self.product(answer), coarse)
        return answer

    def _smoothing(self, load: Array) -> tuple[Array, Array, Array]:
        """Displacements by the polynomial, the last step among them, and the load
        without the forces of the former steps.
        """
        step = self.inverse @ load
        step *= 4.0 / 3.0 / self.largest
        answer, rest = step, load
        for k in range(1, _DEGREE):
            rest = rest - self.product(step)
            more = self.inverse @ rest
            more *= (8 * k + 4) / (2 * k + 3) / self.largest
            more += (2 * k - 1) / (2 * k + 3) * step
            step, answer = more, answer + more
        return answer, step, rest


def _cycle_of(matrix: sp.csr_matrix, unknowns: NodalUnknowns) -> Function:
    """One cycle of multigrid, b (n, k) -> about A^-1 b, for unknowns of nodes."""
    import pyamg

    d, own = unknowns.dimension, np.flatnonzero(unknowns.node >= 0)
    nodes, number = np.unique(unknowns.node[own], return_inverse=True)
    places = own, d * number + unknowns.axis[own]
    # displacements that are no unknowns (of supports) stay among those of their nodes
    shape = len(unknowns.node), d * nodes.size
    spread = sp.csr_matrix((np.ones(own.size), places), shape=shape)
    near = (spread.T @ unknowns.motions).reshape(nodes.size, d, -1)
    is_corner, corners = _corner_interpolation(nodes, unknowns.middles)
    basis = spread
    if not is_corner.all():
        near = near[is_corner]
        basis = sp.csr_matrix(spread @ sp.kron(corners, sp.eye_array(d), format="csr"))
    coarse = _with_diagonal(sp.csr_matrix(basis.T @ (matrix @ basis)))
    aggregated = pyamg.smoothed_aggregation_solver(
        coarse.tobsr((d, d)),
        B=near.reshape(coarse.shape[0], -1),
        strength=("symmetric", {"theta": 0.0}),
        smooth=("jacobi", {"weighting": "local"}),
        improve_candidates=None,
        max_coarse=_COARSEST,
    ).levels
    rest = aggregated[:-1]
    if is_corner.all() and rest:  # its first matrix is `matrix`, in another order
        basis = sp.csr_matrix(spread @ sp.csr_matrix(rest.pop(0).P))
    levels = [_level(matrix, basis, _inverse_of_blocks(matrix, d, spread))]
    for finer in rest:
        inner = sp.csr_matrix(finer.A)
        inverse = _inverse_of_blocks(inner, finer.A.blocksize[0])
        levels.append(_level(inner, sp.csr_matrix(finer.P), inverse))
    cycle: Function = splu(
        _with_diagonal(sp.csc_matrix(aggregated[-1].A)),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    ).solve
    for level in reversed(levels[1:]):
        cycle = partial(level.corrected_twice, coarse=cycle)
    return partial(levels[0].corrected, coarse=cycle)


def _level(
    matrix: sp.csr_matrix, prolongation: sp.csr_matrix, inverse: sp.csr_matrix
) -> _Level:
    product = _products(matrix)
    vector = np.random.default_rng(0).standard_normal((inverse.shape[0], 1))
    size = np.float64(1.0)
    for _ in range(_POWER_ITERATIONS):
        vector = inverse @ product(vector / size)
        size = np.float64(np.linalg.norm(vector))
    return _Level(product, inverse, _ROOM * float(size), prolongation)


def _corner_interpolation(
    nodes: Indices, middles: Indices
) -> tuple[NDArray[np.bool_], sp.csr_matrix]:
    """Which of the nodes are corners of elements, and all nodes by these: those in the
    middle of edges are the means of their ends, as far as these are among the nodes.

    Parameters
    ----------
    middles : (3, m) see `NodalUnknowns`
    """
    _, first = np.unique(middles[0], return_index=True)
    middle, *ends = middles[:, first]
    is_corner = ~np.isin(nodes, middle)
    corner = np.full(max(nodes.max(), middles.max(initial=0)) + 1, -1)
    corner[nodes[is_corner]] = np.arange(is_corner.sum())
    number = np.full(len(corner), -1)
    number[nodes] = np.arange(nodes.size)
    rows, columns = [np.flatnonzero(is_corner)], [np.arange(is_corner.sum())]
    for end in ends:
        there = (number[middle] >= 0) & (corner[end] >= 0)
        rows.append(number[middle[there]])
        columns.append(corner[end[there]])
    values = np.full(sum(map(len, rows)), 0.5)
    values[: rows[0].size] = 1.0
    places = np.concatenate(rows), np.concatenate(columns)
    return is_corner, sp.csr_matrix((values, places), shape=(nodes.size, rows[0].size))


def _with_diagonal(matrix: Any) -> Any:
    """A sparse matrix whose rows of zeros have their diagonal, which nothing moves."""
    size = matrix.diagonal()
    if (size != 0.0).all():
        return matrix
    return (matrix + sp.diags_array((size == 0.0) * size.mean())).asformat(
        matrix.format
    )


def _inverse_of_blocks(
    matrix: sp.csr_matrix, size: int, spread: sp.csr_matrix | None = None
) -> sp.csr_matrix:
    """(n, n) the inverses of the blocks on the diagonal of a matrix.

    Parameters
    ----------
    spread : (n, m) unknowns that the displacements of all nodes are, node by node
    """
    if spread is None:
        spread = sp.eye_array(matrix.shape[0], format="csr")
    count = spread.shape[1] // size
    every = sp.kron(sp.eye_array(count), np.ones((size, size)), format="csr")
    inside = sp.coo_matrix(
        spread.T @ matrix.multiply(spread @ every @ spread.T) @ spread
    )
    blocks = np.zeros((count, size, size))
    blocks[inside.row // size, inside.row % size, inside.col % size] = inside.data
    starts = np.arange(count + 1)
    inverses = np.linalg.pinv(blocks, hermitian=True)
    inverse = sp.bsr_matrix((inverses, starts[:-1], starts), shape=(count * size,) * 2)
    return sp.csr_matrix(spread @ inverse.tocsr() @ spread.T)


def multigrid_eigenvectors(
    pencil: Pencil,
    count: int,
    factors: MultigridFactors,
    responses: Array,
    accuracy: Accuracy,
) -> Array:
    """(n, count) vectors that span the lowest eigenvectors, by LOBPCG.

    The iteration ends by the errors of the modes in the energy norm, as one cycle
    estimates them: norms of residuals would count the rounding of the stiffest
    deformations.

    Parameters
    ----------
    factors : of K with springs against its rigid motions
    responses : (n, k) of these to the constraints

    Raises
    ------
    RuntimeError : the iteration does not converge.
    """
    order, (n, known) = factors.order, pencil.rigid.shape
    sizes = products_of_magnitudes(pencil.stiffness, np.ones((n, 1)))[order, 0]
    springs = (factors.diagonal - pencil.stiffness.diagonal())[order, None]
    pencil = Pencil(
        pencil.stiffness,
        in_order(pencil.mass.tocsr(), order),
        pencil.shift,
        pencil.constraints[:, order],
        pencil.rigid[order],
    )
    wanted = count - known
    goal = max(_MODE_ERROR, _MARGIN * accuracy.value_error**0.5)
    counter = ProgressCounter("eigenvectors: {} cycles of multigrid", 25.0)
    mass = _products(pencil.mass)
    balanced, admissible = _conditions(pencil, responses[order])

    def stiffness(columns: Array) -> Array:
        return factors.levels.product(columns) - springs * columns

    def precondition(load: Array) -> Array:
        counter()
        return admissible(factors.levels.precondition(balanced(load)))

    size = min(wanted + max(4, wanted // 4), (n - known) // 3)
    start = np.random.default_rng(0).standard_normal((n, size))
    search = _ModeSearch(stiffness, mass, precondition, sizes)
    modes = search.lowest(precondition(mass(start)), wanted, goal)
    found = np.empty((n, count))
    found[order] = np.hstack([pencil.rigid, modes])
    return found


@dataclass(frozen=True, eq=False)
class _ModeSearch:
    """Locally optimal block preconditioned conjugate gradients for K v = lambda M v.

    Attributes
    ----------
    stiffness, mass : x (n, k) -> K x, M x
    precondition : f (n, k) -> about the response to f
    sizes : (n,) sums of the magnitudes of the rows of K
    """

    stiffness: Function
    mass: Function
    precondition: Function
    sizes: Array

    def lowest(self, basis: Array, wanted: int, goal: float) -> Array:
        """(n, wanted) the lowest modes from a start (n, k), k >= wanted.

        Parameters
        ----------
        goal : error of the modes in the energy norm, or what the rounding of K allows

        Raises
        ------
        RuntimeError : the iteration does not converge.
        """
        size = basis.shape[1]
        forces, momenta = self.stiffness(basis), self.mass(basis)
        for _ in range(_MOST_ITERATIONS):
            values, mixing = _ritz_vectors(basis.T @ forces, basis.T @ momenta, size)
            change = mixing.copy()
            change[:size] = 0.0
            modes, mode_momenta = basis @ mixing, momenta @ mixing
            mode_forces = self.stiffness(modes)  # sums would keep the rounding of all
            rest = mode_forces - mode_momenta * values
            step = self.precondition(rest)
            errors = np.sqrt(np.abs(_dot(rest, step) / values))
            goals = np.maximum(goal, self._rounding(modes, values))
            if (errors <= goals)[:wanted].all():
                return modes[:, :wanted]
            active = errors > _MARGIN * goals
            change, step = change[:, active], step[:, active]
            step = step - modes @ (mode_momenta.T @ step)
            basis = np.hstack([modes, basis @ change, step])
            forces = np.hstack([mode_forces, forces @ change, self.stiffness(step)])
            momenta = np.hstack([mode_momenta, momenta @ change, self.mass(step)])
        raise RuntimeError(_NO_CONVERGENCE)

    def _rounding(self, modes: Array, values: Array) -> Array:
        """(k,) the rounding of v^T K v over its value, at most `_WORST_ERROR`.

        |v|^T |K| |v|, whose rounding is left, is at most the sum of the squares of v
        times the sums of the rows of |K|.
        """
        noise = np.finfo(float).eps * (self.sizes @ modes**2) / values
        return np.minimum(noise, _WORST_ERROR)


def _ritz_vectors(stiffness: Array, mass: Array, count: int) -> tuple[Array, Array]:
    """The lowest eigenvalues (count,) and eigenvectors (n, count) in a space of n
    vectors, some of which may depend on others.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(mass), np.finfo(float).tiny))
    sizes, axes = np.linalg.eigh(scale[:, None] * mass * scale)
    kept = sizes > _DEPENDENT * sizes[-1]
    space = scale[:, None] * axes[:, kept] / np.sqrt(sizes[kept])
    values, mixing = np.linalg.eigh(space.T @ stiffness @ space)
    return values[:count], space @ mixing[:, :count]


def _conditions(pencil: Pencil, responses: Array) -> tuple[Function, Function]:
    """Functions that free forces of what conditions C and inertia balance, and
    displacements of what the conditions prevent and of rigid motions: with the
    responses R = A^-1 C^T (n, k), of ``C^T (C R)^-1 R^T f`` and ``R (C R)^-1 C u``.
    """
    rows, rigid = pencil.constraints, pencil.rigid
    momenta = pencil.mass @ rigid
    pairs = [(rigid, np.linalg.solve(rigid.T @ momenta, momenta.T))]
    if len(rows):
        pairs.insert(0, (responses, np.linalg.solve(rows @ responses, rows)))

    def balanced(load: Array) -> Array:
        for directions, amounts in pairs:
            load = load - amounts.T @ (directions.T @ load)
        return load

    def admissible(moved: Array) -> Array:
        for directions, amounts in pairs:
            moved = moved - directions @ (amounts @ moved)
        return moved

    return balanced, admissible
