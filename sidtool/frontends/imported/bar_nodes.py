"""Nodes of bars: rigid couplings, degrees of freedom, sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sidtool.formats.errors import InputError

from ...importers.imported import ImportedMesh
from ..beams.element import transport
from ..mesh.data import Mesh
from ..named_sets import NamedSets

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: A place of a marker this near to a node, of the body's size, is the node.
_AT_NODE = 1e-6


@dataclass(frozen=True, eq=False)
class BarNodes:
    """Places of nodes, and the degrees of freedom that move them.

    Attributes
    ----------
    mesh : all nodes [m]
    row : label -> row of the mesh
    owner : node -> the node that it is fixed to
    partial : node -> the node that it follows in some directions, and these from 0
    table : (n, 6) degrees of freedom, -1 for none
    """

    mesh: Mesh
    row: Mapping[int, int]
    owner: Mapping[int, int]
    partial: Mapping[int, tuple[int, tuple[int, ...]]]
    table: Indices

    def place(self, label: int) -> Array:
        """(3,) of a node [m]."""
        return self.mesh.positions[self.row[label]]

    def motion(self, label: int, place: Array) -> tuple[Array, Indices]:
        """(6, k) motion of a place that is fixed to a node, and its (k,) dofs."""
        base = self.owner.get(label, label)
        dofs = self.table[self.row[base]]
        there = dofs >= 0
        own, dofs = np.eye(6)[:, there], dofs[there]
        if base in self.partial:
            reference, tied = self.partial[base]
            found, others = self.motion(reference, self.place(base))
            follow = np.zeros_like(found)
            follow[list(tied)] = found[list(tied)]
            own, dofs = np.hstack([own, follow]), np.concatenate([dofs, others])
        return transport(place - self.place(base)) @ own, dofs


def bar_nodes(imported: ImportedMesh, mesh: Mesh) -> BarNodes:
    """The nodes of bars and of rigid couplings.

    Raises
    ------
    InputError : rigid couplings hold a node twice, or the bars fall apart.
    """
    row = {int(label): i for i, label in enumerate(mesh.labels)}
    owner = _owners(imported, row)
    ends_of_bars = {n for bar in imported.bars for n in bar.nodes}
    partial = _followers(imported, owner, ends_of_bars)
    table = np.full((len(row), 6), -1, np.int64)
    ends = [(owner.get(n, n), b) for b in imported.bars for n in b.nodes]
    turning = {n for n, bar in ends if bar.y_axis is not None} | set(owner.values())
    leaders = {owner.get(n, n) for n, _ in partial.values()}
    turning |= leaders
    used = sorted(
        {row[n] for n, _ in ends} | {row[n] for n in {*owner.values(), *leaders}}
    )
    wide = {row[n] for n in turning}
    followed = {row[n]: tied for n, (_, tied) in partial.items()}
    count = 0
    for i in used:
        free = [d for d in range(6 if i in wide else 3) if d not in followed.get(i, ())]
        table[i, free] = np.arange(count, count + len(free))
        count += len(free)
    pairs = [bar.nodes for bar in imported.bars]
    pairs += [(n, reference) for n, (reference, _) in partial.items()]
    _check_connected(pairs, owner, row, used, mesh)
    return BarNodes(mesh, row, owner, partial, table)


def _followers(
    imported: ImportedMesh, owner: Mapping[int, int], used: set[int]
) -> dict[int, tuple[int, tuple[int, ...]]]:
    """Nodes of bars that follow a reference node in some directions.

    Raises
    ------
    InputError : a node is held twice, or nodes follow each other in a ring.
    """
    result: dict[int, tuple[int, tuple[int, ...]]] = {}
    for coupling in imported.couplings:
        if not coupling.rigid or coupling.turns:
            continue
        assert coupling.reference is not None
        tied = tuple(int(d) - 1 for d in coupling.directions)
        for node in coupling.nodes:
            if node in result or node in owner or node == coupling.reference:
                raise InputError(
                    f"{coupling.name} holds node {node}, which is held already",
                    place=coupling.place,
                    expected="every node in one rigid piece",
                )
            if node in used or node in owner.values():
                result[node] = coupling.reference, tied
    for node in result:
        seen, base = {node}, owner.get(result[node][0], result[node][0])
        while base in result:
            if base in seen:
                raise InputError(
                    f"node {node} is held by rigid couplings in a ring",
                    expected="rigid couplings without rings",
                )
            seen.add(base)
            base = owner.get(result[base][0], result[base][0])
    return result


def _owners(imported: ImportedMesh, row: Mapping[int, int]) -> dict[int, int]:
    """Nodes of rigid couplings -> the reference node at the end of their chain."""
    direct: dict[int, int] = {}
    for coupling in imported.couplings:
        for node in (*coupling.nodes, coupling.reference):
            if node not in row:
                raise InputError(
                    f"{coupling.name} names node {node}, which is not defined",
                    place=coupling.place,
                    expected="nodes of this file",
                )
        for node in coupling.nodes if coupling.turns else ():
            if node in direct or node == coupling.reference:
                raise InputError(
                    f"{coupling.name} holds node {node}, which is held already",
                    place=coupling.place,
                    expected="every node in one rigid piece",
                )
            assert coupling.reference is not None
            direct[node] = coupling.reference
    result = {}
    for node in direct:
        seen, base = {node}, direct[node]
        while base in direct:
            if base in seen:
                raise InputError(
                    f"node {node} is held by rigid couplings in a ring",
                    expected="rigid couplings without rings",
                )
            seen.add(base)
            base = direct[base]
        result[node] = base
    return result


def _check_connected(
    joined: Sequence[tuple[int, int]],
    owner: Mapping[int, int],
    row: Mapping[int, int],
    used: list[int],
    mesh: Mesh,
) -> None:
    number = {i: k for k, i in enumerate(used)}
    pairs = [[number[row[owner.get(n, n)]] for n in pair] for pair in joined]
    i, j = np.array(pairs).T
    graph = sp.csr_matrix((np.ones(len(i)), (i, j)), shape=(len(used),) * 2)
    count, part = connected_components(graph, directed=False)
    if count > 1:
        lost = int(np.flatnonzero(part == np.argmin(np.bincount(part)))[0])
        raise InputError(
            f"the bars fall into {count} unconnected parts; the smallest holds node "
            f"{mesh.labels[used[lost]]}",
            place="mesh",
            expected="one connected body (are nodes at the same place merged?)",
        )


def node_sets(
    nodes: BarNodes, used: Indices, undefined: Mapping[str, str]
) -> NamedSets:
    """Node sets; the nodes of rigid pieces by what they are fixed to."""
    number = {int(i): k for k, i in enumerate(used)}
    sets = NamedSets(undefined=undefined)
    for name, rows in nodes.mesh.node_sets.items():
        labels = (int(nodes.mesh.labels[i]) for i in rows)
        bases = {nodes.row[nodes.owner.get(n, n)] for n in labels}
        sets[name] = np.array(sorted(number[i] for i in bases if i in number), np.int64)
    return sets


def nearest_node(nodes: BarNodes, where: Array) -> int:
    """The label of the node at a place.

    Raises
    ------
    InputError : there is none.
    """
    positions = nodes.mesh.positions
    apart = np.linalg.norm(positions - where, axis=1)
    moved = np.array(
        [
            (nodes.table[nodes.row[nodes.owner.get(int(n), int(n))]] >= 0).any()
            for n in nodes.mesh.labels
        ]
    )
    best = int(np.where(moved, apart, np.inf).argmin())
    if apart[best] > _AT_NODE * np.ptp(positions, axis=0).max():
        raise InputError(
            "is not at a node of bars",
            place="position",
            expected=f"a node; the nearest is {nodes.mesh.labels[best]}",
        )
    return int(nodes.mesh.labels[best])
