"""The command line: ``sidtool COMMAND``. Answers before anything heavy is imported."""

from __future__ import annotations

import gc
import os
import sys
import warnings
from collections.abc import Sequence
from traceback import walk_tb
from typing import NoReturn, TextIO

import click

from sidtool.formats.errors import InputError, NoteWarning, ValidityWarning
from sidtool.formats.storage.operating_system import (
    DEFAULT,
    ENDING_SIGNALS,
    INTERRUPT,
    handle_signal,
    is_closed_pipe,
    is_usual_interrupt,
    outlive_console,
    present_signals,
    signal_handler,
)
from sidtool.formats.storage.unreadable import reason_of

from .. import __version__
from .analyse import analyse
from .animate import animate
from .common import JSON, QUIET
from .convert import convert
from .demo import demo
from .export import export
from .info import info
from .new import new
from .plot import plot
from .progress import progress_shown
from .recorded import outputs
from .report import report
from .schema import schema
from .simulate import simulate
from .study import study, sweep
from .trim import trim
from .validate import validate
from .warmup import warmup

BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130
#: New objects between two searches for garbage: a command makes little, and all that
#: it imports would be searched through again and again. At its end nothing is.
GARBAGE_THRESHOLD = 500_000
_show_warning = warnings.showwarning


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="sidtool")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Flexible bodies for multibody simulation.

    Takes a part from its geometry to Standard Input Data (SID), judges any SID, and
    simulates mechanisms with it. A first look, and the same by hand:

    \b
      sidtool demo
      sidtool new my_first --from beam
      sidtool convert rod_q4.toml -o rod.SID_FEM
      sidtool validate rod.SID_FEM
      sidtool simulate slider_crank.toml -o motion.csv

    Each command explains itself: sidtool COMMAND --help
    """
    ctx.with_resource(progress_shown())


for command in (
    new,
    convert,
    simulate,
    analyse,
    validate,
    info,
    outputs,
    plot,
    animate,
    export,
    report,
    study,
    sweep,
    trim,
    demo,
    schema,
    warmup,
):
    cli.add_command(command)

#: Commands whose numbers `tell` gives; validate, outputs and export have their own.
for command in (
    convert,
    simulate,
    info,
    study,
    sweep,
    trim,
    *analyse.commands.values(),
):
    command.params.append(JSON)
for command in (convert, simulate, study, validate, outputs, plot, animate, export):
    command.params.append(QUIET)
for command in (sweep, report, trim, warmup, demo, *analyse.commands.values()):
    command.params.append(QUIET)


class Ended(BaseException):
    """A signal has told the program to end: it cleans up as after Ctrl-C."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def _end(number: int, frame: object) -> NoReturn:
    raise Ended(number)


def _interrupt(number: int, frame: object) -> NoReturn:
    """The first Ctrl-C cleans up; the second one ends the program as it is."""
    handle_signal(number, DEFAULT)
    raise KeyboardInterrupt


def _ending_signals() -> list[int]:
    """Those that end a program without cleaning up, and are not ignored (nohup)."""
    numbers = [n for n in present_signals(ENDING_SIGNALS) if n != INTERRUPT]
    return [n for n in numbers if signal_handler(n) is DEFAULT]


def main() -> NoReturn:
    """Run the command line and leave with its exit status."""
    _open_standard_streams()
    gc.set_threshold(GARBAGE_THRESHOLD)
    warnings.showwarning = _tell
    outlive_console()
    before = {number: handle_signal(number, _end) for number in _ending_signals()}
    if is_usual_interrupt(signal_handler(INTERRUPT)):
        before[INTERRUPT] = handle_signal(INTERRUPT, _interrupt)
    status = run(sys.argv[1:])
    for number, handler in before.items():
        handle_signal(number, handler)
    gc.freeze()
    sys.exit(status)


def _open_standard_streams() -> None:
    """A caller may have closed them (``>&-``): what is said there goes nowhere.

    Else the next file that is opened would be the standard output. Characters that a
    terminal or pipe cannot show, as of Greek in a code page of Windows, are escaped.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            setattr(sys, name, os.fdopen(nowhere, "w", encoding="utf-8"))
        stream = getattr(sys, name)
        if stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")


def run(arguments: Sequence[str]) -> int:
    """Exit status: 0 done, 1 failed or judged bad, 2 bad input, 130 interrupted.

    128 and the number of the signal if it was told to end by one, 143 for SIGTERM.
    """
    try:
        status = cli.main(list(arguments), prog_name="sidtool", standalone_mode=False)
        sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except InputError as error:
        return _complain(str(error), BAD_INPUT)
    except Ended as ended:
        return _complain("ended by a signal", 128 + ended.number)
    except (KeyboardInterrupt, click.Abort):
        return _complain("interrupted", INTERRUPTED)
    except (BrokenPipeError, SystemExit):  # click makes the second of the first
        return _closed_pipe()
    except MemoryError:
        return _complain("there is not enough memory for this", FAILED)
    except OSError as error:
        if is_closed_pipe(error) and _is_of_output(error):
            return _closed_pipe()
        name = f"{error.filename}: " if error.filename else ""
        return _complain(f"{name}{reason_of(error)}", FAILED)


def _tell(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Our own warnings as messages, without the line of code that they come from."""
    if issubclass(category, ValidityWarning):
        click.echo(f"warning: {message}", err=True)
    elif issubclass(category, NoteWarning):
        click.echo(f"note: {message}", err=True)
    elif category.__module__.partition(".")[0] == "sidtool":
        _complain(str(message), 0)
    else:
        _show_warning(message, category, filename, lineno, file, line)


def _complain(message: str, status: int) -> int:
    click.echo(f"sidtool: {message}", err=True)
    return status


def _is_of_output(error: OSError) -> bool:
    """Whether it arose where the standard output is written, not of another file."""
    frames = [frame for frame, _ in walk_tb(error.__traceback__)]
    writers = click.echo.__code__, run.__code__
    return frames[-1].f_code in writers or any(f.f_code == writers[0] for f in frames)


def _closed_pipe() -> int:
    """The reader has seen enough (``sidtool info x | head``): be quiet at exit, too."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0
