"""Reading an ASCII SID file of any known dialect.

The grammar of the ASCII SID file: lines in, `RawFile` out.

Assemble a SID, in the convention of memory, from the raw contents of a file.
"""

import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..base.errors import InputError
from ..base.sid import (
    BLOCK_SHAPES,
    J_INDICES,
    NODE_SHAPES,
    SID,
    Array,
    Dialect,
    Node,
    Taylor,
    block_shape,
)
from ..storage.unreadable import unreadable_error
from . import lines
from .codes import M0
from .expansion import (
    PRINT_NOISE,
    SYMMETRIC,
    ReadingContext,
    dense_expansion,
    header_value,
    shape_of_unknown_block,
    symmetrise,
)
from .lines import (
    ExpansionEntries,
    LineReader,
    RawFile,
    RawNode,
    RawReference,
    RawTaylor,
    ReadingNotes,
    parse_integer,
    parse_real,
    shorten,
)
from .title import Layout, layout_from_words, split_tag, split_title

#: More would be a damaged file, and its matrices would not fit into memory.
MAX_MODES = 2000

_BLOCKS = {name.lower(): name for name in BLOCK_SHAPES} | {"mcm": "mdCM", "mmi": "J"}
_NODE_ENTRIES = {name.lower(): name for name in NODE_SHAPES}
_RESERVED = {"part", "modal", "refmod", "frame", "node", "rframe", "end", "new"}
_LABEL = re.compile(r"ielastq\s*\(\s*(\d{1,6})\s*\)", re.ASCII)
_BLOCK_NAME = re.compile(r"[A-Za-z]\w{0,39}", re.ASCII)


def parse_sid(lines: LineReader) -> RawFile:
    """A whole file; the entries are not interpreted.

    Raises
    ------
    InputError : the file does not follow the grammar; names the line.
    """
    counts, title, text = _parse_title(lines)
    closings, name = [], ""
    if _normalise_keyword(text) == "part":
        closings.append("end part")
        text = lines.next("part", "'new modal'")
    key, _, value = text.partition("=")
    if _normalise_keyword(key) == "new modal":
        closings.append("end modal")
        name = " ".join(value.split())
        text = lines.next("new modal", "'refmod'")
    _expect_line(lines, text, "refmod")
    reference = _parse_refmod(lines)
    text = lines.next("the body", "'frame'")
    if _normalise_keyword(text) != "new frame":
        _expect_line(lines, text, "frame")
    nodes = _parse_frame(lines)
    blocks = _parse_blocks(lines, closings)
    for text in lines:
        raise _unexpected(lines, text, "nothing after the end of the body")
    return RawFile(
        title, counts, name, reference, nodes, blocks, last_line=lines.number
    )


def _parse_title(lines: LineReader) -> tuple[tuple[int, int] | None, str, str]:
    """Counts, text of the title, and the first line behind it."""
    first = next(iter(lines), None)
    if first is None:
        raise lines.error("the file is empty", "a SID file in ASCII or HDF5")
    if _normalise_keyword(first) in ("part", "new modal", "refmod"):
        return None, "", first
    title = split_title(first)
    if title is None:
        raise lines.error(
            f"'{shorten(first)}' does not begin a SID file",
            "a title with the numbers of nodes and modes, or 'part'",
        )
    return *title, lines.next("the title", "'part'")


