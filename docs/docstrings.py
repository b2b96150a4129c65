"""Docstrings as Sphinx is given them: names with what they mean, not with a type.

The source says `name : meaning [unit]` under headings such as Parameters, where numpy's
convention has a type, and in functions with few parameters without a heading. Types are
those of the signature.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

#: Fields of Sphinx by heading; attributes of a class are what it is made with.
FIELDS = {"Parameters": "param", "Attributes": "param", "Raises": "raises"}
_HEADING = re.compile(r"^(Parameters|Attributes|Raises|Returns)\n-+\n", re.MULTILINE)
_ENTRY = re.compile(r"([\w., ]+?)(?: \[[^\]]+\])? : (.*)|([\w, ]+) (\[.*)", re.DOTALL)


def sections(text: str) -> Iterator[tuple[str, str]]:
    """(heading, text) of a docstring, the heading "" first."""
    parts = _HEADING.split(text)
    yield "", parts[0]
    yield from zip(parts[1::2], parts[2::2], strict=True)


def entries(text: str) -> Iterator[tuple[list[str], str]]:
    """(names, meaning) of the entries of a section, which may share a line."""
    for entry in re.split(r"\n(?=\S)|; (?=\w+, \w+ :)", text.strip()):
        match = _ENTRY.fullmatch(entry)
        if match:
            names, meaning = (match[1], match[2]) if match[1] else (match[3], match[4])
            yield names.split(", "), " ".join(meaning.split())


def as_fields(text: str) -> str:
    """A docstring with fields of Sphinx for its sections."""
    parts = []
    for heading, section in sections(text):
        if heading == "Returns":
            parts.append(f":returns: {' '.join(section.split())}")
        else:
            kind = FIELDS.get(heading, "param")
            parts += [_paragraph(kind, part) for part in section.strip().split("\n\n")]
    return "\n\n".join(parts)


def _paragraph(kind: str, text: str) -> str:
    """A paragraph, or one list of the fields that it is."""
    found = list(entries(text))
    lines = [line for line in text.splitlines() if not line.startswith(" ")]
    if not found or len(found) < len(lines):
        return text
    return "\n".join(f":{kind} {name}: {t}" for names, t in found for name in names)
