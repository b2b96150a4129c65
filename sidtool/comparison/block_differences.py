"""Rows of a comparison, and every block of two SIDs in the basis of the reference.

The elastic coordinates of one are those of the other times a matrix T: natural modes of
both, normalised to unit mass, differ by signs, and for close frequencies by a rotation.
It follows from the shape functions at the nodes and the couplings to the rigid motion
(orthogonal Procrustes problem).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.linalg import block_diag

from sidtool.formats.base.sid import BLOCK_SHAPES, NODE_SHAPES, SID, Array, Taylor

from ..conversion.frame_change import FrameChange, apply_frame_change
from ..validate.basis_change import change_basis
from ..validate.body_modes import Pairing
from ..validate.frequencies import held_modes
from ..validate.identity import (
    max_magnitude,
    modal_scale,
    rotation_scale,
    translation_scale,
)

Outcome = Literal["passed", "failed", "shown"]


@dataclass(frozen=True)
class ComparisonRow:
    """One number and its reference.

    Attributes
    ----------
    group : kind of quantity, e.g. "frequencies, frame held [Hz]"
    quantity : which one
    value, reference : number of the SID and of the reference
    deviation : relative; its basis depends on the group
    tolerance : accepted magnitude of the deviation; None if the row is only printed
    source : source of the reference
    """

    group: str
    quantity: str
    value: float
    reference: float
    deviation: float
    tolerance: float | None = None
    source: str = ""

    @property
    def verdict(self) -> Outcome:
        """Passed or failed where a tolerance is given, else only shown."""
        if self.tolerance is None:
            return "shown"
        return "passed" if abs(self.deviation) <= self.tolerance else "failed"


@dataclass(frozen=True)
class Comparison:
    """All rows of a comparison, and notes on what could not be compared and why."""

    rows: tuple[ComparisonRow, ...]
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """True when no judged row failed."""
        return not any(row.verdict == "failed" for row in self.rows)

    def group(self, start: str) -> tuple[ComparisonRow, ...]:
        """The rows of all groups whose name starts so."""
        return tuple(row for row in self.rows if row.group.startswith(start))


#: Entries below this fraction of the natural size of a block are rounding.
_ROUNDING_SHARE = 1e-9
#: Natural modes this close in frequency may mix.
_CLOSE_FREQUENCIES = 1e-3
BLOCK_GROUP = "blocks, in the basis of the reference"


def block_rows(
    here: SID, reference: SID, common: Pairing, notes: list[str]
) -> Iterator[ComparisonRow]:
    """Compare the largest entry of each term with that of the reference."""
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
        here = apply_frame_change(here, FrameChange(-common.offset, none, none))
    numbers = {node.id: i for i, node in enumerate(here.nodes)}
    others = {node.id: i for i, node in enumerate(reference.nodes)}
    first = [numbers[node.id] for node, _ in common.nodes]
    second = [others[node.id] for _, node in common.nodes]
    try:
        T = _basis_transformation(here, reference, first, second)
    except np.linalg.LinAlgError:
        return
    transformed = change_basis(_known_part(here), T, reference.labels)
    sizes = {
        **dict.fromkeys(("mdCM", "Ct"), translation_scale(reference)),
        **dict.fromkeys(("J", "Cr", "Gr"), rotation_scale(reference)),
        **dict.fromkeys(("Me", "Ge", "Oe"), modal_scale(reference)),
    }
    for name in BLOCK_SHAPES:
        yield from _term_rows(
            name,
            getattr(transformed, name),
            getattr(reference, name),
            sizes.get(name, 0.0),
        )
    for name in NODE_SHAPES:
        block, reference_block = (
            _stack_nodes(transformed, name, first),
            _stack_nodes(reference, name, second),
        )
        if block is not None and reference_block is not None:
            yield from _term_rows(name, block, reference_block, 0.0)
        elif block is not reference_block:
            notes.append(f"only one of the bodies has {name}: it is not compared")


def _term_rows(
    name: str, block: Taylor, reference_block: Taylor, natural: float
) -> Iterator[ComparisonRow]:
    for part in ("m0", "m1"):
        value, expected = getattr(block, part), getattr(reference_block, part)
        if value is None and expected is None:
            continue
        value = np.zeros_like(expected) if value is None else value
        expected = np.zeros_like(value) if expected is None else expected
        size = max(max_magnitude(expected), _ROUNDING_SHARE * natural)
        if size == 0.0 and not value.any():
            continue
        difference = max_magnitude(value - expected)
        share = difference / size if size else 1.0
        yield ComparisonRow(
            BLOCK_GROUP,
            f"{name} {part}",
            max_magnitude(value),
            max_magnitude(expected),
            share,
        )


def _known_part(sid: SID) -> SID:
    """Return the SID without blocks of unknown name and terms of unknown meaning."""
    return replace(sid, extra={})


def _basis_transformation(
    here: SID, reference: SID, first: list[int], second: list[int]
) -> Array:
    """T, (nq, nq): q here = T q of the reference."""
    squares, modes = held_modes(reference)
    _, own = held_modes(here)
    signatures = (
        _mode_signature(here, first) @ own,
        _mode_signature(reference, second) @ modes,
    )
    parts = []
    frequencies = np.sqrt(np.clip(squares, 0.0, None))
    starts = np.flatnonzero(
        np.diff(frequencies, prepend=-np.inf) > _CLOSE_FREQUENCIES * frequencies
    )
    for chosen in np.split(np.arange(len(squares)), starts[1:]):
        left, _, right = np.linalg.svd(
            signatures[0][:, chosen].T @ signatures[1][:, chosen]
        )
        parts.append(left @ right)
    return np.asarray(own @ block_diag(*parts) @ np.linalg.inv(modes))


def _mode_signature(sid: SID, nodes: list[int]) -> Array:
    """Return rows that distinguish natural modes: motion of the nodes, couplings."""
    phi, psi = (shapes[nodes].reshape(-1, sid.nq) for shapes in sid.shapes)
    first = sid.J.first_order(sid.nq)[:, :, 0].T
    mass, inertia = abs(sid.mass) or 1.0, max_magnitude(sid.J.m0) or 1.0
    length = np.sqrt(inertia / mass)
    root = np.sqrt(mass)
    rows = [phi * root, psi * root * length, sid.Ct.m0.T / root]
    rows += [sid.Cr.m0.T / np.sqrt(inertia), first / np.sqrt(inertia)]
    return np.vstack(rows)


def _stack_nodes(sid: SID, name: str, nodes: list[int]) -> Taylor | None:
    """Return the entries of several nodes as one expansion; None if one has no
    entry.
    """
    entries = [getattr(sid.nodes[i], name) for i in nodes]
    if not entries or any(entry is None for entry in entries):
        return None
    m1 = None
    if any(entry.m1 is not None for entry in entries):
        m1 = np.concatenate([entry.first_order(sid.nq) for entry in entries], axis=1)
    return Taylor(np.vstack([entry.m0 for entry in entries]), m1)
