"""Plain data (tables, lists, numbers, texts) as TOML that people read."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")
#: Width of a line; longer lists have one entry per line.
WIDTH = 88
#: Tables in each other that get a header of their own, such as [bodies.rod].
HEADERS = 2


def toml_text(data: Mapping[str, Any]) -> str:
    """A file with these entries, in their order; tables follow plain values."""
    return "\n\n".join(_tables(data, ())) + "\n"


def _tables(data: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    inner = {k: v for k, v in data.items() if len(path) < HEADERS and _is_table(v)}
    lines = [f"{_key(k)} = {_value(v)}" for k, v in data.items() if k not in inner]
    if path and (lines or not inner):
        lines.insert(0, f"[{'.'.join(map(_key, path))}]")
    found = ["\n".join(lines)] if lines else []
    for key, table in inner.items():
        found += _tables(table, (*path, key))
    return found


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


def _key(text: str) -> str:
    return text if _BARE.fullmatch(text) else _text(text)


def _value(value: Any, indent: str = "") -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        entries = (f"{_key(k)} = {_value(v, indent)}" for k, v in value.items())
        return f"{{{', '.join(entries)}}}"
    if isinstance(value, list | tuple):
        line = f"[{', '.join(_value(part, indent) for part in value)}]"
        if len(line) + len(indent) <= WIDTH - 20 or not value:
            return line
        more = indent + "    "
        parts = "".join(f"{more}{_value(part, more)},\n" for part in value)
        return f"[\n{parts}{indent}]"
    return _text(value) if isinstance(value, str) else repr(value)


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