def _parse_refmod(lines: LineReader) -> RawReference:
    mass: float | None = None
    nq: int | None = None
    nq_line = 0
    labels: dict[int, tuple[str, int]] = {}
    for text in lines:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals:
            _expect_line(lines, text, "end refmod")
            break
        label = _LABEL.fullmatch(key.lower())
        if key.lower() == "mass" and mass is None:
            mass = parse_real(value, lines)
        elif key.lower() == "nelastq" and nq is None:
            nq, nq_line = _mode_count(value, lines), lines.number
        elif label and int(label[1]) not in labels:
            labels[int(label[1])] = (" ".join(value.split("\t")), lines.number)
        else:
            problem = f"'{shorten(key)}' is unknown or given twice"
            raise lines.error(problem, "mass, nelastq, ielastq(n) or 'end refmod'")
    else:
        raise lines.truncation_error("refmod", "'end refmod'")
    if mass is None or nq is None:
        missing = "mass" if mass is None else "nelastq"
        raise lines.error(f"refmod has no {missing}", f"'{missing} = ...'")
    for index, (_, number) in labels.items():
        if not 1 <= index <= nq:
            problem = f"ielastq({index}) for {nq} elastic coordinates"
            raise lines.error(problem, f"an index from 1 to {nq}", number)
    texts = tuple(labels.get(index + 1, ("", 0))[0] for index in range(nq))
    return RawReference(mass, nq, texts, nq - len(labels), nq_line)


def _mode_count(text: str, lines: LineReader) -> int:
    nq = parse_integer(text, "nelastq", lines)
    if nq > MAX_MODES:
        raise lines.error(f"nelastq = {nq}", f"at most {MAX_MODES} elastic coordinates")
    return nq


def _parse_frame(lines: LineReader) -> tuple[RawNode, ...]:
    nodes: list[RawNode] = []
    known: dict[str, int] = {}
    for text in lines:
        key, equals, value = text.partition("=")
        if not equals:
            _expect_line(lines, text, "end frame", " or 'new node = ...'")
            return tuple(nodes)
        name = " ".join(value.split())
        if _normalise_keyword(key) != "new node" or not name:
            raise _unexpected(lines, text, "'new node = <id>' or 'end frame'")
        if name in known:
            problem = f"node {shorten(name)} is in line {known[name]} already"
            raise lines.error(problem, "one node per id")
        known[name] = lines.number
        nodes.append(_parse_node(lines, name))
    raise lines.truncation_error("frame", "'end frame'")


def _parse_node(lines: LineReader, name: str) -> RawNode:
    start, rframe = lines.number, ""
    entries: dict[str, RawTaylor] = {}
    inside = f"node {shorten(name)}"
    expected = ", ".join(NODE_SHAPES)
    for text in lines:
        key, equals, value = text.partition("=")
        if equals and key.strip().lower() == "rframe" and not rframe:
            rframe = " ".join(value.split())
            continue
        keyword = _normalise_keyword(text)
        if keyword == "end node":
            break
        entry = _NODE_ENTRIES.get(keyword)
        if entry is None or entry in entries:
            problem = f"'{shorten(text)}' is unknown or given twice in {inside}"
            raise lines.error(problem, f"rframe, {expected} or 'end node'")
        entries[entry] = _parse_expansion(lines, text)
    else:
        raise lines.truncation_error(inside, "'end node'")
    return RawNode(name, start, rframe or "body ref", entries)


def _parse_blocks(lines: LineReader, closings: list[str]) -> dict[str, RawTaylor]:
    blocks: dict[str, RawTaylor] = {}
    expected = "a block such as mdCM, J, Ct" + (" or 'end modal'" if closings else "")
    for text in lines:
        keyword = _normalise_keyword(text)
        if closings and keyword == closings[-1]:
            closings.pop()
            break
        if not _BLOCK_NAME.fullmatch(text) or keyword in _RESERVED | set(_NODE_ENTRIES):
            raise _unexpected(lines, text, expected)
        name = _BLOCKS.get(keyword, text)
        if name in blocks:
            problem = f"block {name} is in line {blocks[name].line} already"
            raise lines.error(problem, "each block once")
        blocks[name] = _parse_expansion(lines, text)
    for closing in reversed(closings):
        _expect_line(lines, lines.next("the body", f"'{closing}'"), closing)
    return blocks


