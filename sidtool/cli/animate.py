"""``sidtool animate`` and ``sidtool export``: the motion of a result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sidtool.formats.base.errors import InputError
from sidtool.formats.file_names import kind_by_ending

from .common import (
    Target,
    check_targets,
    existing_file,
    files_by_body,
    force_option,
    full_fields,
    json_stream,
    output_path,
    print_remarks,
)

if TYPE_CHECKING:
    from ..view.body_fields import StressPeak


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
    type=float,
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


@click.command()
@click.argument("result", metavar="RESULT", type=existing_file)
@click.option(
    "-o",
    "--output",
    type=output_path,
    help="File to write: .vtkhdf, or .pvd with a folder of .vtu files.",
)
@full_fields
@click.option("--peak", is_flag=True, help="Print the peak stress of flexible bodies.")
@click.option("--json", "as_json", is_flag=True, help="Print the peaks as JSON.")
@force_option
def export(
    result: Path,
    output: Path | None,
    fields: tuple[str, ...],
    peak: bool,
    as_json: bool,
    force: bool,
) -> None:
    """Write the bodies of a RESULT in motion for ParaView and VTK.

    The file holds the elastic displacement and velocity of every point in inertial
    axes. For flexible bodies with a full field (see `sidtool convert --field`) it also
    holds all stress components in the axes of the body and the von Mises stress; these
    are NaN elsewhere. Cell data `body` is the number of the body. Bodies without a full
    field are drawn as by `sidtool animate`. Springs, dampers, actuators and distance
    rods between markers are lines; their numbers follow those of the bodies. The
    dataset /bodies of a .vtkhdf file holds all names.

    --peak prints the largest von Mises stress of each body over all points of its field
    and over time, with its position in the body frame and its time. Stresses of the
    field are averaged over the elements that meet at a node. BODY.peak_von_mises is
    different: it is evaluated at the markers and at the `peak_points` of the model,
    which include points inside elements. Those have larger stresses near sharp corners
    of coarse meshes.

    \b
    Examples:
      sidtool export result.h5 -o motion.vtkhdf
      sidtool export result.h5 -o motion.pvd --field rod=rod.field.h5
      sidtool export result.h5 --peak --json
    """
    from ..api.scene import read
    from ..pipeline.files import expect_kind

    expect_kind(result, "result")
    given = files_by_body("--field", fields)
    check_targets([Target("-o", output, "export")], [result, *given.values()], force)
    if output is None and not (peak or as_json):
        raise InputError(
            "there is nothing to do", place="-o", expected="-o FILE, --peak or both"
        )
    from ..view.body_fields import peak_stresses
    from ..view.export import export_mesh, write_export

    content, folder = read(result), result.parent
    try:
        if output is not None:
            mesh = export_mesh(content, given, folder)
            write_export(output, mesh)
            print_remarks(mesh.notes, err=as_json)
            click.echo(
                f"{output} written: {len(mesh.t)} times, {mesh.n_points} points",
                err=as_json,
            )
        if peak or as_json:
            _print_peaks(peak_stresses(content, given, folder), as_json)
    except InputError as error:
        raise error.located(result) from None


def _print_peaks(peaks: dict[str, StressPeak], as_json: bool) -> None:
    from ..report.tables import text_table

    if as_json:
        click.echo(
            json.dumps(
                {
                    name: {
                        "von_mises": peak.stress,
                        "time": peak.time,
                        "place": peak.place.tolist(),
                        "stress": peak.components.tolist(),
                    }
                    for name, peak in peaks.items()
                }
            ),
            file=json_stream(),
        )
        return
    rows = [
        [name, f"{p.stress:.6g}", f"{p.time:.6g}", *(f"{x:.6g}" for x in p.place)]
        for name, p in peaks.items()
    ]
    click.echo(text_table(["body", "von Mises Pa", "t s", "x m", "y m", "z m"], rows))
