"""``sidtool study``: error against time for one's own scene."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .common import changes, existing, read_changed, target, tell

if TYPE_CHECKING:
    from ..study import Study


@click.command()
@click.argument("scene", metavar="SCENE", type=existing)
@click.option(
    "-o",
    "--output",
    type=target,
    help="Folder for the plot, the tables as text, and the study for `sidtool plot`.",
)
@click.option(
    "--wanted",
    type=float,
    multiple=True,
    help="Wanted relative error; may be given several times. Default 1e-3, 1e-6, 1e-9.",
)
@click.option(
    "--integrator",
    "integrators",
    metavar="NAME",
    multiple=True,
    help="Default all; auto if asked for.",
)
@click.option(
    "--rtol", "tolerances", type=float, multiple=True, help="Default 1e-2 to 1e-9."
)
@click.option(
    "--step", "steps", type=float, multiple=True, help="Fixed steps in seconds."
)
@click.option(
    "--of",
    "outputs",
    metavar="NAME",
    multiple=True,
    help="Output that counts, such as piston.x. Default all that the scene records.",
)
@changes
def study(
    scene: Path,
    output: Path | None,
    wanted: tuple[float, ...],
    integrators: tuple[str, ...],
    tolerances: tuple[float, ...],
    steps: tuple[float, ...],
    outputs: tuple[str, ...],
    changes: tuple[str, ...],
) -> None:
    """Measure error against time for a SCENE and recommend a setting.

    Runs integrators and tolerances over the scene and compares each run with a
    reference of tight tolerance at the output times. The error is relative to the
    variation of each output in the run; the worst output counts. Outputs that cannot
    be predicted over the time span, as in a chaotic motion, are named.

    \b
    Examples:
      sidtool study slider_crank.toml --wanted 1e-6
      sidtool study slider_crank.toml -o study --of rod.q1
      sidtool study slider_crank.toml --integrator radau5 --integrator radau9
    """
    from sidtool.formats.files import located
    from sidtool.solver import compile_scene
    from sidtool.solver.errors import SimulationError

    from ..study import default_settings, study_file
    from ..study import study as run

    for option, numbers in (("--wanted", wanted), ("--rtol", tolerances)):
        _check(option, numbers, 1e-13, 1.0 if option == "--wanted" else 0.1)
    _check("--step", steps, 1e-12, 1e12)
    settings = default_settings(integrators, tolerances, steps)
    if output is not None:
        _check_folder(output)
    try:
        content = read_changed(scene, changes)
        with located(content):
            result = run(
                compile_scene(content, content.folder), settings, outputs, _say
            )
    except SimulationError as error:
        click.echo(f"sidtool: {scene}: the reference {error}", err=True)
        raise click.exceptions.Exit(1) from None
    text = _report(result, wanted or (1e-3, 1e-6, 1e-9))
    tell(text, lambda: study_file(result, scene.stem).model_dump(mode="json"))
    if output is not None:
        _write(output, result, text, scene.stem)


def _say(line: str) -> None:
    click.echo(line, err=True)


def _check(option: str, numbers: tuple[float, ...], least: float, most: float) -> None:
    from sidtool.formats.errors import InputError

    for number in numbers:
        if not least <= number <= most:
            raise InputError(
                f"found {number:g}", place=option, expected=f"{least:g} to {most:g}"
            )


def _check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be made at the end, before any work is done."""
    from sidtool.formats.errors import InputError

    there = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    if not (there.is_dir() and os.access(there, os.W_OK)):
        raise InputError(
            "cannot be a folder to write to",
            source=folder,
            expected=f"{there} to be a folder with permission to write",
        )


def _report(result: Study, wanted: tuple[float, ...]) -> str:
    from ..study import differing, recommendation_table, study_table

    reference = result.reference
    parts = [study_table(result)]
    parts.append(recommendation_table(result.points, wanted))
    parts.append(
        f"Errors are relative, of the worst of: {', '.join(reference.names)}.\n"
        f"The reference is good to {reference.uncertainty:.0e}; smaller errors cannot "
        "be told."
    )
    if reference.left_out:
        parts.append(f"Left out, rounding only: {', '.join(reference.left_out)}.")
    if reference.unpredictable:
        found = differing(reference.unpredictable)
        parts.append(
            f"Not predictable over this time span: {found}. No setting above is "
            "recommended for them; a shorter time span may help."
        )
    return "\n\n".join(parts)


def _write(folder: Path, result: Study, text: str, title: str) -> None:
    """The text takes its place last: where it stands, nothing is missing."""
    from sidtool.formats.atomic import atomic_path
    from sidtool.formats.study import write_study

    from ..study import plot_study, study_file

    folder.mkdir(parents=True, exist_ok=True)
    table, plot, data = (folder / f"study.{end}" for end in ("txt", "png", "json"))
    content = study_file(result, title)
    with atomic_path(table) as temporary:
        temporary.write_text(text + "\n")
        plot_study(plot, content)
        write_study(data, content)
    click.echo(f"{table}, {plot} and {data} written")
