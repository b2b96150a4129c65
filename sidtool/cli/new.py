"""``sidtool new``: a commented start."""

from __future__ import annotations

from pathlib import Path

import click

from ..starting import STARTS, begin

_WIDTH = max(map(len, STARTS)) + 2
_LIST = "\n      ".join(f"{name:{_WIDTH}}{text}" for name, text in STARTS.items())


def _help() -> str:
    return f"""Make the folder NAME with a commented start: model, scene, README.

    The README of the folder has its equation or a sketch, and the commands to go on
    with, step by step. The starts are the examples of sidtool:

    \b
      {_LIST}

    \b
    Examples:
      sidtool new my_arm --from robot_arm
      cd my_arm
    """


@click.command(help=_help())
@click.argument("name", metavar="NAME", type=click.Path(path_type=Path))
@click.option(
    "--from",
    "start",
    type=click.Choice(list(STARTS)),
    default="slider_crank",
    show_default=True,
    help="What to start from.",
)
def new(name: Path, start: str) -> None:
    """See `_help`."""
    for made in begin(name, start):
        click.echo(f"  {name / made}")
    click.echo(f"Go on in the folder {name}: README.md has the commands, step by step.")
