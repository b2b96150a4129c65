"""``sidtool animate``: the motion of a result in a browser or as a film."""

from __future__ import annotations

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
    output_path,
    print_remarks,
)

if TYPE_CHECKING:
    pass


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
