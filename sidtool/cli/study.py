"""``sidtool study``: error against time and size for one's own scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sidtool.formats.endings import check_ending
from sidtool.formats.errors import InputError, printable
from sidtool.formats.progress import is_heard, reached
from sidtool.formats.storage.operating_system import (
    ENDING_SIGNALS,
    is_writable_folder,
    processors,
)

from ..interrupting import ending
from .common import changes, existing, is_quiet, read_changed, target, tell, tell_notes

if TYPE_CHECKING:
    from ..study import Study

#: Lines of progress where there is no terminal come this often at most [s].
PATIENCE = 10.0
#: What is said of before the points, each of which has its own words.
STAGES = ("converting bodies", "reference")


@click.command()
@click.argument("scene", metavar="SCENE", type=existing)
@click.option(
    "--over",
    "over",
    metavar="AXES",
    multiple=True,
    help="What is varied, with commas between: mesh, modes, reduction, frame, terms, "
    "integrator; or with values, as in modes=2:4:8. Default integrator.",
)
@click.option(
    "--model",
    "models",
    metavar="BODY=FILE",
    multiple=True,
    help="The model of a body, in place of its SID; several of one body are compared.",
)
@click.option(
    "-o",
    "--output",
    type=target,
    help="Folder for tables (text, CSV), pictures (PNG, SVG), the study for `sidtool "
    "plot`, and the finished points, with which the next study goes on.",
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
@click.option(
    "--differ",
    type=click.IntRange(1),
    metavar="N",
    help="Of all combinations those that differ from the scene in at most N choices; "
    "default as many as make 300 points.",
)
@click.option(
    "--jobs", type=click.IntRange(1), help="Processes; default one on each core."
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Compute on the cluster of this Dask scheduler, such as tcp://host:8786; "
    "needs the packages dask and distributed.",
)
@changes
def study(
    scene: Path,
    over: tuple[str, ...],
    models: tuple[str, ...],
    output: Path | None,
    wanted: tuple[float, ...],
    integrators: tuple[str, ...],
    tolerances: tuple[float, ...],
    steps: tuple[float, ...],
    outputs: tuple[str, ...],
    differ: int | None,
    jobs: int | None,
    dask: str | None,
    changes: tuple[str, ...],
) -> None:
    """Measure error against time and size for a SCENE and recommend a setting.

    Runs variants of the scene, by default integrators and tolerances, and compares each
    run with a reference at the output times: the richest of all variants, integrated
    much more tightly. The error is relative to the variation of each output in the run;
    the worst output counts. Errors are told as far as the reference is good itself.
    Outputs that cannot be predicted over the time span, as in a chaotic motion, are
    named.

    \b
    --over varies the model, too:
      mesh        elements twice as large, as they are, halved: mesh=-1:0:1
      modes       modes of models, or shape functions of SIDs: modes=2:4:8
      reduction   modal:craig_bampton:attachment:herting:krylov
      frame       tangent:chord:buckens
      terms       geometric stiffening, quadratic inertia: all:stiffening:quadratic:none
      integrator  with tolerances: integrator=radau5:radau9

    mesh and reduction need bodies that are given by models, in the scene or by --model;
    several models of one body, such as Q4 and IGA, are put side by side. Elastic
    coordinates are not compared where shape functions vary.

    Points run on all cores, with one thread for linear algebra each, and are kept in
    the folder of -o: the same command goes on where it was interrupted, and one that
    asks for more computes only that. On a cluster model files and the meshes that they
    name have to be where they are here.

    \b
    Examples:
      sidtool study slider_crank.toml --wanted 1e-6
      sidtool study slider_crank.toml -o study --of rod.q1
      sidtool study slider_crank.toml --integrator radau5 --integrator radau9
      sidtool study slider_crank.toml --over modes,terms -o study
      sidtool study slider_crank.toml --over mesh,modes=1:2:5,integrator -o study \\
          --model rod=rod_q4.toml --model rod=rod_iga.toml

    Exit status: 0 done, also where no setting reaches what is wanted; 1 the scene or
    its reference could not be run to the end; 129, 130 or 143 a signal ended it
    (finished points are kept with -o); 2 the input is wrong.
    """
    from ..study import Ended, StoppedEarly
    from ..study.asked import study as asked_study

    _check_wanted(wanted)
    if output is not None:
        _check_folder(output)
    content = read_changed(scene, changes)
    with ending(*ENDING_SIGNALS) as asked:
        try:
            with progress_told() as say:
                result = asked_study(
                    content,
                    over,
                    models=_by_body(models),
                    integrators=integrators,
                    rtol=tolerances,
                    step=steps,
                    outputs=outputs,
                    differ=differ,
                    folder=output,
                    jobs=jobs or processors(),
                    dask=dask,
                    title=content.title or printable(scene.stem),
                    stop=asked,
                    progress=say,
                )
        except StoppedEarly as error:
            click.echo(f"sidtool: {error}", err=True)
            raise click.exceptions.Exit(1) from None
        except Ended as why:
            rest = "nothing is kept without -o"
            if output is not None:
                rest = "no point was finished"
                if (output / "points").exists():
                    rest = f"finished points are in {output}; the same command goes on"
            click.echo(f"sidtool: {scene}: {why}; {rest}", err=True)
            raise click.exceptions.Exit(128 + asked.number) from None
    _tell(result, wanted, output)


def _by_body(texts: tuple[str, ...]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for text in texts:
        body, _, file = text.partition("=")
        if not body or not file:
            raise InputError(
                f"found {text!r}", place="--model", expected="BODY=MODEL.toml"
            )
        found.setdefault(body, []).append(file)
    return found


def _check_wanted(wanted: tuple[float, ...]) -> None:
    for number in wanted:
        if not 1e-13 <= number <= 1.0:
            raise InputError(
                f"found {number:g}", place="--wanted", expected="1e-13 to 1"
            )


def _check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be made at the end, before any work is done."""
    check_ending(folder, "folder", "-o")
    there = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    if not is_writable_folder(there):
        raise InputError(
            "cannot be a folder to write to",
            source=folder,
            expected=f"{there} to be a folder with permission to write",
        )


@contextmanager
def progress_told() -> Iterator[Callable[[str, int, int, float | None], None]]:
    """Where nobody listens to what is reached, a line from time to time."""
    if is_quiet():
        yield lambda *_: None
        return
    if is_heard():

        def listened(text: str, done: int, count: int, left: float | None) -> None:
            stage = text if text in STAGES else "measuring points"
            reached(stage, done / max(count, 1))

        yield listened
        return
    last = -PATIENCE

    def say(text: str, done: int, count: int, left: float | None) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last < PATIENCE and done < count:
            return
        last = now
        rest = "" if left is None or done == count else f", {_duration(left)} left"
        click.echo(f"{done} of {count}{rest}: {text}", err=True)

    yield say


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _tell(result: Study, wanted: tuple[float, ...], folder: Path | None) -> None:
    from ..study.outcome import WANTED
    from ..study.tables import study_file, write_all

    wanted = wanted or WANTED
    tell_notes(result, warn=False)
    tell(result.report(wanted), lambda: study_file(result).model_dump(mode="json"))
    if folder is not None:
        names = write_all(folder, result, wanted)
        click.echo(f"{', '.join(names)} written to {folder}")
