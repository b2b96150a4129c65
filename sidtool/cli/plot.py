"""``sidtool plot`` and ``sidtool report``: figures of files, report of a run.

``sidtool animate``: the motion of a result in a browser or as a film.
"""

from pathlib import Path
from typing import Any

import click

from sidtool.formats.base.errors import InputError
from sidtool.formats.file_names import kind_by_ending

from .common import (
    Real,
    Target,
    check_targets,
    existing_file,
    files_by_body,
    force_option,
    full_fields,
    output_path,
    print_remarks,
)


@click.command()
@click.argument("file", metavar="FILE", type=existing_file)
@click.option(
    "-o",
    "--output",
    required=True,
    type=output_path,
    help="Picture to write: .png, .svg or .pdf.",
)
@click.option(
    "--outputs",
    metavar="NAMES",
    help=(
        "Of a result: outputs, separated by commas, `*` for any letters; they "
        "need not be recorded. Default all recorded outputs."
    ),
)
@click.option(
    "--kind",
    type=click.Choice(["outputs", "spectrum", "energy", "drift", "sections"]),
    help="Of a result: outputs over time (default), their amplitudes over frequency, "
    "energies, residuals of the constraints, or section forces along bodies with their "
    "envelopes (--outputs then names bodies).",
)
@click.option(
    "--field",
    type=existing_file,
    help=(
        "Of a SID: its full field, from `convert --field`. A file NAME.field.h5"
        " next to it is found automatically."
    ),
)
@force_option
def plot(
    file: Path,
    output: Path,
    outputs: str | None,
    kind: str | None,
    field: Path | None,
    force: bool,
) -> None:
    """Draw a SID, model, field, result or study.

    \b
    SID     the body and its shape functions with their frequencies, on the full
            body where its field is known, else on the hull of its nodes
    model   mesh, markers, what markers are tied to, control net of NURBS
    field   as the SID that it belongs to
    result  outputs over time, spectra, energies, residuals of constraints
    study   study.json of `sidtool study -o`: time over error

    Plane bodies are drawn from above, others in 3D. Between output times curves are
    drawn from interpolated states, not as straight lines. If the run has a requested
    accuracy, a band around each curve shows the estimated error.

    \b
    Examples:
      sidtool plot rod.SID_FEM -o rod.png
      sidtool plot rod_q4.toml -o mesh.svg
      sidtool plot result.h5 -o motion.pdf --outputs "rod.q*,*.vx"
      sidtool plot result.h5 -o spectrum.png --kind spectrum
      sidtool plot result.h5 -o forces.png --kind sections --outputs "blade*"
    """
    from ..api.scene import read
    from ..pipeline.files import expect_kind

    detected = expect_kind(file, "sid", "model", "field", "result", "study")
    _check_options(detected, outputs, kind, field)
    check_targets(
        [Target("-o", output, "picture")], [file, *([field] if field else [])], force
    )
    try:
        notes = _plot_content(
            detected, read(file), output, outputs, kind or "outputs", field, file
        )
    except InputError as error:
        raise error.located(file) from None
    print_remarks(notes)
    click.echo(f"{output} written")


def _check_options(
    detected: str, outputs: str | None, kind: str | None, field: Path | None
) -> None:
    """Refuse options that do not apply to this kind of file."""
    given = {"--outputs": outputs, "--kind": kind, "--field": field}
    kinds_of_options = {"--outputs": "result", "--kind": "result", "--field": "sid"}
    for option, value in given.items():
        if value is not None and kinds_of_options[option] != detected:
            name = "a SID" if kinds_of_options[option] == "sid" else "a result"
            raise InputError(
                f"says nothing of a {detected}",
                place=option,
                expected=f"it with {name}",
            )
    if outputs is not None and kind in ("energy", "drift"):
        raise InputError(
            f"says nothing with --kind {kind}",
            place="--outputs",
            expected="--kind outputs or spectrum",
        )


def _plot_content(
    detected: str,
    content: Any,
    output: Path,
    outputs: str | None,
    kind: str,
    field: Path | None,
    file: Path,
) -> list[str]:
    if detected == "result":
        from ..plot.results import plot_result

        return plot_result(output, content, kind, outputs)
    if detected == "study":
        from ..plot.studies import plot_study

        plot_study(output, content)
        return []
    from ..plot.bodies import plot_field, plot_model, plot_sid

    if detected == "model":
        return plot_model(output, content)
    if detected == "field":
        return plot_field(output, content)
    from sidtool.formats.field import read_field

    from ..view.body_fields import FIELD_ENDING

    field_path = file.with_suffix(FIELD_ENDING)
    if field is None and field_path.is_file() and field_path != file:
        field = field_path
    return plot_sid(output, content, None if field is None else read_field(field))


