"""``sidtool sensitivity``: derivatives by numbers of a scene or of a model."""

from __future__ import annotations

from pathlib import Path

import click

from .common import (
    Target,
    changes_option,
    check_targets,
    existing_file,
    force_option,
    input_files,
    method_option,
    output_path,
    print_result,
    read_scene_with_changes,
    threads_option,
)
from .study import print_progress


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
def sensitivity(
    file: Path,
    variables: tuple[str, ...],
    functionals: tuple[str, ...],
    output: Path | None,
    jobs: int | None,
    method: str,
    changes: tuple[str, ...],
    force: bool,
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
        _model_sensitivity(file, variables, functionals, output, changes, force)
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
    print_result(found.report(), found.data)
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
    print_result(found.report(), found.data)
    if output is not None:
        (derivatives if kind == "derivatives" else found).save(output)
        click.echo(f"{output} written")
