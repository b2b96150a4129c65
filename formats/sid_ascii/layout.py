"""Detection of the index order and column layout of a file from its numbers."""

from collections.abc import Callable, Iterable

import numpy as np

from ..base.sid import Array, Taylor, by_mode, symmetric_3x3
from .raw_file import RawTaylor
from .title import Layout

CERTAIN_ERROR = 1e-3
WORSE_RATIO = 10.0


def detect_m1_index(
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


def rearrange(block: Taylor, change: Callable[[Array], Array]) -> Taylor:
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
    """Return the deviations of Gr (3, 3 nq) from the identity with J1, in each layout.

    None if they cannot be determined: one mode, or a block without entries.
    """
    nq = len(j1)
    if nq < 2 or not gr.any() or not j1.any():
        return None
    doubled = 2 * symmetric_3x3(j1[:, :, 0])
    parts = {name: by_mode_in(gr, nq, name) for name in ("axis", "mode")}
    return {
        name: _relative_error(part + np.swapaxes(part, 1, 2) - doubled, gr)
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
        name: min(_relative_error(part - candidate, ge) for candidate in candidates)
        for name, part in parts.items()
    }


def certain_layout(errors: dict[str, float] | None) -> str | None:
    """The layout that the identity proves, None if it proves neither."""
    if errors is None:
        return None
    best, other = sorted(errors, key=lambda name: errors[name])
    is_clear = (
        errors[best] < CERTAIN_ERROR and errors[other] > WORSE_RATIO * errors[best]
    )
    return best if is_clear else None


def choose_layout(
    errors: dict[str, float] | None, hint: str | None
) -> tuple[str, bool]:
    """The layout to read, and whether it is certain.

    The identity decides; then the title; then the smaller deviation; then axis-major,
    which is what most writers use.
    """
    certain = certain_layout(errors)
    if certain:
        return certain, True
    if hint or errors is None:
        return hint or "axis", hint is not None
    return min(errors, key=lambda name: errors[name]), False


def _relative_error(deviation: Array, reference: Array) -> float:
    return float(np.abs(deviation).max() / np.abs(reference).max())
