"""Weak tie of sides that do not match: the mortar method with a penalty.

The jump of the displacements across the tie, projected on the functions of the slave
side, is penalised by springs that are stiff compared with the elements. Functions of
the slave side only: springs at every point would lock, because the two sides share few
displacements.

Source: C. Bernardi, Y. Maday, A. T. Patera, "A new nonconforming approach to domain
decomposition: the mortar element method", 1994.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

import numpy as np
import scipy.sparse as sp

from sidtool.formats.base.taylor import Array

from ..geometry.bspline import gauss_points
from ..geometry.multipatch import CommonNumbering, Side, side_net
from ..geometry.nurbs_patch import NurbsPatch, scattered_basis
from ..geometry.patch_contact import WeakTie
from ..geometry.patch_evaluation import nearest_parameters

#: Stiffness of the springs beside that of an element at the tie.
_PENALTY_RATIO = 1e4


def tie_stiffness(
    tie: WeakTie,
    patches: Mapping[str, NurbsPatch],
    numbering: CommonNumbering,
    modulus: float,
) -> sp.csr_matrix:
    """(d n, d n) stiffness that holds a side on another.

    Parameters
    ----------
    patches : refined
    modulus : Young's modulus [Pa], of a plane body times thickness [N/m]
    """
    slave, master = patches[tie.slave.patch], patches[tie.master.patch]
    parameters, weights, spans = _side_points(slave, tie.slave, max(master.degrees))
    own, points = _common_functions(slave, parameters, numbering, tie.slave)
    end = (tie.master.direction, tie.master.end)
    there, _ = nearest_parameters(master, points, end)
    jump = own - _common_functions(master, there, numbering, tie.master)[0]
    numbers = side_net(slave, tie.slave, numbering.numbers[tie.slave.patch])
    test = own[:, np.unique(numbers)].T @ sp.diags_array(weights)
    square = (test @ own[:, np.unique(numbers)]).toarray()
    projected = sp.csc_matrix(test @ jump)
    used = np.flatnonzero(np.diff(projected.indptr))
    projected = projected[:, used].toarray()
    d = slave.points.shape[1]
    height = (weights.sum() / spans) ** (1 / (d - 1))
    local = projected.T @ np.linalg.solve(square, projected)
    local *= _PENALTY_RATIO * modulus / height
    index = np.repeat(used, len(used)), np.tile(used, len(used))
    shape = (numbering.count,) * 2
    scalar = sp.csr_matrix(((local + local.T).ravel() / 2, index), shape=shape)
    return sp.csr_matrix(sp.kron(scalar, sp.eye_array(d)))


def _side_points(
    patch: NurbsPatch, side: Side, degree: int
) -> tuple[Array, Array, int]:
    """Gauss points (q, k) on a side, their lengths or areas, and its knot spans."""
    axes, rules, spans = [], [], 1
    for i, knots in enumerate(patch.knots):
        if i == side.direction:
            axes.append(np.array([float(side.end)]))
            rules.append(np.ones(1))
            continue
        x, w = gauss_points(knots, max(degree, patch.degrees[i]) + 2)
        axes.append(x.ravel())
        rules.append(w.ravel())
        spans *= len(x)
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(axes))
    basis = scattered_basis(patch, grid)
    free = [i for i in range(len(axes)) if i != side.direction]
    slopes = basis.gradients[..., free]
    t = np.einsum("nmd,nmk->nkd", patch.points[basis.nodes], slopes)
    measure = np.sqrt(np.linalg.det(t @ np.swapaxes(t, 1, 2)))
    return grid, reduce(np.multiply.outer, rules).ravel() * measure, spans


def _common_functions(
    patch: NurbsPatch, parameters: Array, numbering: CommonNumbering, side: Side
) -> tuple[sp.csr_matrix, Array]:
    """(q, n) common functions at points of one patch, and the points."""
    basis = scattered_basis(patch, parameters)
    columns = numbering.numbers[side.patch][basis.nodes]
    rows = np.repeat(np.arange(len(parameters)), columns.shape[1])
    shape = (len(parameters), numbering.count)
    entries = (basis.values.ravel(), (rows, columns.ravel()))
    points = np.einsum("nm,nmd->nd", basis.values, patch.points[basis.nodes])
    return sp.csr_matrix(entries, shape=shape), points
