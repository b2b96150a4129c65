"""Writes the page of the stable interface: `python docs/interface.py`.

The page is under version control. A test compares it with the source, so a change of a
public name, option, key or format is seen in the commit that makes it.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path

import generate
from pydantic import BaseModel

import sidtool
from sidtool.cli.main import cli
from sidtool.formats.sid_files import FORMATS
from sidtool.importers.mesh_files import MESH_READERS
from sidtool.pipeline.files import TEXT_FORMATS

PAGE = Path(__file__).resolve().parent / "interface.md"
INTRODUCTION = """# Stable interface

What a program, a script or a file of yours may rely on. Within one major version
nothing on this page is removed, renamed or given another meaning; names are added. All
else (modules, wording of messages, layout of printed tables) may change.

- Exit status: 0 success, 1 a run stopped or a judgement is bad, 2 wrong input, 128 and
  its number after a signal.
- Codes of [diagnostics](generated/diagnostics.md) keep their meaning and are not used
  again.
- Files of earlier versions, from 0.1 on, are read.

`python docs/interface.py` writes this page. A test fails where it differs from the
source.
"""


def page() -> str:
    """Return the text of the page."""
    sections = {
        "Python": python_names(),
        "Commands": commands(),
        "File keys": file_keys(),
        "File formats": formats(),
    }
    parts = [INTRODUCTION]
    for title, lines in sections.items():
        parts.append(f"## {title}\n\n```text\n" + "\n".join(lines) + "\n```\n")
    return "\n".join(parts)


def python_names() -> Iterator[str]:
    """Every public name with its parameters; classes of no table with their methods."""
    for name in sidtool.__all__:
        value = getattr(sidtool, name)
        if inspect.isclass(value) and issubclass(value, BaseModel):
            yield f"{name}({', '.join(value.model_fields)})"
        elif inspect.isclass(value):
            yield name
        else:
            yield f"{name}({_parameters(value)})"
        has_members = inspect.isclass(value) and name not in sidtool._TABLES
        for member in sorted(_members(value)) if has_members else ():
            found = inspect.getattr_static(value, member, None)
            function = getattr(found, "__func__", found)
            is_method = inspect.isfunction(function)
            call = f"({_parameters(function)})" if is_method else ""
            yield f"{name}.{member}{call}"


def _members(value: type) -> set[str]:
    """Public attributes and methods that sidtool itself gives a class."""
    is_table = issubclass(value, BaseModel)
    common = {"load", "save", "with_"} if is_table else set()
    inside = "sidtool.api." if is_table else "sidtool."
    own = [c for c in value.__mro__ if c.__module__.startswith(inside)]
    fields = set(value.model_fields) if is_table else set()
    names = {n for c in own for n in [*vars(c), *c.__dict__.get("__annotations__", {})]}
    hidden = fields | {"model_config", "model_post_init"}
    return {n for n in names if not n.startswith("_")} - hidden | common


def _parameters(function: object) -> str:
    parameters = inspect.signature(function).parameters.values()  # type: ignore[arg-type]
    return ", ".join(
        f"{p.name}=..." if p.default is not p.empty else str(p).split(":")[0]
        for p in parameters
        if p.name not in ("self", "cls")
    )


def commands() -> Iterator[str]:
    """Every command with its arguments and options."""
    for path, command in generate._commands(cli, "sidtool"):
        yield path
        for parameter in command.params:
            names = sorted([*parameter.opts, *parameter.secondary_opts])
            is_option = parameter.param_type_name == "option"
            yield f"    {', '.join(names) if is_option else names[0].upper()}"


def file_keys() -> Iterator[str]:
    """Every key of scenes, models and reference files, by table, with its type."""
    for kind, (root, _, _) in generate.ROOTS.items():
        for table, name in generate.keys(root):
            info = table.model_fields[name]
            key = info.alias or name
            yield f"{kind}: {table.__name__}.{key}: {generate._type(info.annotation)}"


def formats() -> Iterator[str]:
    """Formats of SIDs and endings of meshes."""
    yield from (f"text: {name}" for name in TEXT_FORMATS)
    yield from (f"SID: {form.name}" for form in FORMATS)
    yield from (f"mesh: {ending}" for ending in MESH_READERS)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
