"""``sidtool identify``: numbers of a scene from measurements."""

from __future__ import annotations

from pathlib import Path

import click

from sidtool.formats.base.errors import InputError

from .common import (
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
    threads_option,
)


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
        "File to write: numbers (.json), or a picture of measurement and fit (.png,"
        " .svg, .pdf); may be given for each."
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
        numbers = float(low), float(high)
    except ValueError:
        numbers = 1.0, 0.0
    if not (key and numbers[0] < numbers[1]):
        raise InputError(
            f"found {text!r}", place="--range", expected="KEY=MIN:MAX, as in c=0.1:20"
        )
    return key.strip(), numbers
