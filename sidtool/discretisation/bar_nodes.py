"""Nodes of bars, shells, springs: couplings, degrees of freedom, sets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sidtool.formats.base.complex_step import analytic_norm, number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.sid_mass import skew

from ..beams.element import translate_motion
from ..mesh.connections import NamedSets
from ..mesh.imported_mesh import ImportedMesh
from ..mesh.mesh import Mesh
from .bar_elements import Bar

Indices = NDArray[np.int64]

#: Nodes on one line, by the ratio of their second moments.
_ON_LINE = 1e-10
#: Distance of a marker from a node, relative to the size of the body, below which it is
#: the node.
_AT_NODE = 1e-6


Mean = tuple[tuple[int, ...], Array, tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class BarNodes:
    """Positions of nodes, and the degrees of freedom that move them.

    Attributes
    ----------
    mesh : all nodes [m]
    row : label -> row of the mesh
    owner : node -> the node that it is fixed to
    partly_dependent : node -> the node that it follows in some directions, and these
        directions, counted from 0
    means : node -> the nodes whose mean motion it has; (k, 6, 6) its motion by theirs;
        and its dependent directions, counted from 0
    table : (n, 6) degrees of freedom, -1 for none
    """

    mesh: Mesh
    row: Mapping[int, int]
    owner: Mapping[int, int]
    partly_dependent: Mapping[int, tuple[int, tuple[int, ...]]]
    means: Mapping[int, Mean]
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
        if base in self.means:
            labels, shares, tied = self.means[base]
            rows = np.zeros((6, 1))
            rows[list(tied)] = 1.0
            for label_, share in zip(labels, shares, strict=True):
                matrix, others = self.motion(label_, self.place(label_))
                follow = rows * (share @ matrix)
                own, dofs = np.hstack([own, follow]), np.concatenate([dofs, others])
        if base in self.partly_dependent:
            reference, tied = self.partly_dependent[base]
            matrix, others = self.motion(reference, self.place(base))
            follow = np.zeros_like(matrix)
            follow[list(tied)] = matrix[list(tied)]
            own, dofs = np.hstack([own, follow]), np.concatenate([dofs, others])
        return translate_motion(place - self.place(base)) @ own, dofs


def bar_nodes(imported: ImportedMesh, bars: Sequence[Bar], mesh: Mesh) -> BarNodes:
    """Return the nodes of bars and of rigid couplings.

    Raises
    ------
    InputError : a node belongs to two rigid couplings, or the bars are not connected.
    """
    row = {int(label): i for i, label in enumerate(mesh.labels)}
    owner = _reference_nodes(imported, row)
    members = _members(imported, bars)
    ends_of_elements = {n for nodes, _ in members for n in nodes}
    partial = _dependent_nodes(imported, owner, ends_of_elements)
    table = np.full((len(row), 6), -1, np.int64)
    ends = [(owner.get(n, n), turns) for nodes, turns in members for n in nodes]
    turning = {n for n, turns in ends if turns} | set(owner.values())
    leaders = {owner.get(n, n) for n, _ in partial.values()}
    flexural = {n for n in row if owner.get(n, n) in turning | leaders}
    means = _means(imported, mesh, row, {*owner, *partial}, flexural)
    turning |= leaders
    used = sorted(
        {row[n] for n, _ in ends}
        | {row[n] for n in {*owner.values(), *leaders, *means}}
    )
    wide = {row[n] for n in turning}
    followed = {row[n]: tied for n, (_, tied) in partial.items()}
    held = {n for n, _ in ends}
    followed |= {
        row[n]: tied if n in held else tuple(range(6))
        for n, (*_, tied) in means.items()
    }
    count = 0
    for i in used:
        free = [d for d in range(6 if i in wide else 3) if d not in followed.get(i, ())]
        table[i, free] = np.arange(count, count + len(free))
        count += len(free)
    pairs = [(nodes[0], n) for nodes, _ in members for n in nodes[1:]]
    pairs += [(n, reference) for n, (reference, _) in partial.items()]
    pairs += [(n, other) for n, (others, *_) in means.items() for other in others]
    for equation in imported.equations:
        first, *others = (n for n, _ in (*equation.terms, *equation.rotations))
        pairs += [(first, n) for n in others if n in row and first in row]
    named = {row[owner.get(n, n)] for pair in pairs for n in pair}
    _check_connected(pairs, owner, row, sorted({*used, *named}), mesh)
    return BarNodes(mesh, row, owner, partial, means, table)


def _members(
    imported: ImportedMesh, bars: Sequence[Bar]
) -> list[tuple[tuple[int, ...], bool]]:
    """Return the nodes of every element, and whether it resists their rotation."""
    labels = imported.mesh.labels
    members: list[tuple[tuple[int, ...], bool]] = [
        (bar.nodes, not bar.rod) for bar in bars
    ]
    members += [(shell.nodes, shell.section.flexural) for shell in imported.shells]
    for spring in imported.springs:
        turns = spring.components is None or max(spring.components) > 2
        members.append((tuple(n for n in spring.nodes if n is not None), turns))
    for block in imported.mesh.blocks:
        members += [(tuple(nodes), False) for nodes in labels[block.nodes].tolist()]
    return members


def _means(
    imported: ImportedMesh,
    mesh: Mesh,
    row: Mapping[int, int],
    held: set[int],
    turning: set[int],
) -> dict[int, Mean]:
    """Return reference nodes that have the mean motion of others.

    Parameters
    ----------
    turning : nodes that have rotations

    Raises
    ------
    InputError : such a node is constrained twice, depends on itself, or the other nodes
        do not determine its rotation.
    """
    result: dict[int, Mean] = {}
    for coupling in imported.couplings:
        if coupling.rigid:
            continue
        node, nodes = coupling.reference, coupling.nodes
        assert node is not None
        for label in (node, *nodes):
            if label not in row:
                raise InputError(
                    f"{coupling.name} names node {label}, which is not defined",
                    place=coupling.place,
                    expected="nodes of this file",
                )
        if node in result or node in held or node in nodes:
            raise InputError(
                f"{coupling.name} holds node {node}, which is held already",
                place=coupling.place,
                expected="every reference node in one coupling",
            )
        weights = np.array(coupling.weights or np.ones(len(nodes)))
        places = mesh.positions[[row[n] for n in nodes]]
        turns = np.array([n in turning and n in coupling.turning for n in nodes])
        where = mesh.positions[row[node]]
        share = _mean_motion(places, weights / weights.sum(), turns, where)
        tied = tuple(int(d) - 1 for d in coupling.directions)
        if share is None:
            raise InputError(
                f"{coupling.name} takes the mean of nodes on one line, which do not "
                "determine how it turns",
                place=coupling.place,
                expected="three nodes that are not on one line, or RBE2",
            )
        result[node] = nodes, share, tied
    for start in result:
        open_, visited = [start], set[int]()
        while open_:
            for other in result[open_.pop()][0]:
                if other == start:
                    raise InputError(
                        f"node {start} has the mean motion of nodes that follow it",
                        expected="RBE3 without rings",
                    )
                if other in result and other not in visited:
                    visited.add(other)
                    open_.append(other)
    return result


def _mean_motion(
    places: Array, weights: Array, turns: NDArray[np.bool_], where: Array
) -> Array | None:
    """(k, 6, 6) motion of a place by the motions of nodes, as RBE3 has it.

    The rigid motion that fits those of the nodes in the least squares. The weight of a
    rotation is that of the displacement times the square of the mean distance of the
    nodes. None if the nodes do not determine a rotation.

    Parameters
    ----------
    turns : (k,) nodes whose rotations take part
    """
    if not turns.any():
        arms = skew((places - weights @ places).real)
        values = np.linalg.eigvalsh(-np.einsum("k,kab,kbc->ac", weights, arms, arms))
        if not values[0] > _ON_LINE * values[2]:
            return None
    arms = places - where
    length = analytic_norm(arms, axis=1).mean() or 1.0
    rigid = np.tile(np.eye(6, dtype=number_type(arms)), (len(places), 1, 1))
    rigid[:, :3, 3:] = -skew(arms)
    heavy = np.ones((len(places), 6), number_type(arms))
    heavy[:, 3:] = length**2 * turns[:, None]
    weighted = np.swapaxes(rigid, 1, 2) * (weights[:, None] * heavy)[:, None, :]
    return np.asarray(np.linalg.solve((weighted @ rigid).sum(axis=0), weighted))


def _dependent_nodes(
    imported: ImportedMesh, owner: Mapping[int, int], used: set[int]
) -> dict[int, tuple[int, tuple[int, ...]]]:
    """Return nodes of bars that depend on a reference node in some directions.

    Raises
    ------
    InputError : a node is constrained twice, or nodes depend on each other in a loop.
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
        visited, base = {node}, owner.get(result[node][0], result[node][0])
        while base in result:
            if base in visited:
                raise InputError(
                    f"node {node} is held by rigid couplings in a ring",
                    expected="rigid couplings without rings",
                )
            visited.add(base)
            base = owner.get(result[base][0], result[base][0])
    return result


