"""What several commands share: checks of targets, --quiet and --json."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from sidtool.formats.endings import WRITTEN, check_ending, kind_by_ending
from sidtool.formats.errors import InputError
from sidtool.formats.storage.operating_system import (
    STANDARD_OUTPUT,
    is_open_elsewhere,
    is_read_only,
    is_writable_folder,
    path_problem,
)

if TYPE_CHECKING:
    from ..report.result import Noted
    from ..scenes import Scene

existing = click.Path(path_type=Path)
target = click.Path(path_type=Path)


#: What files of these kinds have near their beginning.
_STARTS = {
    "page": (b'name="generator" content="sidtool',),
    "film": (b"GIF8", b"ftyp"),
    "export": (b"VTKHDF", b'<VTKFile type="Collection"'),
    "picture": (b"\x89PNG", b"<svg", b"%PDF"),
}
force = click.option(
    "--force",
    is_flag=True,
    help="Replace an output file even if it is not one that sidtool writes there.",
)

changes = click.option(
    "--set",
    "changes",
    metavar="KEY=VALUE",
    multiple=True,
    help="Another value for a key of the file, such as time.end=2, crank.mass=0.4 or "
    "parameters.n=8; may be given several times.",
)


@dataclass(frozen=True)
class Target:
    """A file that a command is to write: its option, path and kind, see `WRITTEN`."""

    option: str
    path: Path | None
    kind: str


def result_target(path: Path | None) -> Target:
    """Of an option -o that takes a result or, by its ending, a table."""
    return Target("-o", path, kind_by_ending(path, "result", "table"))


def read_changed(path: Path, changes: Sequence[str]) -> Scene:
    """A scene with the values of `--set`.

    Raises
    ------
    InputError : it is no scene, or a value or key does not fit.
    """
    from sidtool.formats.toml.files import settings

    from ..kinds import expect_kind
    from ..scenes import Scene

    expect_kind(path, "scene")
    return Scene.load(path, settings(changes))


def files_of(path: Path) -> list[Path]:
    """A file that people write, and the files that it names."""
    if path.suffix not in (".toml", ".json") or not path.is_file():
        return [path]
    from sidtool.formats.toml.reading import read_data

    texts: list[str] = []
    waiting: list[Any] = [read_data(path)]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, str):
            texts.append(value)
    return [path, *(path.parent / text for text in texts if _is_file(path, text))]


def _is_file(path: Path, text: str) -> bool:
    try:
        return (path.parent / text).is_file()
    except (OSError, ValueError):
        return False


def check_targets(
    targets: Sequence[Target], inputs: Sequence[str | Path], force: bool
) -> None:
    """Refuse files that must not or cannot be written, before any work is done.

    inputs : files that the command reads

    Raises
    ------
    InputError : a target is an input or another target, also through a link; it is a
        folder or in none; its ending belongs to another kind of file; or a file of
        another kind stands there and `force` is not given.
    """
    wanted = [(t, t.path) for t in targets if t.path is not None]
    for i, (target, path) in enumerate(wanted):
        if str(path) == "-":
            stdout = f"; {STANDARD_OUTPUT} is the standard output"
            raise InputError(
                "is no file name here",
                source="-",
                place=target.option,
                expected="a file" + (stdout if STANDARD_OUTPUT else ""),
            )
        _check_place(path)
        for other in map(Path, inputs):
            if _same(path, other):
                raise InputError(
                    "is read by this command and would be replaced",
                    source=path,
                    place=target.option,
                    expected="another name",
                )
        for earlier, name in wanted[:i]:
            if _same(path, name):
                raise InputError(
                    f"is what {earlier.option} writes, too",
                    source=path,
                    place=target.option,
                    expected="another name",
                )
        check_ending(path, target.kind, target.option)
        if not force:
            _check_present(target, path)


def _same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)


def _check_place(path: Path) -> None:
    if problem := path_problem(path):
        raise InputError(problem, source=path, expected="another name")
    if path.is_dir():
        raise InputError("is a folder", source=path, expected="the name of a file")
    folder = Path(os.path.realpath(path)).parent
    if path.exists() and not path.is_file():
        return
    if is_read_only(path):
        raise InputError(
            "is read-only", source=path, expected="a file that may be replaced"
        )
    if is_open_elsewhere(path):
        raise InputError(
            "is open in another program and cannot be replaced",
            source=path,
            expected="it to be closed there, or another name",
        )
    if not is_writable_folder(folder):
        raise InputError(
            "cannot be written here",
            source=path,
            expected=f"{folder} to be a folder with permission to write",
        )


def _check_present(target: Target, path: Path) -> None:
    """A file of another kind is not replaced without being told to."""
    if not path.is_file() or path.stat().st_size == 0:
        return
    if not _is_of_kind(path, target.kind):
        raise InputError(
            f"is there and is not {WRITTEN[target.kind].name} of sidtool's",
            source=path,
            place=target.option,
            expected="another name, or --force",
        )


def _is_of_kind(path: Path, kind: str) -> bool:
    from sidtool.formats.sid_ascii.title import is_own

    from ..kinds import kind_of

    if kind in _STARTS:
        with path.open("rb") as stream:
            start = stream.read(2048)
        return any(mark in start for mark in _STARTS[kind])
    if kind == "table":
        with path.open("rb") as stream:
            return stream.read(2) in (b"t,", b"t\n")
    if kind == "sweep":
        with path.open("rb") as stream:
            return stream.readline().rstrip().endswith(b",message")
    if kind == "modes":
        with path.open("rb") as stream:
            return b'"coordinates"' in stream.read(64)
    try:
        found = kind_of(path)
    except InputError:
        return False
    if kind == "sid" and found == "sid":
        with path.open("rb") as stream:
            start = stream.read(4096)
        return start[:1] == b"\x89" or is_own(start)
    return found == kind


def hush(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    """Of --quiet: what a command says on its standard output goes nowhere."""
    if value:
        ctx.meta[_QUIET] = sys.stdout  # which --json may want
        nowhere = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        ctx.with_resource(nowhere)
        ctx.with_resource(redirect_stdout(nowhere))


def as_data(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    """Of --json: `tell` alone writes to the standard output."""
    if value:
        ctx.meta[_JSON] = ctx.meta.get(_QUIET, sys.stdout)
        if _QUIET not in ctx.meta:
            ctx.with_resource(redirect_stdout(sys.stderr))


QUIET = click.Option(
    ["--quiet"],
    is_flag=True,
    expose_value=False,
    callback=hush,
    help="Say nothing but notes and errors, and the numbers of --json.",
)
JSON = click.Option(
    ["--json"],
    is_flag=True,
    expose_value=False,
    callback=as_data,
    help="Print the numbers as JSON; all else goes to the standard error.",
)
_QUIET, _JSON = "sidtool.quiet", "sidtool.json"


def is_quiet() -> bool:
    """Whether --quiet was given."""
    ctx = click.get_current_context(silent=True)
    return ctx is not None and _QUIET in ctx.meta


def for_json() -> TextIO | None:
    """Where --json writes that a command has of its own: --quiet does not hide it."""
    ctx = click.get_current_context(silent=True)
    return None if ctx is None else ctx.meta.get(_QUIET)


def tell_notes(found: Noted, warn: bool = True) -> None:
    """Writes the warnings of what was found to the standard error, and its other notes
    where nothing else shows them, with --quiet.

    warn : False where warnings have been written
    """
    for text in found.warnings if warn else ():
        click.echo(f"warning: {text}", err=True)
    if is_quiet():
        for text in found.notes:
            if text not in found.warnings:
                click.echo(f"note: {text}", err=True)


def tell_remarks(sentences: Iterable[str], err: bool = False) -> None:
    """Notes beside what a command says on its standard output, or with `err` and with
    --quiet on the standard error."""
    for sentence in sentences:
        click.echo(f"note: {sentence}", err=err or is_quiet())


def tell(text: str, data: Callable[[], Any]) -> None:
    """What a command found: the text, or with --json the data."""
    ctx = click.get_current_context(silent=True)
    stream = None if ctx is None else ctx.meta.get(_JSON)
    if stream is None:
        click.echo(text)
    else:
        from ..report.data import as_json

        click.echo(as_json(data()), file=stream)
