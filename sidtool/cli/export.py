"""``sidtool export``: the motion of a result for ParaView."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sidtool.formats.errors import InputError

from .body_files import files_by_body, full_fields
from .common import (
    Target,
    check_targets,
    existing,
    for_json,
    force,
    target,
    tell_remarks,
)

if TYPE_CHECKING:
    from ..view.peaks import Peak


@click.command()
@click.argument("result", metavar="RESULT", type=existing)
@click.option(
    "-o",
    "--output",
    type=target,
    help="File to write: .vtkhdf, or .pvd with a folder of .vtu beside it.",
)
@full_fields
@click.option("--peak", is_flag=True, help="Tell the peak stress of flexible bodies.")
@click.option("--json", "as_json", is_flag=True, help="Print the peaks as JSON.")
@force
def export(
    result: Path,
    output: Path | None,
    fields: tuple[str, ...],
    peak: bool,
    as_json: bool,
    force: bool,
) -> None:
    """Write the bodies of a RESULT in motion for ParaView and VTK.

    Of every point: elastic displacement and velocity in inertial axes, and of flexible
    bodies with a full field (see `sidtool convert --field`) all stress components in
    the axes of the body and von Mises; elsewhere these are NaN. Cell data `body` is
    the number of the body. Bodies without a full field are drawn as by `sidtool
    animate`. Springs, dampers, actuators and distance rods between markers are lines,
    numbered behind the bodies; /bodies of a .vtkhdf has all names.

    --peak tells the largest von Mises stress of each body over all points of its field
    and over time, with its place in the body frame and its instant. Stresses of the
    field are means of the elements that meet at a node; BODY.peak_von_mises is that of
    the markers and of `peak_points` of the model, chosen from such nodes and from
    points inside elements, which have more beside sharp corners of coarse meshes.

    \b
    Examples:
      sidtool export result.h5 -o motion.vtkhdf
      sidtool export result.h5 -o motion.pvd --field rod=rod.field.h5
      sidtool export result.h5 --peak --json
    """
    from ..kinds import expect_kind, read

    expect_kind(result, "result")
    given = files_by_body("--field", fields)
    check_targets([Target("-o", output, "export")], [result, *given.values()], force)
    if output is None and not (peak or as_json):
        raise InputError(
            "there is nothing to do", place="-o", expected="-o FILE, --peak or both"
        )
    from ..view.exported import exported
    from ..view.peaks import peak_stresses
    from ..view.vtk_files import write_export

    content, folder = read(result), result.parent
    try:
        if output is not None:
            mesh = exported(content, given, folder)
            write_export(output, mesh)
            tell_remarks(mesh.told, err=as_json)
            click.echo(
                f"{output} written: {len(mesh.t)} times, {mesh.n_points} points",
                err=as_json,
            )
        if peak or as_json:
            _tell(peak_stresses(content, given, folder), as_json)
    except InputError as error:
        raise error.located(result) from None


def _tell(peaks: dict[str, Peak], as_json: bool) -> None:
    from ..report.tables import table

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
            file=for_json(),
        )
        return
    rows = [
        [name, f"{p.stress:.6g}", f"{p.time:.6g}", *(f"{x:.6g}" for x in p.place)]
        for name, p in peaks.items()
    ]
    click.echo(table(["body", "von Mises Pa", "t s", "x m", "y m", "z m"], rows))
