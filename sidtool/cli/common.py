"""Options, input files, output files and printing that commands share."""

from __future__ import annotations

import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Container, Iterable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import update_wrapper
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_plain
from sidtool.formats.file_names import (
    INSTEAD,
    OUTPUT_KINDS,
    check_ending,
    kind_by_ending,
)
from sidtool.formats.storage.operating_system import (
    STANDARD_OUTPUT,
    is_open_in_other_program,
    is_read_only,
    is_writable_folder,
    path_problem,
)
from sidtool.formats.text import wrapped_lines

if TYPE_CHECKING:
    from sidtool.formats.diagnostics import Diagnostic
    from sidtool.solver.system.errors import SimulationError

    from ..api.scene import Scene


class _DecimalNumber(click.ParamType):
    """A finite number, without the further forms that `int` and `float` convert."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        number = super().convert(value, param, ctx)
        if not isfinite(number) or (isinstance(value, str) and not is_plain(value)):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


class Real(_DecimalNumber, click.types.FloatParamType):
    """A number."""


class RealRange(_DecimalNumber, click.FloatRange):
    """A number with limits."""


class IntegerRange(_DecimalNumber, click.IntRange):
    """An integer with limits."""


existing_file = click.Path(path_type=Path)
output_path = click.Path(path_type=Path)


#: Text near the beginning of a file of each kind.
_FILE_BEGINNINGS = {
    "stations": (b"# sidtool stations of a beam",),
    "page": (b'name="generator" content="sidtool',),
    "film": (b"GIF8", b"ftyp"),
    "export": (b"VTKHDF", b'<VTKFile type="Collection"'),
    "body": (
        b"written by sidtool",
        b"KAAX",
        b"$ Superelement",
        b"** MBDyn MODAL DATA FILE",
        b"massMatrixReduced.npy",
    ),
    "picture": (b"\x89PNG", b"<svg", b"%PDF"),
    "unit": (b"modelDescription.xml",),
    "state_space": (
        b"state_names.npy",
        b"MATLAB 5.0",
        b'"sidtool state space"',
        b"modelDescription.xml",
    ),
    "optimisation": (b'"sidtool optimisation"',),
    "campbell": (b"speed [rad/s],mode1.", b'"sidtool Campbell diagram"'),
    "response": (b"frequency [Hz]", b'"sidtool frequency response"'),
}
force_option = click.option(
    "--force",
    is_flag=True,
    help=("Replace an output file even if it is not a file that sidtool writes there."),
)

threads_option = click.option(
    "--jobs",
    type=IntegerRange(min=1),
    help="Number of threads; default one per core.",
)

method_option = click.option(
    "--method",
    type=click.Choice(["auto", "adjoint", "direct", "differences"]),
    default="auto",
    help=(
        "Derivatives of the motion: of the linearised run for all functionals (adjoint)"
        " or for all variables (direct) at once, or differences of runs; default auto."
    ),
)

verbose_option = click.option(
    "-v", "--verbose", is_flag=True, help="Print all rows of long tables."
)
#: Largest number of rows of a table on a screen.
MAX_ROWS = 38

_QUIET, _JSON = "sidtool.quiet", "sidtool.json"
_IGNORED, _STRICT, _WARNED = "sidtool.ignored", "sidtool.strict", "sidtool.warned"


def table_on_screen(report: Callable[[int | None], str], verbose: bool) -> str:
    """Return a report with as many rows as fit on a screen, or with all.

    report : returns the text with at most so many rows in each table
    """
    from sidtool.formats.text import fit_on_screen

    return fit_on_screen(report, MAX_ROWS, verbose)


rigid_option = click.option(
    "--rigid",
    "rigid",
    metavar="BODIES",
    multiple=True,
    callback=lambda _, __, texts: tuple(x for t in texts for x in listed_names(t)),
    help="Take bodies with a SID as rigid, such as arm or arm1,arm2.",
)

changes_option = click.option(
    "--set",
    "changes",
    metavar="KEY=VALUE",
    multiple=True,
    help=(
        "Set a key of the file to a value, such as time.end=2, crank.mass=0.4 "
        "or parameters.n=8; may be given several times."
    ),
)


@dataclass(frozen=True)
class Target:
    """An output file of a command: its option, path and kind, see `OUTPUT_KINDS`."""

    option: str
    path: Path | None
    kind: str


def result_target(path: Path | None) -> Target:
    """Return the target of an option -o that takes a result or, by its ending,
    a table.
    """
    return Target("-o", path, kind_by_ending(path, "result", "table"))


def picture_target(path: Path | None, kind: str) -> Target:
    """Return the target of an option -o that takes a file of a kind or, by its ending,
    its picture, or its report.
    """
    return Target("-o", path, kind_by_ending(path, kind, *INSTEAD[kind]))


def read_scene_with_changes(path: Path, changes: Sequence[str]) -> Scene:
    """Read a scene and apply the values of `--set`.

    Raises
    ------
    InputError : the file is not a scene, or a key or value is not valid.
    """
    from sidtool.formats.toml.files import ignoring, parse_settings

    from ..api.scene import Scene
    from ..pipeline.files import expect_kind

    expect_kind(path, "scene")
    scene = Scene.load(path, parse_settings(changes))
    ignored = ignored_codes()
    return ignoring(scene, ignored) if ignored else scene


def ignored_codes() -> tuple[str, ...]:
    """Return the codes of --ignore."""
    return click.get_current_context().meta.get(_IGNORED, ())


def input_files(path: Path) -> list[Path]:
    """Return the paths of a model or scene file and of the files that it names."""
    if path.suffix.lower() not in (".toml", ".json") or not path.is_file():
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
    """Refuse, before any computation, targets that must not or cannot be written.

    Parameters
    ----------
    inputs : files that the command reads

    Raises
    ------
    InputError : a target is an input or another target, also through a link; it is a
        folder or its folder does not exist; its ending belongs to another kind of file;
        or a file of another kind exists and `force_option` is not set.
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
        _check_folder(path)
        for other in map(Path, inputs):
            if _is_same_file(path, other):
                raise InputError(
                    "is read by this command and would be replaced",
                    source=path,
                    place=target.option,
                    expected="another name",
                )
        for earlier, name in wanted[:i]:
            if _is_same_file(path, name):
                raise InputError(
                    f"is what {earlier.option} writes, too",
                    source=path,
                    place=target.option,
                    expected="another name",
                )
        check_ending(path, target.kind, target.option)
        if not force:
            _check_existing(target, path)


