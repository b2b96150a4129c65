"""Degrees of freedom that nothing resists: pins of bars, AUTOSPC."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.elements.finite_element_model import MarkerRows, moving_dofs
from sidtool.formats.base.taylor import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.text import counted_noun

from .bar_elements import Bar
from .structure import Structure
from .structure_elements import merge_particles

#: Stiffness below this share of that without pins is none.
_FREE_STIFFNESS_TOLERANCE = 1e-12
#: Cosines of bars in one line differ from one by less.
_COLLINEAR_TOLERANCE = 1e-9


def without_unsupported(
    structure: Structure, marked: Callable[[Structure], set[int]]
) -> tuple[Structure, list[Diagnostic]]:
    """Return the structure without rotations that have neither stiffness nor mass.

    Parameters
    ----------
    marked : returns the labels of nodes that markers fix
    """
    structure, found = _resolve_pins(structure, marked)
    structure, more = _without_idle(structure)
    return structure, found + more


def markers_without_rotation(
    markers: Iterable[MarkerRows], axes: str = "xyz"
) -> list[Diagnostic]:
    """Name the markers at nodes that do not turn about an axis of the model (N147).

    Parameters
    ----------
    axes : those about which markers of the body may turn
    """
    found: dict[tuple[str, ...], list[str]] = {}
    for marker in markers:
        rows = zip("xyz", marker.rotation, strict=True)
        still = [axis for axis, row in rows if not moving_dofs(row).size]
        missing = tuple(axis for axis in still if axis in axes)
        if missing and marker.displacement.nnz:  # the body holds the point
            found.setdefault(missing, []).append(marker.name)
    return [diagnose("N147", markers=m, axes=axes) for axes, m in found.items()]


def _resolve_pins(
    structure: Structure, marked: Callable[[Structure], set[int]]
) -> tuple[Structure, list[Diagnostic]]:
    """Return bars and nodes without rotations that have neither stiffness nor mass.

    The stiffness is that of all elements, such as springs and shells. Such a rotation
    about an axis of the model is removed, as by AUTOSPC of Nastran. About another axis
    it follows a bar that is pinned there, unless a marker fixes it.
    """
    bars, table = structure.bars, structure.nodes.table
    if not any(any(bar.pins) for bar in bars):
        return structure, []
    heavy = np.zeros(structure.ndof)
    if (points := structure.point_masses()) is not None:
        heavy = points.mass_matrix().diagonal()
    plain = [replace(bar, pins=((), ())) for bar in bars]
    others, _ = structure.other_elements()
    whole = (structure.bar_stiffness(plain) + others).diagonal().real
    stiff = (structure.bar_stiffness(bars) + others).diagonal().real
    unsupported = (stiff <= _FREE_STIFFNESS_TOLERANCE * whole) & (heavy.real <= 0)
    turning = table[:, 3:]
    unsupported &= np.isin(np.arange(structure.ndof), turning[turning >= 0])
    structure, found = _without(structure, unsupported)
    kept = np.flatnonzero(~unsupported)
    supported = others[kept][:, kept], whole[kept], heavy[kept]
    bars = _without_free_rotations(structure, marked(structure), *supported)
    return replace(structure, bars=bars), found


def _without_free_rotations(
    structure: Structure,
    marked: set[int],
    others: sp.csr_matrix,
    whole: Array,
    heavy: Array,
) -> tuple[Bar, ...]:
    """Remove one pin for every rotation of a node that has no stiffness.

    Parameters
    ----------
    others : (ndof, ndof) stiffness of all elements but bars
    whole : (ndof,) diagonal of the stiffness without pins
    heavy : (ndof,) diagonal of the mass of points
    """
    bars, nodes = structure.bars, structure.nodes
    stiffness = sp.csr_matrix(structure.bar_stiffness(bars) + others)
    ends: dict[int, list[tuple[int, int]]] = {}
    for k, bar in enumerate(bars):
        for end, label in enumerate(bar.nodes):
            if not bar.rod and label not in {*nodes.owner, *marked}:
                ends.setdefault(nodes.row[label], []).append((k, end))
    changed = list(bars)
    used: set[tuple[int, int]] = set()
    for row, own in ends.items():
        there = nodes.table[row, 3:] >= 0
        dofs = nodes.table[row, 3:][there]
        if not dofs.size:
            continue
        block = stiffness[dofs][:, dofs].toarray().real
        values, vectors = np.linalg.eigh(block)
        free = vectors[:, values <= _FREE_STIFFNESS_TOLERANCE * whole[dofs].max()]
        if not free.shape[1] or heavy[dofs].any():
            continue
        for k, end in own:
            element, _ = structure.bar_element(changed[k])
            axes = element.frames(np.array([end])).section_axes[0]
            for direction in changed[k].pins[end]:
                axis = axes[direction - 4] if direction > 3 else np.zeros(3)
                inside = np.linalg.norm(free.T @ axis[there])
                if inside < 1 - _COLLINEAR_TOLERANCE or (k, direction) in used:
                    continue
                used.add((k, direction))
                pins = [list(pin) for pin in changed[k].pins]
                pins[end].remove(direction)
                changed[k] = replace(changed[k], pins=(tuple(pins[0]), tuple(pins[1])))
                left = free - np.outer(axis[there], axis[there] @ free)
                u, sizes, _ = np.linalg.svd(left, full_matrices=False)
                free = u[:, sizes > 0.5]
    return tuple(changed)


def _without_idle(structure: Structure) -> tuple[Structure, list[Diagnostic]]:
    """Return nodes without rotations that have neither stiffness nor mass."""
    if not (structure.imported.springs or structure.imported.couplings):
        return structure, []
    ndof, table = structure.ndof, structure.nodes.table
    total, points = structure.other_elements()
    if (masses := structure.point_masses()) is not None:
        points = [*points, masses]
    stiff = (total + structure.bar_stiffness(structure.bars)).diagonal().real
    heavy = (
        merge_particles(points).mass_matrix().diagonal() if points else np.zeros(ndof)
    )
    turning = table[:, 3:]
    idle = (stiff <= 0) & (heavy.real <= 0)
    idle &= np.isin(np.arange(ndof), turning[turning >= 0])
    return _without(structure, idle)


def _without(
    structure: Structure, removed: NDArray[np.bool_]
) -> tuple[Structure, list[Diagnostic]]:
    """Return the structure without some degrees of freedom (ndof,), and N129."""
    if not removed.any():
        return structure, []
    table = structure.nodes.table
    number = np.where(removed, -1, np.cumsum(~removed) - 1)
    count = int(np.count_nonzero(removed))
    rotations = counted_noun(count, "rotation")
    limit = f"left out, as nothing resists them: {rotations} of nodes (AUTOSPC)"
    remedy = "Hold no moment about them by joints."
    reduced = structure.with_nodes(np.where(table >= 0, number[table], -1))
    return reduced, [diagnose("N129", limit=limit, remedy=remedy)]
