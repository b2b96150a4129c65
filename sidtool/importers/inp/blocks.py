"""Keyword lines of Abaqus and CalculiX input files with their data lines."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from sidtool.formats.errors import InputError

from ..imported import read_lines
from ..included import Included, located_line

#: Commas outside double quotes.
_COMMA = re.compile(r',(?=(?:[^"]*"[^"]*")*[^"]*$)')


@dataclass(frozen=True)
class Block:
    """A keyword line with its data lines.

    Attributes
    ----------
    keyword : in capitals, words separated by one blank
    options : name in capitals -> value, "" for none
    rows : the words of every data line, "" for a blank one, and where it stands
    """

    keyword: str
    options: dict[str, str]
    place: str
    rows: list[tuple[list[str], str]] = field(default_factory=list)


def read_blocks(
    path: Path, included: Included | None = None, before: list[Block] | None = None
) -> list[Block]:
    """All blocks of a file and of the files that it includes, in order.

    An included file may go on with the data lines of the block that includes it.

    Parameters
    ----------
    before : the blocks that are read already, which those of the file join

    Raises
    ------
    InputError : names file and line.
    """
    included = included or Included()
    included.enter(path)
    blocks = [] if before is None else before
    nested = len(included.open) > 1
    for is_keyword, text, place in _statements(path, path.name if nested else ""):
        if not is_keyword:
            if not blocks:
                raise InputError(
                    f"found {text[:40]!r} before any keyword",
                    place=place,
                    expected="a line like *NODE",
                )
            blocks[-1].rows.append((fields(text), place))
            continue
        block = _keyword(text, place)
        if block.keyword == "INCLUDE":
            read_blocks(_named(path, block), included, blocks)
            continue
        blocks.append(block)
        if "INPUT" in block.options:
            file = _named(path, block)
            block.rows.extend(_data_of(file))
    included.open.pop()
    return blocks


def fields(text: str) -> list[str]:
    """The words of a data line; a comma at its end opens no further one."""
    words = [word.strip() for word in text.split(",")]
    return words[:-1] if len(words) > 1 and not words[-1] else words


def _statements(path: Path, name: str) -> Iterator[tuple[bool, str, str]]:
    """Keyword lines, continuation lines joined, and data lines, with their places.

    name : of a file that the deck takes in, for messages; else empty
    """
    pending, begun = "", ""
    for number, line in enumerate(read_lines(path), start=1):
        text, place = line.strip(), located_line(number, name)
        if not text or text.startswith("**"):
            continue
        starts = text.startswith("*")
        if pending and (starts or not _continues(text)):
            yield True, pending, begun
            pending = ""
        if not starts and not pending:
            yield False, text, place
            continue
        begun = begun if pending else place
        pending += text
        if not text.endswith(","):
            yield True, pending, begun
            pending = ""
    if pending:
        yield True, pending, begun


def _continues(text: str) -> bool:
    """Whether a line after a comma at the end of a keyword line holds parameters."""
    return text[0].isalpha() or text[0] == '"'


def _keyword(text: str, place: str) -> Block:
    words = [word.strip() for word in _COMMA.split(text[1:])]
    options = {}
    for word in words[1:]:
        name, _, value = word.partition("=")
        if name.strip():
            options[" ".join(name.upper().split())] = value.strip()
    return Block(" ".join(words[0].upper().split()), options, place)


def _named(path: Path, block: Block) -> Path:
    name = block.options.get("INPUT", "").strip('"')
    if not name:
        raise InputError(
            f"*{block.keyword} names no file",
            source=path,
            place=block.place,
            expected=f"*{block.keyword}, INPUT=FILE",
        )
    return path.parent / name


def _data_of(file: Path) -> Iterator[tuple[list[str], str]]:
    for is_keyword, text, place in _statements(file, file.name):
        if is_keyword:
            raise InputError(
                f"found {text[:40]!r}",
                place=place,
                expected="data lines only",
            )
        yield fields(text), place
