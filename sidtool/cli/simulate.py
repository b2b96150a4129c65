"""``sidtool simulate``: simulate a scene and write its result files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import report_stage
from sidtool.formats.storage.operating_system import ENDING_SIGNALS

from ..api.interrupts import StopRequest, stop_on_signals
from .common import (
    Real,
    Target,
    changes_option,
    check_targets,
    existing_file,
    files_by_body,
    force_option,
    input_files,
    output_path,
    print_failure,
    print_result,
    print_warnings,
    read_scene_with_changes,
    result_target,
    rigid_option,
)

if TYPE_CHECKING:
    from sidtool.formats.diagnostics import Diagnostic
    from sidtool.formats.result import Result
    from sidtool.formats.scene import SceneFile

    from ..api.scene import Scene
    from .result_files import OutputFiles


@click.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "-o",
    "--output",
    "outputs",
    type=output_path,
    multiple=True,
    help="Result to write (.h5), or recorded outputs as a table (.csv); may be given "
    "once for each.",
)
@click.option(
    "--integrator",
    metavar="NAME",
    help="radau9 (default), auto, ...; see `sidtool schema scene`.",
)
@click.option("--rtol", type=Real(), help="Relative tolerance, for example 1e-6.")
@click.option(
    "--accuracy",
    "accuracy",
    metavar="ERROR",
    multiple=True,
    help=(
        "Find the fastest model whose outputs have an error of at most this "
        "fraction of their variation, such as 1e-3; or OUTPUT=ERROR for "
        "selected outputs, several times."
    ),
)
@click.option("--step", type=Real(), help="Fixed step in seconds, no error control.")
@click.option(
    "--spectral-radius",
    type=Real(),
    metavar="RHO",
    help=(
        "Of generalised_alpha, 0 to 1: factor per step on the amplitude of "
        "vibrations that are too fast for the steps."
    ),
)
@click.option(
    "--sid",
    "swaps",
    metavar="BODY=FILE",
    multiple=True,
    help="Use another SID for a body; may be given several times.",
)
@rigid_option
@click.option(
    "--input",
    "inputs",
    metavar="NAME=FILE",
    multiple=True,
    help="Table of an input of the scene: CSV with columns t and value; may be given "
    "several times.",
)
@click.option(
    "--continue",
    "goes_on",
    is_flag=True,
    help=(
        "Continue the run in the file of -o with the same scene and options: an"
        " unfinished run, or a complete one with a later time.end; without such"
        " a file start a new run."
    ),
)
@changes_option
@force_option
@click.option(
    "-v",
    "--verbose",
    is_flag=True,
    help="Print all counters, all diagnostics, and the tables of --accuracy.",
)
@click.option(
    "--accept-defects",
    is_flag=True,
    help=(
        "Accept impossible mass matrices, and joints or forces on nodes that no"
        " shape function moves, which are refused otherwise."
    ),
)
def simulate(
    scene: Path,
    outputs: tuple[Path, ...],
    integrator: str | None,
    rtol: float | None,
    step: float | None,
    spectral_radius: float | None,
    swaps: tuple[str, ...],
    rigid: tuple[str, ...],
    accuracy: tuple[str, ...],
    inputs: tuple[str, ...],
    goes_on: bool,
    changes: tuple[str, ...],
    force: bool,
    verbose: bool,
    accept_defects: bool,
) -> None:
    """Simulate the motion of a SCENE and report cost and accuracy.

    The scene specifies the model and the integration; options override it. `sidtool
    info SCENE` shows what would be simulated, `sidtool info RESULT` what each shape
    function contributed. Before the run one line per flexible body compares its
    frequencies with the excitation and estimates whether geometric stiffening matters.
    After the run the estimate is repeated for the largest loads that occurred.

    With --accuracy, or `wanted` in the table [accuracy] of the scene, the model is
    chosen by measurement. Shape functions, flexibility of bodies and terms are omitted,
    and integrator and tolerance are chosen, as far as the allowed error permits. Each
    choice is listed with its reason, and the result holds the estimated error of every
    output and the cost. The choice is cached: a second run needs no search.

    Tables [events.NAME] of the scene define events: the time of each crossing of a
    value is reported, and `action = "stop"` ends the run there.

    \b
    Examples:
      sidtool simulate slider_crank.toml -o result.h5 -o motion.csv
      sidtool simulate slider_crank.toml --sid rod=rod_iga.SID_FEM -o iga.csv
      sidtool simulate slider_crank.toml --rigid rod -o rigid.csv
      sidtool simulate slider_crank.toml --integrator radau13 --rtol 1e-8
      sidtool simulate slider_crank.toml --accuracy 1e-3 -o result.h5
      sidtool simulate slider_crank.toml --accuracy "piston.x=1e-6 m"
      sidtool simulate slider_crank.toml --set piston.mass=6 --set time.end=1
      sidtool simulate arm.toml --input torque=torque.csv -o result.h5
      sidtool simulate slider_crank.toml -o result.h5 --continue
      sidtool simulate slider_crank.toml -o result.h5 --continue --set time.end=9

    Ctrl-C, SIGTERM and SIGHUP end a run at its next step. Its files hold the motion so
    far, marked as unfinished, and `--continue` continues the run. A second signal ends
    the program at once. On Windows these are Ctrl-C, Ctrl-Break and the closing of the
    console. If the program is killed, existing files stay unchanged.

    A warning on the standard error names bodies that leave linear theory (a deformation
    above a tenth of the size, or an elastic rotation above 0.15 rad).

    Exit status: 0 done, or ended by an event; 1 the run stopped early, or a body
    deformed by more than its own size, so that its numbers are meaningless (the files
    hold the motion so far); 128 + N ended by signal N, 130 by Ctrl-C (likewise); 2 the
    input is wrong, and nothing is written.
    """
    from sidtool.solver.system.errors import SimulationError

    targets = [result_target(path) for path in outputs]
    named = [text.partition("=")[2] for text in (*swaps, *inputs, *changes)]
    check_targets(targets, [*input_files(scene), *named], force)
    output, csv = _single_target(targets, "result"), _single_target(targets, "table")
    settings = {"integrator": integrator, "rtol": rtol, "step": step}
    settings["spectral_radius"] = spectral_radius
    _check_numbers(rtol, step, spectral_radius)
    from ..accuracy.options import parse_accuracy_options
    from .result_files import OutputFiles

    unfinished = _read_unfinished(output) if goes_on else None
    stop = StopRequest()
    printed: set[Diagnostic] = set()
    with OutputFiles(output, csv) as files:
        try:
            ends = {"stop": stop, "unfinished": unfinished}
            model = ModelOptions(
                swaps, rigid, parse_accuracy_options(accuracy), accept_defects
            )
            content = read_scene_with_changes(scene, changes)
            content = _with_input_tables(content, inputs)
            if unfinished is not None and _is_done(unfinished, content):
                click.echo(f"{output}: is complete to t = {unfinished.t[-1]:.9g} s")
                return
            result = _run(content, model, settings, files, ends, printed)
        except SimulationError as error:
            print_failure(error, scene)
            if error.result is not None:
                printed.update(error.diagnostics)
                print_warnings(error.result.diagnostics, printed)
                _print_result(error.result, files, verbose)
            files.print_messages(stderr=True)
            status = 128 + stop.number if stop.number else 1
            raise click.exceptions.Exit(status) from None
        except OSError:
            files.print_messages(stderr=True)
            if not files.failed:
                raise
            raise click.exceptions.Exit(1) from None
    files.print_messages(stderr=False)
    if files.failed:
        raise click.exceptions.Exit(1)
    print_warnings(result.diagnostics, printed)
    _print_result(result, files, verbose)
    if output is None and csv is None:
        click.echo("nothing written: -o FILE.h5 keeps the result, .csv its outputs")


def _with_input_tables(scene: Scene, texts: tuple[str, ...]) -> Scene:
    """Return the scene whose inputs follow the tables of --input."""
    from sidtool.formats.scene import INPUTS, read_input_table, unit_of, with_inputs
    from sidtool.formats.toml.files import locate_errors

    files = files_by_body("--input", texts, [*scene.inputs], "NAME")
    with locate_errors(scene):
        tables = {
            name: read_input_table(file, unit_of(f"{INPUTS}.{name}", scene))
            for name, file in files.items()
        }
        return with_inputs(scene, tables)


def _print_result(result: Result, files: OutputFiles, verbose: bool) -> None:
    """Print the summary of a run, or its data as JSON."""
    from ..report.json_data import result_data
    from ..report.result import run_summary

    text = run_summary(result, files.span, files.written, verbose)
    print_result(text, lambda: result_data(result, files.span, files.ranges))


def _single_target(targets: list[Target], kind: str) -> Path | None:
    paths = [target.path for target in targets if target.kind == kind]
    if len(paths) > 1:
        problem = f"{' and '.join(map(str, paths))} would be the same twice"
        raise InputError(problem, place="-o", expected="one .h5 and one .csv at most")
    return paths[0] if paths else None


def _read_unfinished(output: Path | None) -> Result | None:
    """Return the run to continue, or None if there is no file yet."""
    from sidtool.formats.result import read_result

    if output is None:
        raise InputError(
            "needs the file of the run", place="--continue", expected="-o RESULT.h5"
        )
    return read_result(output) if output.exists() else None


def _is_done(result: Result, scene: SceneFile) -> bool:
    """Return whether a run is complete up to the end time of the scene."""
    from sidtool.solver.output.resume import ended_by_event

    if not result.completed:
        return False
    end = json.loads(result.scene)["time"]["end"] if result.scene else math.inf
    return scene.time.end <= end or ended_by_event(result)


def _check_numbers(
    rtol: float | None, step: float | None, radius: float | None
) -> None:
    if rtol is not None and not 1e-13 <= rtol <= 0.1:
        raise InputError(f"found {rtol}", place="--rtol", expected="1e-13 to 0.1")
    if step is not None and not 0 < step < float("inf"):
        raise InputError(
            f"found {step}", place="--step", expected="a positive number of seconds"
        )
    if radius is not None and not 0 <= radius <= 1:
        place = "--spectral-radius"
        raise InputError(f"found {radius}", place=place, expected="0 to 1")


@dataclass(frozen=True)
class ModelOptions:
    """Options of the command that change the model."""

    swaps: tuple[str, ...]
    rigid: tuple[str, ...]
    accuracy: Any
    accept_defects: bool


def _run(
    scene: SceneFile,
    model: ModelOptions,
    settings: dict[str, Any],
    files: Any,
    ends: dict[str, Any],
    printed: set[Diagnostic],
) -> Any:
    from sidtool.formats.result.data import write_rows
    from sidtool.formats.toml.files import locate_errors
    from sidtool.solver import simulate as run
    from sidtool.solver.simulation.simulate import report_implausible_inputs

    from ..api.prepared_scene import prepare_scene

    def print_before_run(diagnostic: Diagnostic) -> None:
        print_warnings([diagnostic])
        printed.add(diagnostic)

    replaced = files_by_body("--sid", model.swaps, scene.flexible)
    with locate_errors(scene):
        prepared = prepare_scene(
            scene,
            scene.folder,
            replaced,
            model.rigid,
            model.accuracy,
            settings,
            accept_defects=model.accept_defects,
        )
        files = prepared.certified(files)
        known = prepared.known_result() if ends["unfinished"] is None else None
        if known is not None:
            report_implausible_inputs(prepared.system, print_before_run)
            write_rows(known, files)
            return known
        with stop_on_signals(*ENDING_SIGNALS, stop=ends["stop"]):
            result = run(
                prepared.system,
                progress=_time_fraction(prepared.system.scene.time),
                diagnostics=prepared.diagnostics,
                into=files,
                report_diagnostic=print_before_run,
                **settings,
                **ends,
            )
        return prepared.with_errors(result)


def _time_fraction(time: Any) -> Callable[[float], None]:
    """Return a function that reports the completed fraction at a simulated time [s]."""
    length = time.end - time.start
    return lambda t: report_stage("simulating", (t - time.start) / length)
