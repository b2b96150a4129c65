"""Which index order and column layout a file uses, found from the numbers.

Writers disagree; the identities Gr_l + Gr_l^T = 2 J1_l and Ge_l = Cr1_l - Cr1_l^T (or
2 Cr1_l, as most writers have it) tell the layouts apart. See theory, section 4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from ..sid import Array, Taylor, by_mode, symmetric_3x3
from .raw import RawTaylor
from .title import Layout

CONFIDENT = 1e-3
CLEARLY_WORSE = 10.0


def m1_index(
    expansions: Iterable[tuple[RawTaylor, int]], nq: int, hint: Layout | None
) -> str:
    """The index order of m1, "rlc" or "rcl".

    Parameters
    ----------
    expansions : each with its number of columns
    nq : number of elastic coordinates
    hint : the layout of the writer that the title names
    """
    misfits = {"rlc": 0, "rcl": 0}
    for raw, columns in expansions:
        j, k = raw.codes.largest
        misfits["rlc"] += j > nq or k > columns
        misfits["rcl"] += j > columns or k > nq
    if misfits["rlc"] != misfits["rcl"]:
        return min(misfits, key=lambda order: misfits[order])
    return "rlc" if hint is None else hint.m1_index


def changed(block: Taylor, change: Callable[[Array], Array]) -> Taylor:
    """The expansion with m0, m1 and mn rearranged alike."""
    m1 = None if block.m1 is None else change(block.m1)
    mn = None if block.mn is None else change(block.mn)
    return Taylor(change(block.m0), m1, mn, block.order)


def by_mode_in(columns: Array, nq: int, layout: str) -> Array:
    """Columns (n, 3 nq) in either layout as one matrix a mode, (nq, n, 3)."""
    if layout == "axis":
        return by_mode(columns, nq)
    return np.moveaxis(columns.reshape(-1, nq, 3), 1, 0)


def mode_major(columns: Array, nq: int) -> Array:
    """Axis-major columns (..., 3 nq) in mode-major order."""
    parts = columns.reshape(*columns.shape[:-1], 3, nq)
    return np.swapaxes(parts, -1, -2).reshape(columns.shape)


def axis_from_mode_major(columns: Array, nq: int) -> Array:
    """Mode-major columns (..., 3 nq) in axis-major order."""
    parts = columns.reshape(*columns.shape[:-1], nq, 3)
    return np.swapaxes(parts, -1, -2).reshape(columns.shape)


def gr_errors(gr: Array, j1: Array) -> dict[str, float] | None:
    """How far Gr (3, 3 nq) is from the identity with J1 (nq, 6, 1) in each layout.

    None when nothing can be told: one mode, or a block without entries.
    """
    nq = len(j1)
    if nq < 2 or not gr.any() or not j1.any():
        return None
    twice = 2 * symmetric_3x3(j1[:, :, 0])
    parts = {name: by_mode_in(gr, nq, name) for name in ("axis", "mode")}
    return {
        name: _relative(part + np.swapaxes(part, 1, 2) - twice, gr)
        for name, part in parts.items()
    }


def ge_errors(ge: Array, cr1: Array) -> dict[str, float] | None:
    """How far Ge (nq, 3 nq) is from its identity with Cr1 (nq, nq, 3), by layout."""
    nq = len(cr1)
    if nq < 2 or not ge.any() or not cr1.any():
        return None
    candidates = (2 * cr1, cr1 - np.swapaxes(cr1, 0, 1))
    parts = {name: by_mode_in(ge, nq, name) for name in ("axis", "mode")}
    return {
        name: min(_relative(part - candidate, ge) for candidate in candidates)
        for name, part in parts.items()
    }


def confident(errors: dict[str, float] | None) -> str | None:
    """The layout that the identity proves, None if it proves neither."""
    if errors is None:
        return None
    best, other = sorted(errors, key=lambda name: errors[name])
    clear = errors[best] < CONFIDENT and errors[other] > CLEARLY_WORSE * errors[best]
    return best if clear else None


def choose(errors: dict[str, float] | None, hint: str | None) -> tuple[str, bool]:
    """The layout to read, and whether it is certain.

    The identity decides; then the title; then the smaller deviation; then axis-major,
    which is what most writers use.
    """
    proven = confident(errors)
    if proven:
        return proven, True
    if hint or errors is None:
        return hint or "axis", hint is not None
    return min(errors, key=lambda name: errors[name]), False


def _relative(deviation: Array, reference: Array) -> float:
    return float(np.abs(deviation).max() / np.abs(reference).max())
