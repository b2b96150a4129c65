"""Write ASCII SID files: the canonical dialect (FEMBS) and three others.

`STYLES` states how each dialect prints numbers and stores matrices.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..base.errors import InputError
from ..base.sid import (
    BLOCK_SHAPES,
    NODE_SHAPES,
    SID,
    Array,
    Node,
    Taylor,
    symmetric_3x3,
)
from ..base.stress import has_peak_nodes, stress_nodes
from ..storage.atomic import atomic_path
from ..storage.hdf5_files import check_finite
from . import lines
from .expansion import symmetrise
from .title import LAYOUTS, Layout, ascii_text, layout_from_words, title_line

#: Smaller numbers are written as zero: their exponent would need three digits.
SMALLEST_NUMBER = 1e-99
#: Halves of a matrix this close (relative) are one symmetric matrix plus rounding.
ROUNDING = 1e-12

_EQUALS = 48
_NAME = re.compile(r"[A-Za-z]\w{0,39}", re.ASCII)


def write_ascii(path: str | os.PathLike[str], sid: SID, dialect: str = "fembs") -> None:
    """Write a SID with 12 significant digits; the file appears wholly or not at all.

    Parameters
    ----------
    path : file to create or replace
    sid : any body; numbers below 1e-99 are written as zero, a title beyond 400
        characters is cut, and text that is not ASCII loses its accents
    dialect : "fembs" (canonical), "pysid", "matmorembs" or "fembeam"

    Raises
    ------
    InputError : unknown dialect, a number that is not finite, a name that no line of
        the format can hold, or a place that cannot be written to.
    """
    style = STYLES.get(dialect)
    if style is None:
        known = ", ".join(STYLES)
        raise InputError(f"'{dialect}' is no dialect of SID files", expected=known)
    check_finite(sid)
    _check_names(sid)
    with (
        atomic_path(path) as temporary,
        temporary.open("w", encoding="ascii", newline="\n") as stream,
    ):
        for block in _file_text(sid, style):
            stream.write(block)


def _check_names(sid: SID) -> None:
    for node in sid.nodes:
        if not node.id or node.id != " ".join(ascii_text(node.id).split()):
            raise InputError(
                f"the node id {node.id!r} cannot be written to an ASCII file",
                expected="letters, digits and single blanks",
            )
    reserved = {name.lower() for name in (*BLOCK_SHAPES, *NODE_SHAPES, "mCM", "mmi")}
    for name in sid.extra:
        if not _NAME.fullmatch(name) or name.lower() in reserved:
            problem = f"the block name {name!r} cannot be written to an ASCII file"
            raise InputError(problem, expected="a word that is no block of the format")


def _file_text(sid: SID, style: Style) -> Iterator[str]:
    """The file in pieces of whole lines."""
    counts = (len(sid.nodes), sid.nq)
    fembeam = style.layout is LAYOUTS["fembeam"]
    peaks = has_peak_nodes(sid) if stress_nodes(sid) else None
    tag, known = _layout_tag(sid, style), (sid.carried, sid.from_matrices, peaks)
    yield title_line(sid.title, counts, fembeam, tag, *known) + "\n"
    yield _entry_line(1, "part")
    yield _entry_line(6, "new modal", "")
    yield _entry_line(11, "refmod")
    yield _entry_line(16, "mass", _format_reals(np.array([sid.mass]), style)[0])
    yield _entry_line(16, "nelastq", f"{sid.nq:5d}")
    for index, label in enumerate(sid.labels, start=1):
        yield _entry_line(16, f"ielastq ({index:4d})", f" {ascii_text(label)}".rstrip())
    yield _entry_line(11, "end refmod")
    yield _entry_line(11, "frame")
    for node in sid.nodes:
        yield from _node_text(node, sid.nq, style)
    yield _entry_line(11, "end frame")
    names = style.names or {}
    for name, block in (sid.blocks | dict(sid.extra)).items():
        arranged = _arrange_block(name, block, sid.nq, style)
        symmetric = name in ("Me", "Ke", "De") or (name == "J" and style.j_is_3x3)
        yield _expansion_text(
            names.get(name, name), arranged, sid.nq, style, 11, symmetric
        )
    yield _entry_line(6, "end modal")
    yield _entry_line(1, "end part")


def _node_text(node: Node, nq: int, style: Style) -> Iterator[str]:
    yield _entry_line(16, "new node", f"{node.id:>9}")
    yield _entry_line(21, "rframe", f" {ascii_text(node.rframe)}".rstrip())
    for name in NODE_SHAPES:
        entry = getattr(node, name)
        if entry is not None:
            yield _expansion_text(name, entry, nq, style, 21)
    yield _entry_line(16, "end node")


def _expansion_text(
    name: str,
    block: Taylor,
    nq: int,
    style: Style,
    indent: int,
    symmetric: bool = False,
) -> str:
    """One expansion as text: header, m0 by rows, m1 by columns."""
    m0, structure = _stored_entries(block.m0, style, symmetric)
    nqn = 0 if block.mn is None else len(block.mn)
    header = {
        "order": block.order,
        "nrow": block.shape[0],
        "ncol": block.shape[1],
        "nq": nq,
        "nqn": nqn,
        "structure": structure if m0.any() or not block.is_zero else 0,
    }
    lines = [_entry_line(indent, name)]
    lines += [_entry_line(26, item, f"{value:5d}") for item, value in header.items()]
    rows, columns = np.nonzero(np.abs(m0) >= SMALLEST_NUMBER)
    pairs = zip(rows + 1, columns + 1, strict=True)
    keys = [f"m0({row:2d},{column:2d})" for row, column in pairs]
    values = m0[rows, columns]
    for kind, part in (("m1", block.m1), ("mn", block.mn)):
        if part is not None:
            more, numbers = _higher_order_entries(kind, part, style)
            keys += more
            values = np.concatenate([values, numbers])
    numbers_text = _format_reals(values, style)
    margin = 26 * " "
    lines += [
        f"{margin}{key:<22}={value}\n"
        for key, value in zip(keys, numbers_text, strict=True)
    ]
    lines.append(_entry_line(indent, f"end {name}"))
    return "".join(lines)


def _higher_order_entries(
    kind: str, part: Array, style: Style
) -> tuple[list[str], Array]:
    """Keys and values of m1 or mn: column outermost, then row, mode fastest."""
    by_column = part.transpose(2, 1, 0)
    columns, rows, modes = np.nonzero(np.abs(by_column) >= SMALLEST_NUMBER)
    values = by_column[columns, rows, modes]
    second, third = modes, columns
    if style.layout.m1_index == "rcl":
        second, third = columns, modes
    indices = zip(rows.tolist(), second.tolist(), third.tolist(), strict=True)
    keys = [f"{kind}({r + 1:2d},{s + 1:2d},{t + 1:2d})" for r, s, t in indices]
    return keys, values


def _stored_entries(m0: Array, style: Style, symmetric: bool) -> tuple[Array, int]:
    """Return the entries of m0 that a dialect stores, and the structure it declares."""
    size = np.abs(m0).max(initial=0.0)
    if not symmetric or np.abs(m0 - m0.T).max(initial=0.0) > ROUNDING * size:
        return m0, 3
    mean = symmetrise(m0)
    if style.stored == "diagonal":
        off_diagonal = mean - np.diag(np.diag(mean))
        return (mean, 3) if off_diagonal.any() else (mean, 1)
    return (np.tril(mean), 2) if style.stored == "lower" else (mean, 2)


def _arrange_block(name: str, block: Taylor, nq: int, style: Style) -> Taylor:
    """A body block in the columns and the shape of the dialect."""
    columns = {"Gr": style.layout.gr, "Ge": style.layout.ge}.get(name)
    if columns == "mode":
        return lines.rearrange(block, lambda part: lines.mode_major(part, nq))
    if name == "J" and style.j_is_3x3:
        return lines.rearrange(block, lambda part: symmetric_3x3(part[..., 0]))
    return block


def _layout_tag(sid: SID, style: Style) -> Layout | None:
    """The layout to mark in the title: always, unless readers find the canonical one.

    They do when the identities prove it and the title names no other writer.
    """
    if style.layout is not LAYOUTS["fembs"]:
        return style.layout
    title_layout = layout_from_words(ascii_text(sid.title))
    misleading = title_layout is not None and title_layout != style.layout
    j1, cr1 = sid.J.first_order(sid.nq), sid.Cr.first_order(sid.nq)
    proofs = (
        (sid.Gr.m0, lines.gr_errors(sid.Gr.m0, j1)),
        (sid.Ge.m0, lines.ge_errors(sid.Ge.m0, cr1)),
    )
    is_proven = all(
        sid.nq < 2 or not columns.any() or lines.certain_layout(errors) == "axis"
        for columns, errors in proofs
    )
    return style.layout if misleading or not is_proven else None


def _entry_line(indent: int, key: str, value: str | None = None) -> str:
    left = " " * indent + key
    return f"{left}\n" if value is None else f"{left:<{_EQUALS}}={value}\n"


def _format_reals(values: Array, style: Style) -> list[str]:
    if not len(values):
        return []
    text = "\n".join([style.number] * len(values)) % tuple(values.tolist())
    return text.replace("E", style.letter).split("\n")


@dataclass(frozen=True)
class Style:
    """How one dialect prints what its `Layout` arranges.

    Attributes
    ----------
    layout : arrangement of columns and indices
    number : printf format of a real number
    letter : exponent letter
    stored : of a symmetric matrix, "both" halves, the "lower" one or "diagonal"
    j_is_3x3 : J as a matrix instead of its six elements
    names : blocks that this dialect calls differently
    """

    layout: Layout
    number: str = "% .11E"
    letter: str = "D"
    stored: str = "both"
    j_is_3x3: bool = False
    names: Mapping[str, str] | None = None


#: FEMBeam itself prints "%f" and loses small numbers; "%.12g" reads the same and
#: keeps 12 digits, with an exponent where a number is small or large.
STYLES = {
    "fembs": Style(LAYOUTS["fembs"]),
    "pysid": Style(LAYOUTS["pysid"], stored="diagonal"),
    "matmorembs": Style(
        LAYOUTS["matmorembs"],
        letter="E",
        stored="lower",
        names={"mdCM": "mCM", "J": "mmi"},
    ),
    "fembeam": Style(
        LAYOUTS["fembeam"], number="%.12g", letter="e", stored="lower", j_is_3x3=True
    ),
}
