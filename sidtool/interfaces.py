"""Markers tied to many nodes: RBE2 (rigid) and RBE3 (distributing).

Both markers move as the rigid motion that fits the nodes best in the least-squares
sense; loads spread over the nodes by the transposed rows. A rigid tie also makes the
nodes one rigid piece. On edges and faces of a patch the fit weighs by length or area,
on plain node sets every node alike. The rows are the first order of that fit; what
`marker_motion` adds for stiffening is the second.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from formats.errors import InputError
from formats.model import ModelFile
from formats.model_reduction import Tie

from .frontends.finite_element_model import FiniteElementModel, Indices, MarkerRows

Array = NDArray[np.float64]

#: Nodes do not tell a rotation if its share in the fit is below this.
_FLAT = 1e-12


def tied(body: FiniteElementModel, model: ModelFile) -> FiniteElementModel:
    """The body with the markers of the model file that are tied to node sets.

    Raises
    ------
    InputError : a node set does not exist, or does not tell how its marker turns.
    """
    if not any(marker.tie for marker in model.markers.values()):
        return body
    placed = {marker.name: marker for marker in body.markers}
    markers: list[MarkerRows] = []
    rigid: dict[str, Indices] = {}
    for name, settings in model.markers.items():
        if settings.tie is None:
            markers.append(placed[name])
            continue
        nodes = _nodes(body, settings.tie, f"markers.{name}.tie.to")
        at = placed[name].position if name in placed else None
        markers.append(_tied_rows(body, name, settings.node, settings.tie, nodes, at))
        if settings.tie.type == "rigid":
            rigid[name] = nodes
    return replace(body, markers=tuple(markers), rigid_sets=rigid)


def _nodes(body: FiniteElementModel, tie: Tie, place: str) -> Indices:
    missing = [name for name in tie.names if name not in body.node_sets]
    if missing:
        raise InputError(
            f"there is no edge or node set {missing[0]!r}",
            place=place,
            expected=f"one of {', '.join(body.node_sets)}",
        )
    return np.unique(np.concatenate([body.node_sets[name] for name in tie.names]))


def _tied_rows(
    body: FiniteElementModel,
    name: str,
    node: int,
    tie: Tie,
    nodes: Indices,
    position: Array | None,
) -> MarkerRows:
    d = body.dimension
    weights = _weights(body, tie, nodes)
    if position is None:
        share = np.asarray(weights.sum(axis=0)).ravel()
        position = np.pad(share @ body.positions / share.sum(), (0, 3 - d))
    dofs = body.table[nodes, :d].ravel()
    dofs = dofs[dofs >= 0]
    metric = _on_displacements(body, weights)[dofs][:, dofs]
    rigid = body.rigid_body_modes(position)[dofs]
    momentum = metric @ rigid
    gram = rigid.T @ momentum
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    if np.linalg.eigvalsh(gram / np.outer(scale, scale))[0] < _FLAT:
        raise InputError(
            "these nodes do not tell how the marker turns",
            place=f"markers.{name}.tie.to",
            expected="nodes in more places: not one point, and in space not one line",
        )
    fit = np.zeros((6, body.ndof))
    which = np.array([0, 1, 5] if d == 2 else range(6))
    fit[which[:, None], dofs] = np.linalg.solve(gram, momentum.T)
    rows = sp.csr_matrix(fit)
    return MarkerRows(name, node, position, rows[:3], rows[3:])


def _weights(body: FiniteElementModel, tie: Tie, nodes: Indices) -> sp.csr_matrix:
    """(n, n) metric of the fit."""
    n = len(body.positions)
    if all(name in body.edge_mass for name in tie.names):
        total = sp.csr_matrix((n, n))
        for name in tie.names:
            total = total + body.edge_mass[name]
        return sp.csr_matrix(total)
    return sp.csr_matrix((np.ones(nodes.size), (nodes, nodes)), shape=(n, n))


def _on_displacements(
    body: FiniteElementModel, weights: sp.csr_matrix
) -> sp.csr_matrix:
    """A metric of nodes as one of all displacement components, (ndof, ndof)."""
    entries = weights.tocoo()
    total = sp.csr_matrix((body.ndof, body.ndof))
    for axis in range(body.dimension):
        i, j = body.table[entries.row, axis], body.table[entries.col, axis]
        there = (i >= 0) & (j >= 0)
        part = (entries.data[there], (i[there], j[there]))
        total = total + sp.csr_matrix(part, shape=total.shape)
    return sp.csr_matrix(total)
