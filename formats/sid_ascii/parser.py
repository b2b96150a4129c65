"""The grammar of the ASCII SID file: lines in, `RawFile` out."""

import re

from ..base.errors import InputError
from ..base.sid import BLOCK_SHAPES, NODE_SHAPES
from .lines import LineReader, parse_integer, parse_real, shorten
from .raw_file import ExpansionEntries, RawFile, RawNode, RawReference, RawTaylor
from .title import split_title

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
