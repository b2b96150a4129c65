"""The motion of markers to second order, of which their rows tell the first.

The rows D and H of a marker give its displacement t = D u and its small rotation
theta = H u. The motion of a marker in a finite displacement u is the rigid motion after
whose removal the rows see nothing: of a tie the one that fits its nodes best, of a
gradient the rotation of its polar decomposition. Around the marker, r from its place,
what is left once that motion is taken back is, to second order,

    u - t - theta x r - theta x (u - t) + theta x (theta x r) / 2

and D and H of it vanish. With first-order t and theta in products,

    t = D u - D f,    theta = H u - H f,    f = theta x (u - t - theta x r / 2)

A load of the rows alone does the work of D u and H u and so too much by that of f. Of a
marker at one point D f = 0, and H f is a product of strain and rotation. Of a tie both
hold products of two rotations: in a plane D f at a distance from the tie's centroid,
in space H f as well.

The points of a cross-section of a beam have f = theta x (theta x r) / 2. A bending
moment does its work along the beam and a torsional one across it, in equal parts along
both axes of the section, so that H f = (e . theta) theta x e / 2 with the tangent e.

Nodes of a rigid tie go the second-order way f of their piece, on which the forces that
hold the piece together do work.

Source: the fit to nodes is that of B. K. P. Horn, H. M. Hilden, S. Negahdaripour,
"Closed-form solution of absolute orientation using orthonormal matrices", J. Opt. Soc.
Am. A 5, 1988; expanded here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..frontends.finite_element_model import FiniteElementModel, Indices, MarkerRows
from .vectors import LEVI_CIVITA

Array = NDArray[np.float64]


def excess_of_rows(
    body: FiniteElementModel, marker: MarkerRows, shapes: Array
) -> tuple[Array, Array]:
    """What the rows of a marker tell beyond its motion, by pairs of shape functions.

    The displacement is D Phi q - q^T E q / 2 with the first E, the rotation vector
    H Phi q - q^T E q / 2 with the second.

    Parameters
    ----------
    shapes : (ndof, nq)

    Returns
    -------
    two of (3, nq, nq), symmetric in the shape functions [m], [rad]
    """
    dofs = np.union1d(marker.displacement.indices, marker.rotation.indices)
    nodes = np.flatnonzero(np.isin(body.table[:, :3], dofs).any(axis=1))
    rows = np.vstack([marker.displacement.toarray(), marker.rotation.toarray()])
    work = _second_order_work(body, marker, nodes, shapes, rows.T)
    shift, turn = work[:3], work[3:]
    if marker.tangent is not None:
        turn = turn + _excess_of_section(marker.tangent, marker.rotation @ shapes)
    return shift, turn


def _excess_of_section(tangent: Array, turn: Array) -> Array:
    """(3, nq, nq) from H f of a cross-section that turns by turn (3, nq)."""
    crossed = np.einsum("abc,bk,c->ak", LEVI_CIVITA, turn, tangent)
    pairs = np.einsum("ak,l->akl", crossed, tangent @ turn)
    return (pairs + np.swapaxes(pairs, 1, 2)) / 2


def work_in_rigid_pieces(
    body: FiniteElementModel, forces: Array, shapes: Array
) -> Array:
    """Work that forces do on the second-order way of the nodes of all rigid ties.

    Parameters
    ----------
    forces : (ndof, n) [N]
    shapes : (ndof, nq)

    Returns
    -------
    (n, nq, nq), symmetric in the shape functions; half of q^T . q is the work [N m]
    """
    nq = shapes.shape[1]
    total = np.zeros((forces.shape[1], nq, nq))
    for name, nodes in body.rigid_sets.items():
        total += _second_order_work(body, body.marker(name), nodes, shapes, forces)
    return total


def _second_order_work(
    body: FiniteElementModel,
    marker: MarkerRows,
    nodes: Indices,
    shapes: Array,
    forces: Array,
) -> Array:
    """(n, nq, nq) work of forces (ndof, n) at some nodes on the way f, twice.

    A force times theta x a is theta times the moment of the force on the arm a.
    """
    shift, turn = marker.displacement @ shapes, marker.rotation @ shapes
    r = np.zeros((nodes.size, 3))
    r[:, : body.dimension] = body.positions[nodes]
    r -= marker.position
    half = np.einsum("bca,cl,pa->pbl", LEVI_CIVITA, turn, r) / 2
    arms = _at(body, nodes, shapes) - shift - half
    at_nodes = _at(body, nodes, forces)
    pairs = np.einsum("pcl,pan->clan", arms, at_nodes, optimize=True)
    moments = np.einsum("bca,clan->nbl", LEVI_CIVITA, pairs)
    work = np.einsum("bk,nbl->nkl", turn, moments)
    return work + np.swapaxes(work, 1, 2)


def _at(body: FiniteElementModel, nodes: Indices, fields: Array) -> Array:
    """(p, 3, n) of the fields (ndof, n): zero where a node has no such motion."""
    numbers = body.table[nodes, :3]
    return np.where((numbers >= 0)[..., None], fields[numbers], 0.0)
