"""``sidtool trim``: a SID with what a scene needs of it, and no more."""

from __future__ import annotations

from pathlib import Path

import click

from sidtool.formats.errors import InputError

from .common import (
    Target,
    check_targets,
    existing,
    files_of,
    force,
    target,
    tell,
    tell_notes,
)


@click.command()
@click.argument("sid", metavar="SID", type=existing)
@click.argument("scene", metavar="SCENE", type=existing)
@click.option("-o", "--output", type=target, required=True, help="SID file to write.")
@click.option(
    "--accuracy",
    metavar="ERROR",
    multiple=True,
    help="As in `sidtool simulate`; default what the scene asks for, else 1e-3.",
)
@force
def trim(
    sid: Path, scene: Path, output: Path, accuracy: tuple[str, ...], force: bool
) -> None:
    """Take out of a SID the shape functions and nodes that a SCENE does not need.

    The search is that of `sidtool simulate --accuracy`. The bodies of the scene that
    have this SID say which of its shape functions are kept, those that one of them
    needs, and which nodes: those that it names. What is kept is copied as it is. Told
    is what was taken out, what it costs the outputs of the scene, and how the elastic
    coordinates are numbered now. Exit status 2: wrong input, nothing is written.

    \b
    Examples:
      sidtool trim rod.SID_FEM slider_crank.toml -o small.SID_FEM
      sidtool trim rod.SID_FEM slider_crank.toml --accuracy piston.x=1e-5 -o small.h5
    """
    from sidtool.formats.scene import read_scene
    from sidtool.formats.sid_files import write_sid
    from sidtool.solver.errors import SimulationError

    from ..accuracy import from_texts
    from ..kinds import expect_kind
    from ..trim import trimmed

    check_targets([Target("-o", output, "sid")], [sid, *files_of(scene)], force)
    expect_kind(sid, "sid")
    expect_kind(scene, "scene")
    wanted = from_texts(accuracy)
    try:
        found = trimmed(sid, read_scene(scene), scene.parent, wanted)
    except InputError as error:
        raise error.located(scene) from None
    except SimulationError as error:
        click.echo(f"sidtool: {scene}: the finest model {error}", err=True)
        raise click.exceptions.Exit(1) from None
    write_sid(output, found.sid)
    tell_notes(found)
    tell("\n".join(found.sentences), found.data)
    click.echo(f"{output} written")
