"""``sidtool study`` and ``sidtool sweep``: run a scene in many variants."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sidtool.formats.base.errors import InputError, printable
from sidtool.formats.base.progress import has_listener, report_stage
from sidtool.formats.file_names import check_ending
from sidtool.formats.storage.operating_system import (
    ENDING_SIGNALS,
    is_writable_folder,
    processors,
)
from sidtool.formats.text import counted_noun

from ..api.interrupts import stop_on_signals
from .common import (
    IntegerRange,
    Real,
    changes_option,
    check_targets,
    existing_file,
    force_option,
    input_files,
    is_quiet,
    output_path,
    picture_target,
    print_on_stderr,
    print_result,
    read_scene_with_changes,
    table_on_screen,
    verbose_option,
)

if TYPE_CHECKING:
    from ..study import Study

#: Minimum interval between progress lines without a terminal [s].
LINE_INTERVAL = 10.0
#: Stages before the runs of the points, in the words of progress reports.
STAGES = ("converting bodies", "reference")
#: Suffix of the folder of finished runs, after the name of the table or figure.
RUNS_FOLDER_SUFFIX = ".points"


@click.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "--over",
    "over",
    metavar="AXES",
    multiple=True,
    help=(
        "Axes to vary, separated by commas: mesh, modes, reduction, frame, "
        "terms, integrator; or with values, as in modes=2:4:8. Default "
        "integrator."
    ),
)
@click.option(
    "--model",
    "models",
    metavar="BODY=FILE",
    multiple=True,
    help="The model of a body, in place of its SID; several of one body are compared.",
)
@click.option(
    "-o",
    "--output",
    type=output_path,
    help=(
        "Folder for tables (text, CSV), figures (PNG, SVG), the study for "
        "`sidtool plot`, and the finished points, which the next study reuses."
    ),
)
@click.option(
    "--wanted",
    type=Real(),
    multiple=True,
    help="Wanted relative error; may be given several times. Default 1e-3, 1e-6, 1e-9.",
)
@click.option(
    "--integrator",
    "integrators",
    metavar="NAME",
    multiple=True,
    help="Integrator to include; default all but auto.",
)
@click.option(
    "--rtol",
    "tolerances",
    type=Real(),
    multiple=True,
    help="Relative tolerances; default 1e-2 to 1e-9.",
)
@click.option(
    "--step", "steps", type=Real(), multiple=True, help="Fixed steps in seconds."
)
@click.option(
    "--of",
    "outputs",
    metavar="NAME",
    multiple=True,
    help="Output that counts, such as piston.x. Default all that the scene records.",
)
@click.option(
    "--differ",
    type=IntegerRange(1),
    metavar="N",
    help=(
        "Largest number of choices in which a point differs from the scene; "
        "default as many as give at most 300 points."
    ),
)
@click.option(
    "--jobs", type=IntegerRange(1), help="Number of processes; default one per core."
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Compute on the cluster of this Dask scheduler, such as tcp://host:8786; "
    "needs the packages dask and distributed.",
)
@changes_option
@verbose_option
def study(
    scene: Path,
    over: tuple[str, ...],
    models: tuple[str, ...],
    output: Path | None,
    wanted: tuple[float, ...],
    integrators: tuple[str, ...],
    tolerances: tuple[float, ...],
    steps: tuple[float, ...],
    outputs: tuple[str, ...],
    differ: int | None,
    jobs: int | None,
    dask: str | None,
    changes: tuple[str, ...],
    verbose: bool,
) -> None:
    """Measure error against time and size for a SCENE and recommend a setting.

    Runs variants of the scene, by default with all integrators and several tolerances,
    and compares each run with a reference at the output times. The reference is the
    most detailed of all variants, integrated much more tightly. The error is relative
    to the variation of each output in the run; the worst output counts. Errors below
    the uncertainty of the reference are not resolved. Outputs that cannot be predicted
    over the time span, as in a chaotic motion, are named.

    \b
    --over also varies the model:
      mesh        doubled, unchanged and halved element size: mesh=-1:0:1
      modes       modes of models, or shape functions of SIDs: modes=2:4:8
      reduction   modal:craig_bampton:attachment:herting:krylov
      frame       tangent:chord:buckens
      terms       geometric stiffening, quadratic inertia: all:stiffening:quadratic:none
      integrator  with tolerances: integrator=radau5:radau9

    mesh and reduction need bodies that are given by models, in the scene or by --model.
    Several models of one body, such as Q4 and IGA, are compared with each other.
    Elastic coordinates are not compared if shape functions vary.

    Points run on all cores, each with one thread for linear algebra, and are stored in
    the folder of -o. The same command continues an interrupted study, and a larger
    study computes only the missing points. On a cluster, model files and the meshes
    that they name must have the same paths as here.

    \b
    Examples:
      sidtool study slider_crank.toml --wanted 1e-6
      sidtool study slider_crank.toml -o study --of rod.q1
      sidtool study slider_crank.toml --integrator radau5 --integrator radau9
      sidtool study slider_crank.toml --over modes,terms -o study
      sidtool study slider_crank.toml --over mesh,modes=1:2:5,integrator -o study \\
          --model rod=rod_q4.toml --model rod=rod_iga.toml

    Exit status: 0 done, also if no setting reaches the wanted error; 1 the scene or its
    reference could not be run to the end; 128 + N signal N ended it, 130 for Ctrl-C
    (finished points are kept with -o); 2 the input is wrong.
    """
    from ..api.study import study as asked_study
    from ..study import StoppedEarly, StudyInterrupted

    _check_wanted(wanted)
    if output is not None:
        _check_folder(output)
    content = read_scene_with_changes(scene, changes)
    with stop_on_signals(*ENDING_SIGNALS) as stop:
        try:
            with print_progress() as say:
                result = asked_study(
                    content,
                    over,
                    models=_models_by_body(models),
                    integrators=integrators,
                    rtol=tolerances,
                    step=steps,
                    outputs=outputs,
                    differ=differ,
                    folder=output,
                    jobs=jobs or processors(),
                    dask=dask,
                    title=content.title or printable(scene.stem),
                    stop=stop,
                    progress=say,
                )
        except StoppedEarly as error:
            print_on_stderr(f"sidtool: {error}")
            raise click.exceptions.Exit(1) from None
        except StudyInterrupted as why:
            points = None if output is None else output / "points"
            rest = _finished_files_text("point", output, points)
            print_on_stderr(f"sidtool: {scene}: {why}; {rest}", [str(scene)])
            raise click.exceptions.Exit(128 + stop.number) from None
    _print_study(result, wanted, output, verbose)


def _finished_files_text(kind: str, folder: Path | None, finished: Path | None) -> str:
    """Return a text on the points or runs that an interrupted command has stored.

    kind : "point" or "run"
    folder : folder to name in the text, None without -o
    finished : folder of the finished points or runs; it may not exist
    """
    if finished is None:
        return "nothing is kept without -o"
    if not finished.exists():
        return f"no {kind} was finished"
    return f"finished {kind}s are in {folder}; the same command goes on"


def _models_by_body(texts: tuple[str, ...]) -> dict[str, list[str]]:
    models: dict[str, list[str]] = {}
    for text in texts:
        body, _, file = text.partition("=")
        if not body or not file:
            raise InputError(
                f"found {text!r}", place="--model", expected="BODY=MODEL.toml"
            )
        models.setdefault(body, []).append(file)
    return models


def _check_wanted(wanted: tuple[float, ...]) -> None:
    for number in wanted:
        if not 1e-13 <= number <= 1.0:
            raise InputError(
                f"found {number:g}", place="--wanted", expected="1e-13 to 1"
            )


def _check_folder(folder: Path) -> None:
    """Refuse, before any computation, a folder that cannot be created."""
    check_ending(folder, "folder", "-o")
    there = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    if not is_writable_folder(there):
        raise InputError(
            "cannot be a folder to write to",
            source=folder,
            expected=f"{there} to be a folder with permission to write",
        )


@contextmanager
def print_progress() -> Iterator[Callable[[str, int, int, float | None], None]]:
    """Print a line from time to time if there is no listener for progress."""
    if is_quiet():
        yield lambda *_: None
        return
    if has_listener():

        def listened(text: str, done: int, count: int, left: float | None) -> None:
            stage = text if text in STAGES else "measuring points"
            report_stage(stage, done / max(count, 1))

        yield listened
        return
    last = -LINE_INTERVAL

    def say(text: str, done: int, count: int, left: float | None) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < LINE_INTERVAL and done < count:
            return
        last = now
        rest = (
            "" if left is None or done == count else f", {_format_seconds(left)} left"
        )
        print_on_stderr(f"{done} of {count}{rest}: {text}")

    yield say


def _format_seconds(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _print_study(
    result: Study, wanted: tuple[float, ...], folder: Path | None, verbose: bool
) -> None:
    from ..study.study_result import (
        RECOMMENDED_ERRORS,
        study_file,
        write_all,
    )

    wanted = wanted or RECOMMENDED_ERRORS
    print_result(
        result.report(wanted, verbose),
        lambda: study_file(result).model_dump(mode="json"),
    )
    if folder is not None:
        names = write_all(folder, result, wanted)
        click.echo(f"{', '.join(names)} written to {folder}")


@click.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "--over",
    "over",
    metavar="KEY=VALUES",
    multiple=True,
    required=True,
    help=(
        "Key of the scene and its values: FROM:TO:COUNT, FROM:TO:COUNT:log, or "
        "values separated by commas. Several keys form a full grid."
    ),
)
@click.option(
    "--of",
    "of",
    metavar="OUTPUT.MEASURE",
    multiple=True,
    required=True,
    help=(
        "Measure of an output: the output (`*` for any letters) and max, min, "
        "end, mean, rms or amplitude; several separated by commas, or given "
        "several times."
    ),
)
@click.option(
    "-o",
    "--output",
    "outputs",
    type=output_path,
    multiple=True,
    help=(
        "File to write: table (.csv) or figure (.png, .svg, .pdf); may be given"
        " for each. Finished runs are stored next to the first one, in "
        "NAME.points."
    ),
)
@click.option(
    "--jobs",
    type=IntegerRange(min=1),
    help="Number of processes; default one per core.",
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Compute on the cluster of this Dask scheduler, such as tcp://host:8786; "
    "needs the packages dask and distributed.",
)
@changes_option
@force_option
@verbose_option
def sweep(
    scene: Path,
    over: tuple[str, ...],
    of: tuple[str, ...],
    outputs: tuple[Path, ...],
    jobs: int | None,
    dask: str | None,
    changes: tuple[str, ...],
    force: bool,
    verbose: bool,
) -> None:
    """Simulate a SCENE for values of its design parameters.

    --over varies any key of the scene; its path is written as for --set:

    \b
      parameters.h=0.01:0.02:11       11 values from 0.01 to 0.02
      forces.spring.stiffness=1e2:1e6:9:log   equal ratios
      bodies.rod.mass=0.5,1,2         a list
      rod.model.geometry.thickness=0.01:0.02:3   a key of the model of the body rod
      rod.sid=a.SID_FEM,b.SID_FEM     texts

    --of evaluates a measure of an output at the output times of the scene. The output
    need not be recorded. Peaks between output times are missed: lower time.output_step.

    \b
      max, min    largest and least value
      end         value at the end of the run
      mean, rms   mean over time, and root of the mean square
      amplitude   half the difference of max and min

    t.end is the time at which a run ends, as by an event with `action = "stop"`.

    Runs are integrated with the settings of the scene, one on each core. A run that
    cannot be set up or stops early is a row with the reason. With -o the same command
    continues an interrupted sweep, and a sweep with more values runs only the new ones.
    The folder NAME.points may be removed.

    \b
    Examples:
      sidtool sweep slider_crank.toml --over crank.mass=0.2:0.5:4 --of piston.x.max
      sidtool sweep arm.toml --over parameters.h=0.01:0.02:11 --of tip.y.max -o h.csv
      sidtool sweep arm.toml --over parameters.h=0.01:0.02:11 \\
          --over parameters.load=1,2,5 --of "arm.tip.*.max" -o h.csv -o h.png

    Exit status: 0 done; 1 some runs failed, and their rows say why; 128 + N signal N
    ended it, 130 for Ctrl-C (finished runs are kept with -o); 2 the input is wrong.
    """
    from ..api.study import sweep as asked_sweep
    from ..study import StudyInterrupted

    targets = [picture_target(path, "sweep") for path in outputs]
    named = [text.partition("=")[2] for text in (*over, *changes)]
    check_targets(targets, [*input_files(scene), *named], force)
    folder = outputs[0].with_suffix(RUNS_FOLDER_SUFFIX) if outputs else None
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError("is not a folder", source=folder, expected="another -o")
    content = read_scene_with_changes(scene, changes)
    with stop_on_signals(*ENDING_SIGNALS) as stop:
        try:
            with print_progress() as say:
                result = asked_sweep(
                    content,
                    over,
                    of,
                    folder=folder,
                    jobs=jobs or processors(),
                    dask=dask,
                    title=content.title or printable(scene.stem),
                    stop=stop,
                    progress=say,
                )
        except StudyInterrupted as why:
            rest = _finished_files_text("run", folder, folder)
            print_on_stderr(f"sidtool: {scene}: {why}; {rest}", [str(scene)])
            raise click.exceptions.Exit(128 + stop.number) from None
    print_result(table_on_screen(result.report, verbose), result.data)
    if result.failed:
        runs = counted_noun(len(result.points), "run")
        count = f"{len(result.failed)} of {runs} failed"
        print_on_stderr(f"sidtool: {scene}: {count}", [str(scene)])
    for path, target in zip(outputs, targets, strict=True):
        if target.kind == "sweep" or len(result.failed) < len(result.points):
            result.save(path)
            click.echo(f"{path} written")
    if result.failed:
        raise click.exceptions.Exit(1)