def _parse_expansion(lines: LineReader, name: str) -> RawTaylor:
    """One expansion, from behind its name to its end."""
    entries = ExpansionEntries(name, lines)
    entries.add_ahead()
    for text in lines:
        key, equals, value = text.partition("=")
        if not equals:
            _expect_line(lines, text, f"end {name}", " or an entry 'm0(...) = ...'")
            return entries.finish()
        entries.add(key, value)
        entries.add_ahead()
    raise lines.truncation_error(name, f"'end {name}'")


def _normalise_keyword(text: str) -> str:
    """A line in small letters and with single blanks."""
    return " ".join(text.split()).lower()


def _expect_line(lines: LineReader, text: str, keyword: str, or_else: str = "") -> None:
    if _normalise_keyword(text) != keyword.lower():
        raise _unexpected(lines, text, f"'{keyword}'{or_else}")


def _unexpected(lines: LineReader, text: str, expected: str) -> InputError:
    return lines.error(f"'{shorten(text)}' cannot stand here", expected)


_REQUIRED_IN_NODE = tuple(name for name in NODE_SHAPES if name != "sigma")


def assemble(raw: RawFile, source: str) -> SID:
    """Make the SID of a raw file; `SID.dialect` holds what was detected.

    Raises
    ------
    InputError : a block is missing, or its entries do not fit.
    """
    notes = ReadingNotes()
    marked = split_tag(raw.title)
    tag, title = marked.layout, marked.text
    hint = tag or layout_from_words(title)
    nq = raw.reference.nq
    _note_counts(raw, notes)
    order = lines.detect_m1_index(list(_expansion_sizes(raw)), nq, hint)
    if tag:
        order = tag.m1_index
    to = ReadingContext(source, nq, order, notes)
    _check_mode_count(raw, to)
    j_raw = _j_is_3x3(raw.blocks.get("J"))
    blocks = _blocks(raw, j_raw, to)
    gr, ge = _detect_layouts(blocks, tag, hint, notes)
    for name, columns in (("Gr", gr), ("Ge", ge)):
        if columns == "mode":
            blocks[name] = lines.rearrange(
                blocks[name], lambda part: lines.axis_from_mode_major(part, nq)
            )
    nodes = tuple(_assemble_node(node, to) for node in raw.nodes)
    extra = {
        name: dense_expansion(block, shape_of_unknown_block(block, to), name, to)
        for name, block in raw.blocks.items()
        if name not in BLOCK_SHAPES
    }
    _note_oe(blocks["Oe"], notes)
    _note_orientation(nodes, hint, tag, notes)
    dialect = Dialect(
        writer=_detect_writer(hint, tag, marked.by),
        gr_layout=gr,
        ge_layout=ge,
        m1_index=order,
        j_shape="3x3" if j_raw else "6x1",
        symmetric=_stored_halves(raw),
        exponent=_exponent_letter(raw),
        name=raw.name,
    )
    return SID(
        mass=raw.reference.mass,
        labels=raw.reference.labels,
        nodes=nodes,
        title=title,
        extra=extra,
        dialect=dialect,
        written_by=marked.by,
        carried=marked.carried,
        from_matrices=marked.from_matrices,
        has_peak_nodes=marked.has_peak_nodes,
        diagnostics=notes.diagnostics(),
        **blocks,  # type: ignore[arg-type]
    )


def _check_mode_count(raw: RawFile, to: ReadingContext) -> None:
    """All of a file against nelastq: then that is wrong, and not the first block."""
    declared_counts = {
        header_value(block, "nq", 0) for _, block in raw.expansions()
    } - {0}
    if len(declared_counts) == 1 and declared_counts != {to.nq}:
        (count,) = declared_counts
        problem = f"nelastq = {to.nq}, but all blocks declare nq = {count}"
        raise to.error(problem, f"nelastq = {count}", raw.reference.nq_line)