@click.command()
@click.argument("result", metavar="RESULT", type=existing_file)
@click.option(
    "-o", "--output", required=True, type=output_path, help="Page to write (.html)."
)
@full_fields
@force_option
def report(result: Path, output: Path, fields: tuple[str, ...], force: bool) -> None:
    """Write the report of a RESULT as one HTML page.

    The report contains the scene and its bodies, what was modelled and what was
    neglected, accuracy and cost, events, outputs as tables and curves, pictures of the
    mechanism, and versions. The page needs no other files and prints on A4 or to PDF.

    \b
    Examples:
      sidtool report result.h5 -o report.html
      chromium --headless --print-to-pdf=report.pdf report.html
    """
    from ..api.scene import read
    from ..pipeline.files import expect_kind
    from ..view.html_report import write_report

    expect_kind(result, "result")
    given = files_by_body("--field", fields)
    check_targets(
        [Target("-o", output, "page")], [result, *map(str, given.values())], force
    )
    try:
        notes = write_report(output, read(result), given, result.parent)
    except InputError as error:
        raise error.located(result) from None
    print_remarks(notes)
    click.echo(f"{output} written")


@click.command()
@click.argument("result", metavar="RESULT", type=existing_file)
@click.option(
    "-o",
    "--output",
    required=True,
    type=output_path,
    help=(
        "File to write: page (.html) or film (.gif, or .mp4 if ffmpeg is installed)."
    ),
)
@full_fields
@click.option(
    "--outputs",
    "outputs",
    metavar="NAMES",
    help=(
        "Outputs to plot next to the motion, separated by commas, `*` for any "
        "letters; default the first recorded ones."
    ),
)
@click.option(
    "--colour",
    type=click.Choice(["body", "displacement", "stress"]),
    default="body",
    show_default=True,
    help="Initial colouring of bodies; a page can change it.",
)
@click.option(
    "--scale",
    type=Real(),
    metavar="FACTOR",
    help=(
        "Magnification of elastic deformations; default one that makes them visible."
    ),
)
@force_option
def animate(
    result: Path,
    output: Path,
    fields: tuple[str, ...],
    outputs: str | None,
    colour: str,
    scale: float | None,
    force: bool,
) -> None:
    """Animate the motion of a RESULT as a page for a browser or as a film.

    The page is one file that needs no network. It shows the mechanism in 3D, with
    controls for time, speed, magnification of deformations, colours (displacement or
    von Mises stress), views, joints and frames. Outputs are plotted next to it; a click
    on a plot moves to its time. It needs three.js from `pip install "sidtool[view]"`.

    Flexible bodies are drawn from their full field if there is one (see `sidtool
    convert --field`), else as the hull of the nodes of their SIDs; rigid bodies as
    lines between their markers, or as boxes.

    \b
    Examples:
      sidtool animate result.h5 -o motion.html
      sidtool animate result.h5 -o motion.html --colour stress --outputs "rod.q*,*.vx"
      sidtool animate result.h5 -o motion.html --field rod=rod.field.h5 --scale 1
      sidtool animate result.h5 -o motion.gif
    """
    from ..api.scene import read
    from ..pipeline.files import expect_kind
    from ..view.animation import animate as animated

    expect_kind(result, "result")
    kind = kind_by_ending(output, "page", "film")
    given = files_by_body("--field", fields)
    check_targets([Target("-o", output, kind)], [result, *given.values()], force)
    if scale is not None and not 0 <= scale < float("inf"):
        expected = "a number of at least 0; 1 shows deformations as they are"
        raise InputError(f"found {scale}", place="--scale", expected=expected)
    try:
        notes = animated(
            read(result),
            output,
            fields=given,
            outputs=outputs,
            colour="" if colour == "body" else colour,
            scale=scale,
            folder=result.parent,
        )
    except InputError as error:
        raise error.located(result) from None
    print_remarks(notes)
    click.echo(f"{output} written: {output.stat().st_size / 1e6:.2f} MB")