def _reference_nodes(imported: ImportedMesh, row: Mapping[int, int]) -> dict[int, int]:
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
        for node in coupling.nodes if coupling.rigid and coupling.turns else ():
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
        visited, base = {node}, direct[node]
        while base in direct:
            if base in visited:
                raise InputError(
                    f"node {node} is held by rigid couplings in a ring",
                    expected="rigid couplings without rings",
                )
            visited.add(base)
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
    i, j = np.array(pairs, np.int64).reshape(-1, 2).T
    graph = sp.csr_matrix((np.ones(len(i)), (i, j)), shape=(len(used),) * 2)
    count, part = connected_components(graph, directed=False)
    if count > 1:
        separate = int(np.flatnonzero(part == np.argmin(np.bincount(part)))[0])
        raise InputError(
            f"the elements fall into {count} unconnected parts; the smallest holds "
            f"node {mesh.labels[used[separate]]}",
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
    positions = nodes.mesh.positions.real
    distances = np.linalg.norm(positions - where, axis=1)
    moved = np.array(
        [
            (nodes.table[nodes.row[nodes.owner.get(int(n), int(n))]] >= 0).any()
            for n in nodes.mesh.labels
        ]
    )
    best = int(np.where(moved, distances, np.inf).argmin())
    if distances[best] > _AT_NODE * np.ptp(positions, axis=0).max():
        raise InputError(
            "is not at a node of bars",
            place="position",
            expected=f"a node; the nearest is {nodes.mesh.labels[best]}",
        )
    return int(nodes.mesh.labels[best])