def _blocks(raw: RawFile, j_is_3x3: bool, to: ReadingContext) -> dict[str, Taylor]:
    """The eleven blocks as laid out in the file, but J in its six elements."""
    blocks = {}
    for name in BLOCK_SHAPES:
        shape = block_shape(name, to.nq)
        block = raw.blocks.get(name)
        if block is not None and name == "J" and j_is_3x3:
            blocks[name] = _six_elements(
                dense_expansion(block, (3, 3), name, to), to.notes
            )
        elif block is not None:
            blocks[name] = dense_expansion(block, shape, name, to)
        elif 0 in shape:
            blocks[name] = Taylor(np.zeros(shape))
        else:
            problem = f"the file ends without the block {name}"
            raise to.error(problem, f"'{name} ... end {name}'", raw.last_line)
    return blocks


def _assemble_node(raw: RawNode, to: ReadingContext) -> Node:
    entries = {}
    for name in _REQUIRED_IN_NODE:
        if name not in raw.entries and 0 not in block_shape(name, to.nq):
            expected = f"'{name} ... end {name}'"
            raise to.error(f"node {raw.id} has no {name}", expected, raw.line)
    for name in NODE_SHAPES:
        shape = block_shape(name, to.nq)
        if name in raw.entries:
            place = f"node {raw.id}, {name}"
            entries[name] = dense_expansion(raw.entries[name], shape, place, to)
        elif name != "sigma":
            entries[name] = Taylor(np.zeros(shape))
    return Node(id=raw.id, rframe=raw.rframe, **entries)  # type: ignore[arg-type]


def _expansion_sizes(raw: RawFile) -> Iterator[tuple[RawTaylor, int]]:
    """Every known expansion with the number of its columns."""
    j_columns = 3 if _j_is_3x3(raw.blocks.get("J")) else 1
    for name, expansion in raw.expansions():
        if name == "J":
            yield expansion, j_columns
        elif name in BLOCK_SHAPES or name in NODE_SHAPES:
            yield expansion, block_shape(name, raw.reference.nq)[1]


def _j_is_3x3(raw: RawTaylor | None) -> bool:
    if raw is None:
        return False
    kinds, rows, columns, _ = raw.codes.kinds_and_indices
    widest = int(columns[kinds == M0].max(initial=1))
    tallest = int(rows.max(initial=1))
    guess = 3 if widest > 1 and tallest <= 3 else 1
    return header_value(raw, "ncol", guess) == 3


def _six_elements(j: Taylor, notes: ReadingNotes) -> Taylor:
    """J (3, 3) as (6, 1); an element whose partner is missing counts for both."""
    rows, columns = np.transpose(J_INDICES)
    return lines.rearrange(
        j, lambda part: _mirror_tensors(part, notes)[..., rows, columns, None]
    )


def _mirror_tensors(tensors: Array, notes: ReadingNotes) -> Array:
    transposed = np.swapaxes(tensors, -1, -2)
    full = np.where(tensors == 0.0, transposed, tensors)
    transposed = np.swapaxes(full, -1, -2)
    difference = np.abs(full - transposed).max(initial=0.0)
    if difference > PRINT_NOISE * np.abs(full).max(initial=0.0):
        problem, taken = "not symmetric", "the mean of its halves is used"
        notes.add("N840", "J", problem=problem, taken=taken, remedy="")
    return symmetrise(full)


def _detect_layouts(
    blocks: dict[str, Taylor],
    tag: Layout | None,
    hint: Layout | None,
    notes: ReadingNotes,
) -> tuple[str, str]:
    """The column layouts of Gr and Ge."""
    if tag:
        return tag.gr, tag.ge
    nq = len(blocks["Me"].m0)
    j1, cr1 = blocks["J"].first_order(nq), blocks["Cr"].first_order(nq)
    errors = {
        "Gr": lines.gr_errors(blocks["Gr"].m0, j1),
        "Ge": lines.ge_errors(blocks["Ge"].m0, cr1),
    }
    hints = {"Gr": hint.gr if hint else None, "Ge": hint.ge if hint else None}
    layouts = {}
    for name in errors:
        layouts[name], certain = lines.choose_layout(errors[name], hints[name])
        if not certain and nq > 1 and blocks[name].m0.any():
            notes.add("N841", name, layout=layouts[name])
    return layouts["Gr"], layouts["Ge"]


