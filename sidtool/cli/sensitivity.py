"""``sidtool sensitivity``: derivatives by numbers of a scene or of a model.

``sidtool optimise``: the best design within limits.

``sidtool identify``: numbers of a scene from measurements.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import real_of_text

from .common import (
    Target,
    changes_option,
    check_targets,
    existing_file,
    force_option,
    input_files,
    is_quiet,
    method_option,
    output_path,
    picture_target,
    print_on_stderr,
    print_result,
    read_scene_with_changes,
    table_on_screen,
    threads_option,
    verbose_option,
)
from .study import print_progress

if TYPE_CHECKING:
    from ..sensitivity.optimisation import Iteration


@click.command()
@click.argument("file", metavar="SCENE_OR_MODEL", type=existing_file)
@click.option(
    "--with",
    "variables",
    metavar="KEY",
    multiple=True,
    required=True,
    help=(
        "Key of a number, as for --set; `*` for any letters of the keys in the file;"
        " several separated by commas, or given several times. Of a model also"
        " NAME=KEY:FACTOR,KEY:FACTOR for numbers that change together."
    ),
)
@click.option(
    "--of",
    "functionals",
    metavar="FUNCTIONAL",
    multiple=True,
    help=(
        "Functional such as max_abs(rod.q1), see above; several separated by commas,"
        " or given several times. Of a model by default mass and frequencies."
    ),
)
@click.option(
    "-o",
    "--output",
    type=output_path,
    help="Table to write (.csv), or of a model the SID with its derivatives (.h5).",
)
@threads_option
@method_option
@changes_option
@force_option
@verbose_option
def sensitivity(
    file: Path,
    variables: tuple[str, ...],
    functionals: tuple[str, ...],
    output: Path | None,
    jobs: int | None,
    method: str,
    changes: tuple[str, ...],
    force: bool,
    verbose: bool,
) -> None:
    """Differentiate a motion by numbers of its SCENE, or a body by those of its MODEL.

    Prints for each functional its value, the derivatives by all variables, their
    estimated errors, and how many per cent of the functional one per cent of the
    variable changes, the most influential variable first.

    --with takes any number of the scene by its path, as --set does:

    \b
      bodies.crank.mass, crank.mass   a key; parts with a name can be named by it alone
      parameters.h                    a parameter, and all formulas that read it
      forces.*                        all numbers of all forces
      gravity[1]                      a component of a vector
      arm.initial.velocity[0]         an initial value
      rod.model.geometry.thickness    a key of the model of the body rod

    --of takes a functional of any output, which the scene need not record:

    \b
      max(y), min(y), max_abs(y)   extrema, at their exact instant
      mean(y), rms(y), integral(y) over the time of the motion
      norm(y, p)                   (mean of |y|^p)^(1/p), a smooth max_abs
      final(y), value(y, t)        value at the end, value at the time t
      error(y, FILE.csv)           root mean square distance to a table with t and y
      end_time                     time at which the motion ends, as by an event
      mass(BODY), mass(*)          mass of a body, of all bodies
      static(y)                    value in the static equilibrium
      frequency(k), damping_ratio(k)   of the k-th natural mode

    Of a model, --with takes a number by its key, and --of a quantity of the body:

    \b
      thickness, material.density              a key, alone where that is clear
      geometry.control_points[1][0][1]         a coordinate of a control point
      section.height, geometry.end[0]          of a beam
      waist=geometry.control_points[1][0][1]:-1,geometry.control_points[1][1][1]:1
                                               numbers that change together
      mass, centre(x), inertia(xx)             mass [kg], centre [m], inertia [kg m^2]
      frequency(k), frequency(*)               frequencies in the frame [Hz]
      compliance(tip.y)                        displacement by a unit force [m/N]
      entry(Ke[0,0]), entry(2.phi[1,0])        an entry of the SID

    These are exact to rounding, and take no further conversions.

    The run is linearised about itself where it can be; else neighbouring scenes are run
    with its steps, four to eight runs for a variable. The last line names the method,
    and why. Where neighbours have other events there is no derivative, and a message
    with a code says why.

    \b
    Examples:
      sidtool sensitivity slider_crank.toml --with piston.mass --of "max_abs(rod.q1)"
      sidtool sensitivity arm.toml --with "forces.*,parameters.h" --of "rms(arm.tip.y)"
      sidtool sensitivity arm.toml --with gravity[1] --of "static(arm.tip.y)" -o s.csv
      sidtool sensitivity rod_q4.toml --with thickness,material.youngs_modulus
      sidtool sensitivity rod_q4.toml --with thickness -o rod_derivatives.h5

    Exit status: 0 done; 1 a derivative does not exist, or the run stops; 2 the input is
    wrong.
    """
    from ..pipeline.files import expect_kind

    if expect_kind(file, "scene", "model") == "model":
        _model_sensitivity(
            file, variables, functionals, output, changes, force, verbose
        )
        return
    from ..api.sensitivity import sensitivity as differentiate

    if not functionals:
        raise click.UsageError("Missing option '--of', such as --of 'rms(rod.q1)'.")
    check_targets([Target("-o", output, "table")], input_files(file), force)
    content = read_scene_with_changes(file, changes)
    with print_progress() as say:
        found = differentiate(
            content,
            variables,
            functionals,
            jobs=jobs,
            method=method,
            progress=lambda key, done, count: say(key, done, count, None),
        )
    print_result(table_on_screen(found.report, verbose), found.data)
    if output is not None:
        found.save(output)
        click.echo(f"{output} written")
    if any(each.code == "N735" for each in found.diagnostics):
        raise click.exceptions.Exit(1)


def _model_sensitivity(
    file: Path,
    variables: tuple[str, ...],
    quantities: tuple[str, ...],
    output: Path | None,
    changes: tuple[str, ...],
    force: bool,
    verbose: bool,
) -> None:
    """Differentiate a body by numbers of its model."""
    from sidtool.formats.file_names import kind_by_ending
    from sidtool.formats.model import read_model
    from sidtool.formats.toml.files import parse_settings

    from ..sensitivity.model_sensitivity import (
        DEFAULT_QUANTITIES,
        model_sensitivities,
    )

    kind = kind_by_ending(output, "table", "derivatives")
    check_targets([Target("-o", output, kind)], input_files(file), force)
    model = read_model(file, parse_settings(changes))
    found, derivatives = model_sensitivities(
        model, variables, quantities or DEFAULT_QUANTITIES
    )
    print_result(table_on_screen(found.report, verbose), found.data)
    if output is not None:
        (derivatives if kind == "derivatives" else found).save(output)
        click.echo(f"{output} written")


@click.command()
@click.argument("design", metavar="DESIGN", type=existing_file)
@click.option(
    "-o",
    "--output",
    "outputs",
    type=output_path,
    multiple=True,
    help=(
        "File to write: history (.json), its picture (.png, .svg, .pdf), or a report"
        " (.html); may be given for each."
    ),
)
@click.option(
    "--continue",
    "continues",
    is_flag=True,
    help="Start at the last point of the history that -o names.",
)
@threads_option
@method_option
@force_option
def optimise(
    design: Path,
    outputs: tuple[Path, ...],
    continues: bool,
    jobs: int | None,
    method: str,
    force: bool,
) -> None:
    """Find the best numbers of a scene within limits.

    DESIGN is a file that names a scene, the numbers that vary with their ranges, what
    is to be as small or as large as possible, and limits:

    \b
      format = "sidtool design"
      version = 1
      scene = "slider_crank.toml"
      changes = { "rod.model" = "rod_q4.toml" }

    \b
      [variables.thickness]
      key = "rod.model.geometry.thickness"
      min = 0.005
      max = 0.02

    \b
      [objective]
      minimise = "mass(rod)"

    \b
      [[limits]]
      of = "max_abs(rod.q1)"
      max = 8e-4

    Keys and functionals are those of `sidtool sensitivity`. The optimiser (SLSQP or
    trust-constr of SciPy) follows the gradients of the motion and finds a local
    optimum. The history is written after each iteration; --continue starts at its last
    point, also with other limits.

    \b
    Examples:
      sidtool optimise design.toml
      sidtool optimise design.toml -o history.json -o report.html
      sidtool optimise design.toml -o history.json --continue

    Exit status: 0 done; 1 not converged, or a limit is exceeded, or the run of the
    start stops; 2 the input is wrong.
    """
    from sidtool.formats.design import read_design

    from ..api.optimise import optimise as search
    from ..pipeline.files import expect_kind
    from ..sensitivity.optimisation import read_history, write_history

    targets = [picture_target(path, "optimisation") for path in outputs]
    check_targets(targets, input_files(design), force)
    expect_kind(design, "design")
    content = read_design(design)
    start: dict[str, float] = {}
    histories = [
        path
        for path, target in zip(outputs, targets, strict=True)
        if target.kind == "optimisation"
    ]
    if continues and histories and histories[0].exists():
        names = [*content.variables]
        start = dict(zip(names, read_history(histories[0], names), strict=True))

    points: list[Iteration] = []

    def say(point: Iteration, number: int) -> None:
        points.append(point)
        for path in histories[:1]:
            write_history(path, [*content.variables], points)
        if not is_quiet():
            numbers = ", ".join(
                f"{name} = {x:.6g}"
                for name, x in zip(content.variables, point.x, strict=True)
            )
            line = f"iteration {number}: {content.objective.of} = {point.values[0]:.6g}"
            print_on_stderr(f"{line}; {numbers}")

    found = search(content, start=start, jobs=jobs, method=method, progress=say)
    print_result(found.report(), found.data)
    for path in outputs:
        found.save(path)
        click.echo(f"{path} written")
    if not (found.converged and found.is_feasible):
        raise click.exceptions.Exit(1)


@click.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "--with",
    "variables",
    metavar="KEY",
    multiple=True,
    required=True,
    help=(
        "Key of a number to identify, as for --set; several separated by commas, or"
        " given several times. Its value in the scene is the first guess."
    ),
)
@click.option(
    "--measured",
    metavar="FILE",
    type=existing_file,
    help="Measured motion: a table (.csv) with t [s] and outputs of the scene.",
)
@click.option(
    "--target",
    "targets",
    metavar="FUNCTIONAL=VALUE+-DEVIATION",
    multiple=True,
    help="Measured value with its standard deviation, as frequency(1)=12.3+-0.1.",
)
@click.option(
    "--range",
    "ranges",
    metavar="KEY=MIN:MAX",
    multiple=True,
    help="Least and largest value of a number.",
)
@click.option(
    "-o",
    "--output",
    "outputs",
    type=output_path,
    multiple=True,
    help=(
        "File to write: numbers (.json), a picture of measurement and fit (.png, .svg,"
        " .pdf), or a report (.html); may be given for each."
    ),
)
@threads_option
@method_option
@changes_option
@force_option
def identify(
    scene: Path,
    variables: tuple[str, ...],
    measured: Path | None,
    targets: tuple[str, ...],
    ranges: tuple[str, ...],
    outputs: tuple[Path, ...],
    jobs: int | None,
    method: str,
    changes: tuple[str, ...],
    force: bool,
) -> None:
    """Fit numbers of a SCENE to measured motions or frequencies.

    Prints the numbers that fit best in the sense of least squares, with intervals that
    contain the true values in 95 of 100 measurements if the scene describes the
    mechanism and the noise of neighbouring values is independent.

    The table has a column t and a column for each measured output, named as in
    `sidtool outputs`. Units in brackets behind names are ignored, empty cells are left
    out. The noise of each output is estimated; outputs count by their noise.

    Functionals of --target and keys of --with are those of `sidtool sensitivity`.

    \b
    Examples:
      sidtool identify scene.toml --with spring.stiffness,spring.damping \\
          --measured measured.csv -o fit.png
      sidtool identify arm.toml --with arm.model.material.youngs_modulus \\
          --target "frequency(1)=31.8+-0.1" --target "frequency(2)=200.6+-0.5"

    Exit status: 0 done; 1 not converged, or a run stops; 2 the input is wrong.
    """
    from ..api.identify import identify as fit
    from ..sensitivity.identification import parse_target

    files = [picture_target(path, "optimisation") for path in outputs]
    read = [*input_files(scene), *([measured] if measured else [])]
    check_targets(files, read, force)
    content = read_scene_with_changes(scene, changes)
    aims = [parse_target(text, content) for text in targets]
    count = 0

    def say(x: object, values: object) -> None:
        nonlocal count
        count += 1
        if not is_quiet():
            print_on_stderr(f"evaluation {count}: {x}")

    found = fit(
        content,
        variables,
        measured,
        targets={aim.functional.text: (aim.value, aim.deviation) for aim in aims},
        ranges=dict(_parse_range(text) for text in ranges),
        jobs=jobs,
        method=method,
        progress=say,
    )
    print_result(found.report(), found.data)
    for path in outputs:
        found.save(path)
        click.echo(f"{path} written")
    if not found.fit.converged:
        raise click.exceptions.Exit(1)


def _parse_range(text: str) -> tuple[str, tuple[float, float]]:
    key, _, rest = text.partition("=")
    low, _, high = rest.partition(":")
    try:
        numbers = real_of_text(low), real_of_text(high)
    except ValueError:
        numbers = 1.0, 0.0
    if not (key and numbers[0] < numbers[1]):
        raise InputError(
            f"found {text!r}", place="--range", expected="KEY=MIN:MAX, as in c=0.1:20"
        )
    return key.strip(), numbers
