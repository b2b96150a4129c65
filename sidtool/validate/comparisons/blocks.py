"""Every block of two SIDs, in the basis of the reference.

The elastic coordinates of one are those of the other times a matrix T: natural modes of
both, normalised to unit mass, differ by signs, and where frequencies are close by a
rotation, which the shape functions at the nodes and the couplings to the rigid motion
tell (orthogonal Procrustes problem).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from sidtool.formats.sid import BLOCK_SHAPES, NODE_SHAPES, SID, Array, Taylor

from ...conversion.rereference import FrameChange, changed
from ..basis import change_basis
from ..frequencies import held_modes
from ..measures import largest, modal_scale, rotation_scale, translation_scale
from ..pairing import Pairing
from .rows import Row

#: Entries below this share of what a block could hold are rounding.
_NOISE = 1e-9
#: Natural modes this close in frequency may mix.
_CLOSE = 1e-3
GROUP = "blocks, in the basis of the reference"


def block_rows(
    here: SID, reference: SID, common: Pairing, notes: list[str]
) -> Iterator[Row]:
    """Largest entry of each term beside that of the reference, and how far they are."""
    if not common.held:
        return
    if here.nq != reference.nq:
        notes.append(
            f"{here.nq} and {reference.nq} shape functions: the blocks, also those of "
            "first order, are not compared"
        )
        return
    if common.offset.any():
        none = np.zeros((here.nq, 3))
        here = changed(here, FrameChange(-common.offset, none, none))
    numbers = {node.id: i for i, node in enumerate(here.nodes)}
    others = {node.id: i for i, node in enumerate(reference.nodes)}
    first = [numbers[node.id] for node, _ in common.nodes]
    second = [others[node.id] for _, node in common.nodes]
    try:
        T = _transformation(here, reference, first, second)
    except np.linalg.LinAlgError:
        return
    told = change_basis(_plain(here), T, reference.labels)
    sizes = {
        **dict.fromkeys(("mdCM", "Ct"), translation_scale(reference)),
        **dict.fromkeys(("J", "Cr", "Gr"), rotation_scale(reference)),
        **dict.fromkeys(("Me", "Ge", "Oe"), modal_scale(reference)),
    }
    for name in BLOCK_SHAPES:
        yield from _rows(
            name, getattr(told, name), getattr(reference, name), sizes.get(name, 0.0)
        )
    for name in NODE_SHAPES:
        found, wanted = _stacked(told, name, first), _stacked(reference, name, second)
        if found is not None and wanted is not None:
            yield from _rows(name, found, wanted, 0.0)
        elif found is not wanted:
            notes.append(f"only one of the bodies has {name}: it is not compared")


def _rows(name: str, found: Taylor, wanted: Taylor, natural: float) -> Iterator[Row]:
    for part in ("m0", "m1"):
        value, expected = getattr(found, part), getattr(wanted, part)
        if value is None and expected is None:
            continue
        value = np.zeros_like(expected) if value is None else value
        expected = np.zeros_like(value) if expected is None else expected
        size = max(largest(expected), _NOISE * natural)
        if size == 0.0 and not value.any():
            continue
        difference = largest(value - expected)
        share = difference / size if size else 1.0
        yield Row(GROUP, f"{name} {part}", largest(value), largest(expected), share)


def _plain(sid: SID) -> SID:
    """Without blocks of unknown name and terms of unknown meaning."""
    return replace(sid, extra={})


def _transformation(
    here: SID, reference: SID, first: list[int], second: list[int]
) -> Array:
    """T, (nq, nq): q here = T q of the reference."""
    squares, modes = held_modes(reference)
    _, own = held_modes(here)
    seen = _seen(here, first) @ own, _seen(reference, second) @ modes
    parts = []
    frequencies = np.sqrt(np.clip(squares, 0.0, None))
    starts = np.flatnonzero(
        np.diff(frequencies, prepend=-np.inf) > _CLOSE * frequencies
    )
    for chosen in np.split(np.arange(len(squares)), starts[1:]):
        left, _, right = np.linalg.svd(seen[0][:, chosen].T @ seen[1][:, chosen])
        parts.append(left @ right)
    return np.asarray(own @ block_diag(*parts) @ np.linalg.inv(modes))


def _seen(sid: SID, nodes: list[int]) -> Array:
    """What tells natural modes apart: motion of the nodes, couplings; each one row."""
    phi, psi = (shapes[nodes].reshape(-1, sid.nq) for shapes in sid.shapes)
    first = sid.J.first_order(sid.nq)[:, :, 0].T
    mass, inertia = abs(sid.mass) or 1.0, largest(sid.J.m0) or 1.0
    length = np.sqrt(inertia / mass)
    root = np.sqrt(mass)
    rows = [phi * root, psi * root * length, sid.Ct.m0.T / root]
    rows += [sid.Cr.m0.T / np.sqrt(inertia), first / np.sqrt(inertia)]
    return np.vstack(rows)


def _stacked(sid: SID, name: str, nodes: list[int]) -> Taylor | None:
    """The entries of several nodes as one expansion; None where one has none."""
    entries = [getattr(sid.nodes[i], name) for i in nodes]
    if not entries or any(entry is None for entry in entries):
        return None
    m1 = None
    if any(entry.m1 is not None for entry in entries):
        m1 = np.concatenate([entry.first_order(sid.nq) for entry in entries], axis=1)
    return Taylor(np.vstack([entry.m0 for entry in entries]), m1)