def _detect_writer(hint: Layout | None, tag: Layout | None, by: str) -> str:
    if tag:
        return f"{by} in the layout of {tag.writer}"
    if by:
        return by
    return hint.writer if hint else "unknown"


def _stored_halves(raw: RawFile) -> str:
    """ "lower" if no symmetric matrix of the file has an entry above the diagonal."""
    has_entries = False
    for name in ("Me", "Ke", "De"):
        block = raw.blocks.get(name)
        if block is None or header_value(block, "structure", 0) != SYMMETRIC:
            continue
        kinds, rows, columns, _ = block.codes.kinds_and_indices
        if ((kinds == M0) & (rows < columns)).any():
            return "both"
        has_entries |= bool(((kinds == M0) & (rows > columns)).any())
    return "lower" if has_entries else "both"


def _exponent_letter(raw: RawFile) -> str:
    letters = [block.letter for _, block in raw.expansions() if len(block.codes)]
    return Counter(letters).most_common(1)[0][0] if letters else "D"


def _note_counts(raw: RawFile, notes: ReadingNotes) -> None:
    counts = (len(raw.nodes), raw.reference.nq)
    if raw.counts not in (None, counts):
        nodes, modes = raw.counts or counts
        announced = f"{nodes} nodes and {modes} modes"
        notes.add("N842", announced=announced, found=f"{counts[0]} and {counts[1]}")
    if raw.reference.missing_labels:
        count = raw.reference.missing_labels
        found = f"{counts[1] - count} labels"
        notes.add("N842", announced=f"{counts[1]} elastic coordinates", found=found)


def _note_oe(oe: Taylor, notes: ReadingNotes) -> None:
    """Oe1 must be symmetric in its two mode indices; PY_SID leaves xy, yz, xz out."""
    if oe.m1 is None:
        return
    asymmetry = np.abs(oe.m1 - np.swapaxes(oe.m1, 0, 1)).max()
    relative = asymmetry / np.abs(oe.m1).max() if asymmetry else 0.0
    if relative > PRINT_NOISE:
        problem = f"first order is not symmetric in the modes ({relative:.1e})"
        remedy = "`convert --repair` makes it symmetric."
        notes.add("N840", "Oe", problem=problem, taken="used as it is", remedy=remedy)


def _note_orientation(
    nodes: tuple[Node, ...],
    hint: Layout | None,
    tag: Layout | None,
    notes: ReadingNotes,
) -> None:
    if tag or hint is None or hint.writer != "FEMBeam":
        return
    for node in nodes:
        if np.abs(node.AP.m0 - np.eye(3)).max() > PRINT_NOISE:
            notes.add(
                "N840",
                f"node {node.id}, AP",
                problem="FEMBeam2SID writes the transpose of this orientation",
                taken="used as it is",
                remedy="`convert --repair` transposes it.",
            )


def read_ascii(path: str | os.PathLike[str]) -> SID:
    """Read the SID in an ASCII file; `SID.dialect` states how it was written.

    Numbers are not changed, even if the body is physically impossible.
    Symmetric matrices that the file stores twice are averaged where the two halves
    differ by print noise.

    Raises
    ------
    InputError : the file cannot be opened or is not a SID file; names the line.
    """
    source = os.fspath(path)
    try:
        with Path(path).open(encoding="latin-1") as stream:
            raw = parse_sid(LineReader(stream, source))
    except OSError as error:
        raise unreadable_error(source, "a SID file", error) from error
    try:
        # identities among numbers near the largest float may overflow harmlessly
        with np.errstate(over="ignore", invalid="ignore"):
            return assemble(raw, source)
    except InputError as error:
        raise error.located(source) from error
