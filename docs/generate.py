"""Writes the pages that follow from the source: formats, commands, the public names.

Every key of a format stands with its type, default, meaning and an example. Meanings
are those of the schema, examples are taken from files that are read: those of
`examples/` and of `docs/formats/`.
"""

from __future__ import annotations

import inspect
import json
import re
import tomllib
import types
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import click
import gallery
from docstrings import entries, sections
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

import sidtool
from sidtool.cli.main import cli
from sidtool.formats.design import DesignFile, read_design
from sidtool.formats.diagnostics.record import CATALOGUE, GROUPS, example_of
from sidtool.formats.model import ModelFile, read_model
from sidtool.formats.reference import ReferenceFile, read_reference
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.report.diagnostics import diagnostic_line

DOCS = Path(__file__).resolve().parent
ROOTS = {
    "scene": (SceneFile, read_scene, "Scene files"),
    "model": (ModelFile, read_model, "Model files"),
    "reference": (ReferenceFile, read_reference, "Reference files"),
    "design": (DesignFile, read_design, "Design files"),
}
Key = tuple[type[BaseModel], str]


def pages() -> dict[str, str]:
    """Name and content of every page."""
    found = examples()
    created = {f"{kind}.md": format_page(kind, found) for kind in ROOTS}
    return created | {
        "commands.md": commands_page(),
        "diagnostics.md": diagnostics_page(),
        "names.md": names_page(),
        **gallery.pages(),
    }


def write(folder: Path) -> None:
    """Write the pages, those only that have changed."""
    folder.mkdir(exist_ok=True)
    created = pages()
    for path in folder.glob("*.md"):
        if path.name not in created:
            path.unlink()
    for name, text in created.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def examples() -> dict[Key, Any]:
    """Return a value of every key of a file as it is written there."""
    found: dict[Key, Any] = {}
    files = sorted(DOCS.glob("formats/*.toml"))
    files += sorted((DOCS.parent / "examples").glob("*/*.toml"))
    for path in files:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
        kind = str(raw.get("format", "")).removeprefix("sidtool ")
        if kind in ROOTS:
            _collect(ROOTS[kind][1](path), raw, found)
    return found


def _collect(value: Any, raw: Any, found: dict[Key, Any]) -> None:
    if isinstance(value, BaseModel) and isinstance(raw, Mapping):
        for name, info in type(value).model_fields.items():
            key = info.alias or name
            if key in raw:
                found.setdefault((type(value), name), raw[key])
                _collect(getattr(value, name), raw[key], found)
    elif isinstance(value, Mapping) and isinstance(raw, Mapping):
        for name, part in value.items():
            _collect(part, raw.get(name), found)
    elif isinstance(value, tuple) and isinstance(raw, list):
        for part, single in zip(value, raw, strict=False):
            _collect(part, single, found)


def diagnostics_page() -> str:
    """Every diagnostic with an example, its meaning and its remedy, by subject."""
    parts = [
        "# Diagnostics\n",
        "What sidtool reports beside its numbers has a code. `sidtool explain CODE` "
        "prints the same text. Errors mean that a number does not exist, warnings that "
        "it may be wrong or misleading, notes need no action. `[diagnostics] ignore` "
        "in a scene or `--ignore CODE` switches a warning or note off; `--strict` lets "
        "warnings count for the exit status.\n",
    ]
    for group, title in GROUPS.items():
        parts.append(f"## {title}\n")
        for code, entry in CATALOGUE.items():
            if not code.startswith(group):
                continue
            example = example_of(entry)
            parts.append(f"### {code} ({entry.severity})\n")
            parts.append(f"```text\n{diagnostic_line(example)}\n```\n")
            parts.append(entry.explanation + "\n")
            if example.remedy:
                parts.append(f"What to do: {example.remedy}\n")
    return "\n".join(parts)


def tables(root: type[BaseModel]) -> list[type[BaseModel]]:
    """The tables of a format, in the order in which a reader meets them."""
    observed: list[type[BaseModel]] = []
    waiting = [root]
    while waiting:
        table = waiting.pop(0)
        if table not in observed:
            observed.append(table)
            for info in table.model_fields.values():
                waiting += _models(info.annotation)
    return observed


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


def keys(root: type[BaseModel]) -> Iterator[Key]:
    """Every key of a format."""
    for table in tables(root):
        for name in table.model_fields:
            yield table, name


def format_page(kind: str, found: Mapping[Key, Any]) -> str:
    """The page of a format."""
    root, _, title = ROOTS[kind]
    parts = [f"# {title}\n", _prose(root)]
    parts.append(
        f"`sidtool schema {kind}` prints the JSON Schema of these tables for editors.\n"
    )
    for table in tables(root):
        if table is not root:
            parts.append(f"## {_name(table)}\n\n{_prose(table)}")
        parts.append(_rows(table, found))
    return "\n".join(parts)


def _name(table: type[BaseModel]) -> str:
    """What its `type` or `method` says, or the words of the name of the class."""
    for key in ("type", "method", "shape"):
        info = table.model_fields.get(key)
        if info is not None and get_origin(info.annotation) is Literal:
            text = " or ".join(json.dumps(x) for x in get_args(info.annotation))
            return f"{_words(table)}: `{key} = {text}`"
    return _words(table)


def _words(table: type[BaseModel]) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", table.__name__).capitalize()


def _prose(table: type[BaseModel]) -> str:
    text = inspect.cleandoc(table.__doc__ or "")
    text = next(sections(text))[1]
    return re.sub(r"``(.+?)``", r"`\1`", text).strip() + "\n"


