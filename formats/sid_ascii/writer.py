"""Writing an ASCII SID file: the canonical dialect (FEMBS) and three others."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator

import numpy as np

from ..errors import InputError
from ..sid import BLOCK_SHAPES, NODE_SHAPES, SID, Array, Node, Taylor, symmetric_3x3
from ..storage.atomic import atomic_path
from ..storage.finite import check_finite
from . import layout
from .expansion import mean_of_halves
from .styles import STYLES, Style
from .title import LAYOUTS, Layout, ascii_text, layout_from_words, title_line

#: Smaller numbers are written as zero: their exponent would need three digits.
SMALLEST = 1e-99
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
        for block in _file(sid, style):
            stream.write(block)


def _check_names(sid: SID) -> None:
    for node in sid.nodes:
        if not node.id or node.id != " ".join(ascii_text(node.id).split()):
            raise InputError(
                f"the node id {node.id!r} cannot be written to an ASCII file",
                expected="letters, digits and single blanks",
            )
    taken = {name.lower() for name in (*BLOCK_SHAPES, *NODE_SHAPES, "mCM", "mmi")}
    for name in sid.extra:
        if not _NAME.fullmatch(name) or name.lower() in taken:
            problem = f"the block name {name!r} cannot be written to an ASCII file"
            raise InputError(problem, expected="a word that is no block of the format")


def _file(sid: SID, style: Style) -> Iterator[str]:
    """The file in pieces of whole lines."""
    counts = (len(sid.nodes), sid.nq)
    fembeam = style.layout is LAYOUTS["fembeam"]
    tag, known = _tag(sid, style), (sid.carried, sid.from_matrices)
    yield title_line(sid.title, counts, fembeam, tag, *known) + "\n"
    yield _line(1, "part")
    yield _line(6, "new modal", "")
    yield _line(11, "refmod")
    yield _line(16, "mass", _real(sid.mass, style))
    yield _line(16, "nelastq", f"{sid.nq:5d}")
    for index, label in enumerate(sid.labels, start=1):
        yield _line(16, f"ielastq ({index:4d})", f" {ascii_text(label)}".rstrip())
    yield _line(11, "end refmod")
    yield _line(11, "frame")
    for node in sid.nodes:
        yield from _node(node, sid.nq, style)
    yield _line(11, "end frame")
    names = style.names or {}
    for name, block in (sid.blocks | dict(sid.extra)).items():
        shown = _arranged(name, block, sid.nq, style)
        symmetric = name in ("Me", "Ke", "De") or (name == "J" and style.j_is_3x3)
        yield _taylor(names.get(name, name), shown, sid.nq, style, 11, symmetric)
    yield _line(6, "end modal")
    yield _line(1, "end part")


def _node(node: Node, nq: int, style: Style) -> Iterator[str]:
    yield _line(16, "new node", f"{node.id:>9}")
    yield _line(21, "rframe", f" {ascii_text(node.rframe)}".rstrip())
    for name in NODE_SHAPES:
        entry = getattr(node, name)
        if entry is not None:
            yield _taylor(name, entry, nq, style, 21)
    yield _line(16, "end node")


def _taylor(
    name: str,
    block: Taylor,
    nq: int,
    style: Style,
    indent: int,
    symmetric: bool = False,
) -> str:
    """One expansion as text: header, m0 by rows, m1 by columns."""
    m0, structure = _stored(block.m0, style, symmetric)
    nqn = 0 if block.mn is None else len(block.mn)
    header = {
        "order": block.order,
        "nrow": block.shape[0],
        "ncol": block.shape[1],
        "nq": nq,
        "nqn": nqn,
        "structure": structure if m0.any() or not block.is_zero else 0,
    }
    lines = [_line(indent, name)]
    lines += [_line(26, item, f"{value:5d}") for item, value in header.items()]
    rows, columns = np.nonzero(np.abs(m0) >= SMALLEST)
    pairs = zip(rows + 1, columns + 1, strict=True)
    keys = [f"m0({row:2d},{column:2d})" for row, column in pairs]
    values = m0[rows, columns]
    for kind, part in (("m1", block.m1), ("mn", block.mn)):
        if part is not None:
            more, numbers = _higher(kind, part, style)
            keys += more
            values = np.concatenate([values, numbers])
    numbers_text = _reals(values, style)
    margin = 26 * " "
    lines += [
        f"{margin}{key:<22}={value}\n"
        for key, value in zip(keys, numbers_text, strict=True)
    ]
    lines.append(_line(indent, f"end {name}"))
    return "".join(lines)


def _higher(kind: str, part: Array, style: Style) -> tuple[list[str], Array]:
    """Keys and values of m1 or mn: column outermost, then row, mode fastest."""
    by_column = part.transpose(2, 1, 0)
    columns, rows, modes = np.nonzero(np.abs(by_column) >= SMALLEST)
    values = by_column[columns, rows, modes]
    second, third = modes, columns
    if style.layout.m1_index == "rcl":
        second, third = columns, modes
    indices = zip(rows.tolist(), second.tolist(), third.tolist(), strict=True)
    keys = [f"{kind}({r + 1:2d},{s + 1:2d},{t + 1:2d})" for r, s, t in indices]
    return keys, values


def _stored(m0: Array, style: Style, symmetric: bool) -> tuple[Array, int]:
    """What a dialect stores of m0, and the structure it declares."""
    size = np.abs(m0).max(initial=0.0)
    if not symmetric or np.abs(m0 - m0.T).max(initial=0.0) > ROUNDING * size:
        return m0, 3
    mean = mean_of_halves(m0)
    if style.stored == "diagonal":
        off_diagonal = mean - np.diag(np.diag(mean))
        return (mean, 3) if off_diagonal.any() else (mean, 1)
    return (np.tril(mean), 2) if style.stored == "lower" else (mean, 2)


def _arranged(name: str, block: Taylor, nq: int, style: Style) -> Taylor:
    """A body block in the columns and the shape of the dialect."""
    columns = {"Gr": style.layout.gr, "Ge": style.layout.ge}.get(name)
    if columns == "mode":
        return layout.changed(block, lambda part: layout.mode_major(part, nq))
    if name == "J" and style.j_is_3x3:
        return layout.changed(block, lambda part: symmetric_3x3(part[..., 0]))
    return block


def _tag(sid: SID, style: Style) -> Layout | None:
    """The layout to mark in the title: always, unless readers find the canonical one.

    They do when the identities prove it and the title names no other writer.
    """
    if style.layout is not LAYOUTS["fembs"]:
        return style.layout
    named = layout_from_words(ascii_text(sid.title))
    misleading = named is not None and named != style.layout
    j1, cr1 = sid.J.first_order(sid.nq), sid.Cr.first_order(sid.nq)
    proofs = (
        (sid.Gr.m0, layout.gr_errors(sid.Gr.m0, j1)),
        (sid.Ge.m0, layout.ge_errors(sid.Ge.m0, cr1)),
    )
    proven = all(
        sid.nq < 2 or not columns.any() or layout.confident(errors) == "axis"
        for columns, errors in proofs
    )
    return style.layout if misleading or not proven else None


def _line(indent: int, key: str, value: str | None = None) -> str:
    left = " " * indent + key
    return f"{left}\n" if value is None else f"{left:<{_EQUALS}}={value}\n"


def _real(value: float, style: Style) -> str:
    return _reals(np.array([value]), style)[0]


def _reals(values: Array, style: Style) -> list[str]:
    if not len(values):
        return []
    text = "\n".join([style.number] * len(values)) % tuple(values.tolist())
    return text.replace("E", style.letter).split("\n")
