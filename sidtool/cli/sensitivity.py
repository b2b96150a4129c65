"""``sidtool sensitivity``: derivatives of functionals by numbers of a scene."""

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
    output_path,
    print_result,
    read_scene_with_changes,
)
from .study import print_progress


@click.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "--with",
    "variables",
    metavar="KEY",
    multiple=True,
    required=True,
    help=(
        "Key of a number, as for --set; `*` for any letters of the keys in the file;"
        " several separated by commas, or given several times."
    ),
)
@click.option(
    "--of",
    "functionals",
    metavar="FUNCTIONAL",
    multiple=True,
    required=True,
    help=(
        "Functional such as max_abs(rod.q1), see above; several separated by commas,"
        " or given several times."
    ),
)
@click.option("-o", "--output", type=output_path, help="Table to write (.csv).")
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    help="Number of threads; default one per core.",
)
@changes_option
@force_option
def sensitivity(
    scene: Path,
    variables: tuple[str, ...],
    functionals: tuple[str, ...],
    output: Path | None,
    jobs: int | None,
    changes: tuple[str, ...],
    force: bool,
) -> None:
    """Differentiate functionals of the motion of a SCENE by its numbers.

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

    Neighbouring scenes are run with the steps of this one, four to eight runs for a
    variable. Where they have other events there is no derivative, and a message with a
    code says why.

    \b
    Examples:
      sidtool sensitivity slider_crank.toml --with piston.mass --of "max_abs(rod.q1)"
      sidtool sensitivity arm.toml --with "forces.*,parameters.h" --of "rms(arm.tip.y)"
      sidtool sensitivity arm.toml --with gravity[1] --of "static(arm.tip.y)" -o s.csv

    Exit status: 0 done; 1 a derivative does not exist, or the run stops; 2 the input is
    wrong.
    """
    from ..api.sensitivity import sensitivity as differentiate

    check_targets([Target("-o", output, "table")], input_files(scene), force)
    content = read_scene_with_changes(scene, changes)
    with print_progress() as say:
        found = differentiate(
            content,
            variables,
            functionals,
            jobs=jobs,
            progress=lambda key, done, count: say(key, done, count, None),
        )
    print_result(found.report(), found.data)
    if output is not None:
        found.save(output)
        click.echo(f"{output} written")
    if any(each.code == "N735" for each in found.diagnostics):
        raise click.exceptions.Exit(1)
