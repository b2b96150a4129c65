"""Repair of blocks that other blocks imply, with a list of every changed number."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.base.sid import J_INDICES, SID, Array, Node, Taylor, axis_major
from sidtool.formats.geometric_stiffening import (
    has_second_order_field,
    stiffens_by_turning,
)
from sidtool.formats.sid_mass import skew

from ..mesh.unit_systems import check_magnitudes
from .frequencies import WRONG_SIGN_CORRELATION, sign_correlation
from .identity import max_magnitude, modal_blocks, transpose_modes
from .mass_identities import corrected_orientation

# Entries that agree with their source to the 12 digits of a file are not changed.
_SAME = 2e-11


@dataclass(frozen=True)
class Change:
    """One number that the repair replaced.

    Attributes
    ----------
    block : name of the block, or of a node and its entry
    entry : the entry as the (canonical) file names it, "m0(r,c)" or "m1(r,l,c)"
    before, after : its values
    reason : the identity that the new value follows from
    """

    block: str
    entry: str
    before: float
    after: float
    reason: str


def repair(sid: SID) -> tuple[SID, tuple[Change, ...]]:
    """Rebuild blocks that follow from other blocks of the same SID.

    Gr_l = J1_l - (Cr0_l)~ (I6, I10); Ge_l = Cr1_l - Cr1_l^T (I7, I8); the first-order
    columns xy, yz, xz of Oe become the mean over their two mode indices (I11); Cr m1
    loses a symmetric part that is no stiffening (I9). Empty mdCM m1, Ct m0, J m1 and Oe
    m0 are filled from their counterpart (I4 to I6), origin m1 from phi (I2). AP is set
    to the rotation that follows from AP m1 and psi (I3, I18). Ct m1 and phi m1 take the
    sign of the centrifugal stiffening (I20). All other blocks are assumed correct. A
    consistent SID is returned unchanged.

    Returns
    -------
    The repaired SID and every number that differs from before by more than the print
    of a file (2e-11 of the largest entry of the block and of those it follows from);
    other entries keep their value.

    Raises
    ------
    InputError : an entry is not a finite number below 1e100.
    """
    check_magnitudes(sid)
    nodes = [_repair_node(node, sid.nq) for node in sid.nodes]
    changes = tuple(change for _, node_changes in nodes for change in node_changes)
    if changes:
        sid = replace(sid, nodes=tuple(node for node, _ in nodes))
    for step in (
        (_fill_empty_blocks, _correct_signs, _rebuild_symmetries) if sid.nq else ()
    ):
        sid, node_changes = step(sid)
        changes += node_changes
    return sid, changes


def _repair_node(node: Node, nq: int) -> tuple[Node, tuple[Change, ...]]:
    """Repair orientations that are no rotations, and positions that do not
    follow phi.
    """
    changes: tuple[Change, ...] = ()
    corrected = corrected_orientation(node, nq)
    if corrected is not None:
        AP, why = corrected
        changes += _changed_entries(f"node {node.id}, AP", node.AP, AP, nq, why)
        node = replace(node, AP=AP)
    if nq and not node.origin.first_order(nq).any() and node.phi.m0.any():
        origin = replace(node.origin, m1=node.phi.m0.T[:, :, None])
        place = f"node {node.id}, origin"
        changes += _changed_entries(
            place, node.origin, origin, nq, "origin m1 = phi m0"
        )
        node = replace(node, origin=origin)
    return node, changes


def _fill_empty_blocks(sid: SID) -> tuple[SID, tuple[Change, ...]]:
    """Fill empty blocks that are the same integral as others; see I4, I5 and I6."""
    nq = sid.nq
    modes, static = modal_blocks(sid), sid.mdCM.first_order(nq)
    six = sid.J.first_order(nq)[:, :, 0]
    filled: dict[str, tuple[Taylor, str]] = {}
    if not six.any() and modes.Gr.any() and sid.Oe.m0.any():
        rate = (modes.Gr + np.swapaxes(modes.Gr, 1, 2)) / 2
        six = np.stack([rate[:, a, b] for a, b in J_INDICES], axis=1)
        filled["J"] = replace(sid.J, m1=six[:, :, None]), "2 J1_l = Gr_l + Gr_l^T"
    if not static.any() and sid.Ct.m0.any():
        filled["mdCM"] = replace(sid.mdCM, m1=sid.Ct.m0[:, :, None]), "mdCM m1 = Ct m0"
    if not sid.Ct.m0.any() and static.any():
        filled["Ct"] = replace(sid.Ct, m0=static[:, :, 0]), "Ct m0 = mdCM m1"
    if not sid.Oe.m0.any() and six.any():
        implied = -six[:, [0, 1, 2, 3, 5, 4]] * [0.5, 0.5, 0.5, 1.0, 1.0, 1.0]
        filled["Oe"] = replace(sid.Oe, m0=implied), "Oe m0 follows from J m1"
    return _with_blocks(sid, filled)


def _correct_signs(sid: SID) -> tuple[SID, tuple[Change, ...]]:
    """Correct the signs of Ct m1 and phi m1 if they contradict Oe m1; see I20."""
    why = "Ct m1 and phi m1 have the sign of Oe m1"
    wrong = {
        name
        for name, value in sign_correlation(sid).items()
        if value < WRONG_SIGN_CORRELATION
    }
    changes: tuple[Change, ...] = ()
    if "Ct" in wrong and sid.Ct.m1 is not None:
        sid, changes = _with_blocks(sid, {"Ct": (replace(sid.Ct, m1=-sid.Ct.m1), why)})
    if "phi" in wrong:
        nodes = []
        for node in sid.nodes:
            m1 = node.phi.m1
            phi = node.phi if m1 is None else replace(node.phi, m1=-m1)
            place = f"node {node.id}, phi"
            changes += _changed_entries(place, node.phi, phi, sid.nq, why)
            nodes.append(replace(node, phi=phi))
        sid = replace(sid, nodes=tuple(nodes))
    return sid, changes


def _rebuild_symmetries(sid: SID) -> tuple[SID, tuple[Change, ...]]:
    """Rebuild Gr, Ge and the symmetries over the modes of Oe m1 and Cr m1."""
    modes = modal_blocks(sid)
    Cr1 = modes.Cr1
    if not (has_second_order_field(sid) or stiffens_by_turning(sid)):
        Cr1 = (Cr1 - transpose_modes(Cr1)) / 2
    Gr = axis_major(modes.J1 - skew(sid.Cr.m0))
    Ge = axis_major(Cr1 - transpose_modes(Cr1))
    Oe1 = modes.Oe1.copy()
    Oe1[..., 3:] = 0.5 * (Oe1 + transpose_modes(Oe1))[..., 3:]
    parts = (
        ("Cr", "m1", modes.Cr1, Cr1, "Cr1 antisymmetric in the modes", sid.Me.m0),
        ("Gr", "m0", sid.Gr.m0, Gr, "Gr_l = J1_l - (Cr0_l)~", modes.J1),
        ("Ge", "m0", sid.Ge.m0, Ge, "Ge_l = Cr1_l - Cr1_l^T", modes.Cr1),
        ("Oe", "m1", modes.Oe1, Oe1, "Oe1 symmetric in the modes", modes.Oe1),
    )
    changes: tuple[Change, ...] = ()
    for name, part, before, after, why, source in parts:
        sources = (
            max_magnitude(source, sid.Cr.m0) if name == "Gr" else max_magnitude(source)
        )
        new, block_changes = _replacement(name, before, after, why, sources)
        if block_changes:
            block = replace(getattr(sid, name), **{part: new})
            sid = replace(sid, **{name: block})  # type: ignore[arg-type]
            changes += block_changes
    return sid, changes


def _with_blocks(
    sid: SID, new_blocks: dict[str, tuple[Taylor, str]]
) -> tuple[SID, tuple[Change, ...]]:
    changes: tuple[Change, ...] = ()
    for name, (block, why) in new_blocks.items():
        changes += _changed_entries(name, getattr(sid, name), block, sid.nq, why)
    blocks: dict[str, Any] = {name: block for name, (block, _) in new_blocks.items()}
    return (replace(sid, **blocks) if blocks else sid), changes


def _changed_entries(
    place: str, before: Taylor, after: Taylor, nq: int, why: str
) -> tuple[Change, ...]:
    """Yield the entries in which two expansions differ."""
    _, first = _replacement(place, before.m0, after.m0, why, 0.0)
    _, linear = _replacement(
        place, before.first_order(nq), after.first_order(nq), why, 0.0
    )
    return first + linear


def _replacement(
    block: str, before: Array, after: Array, reason: str, sources: float
) -> tuple[Array, tuple[Change, ...]]:
    differs = np.abs(after - before) > _SAME * max(
        max_magnitude(before, after), sources
    )
    changes = tuple(
        Change(
            block, _entry_text(index), float(before[index]), float(after[index]), reason
        )
        for index in map(tuple, np.argwhere(differs))
    )
    return np.where(differs, after, before), changes


def _entry_text(index: tuple[int, ...]) -> str:
    """(row, column) or (mode, row, column) from 0, in the notation of the file."""
    if len(index) == 2:
        return f"m0({index[0] + 1},{index[1] + 1})"
    mode, row, column = index
    return f"m1({row + 1},{mode + 1},{column + 1})"
