"""The command line ``sidtool COMMAND``; expensive imports are deferred to commands."""

import io
import os
import sys
import warnings
from collections.abc import Sequence
from traceback import walk_tb
from typing import NoReturn, TextIO

import click

from sidtool.formats.base.errors import InputError, printable
from sidtool.formats.base.interruptible import is_work_left
from sidtool.formats.diagnostics.record import DiagnosticWarning
from sidtool.formats.storage.operating_system import (
    DEFAULT,
    ENDING_SIGNALS,
    INTERRUPT,
    end_children_with_this_process,
    handle_console_close,
    handle_signal,
    is_closed_pipe,
    is_usual_interrupt,
    present_signals,
    signal_handler,
)
from sidtool.formats.storage.unreadable import failure_reason

from .. import __version__
from .analyse import analyse
from .common import (
    JSON,
    QUIET,
    count_warnings_if_strict,
    print_on_stderr,
    print_remarks,
    print_warnings,
)
from .convert import convert, stations
from .export import export, fmu
from .linearise import linearise, response
from .plot import animate, plot, report
from .progress import show_progress
from .sensitivity import identify, optimise, sensitivity
from .simulate import simulate
from .small_commands import demo, explain, info, new, outputs, schema, warmup
from .study import study, sweep
from .validate import trim, validate

BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130
_show_warning = warnings.showwarning


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="sidtool")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Flexible bodies for multibody simulation.

    Converts a part from its geometry to Standard Input Data (SID), validates any SID,
    and simulates mechanisms with it. Start with the demonstration, or do the same step
    by step:

    \b
      sidtool demo
      sidtool new my_first --from beam
      sidtool convert rod_q4.toml -o rod.SID_FEM
      sidtool validate rod.SID_FEM
      sidtool simulate slider_crank.toml -o motion.csv

    Help on each command: sidtool COMMAND --help
    """
    ctx.with_resource(show_progress())


for command in (
    new,
    convert,
    stations,
    simulate,
    analyse,
    linearise,
    response,
    validate,
    info,
    outputs,
    plot,
    animate,
    export,
    fmu,
    report,
    study,
    sweep,
    sensitivity,
    optimise,
    identify,
    trim,
    demo,
    explain,
    schema,
    warmup,
):
    cli.add_command(command)

#: Commands with --json and --quiet; validate, outputs and export define their own.
for command in (
    convert,
    stations,
    simulate,
    fmu,
    info,
    linearise,
    response,
    study,
    sweep,
    sensitivity,
    optimise,
    identify,
    trim,
    *analyse.commands.values(),
):
    command.params.append(JSON)
ANALYSES = linearise, response, *analyse.commands.values()
for command in (
    convert,
    export,
    simulate,
    fmu,
    study,
    sweep,
    sensitivity,
    optimise,
    identify,
    *ANALYSES,
):
    count_warnings_if_strict(command)
for command in (convert, stations, simulate, study, validate, outputs, plot, animate):
    command.params.append(QUIET)
for command in (
    export,
    sweep,
    sensitivity,
    optimise,
    identify,
    report,
    trim,
    fmu,
    warmup,
    demo,
    *ANALYSES,
):
    command.params.append(QUIET)


class TerminationRequested(BaseException):
    """Raised on a signal that terminates the program, to clean up as after Ctrl-C."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def _terminate(number: int, frame: object) -> NoReturn:
    raise TerminationRequested(number)


def _interrupt(number: int, frame: object) -> NoReturn:
    """Raise KeyboardInterrupt once; a second Ctrl-C ends the program at once."""
    handle_signal(number, DEFAULT)
    raise KeyboardInterrupt


def _ending_signals() -> list[int]:
    """Return signals that terminate without clean-up and are not ignored (nohup)."""
    numbers = [n for n in present_signals(ENDING_SIGNALS) if n != INTERRUPT]
    return [n for n in numbers if signal_handler(n) is DEFAULT]


def main() -> NoReturn:
    """Run the command line and exit with its status."""
    _open_standard_streams()
    warnings.showwarning = _print_warning
    handle_console_close()
    end_children_with_this_process()
    before = {number: handle_signal(number, _terminate) for number in _ending_signals()}
    if is_usual_interrupt(signal_handler(INTERRUPT)):
        before[INTERRUPT] = handle_signal(INTERRUPT, _interrupt)
    status = run(sys.argv[1:])
    for number, handler in before.items():
        handle_signal(number, handler)
    if is_work_left():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


def _open_standard_streams() -> None:
    """Replace standard streams that the caller has closed (``>&-``) by discarding ones.

    Otherwise the next opened file would become the standard output. Characters that the
    encoding of a stream lacks are escaped.
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
    """Run a command; the exit status is 0 done, 1 failed, 2 bad input, 130 interrupted.

    After a terminating signal it is 128 plus the number of the signal, 143 for SIGTERM.
    """
    try:
        status = cli.main(list(arguments), prog_name="sidtool", standalone_mode=False)
        sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except click.ClickException as error:
        text = io.StringIO()
        error.show(text)
        print_on_stderr(text.getvalue().rstrip("\n"))
        return error.exit_code
    except InputError as error:
        names = [printable(part) for part in (error.source, error.place) if part]
        return _print_error(str(error), BAD_INPUT, names)
    except TerminationRequested as ended:
        return _print_error("ended by a signal", 128 + ended.number)
    except (KeyboardInterrupt, click.Abort):
        return _print_error("interrupted", INTERRUPTED)
    except (BrokenPipeError, SystemExit):  # click turns the first into the second
        return _quit_quietly()
    except MemoryError:
        return _print_error("there is not enough memory for this", FAILED)
    except OSError as error:
        if is_closed_pipe(error) and _is_from_standard_output(error):
            return _quit_quietly()
        name = f"{error.filename}: " if error.filename else ""
        return _print_error(f"{name}{failure_reason(error)}", FAILED)


def _print_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print warnings of sidtool as messages, without the source line."""
    if isinstance(message, DiagnosticWarning):
        if message.code:
            print_warnings([message.diagnostic])
        else:
            print_remarks([str(message)], stderr=True)
    elif category.__module__.partition(".")[0] == "sidtool":
        _print_error(str(message), 0)
    else:
        _show_warning(message, category, filename, lineno, file, line)


def _print_error(message: str, status: int, names: Sequence[str] = ()) -> int:
    """Print an error in lines that fit on a screen; names in it stay whole."""
    print_on_stderr(f"sidtool: {message}", ("sidtool: ", *names))
    return status


def _is_from_standard_output(error: OSError) -> bool:
    """Return whether an error comes from the standard output, not from a file."""
    frames = [frame for frame, _ in walk_tb(error.__traceback__)]
    writers = click.echo.__code__, run.__code__
    return frames[-1].f_code in writers or any(f.f_code == writers[0] for f in frames)


def _quit_quietly() -> int:
    """Suppress messages at exit after the reader closed the pipe (``sidtool info x |
    head``).
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0