def _is_same_file(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)


def _check_folder(path: Path) -> None:
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
    if is_open_in_other_program(path):
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


def _check_existing(target: Target, path: Path) -> None:
    """Refuse to replace a file of another kind without `force_option`."""
    if not path.is_file() or path.stat().st_size == 0:
        return
    if not _is_of_kind(path, target.kind):
        raise InputError(
            f"is there and is not {OUTPUT_KINDS[target.kind].name} of sidtool's",
            source=path,
            place=target.option,
            expected="another name, or --force",
        )


def _is_of_kind(path: Path, kind: str) -> bool:
    from sidtool.formats.sid_ascii.title import is_own

    from ..pipeline.files import kind_of

    if kind in _FILE_BEGINNINGS:
        with path.open("rb") as stream:
            start = stream.read(2048)
        return any(mark in start for mark in _FILE_BEGINNINGS[kind])
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
        detected = kind_of(path)
    except InputError:
        return False
    if kind == "sid" and detected == "sid":
        with path.open("rb") as stream:
            start = stream.read(4096)
        return start[:1] == b"\x89" or is_own(start)
    return detected == kind


def set_quiet(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    """Discard the standard output (option --quiet)."""
    if value:
        ctx.meta[_QUIET] = sys.stdout  # which --json may want
        nowhere = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        ctx.with_resource(nowhere)
        ctx.with_resource(redirect_stdout(nowhere))


def set_json(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    """Reserve the standard output for `print_result` (option --json)."""
    if value:
        ctx.meta[_JSON] = ctx.meta.get(_QUIET, sys.stdout)
        if _QUIET not in ctx.meta:
            ctx.with_resource(redirect_stdout(sys.stderr))


def set_ignored(ctx: click.Context, _: click.Parameter, codes: tuple[str, ...]) -> None:
    """Remember the codes of diagnostics that are not reported (option --ignore).

    Raises
    ------
    click.BadParameter : there is no such code.
    """
    from ..report.diagnostics import parse_code

    try:
        ctx.meta[_IGNORED] = tuple(map(parse_code, codes))
    except InputError as error:
        raise click.BadParameter(str(error)) from None


def set_strict(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    """Let warnings count for the exit status (option --strict)."""
    ctx.meta[_STRICT] = value


def count_warnings_if_strict(command: click.Command) -> None:
    """Add --ignore and --strict to a command, whose warnings may then fail it."""
    callback = command.callback
    assert callback is not None

    def checked(*arguments: Any, **options: Any) -> Any:
        outcome = callback(*arguments, **options)
        meta = click.get_current_context().meta
        if meta.get(_STRICT) and meta.get(_WARNED):
            raise click.exceptions.Exit(1)
        return outcome

    command.callback = update_wrapper(checked, callback)
    command.params += [IGNORE, STRICT]


IGNORE = click.Option(
    ["--ignore"],
    metavar="CODE",
    multiple=True,
    expose_value=False,
    callback=set_ignored,
    help="Do not report warnings of this code, such as N420; may be given several "
    "times (see `sidtool explain`).",
)
STRICT = click.Option(
    ["--strict"],
    is_flag=True,
    expose_value=False,
    callback=set_strict,
    help="End with exit status 1 if there are warnings.",
)
QUIET = click.Option(
    ["--quiet"],
    is_flag=True,
    expose_value=False,
    callback=set_quiet,
    help="Print nothing but warnings, errors, and the numbers of --json.",
)
JSON = click.Option(
    ["--json"],
    is_flag=True,
    expose_value=False,
    callback=set_json,
    help="Print the numbers as JSON; all else goes to the standard error.",
)


def is_quiet() -> bool:
    """Whether --quiet was given."""
    ctx = click.get_current_context(silent=True)
    return ctx is not None and _QUIET in ctx.meta


def json_stream() -> TextIO | None:
    """Return the stream of a command's own JSON, which --quiet does not discard."""
    ctx = click.get_current_context(silent=True)
    return None if ctx is None else ctx.meta.get(_QUIET)


def print_on_stderr(text: str, names: Iterable[str] = ()) -> None:
    """Print a text on the standard error, in lines that fit on a screen.

    names : files and keys in it, which stay whole
    """
    click.echo(wrapped_lines(text, names), err=True)


def print_warnings(
    diagnostics: Iterable[Diagnostic], printed: Container[Diagnostic] = ()
) -> None:
    """Print errors and warnings to the standard error, also with --quiet and --json.

    printed : diagnostics that have been printed before
    """

    from ..report.diagnostics import diagnostic_line

    for each in diagnostics:
        if each.is_warning and each not in printed:
            print_on_stderr(diagnostic_line(each))
            click.get_current_context().meta[_WARNED] = True


def print_failure(error: SimulationError, scene: Path) -> None:
    """Print why a run or an analysis stopped, and its causes."""
    from ..report.diagnostics import diagnostic_lines
    from ..report.json_data import failure_data

    t = error.diagnostics[0].t
    outcome = "failed" if t is None else f"stopped at t = {t:.9g} s"
    print_on_stderr(f"sidtool: {scene}: {outcome}", [str(scene)])
    print_on_stderr(diagnostic_lines(error.diagnostics))
    if error.result is None:
        print_data(lambda: failure_data(error))


def name_with_size(path: Path) -> str:
    """Return the name of a file with its size, as in "r.h5 (0.4 MB)"."""
    size = path.stat().st_size if path.is_file() else 0
    text = f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"
    return f"{path} ({text})"


def listed_names(text: str) -> list[str]:
    """Return names that an option separates by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def print_remarks(sentences: Iterable[str], stderr: bool = False) -> None:
    """Print notes on the standard output, with `stderr` or --quiet on the standard
    error.
    """
    from ..report.diagnostics import remark_line

    for sentence in sentences:
        click.echo(remark_line(sentence), err=stderr or is_quiet())


def print_result(text: str, data: Callable[[], Any]) -> None:
    """Print the result of a command: the text, or with --json the data."""
    ctx = click.get_current_context(silent=True)
    stream = None if ctx is None else ctx.meta.get(_JSON)
    if stream is None:
        click.echo(text)
    else:
        from ..report.json_data import to_json_text

        click.echo(to_json_text(data()), file=stream)


def print_data(data: Callable[[], Any]) -> None:
    """Print the data of a command that failed, with --json."""
    ctx = click.get_current_context(silent=True)
    if ctx is not None and _JSON in ctx.meta:
        print_result("", data)


class PipedPath(click.Path):
    """Parameter type: the path of a file, or of a copy of the content of a pipe or
    device.
    """

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Path:
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        if ctx is None or not _is_pipe(path):
            return path
        folder = Path(tempfile.mkdtemp(prefix="sidtool-"))
        ctx.call_on_close(lambda: shutil.rmtree(folder, ignore_errors=True))
        copy = folder / path.name
        with path.open("rb") as source, copy.open("wb") as target:
            shutil.copyfileobj(source, target)
        return copy


def _is_pipe(path: Path) -> bool:
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or stat.S_ISSOCK(mode)


piped_path = PipedPath()


full_fields = click.option(
    "--field",
    "fields",
    metavar="BODY=FILE",
    multiple=True,
    help=(
        "Full field of a flexible body, from `convert --field`; may be given "
        "several times. A file NAME.field.h5 next to the SID of a scene is "
        "found automatically."
    ),
)


def files_by_body(
    option: str,
    texts: Iterable[str],
    bodies: Iterable[str] | None = None,
    what: str = "BODY",
) -> dict[str, str]:
    """Return files by body, from an option that may be given several times.

    bodies : bodies that may be named; None if they are not known
    what : what the names are of, if not of bodies

    Raises
    ------
    InputError : a text is not BODY=FILE, names an unknown body, or names a body twice.
    """
    known = None if bodies is None else tuple(bodies)
    expected = f"{what}=FILE" + (
        f" with a {what} out of {', '.join(known)}" if known else ", as in rod=rod.h5"
    )
    files: dict[str, str] = {}
    for text in texts:
        body, _, file = text.partition("=")
        if not body or not file or (known is not None and body not in known):
            raise InputError(f"found {text!r}", place=option, expected=expected)
        if body in files:
            raise InputError(
                f"{body} has two files, {files[body]} and {file}",
                place=option,
                expected="one file for each body",
            )
        files[body] = file
    return files