def _rows(table: type[BaseModel], found: Mapping[Key, Any]) -> str:
    described = _attributes(table)
    lines = ["| key | type | default | meaning | example |", "|---|---|---|---|---|"]
    for name, info in table.model_fields.items():
        key = info.alias or name
        meaning = info.description or described.get(name, "") or _meaning(key, info)
        meaning = re.sub(r"(`[^`]*`)|\*", lambda m: m[1] or "\\*", meaning)
        value = found.get((table, name), PydanticUndefined)
        example = "" if value is PydanticUndefined else f"`{_shown(key, value, info)}`"
        cells = [f"`{key}`", _type(info.annotation), _default(info), meaning, example]
        lines.append("| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |")
    return "\n".join(lines) + "\n"


def _meaning(key: str, info: FieldInfo) -> str:
    """What can be said of a key without a description of its own."""
    if key in ("type", "method", "shape"):
        return "the kind of this table"
    parts = list(_models(info.annotation))
    if len(parts) == 1:
        return _prose(parts[0]).split("\n\n")[0].replace("\n", " ").strip()
    if len(parts) > 1:
        return "one of: " + ", ".join(dict.fromkeys(map(_words, parts)))
    return {
        "title": "a text for reports",
        "format": "the kind of the file",
        "version": "of the format",
    }.get(key, "")


def _attributes(table: type[BaseModel]) -> dict[str, str]:
    """Meanings from the sections `Attributes` of a class and those it derives from."""
    found: dict[str, str] = {}
    for base in reversed(table.__mro__):
        text = inspect.cleandoc(base.__doc__ or "") if base is not object else ""
        for heading, section in sections(text):
            if heading == "Attributes":
                found |= {name: t for names, t in entries(section) for name in names}
    return found


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    value = info.get_default(call_default_factory=True)
    if value is None or value in ((), {}, "") or isinstance(value, BaseModel):
        return ""
    return f"`{json.dumps(value)}`"


def _shown(key: str, value: Any, info: FieldInfo, width: int = 64) -> str:
    """`key = value` as in a file; of long tables and lists their beginning."""
    if isinstance(value, Mapping) and _type(info.annotation) == "tables by name":
        return f"[{key}.{next(iter(value))}]"
    if isinstance(value, Mapping) and len(_toml(value)) > width:
        return f"[{key}]"
    text = _toml(value)
    tables = isinstance(value, list) and value and isinstance(value[0], Mapping)
    if tables and len(text) > width:
        return f"{key} = [{{ {next(iter(value[0]))} = ..., ... }}, ...]"
    return f"{key} = {text if len(text) <= width else text[: width - 4] + ' ...'}"


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        pairs = (f"{_key(name)} = {_toml(part)}" for name, part in value.items())
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)


def _key(name: str) -> str:
    """As TOML has it: with dots or wildcards in quotes."""
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else json.dumps(name)


_NAMES = {float: "number", int: "integer", str: "text", bool: "true or false"}


def _type(annotation: Any) -> str:
    """A type in words."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if annotation in _NAMES:
        return _NAMES[annotation]
    if annotation is type(None):
        return ""
    if origin is Annotated:
        return _type(parts[0])
    if origin is Literal:
        return " or ".join(f"`{json.dumps(part)}`" for part in parts)
    if origin in (Union, types.UnionType):
        return _listed([_type(part) for part in parts])
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return "table"
    if origin is not None and issubclass(origin, Mapping):
        return (
            "tables by name"
            if _type(parts[1]) == "table"
            else f"by name: {_type(parts[1])}"
        )
    if origin is tuple:
        return _tuple(parts)
    return str(annotation)


def _tuple(parts: Sequence[Any]) -> str:
    plural = {
        "number": "numbers",
        "integer": "integers",
        "text": "texts",
        "table": "tables",
    }
    kind = _type(parts[0])
    count = "" if parts[-1] is Ellipsis else f"{len(parts)} "
    return f"list of {count}{plural.get(kind, kind)}"


def _listed(kinds: Sequence[str]) -> str:
    return " or ".join(dict.fromkeys(kind for kind in kinds if kind))


def commands_page() -> str:
    """What `--help` says of every command."""
    parts = ["# Commands\n", "What `sidtool COMMAND --help` says.\n"]
    for path, command in _commands(cli, "sidtool"):
        with click.Context(command, info_name=path, max_content_width=88) as context:
            parts.append(f"## {path}\n\n```text\n{command.get_help(context)}\n```\n")
    return "\n".join(parts)


def _commands(group: click.Command, path: str) -> Iterator[tuple[str, click.Command]]:
    yield path, group
    for name, command in getattr(group, "commands", {}).items():
        yield from _commands(command, f"{path} {name}")


def names_page() -> str:
    """The public names, for Sphinx to fill in."""
    parts = [
        "# Public names\n",
        "Everything public is a name of `sidtool`; it is imported on first use.\n",
    ]
    tables = []
    for name in sidtool.__all__:
        value = getattr(sidtool, name)
        if inspect.isclass(value) and issubclass(value, BaseModel) and _is_part(value):
            tables.append(f"`{name}`")
            continue
        is_class = inspect.isclass(value)
        failed = is_class and issubclass(value, Exception)
        kind = "exception" if failed else "class" if is_class else "function"
        members = "\n   :members:" if is_class else ""
        directive = f".. auto{kind}:: sidtool.{name}{members}"
        parts.append(f"## {name}\n\n```{{eval-rst}}\n{directive}\n```\n")
    parts.append(
        "## Tables of files\n\nClasses with the keys, defaults and checks of the "
        f"tables of [scenes](scene.md) and [models](model.md): {', '.join(tables)}.\n"
    )
    return "\n".join(parts)


def _is_part(table: type[BaseModel]) -> bool:
    return table not in [root for root, _, _ in ROOTS.values()]
