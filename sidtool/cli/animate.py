"""``sidtool animate``: the motion of a result, to look at."""

from __future__ import annotations

from pathlib import Path

import click

from sidtool.formats.endings import kind_by_ending
from sidtool.formats.errors import InputError

from .body_files import files_by_body, full_fields
from .common import Target, check_targets, existing, force, target, tell_remarks


@click.command()
@click.argument("result", metavar="RESULT", type=existing)
@click.option(
    "-o",
    "--output",
    required=True,
    type=target,
    help="Page (.html) or film (.gif, or .mp4 where ffmpeg is installed) to write.",
)
@full_fields
@click.option(
    "--outputs",
    "outputs",
    metavar="NAMES",
    help="Outputs beside the motion, with commas between them, `*` for any letters; "
    "default the first that were recorded.",
)
@click.option(
    "--colour",
    type=click.Choice(["body", "displacement", "stress"]),
    default="body",
    show_default=True,
    help="What bodies are coloured by; a page lets you choose again.",
)
@click.option(
    "--scale",
    type=float,
    metavar="FACTOR",
    help="Magnification of elastic deformations; default one that shows them.",
)
@force
def animate(
    result: Path,
    output: Path,
    fields: tuple[str, ...],
    outputs: str | None,
    colour: str,
    scale: float | None,
    force: bool,
) -> None:
    """Show the motion of a RESULT: as a page for any browser, or as a film.

    The page is one file that needs no network. It plays the mechanism in 3D with a
    slider for time, speed, magnification of deformations, colours by displacement or
    von Mises stress, views, joints and frames, and outputs beside it; a click on a
    plot goes to its time. It takes three.js from `pip install "sidtool[view]"`.

    Flexible bodies are drawn from their full field where it is known (see `sidtool
    convert --field`), else as the hull of the nodes of their SIDs; rigid bodies as
    lines between their markers, or as boxes.

    \b
    Examples:
      sidtool animate result.h5 -o motion.html
      sidtool animate result.h5 -o motion.html --colour stress --outputs "rod.q*,*.vx"
      sidtool animate result.h5 -o motion.html --field rod=rod.field.h5 --scale 1
      sidtool animate result.h5 -o motion.gif
    """
    from ..kinds import expect_kind, read
    from ..view.animating import animate as animated

    expect_kind(result, "result")
    kind = kind_by_ending(output, "page", "film")
    given = files_by_body("--field", fields)
    check_targets([Target("-o", output, kind)], [result, *given.values()], force)
    if scale is not None and not 0 <= scale < float("inf"):
        expected = "a number of at least 0; 1 shows deformations as they are"
        raise InputError(f"found {scale}", place="--scale", expected=expected)
    try:
        told = animated(
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
    tell_remarks(told)
    click.echo(f"{output} written: {output.stat().st_size / 1e6:.2f} MB")
