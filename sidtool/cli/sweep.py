"""``sidtool sweep``: a scene for many values of its design parameters."""

from __future__ import annotations

from pathlib import Path

import click

from sidtool.formats.endings import kind_by_ending
from sidtool.formats.errors import InputError
from sidtool.formats.storage.operating_system import ENDING_SIGNALS, processors

from ..interrupting import ending
from .common import (
    Target,
    changes,
    check_targets,
    existing,
    files_of,
    force,
    read_changed,
    target,
    tell,
)
from .study import progress_told

#: Behind the name of a table or picture: the folder of its finished runs.
POINTS = ".points"


@click.command()
@click.argument("scene", metavar="SCENE", type=existing)
@click.option(
    "--over",
    "over",
    metavar="KEY=VALUES",
    multiple=True,
    required=True,
    help="A key of the scene and its values: FROM:TO:COUNT, FROM:TO:COUNT:log, or "
    "values with commas between them. Several keys make a full grid.",
)
@click.option(
    "--of",
    "of",
    metavar="OUTPUT.MEASURE",
    multiple=True,
    required=True,
    help="What is measured: an output (`*` for any letters) and max, min, end, mean, "
    "rms or amplitude; several with commas between them, or given several times.",
)
@click.option(
    "-o",
    "--output",
    "outputs",
    type=target,
    multiple=True,
    help="Table (.csv) or picture (.png, .svg, .pdf); may be given for each. Finished "
    "runs are kept beside the first one, in NAME.points.",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    help="Processes; default one on each core.",
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Compute on the cluster of this Dask scheduler, such as tcp://host:8786; "
    "needs the packages dask and distributed.",
)
@changes
@force
def sweep(
    scene: Path,
    over: tuple[str, ...],
    of: tuple[str, ...],
    outputs: tuple[Path, ...],
    jobs: int | None,
    dask: str | None,
    changes: tuple[str, ...],
    force: bool,
) -> None:
    """Simulate a SCENE for values of its design parameters.

    --over varies any key of the scene by its path, as --set names it:

    \b
      parameters.h=0.01:0.02:11       11 values from 0.01 to 0.02
      forces.spring.stiffness=1e2:1e6:9:log   equal ratios
      bodies.rod.mass=0.5,1,2         a list
      rod.model.geometry.thickness=0.01:0.02:3   a key of the model of the body rod
      rod.sid=a.SID_FEM,b.SID_FEM     texts

    --of measures an output, which need not be recorded, at the output times of the
    scene (a peak between them is not seen: lower time.output_step):

    \b
      max, min    largest and least value
      end         value at the end of the run
      mean, rms   mean over time, and root of the mean square
      amplitude   half the difference of max and min

    t.end is the time at which a run ends, as by an event with `action = "stop"`.

    Runs are integrated as the scene says, one on each core. A run that cannot be set up
    or stops early is a row with its reason. With -o the same command goes on where it
    was interrupted, and one that asks for more values runs only the new ones; the
    folder NAME.points may be removed.

    \b
    Examples:
      sidtool sweep slider_crank.toml --over crank.mass=0.2:0.5:4 --of piston.x.max
      sidtool sweep arm.toml --over parameters.h=0.01:0.02:11 --of tip.y.max -o h.csv
      sidtool sweep arm.toml --over parameters.h=0.01:0.02:11 \\
          --over parameters.load=1,2,5 --of "arm.tip.*.max" -o h.csv -o h.png

    Exit status: 0 done; 1 some runs failed, and their rows say why; 129, 130 or 143 a
    signal ended it (finished runs are kept with -o); 2 the input is wrong.
    """
    from ..study import Ended
    from ..sweep import sweep as asked_sweep

    targets = [
        Target("-o", path, kind_by_ending(path, "sweep", "picture")) for path in outputs
    ]
    named = [text.partition("=")[2] for text in (*over, *changes)]
    check_targets(targets, [*files_of(scene), *named], force)
    folder = outputs[0].with_suffix(POINTS) if outputs else None
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError("is not a folder", source=folder, expected="another -o")
    content = read_changed(scene, changes)
    with ending(*ENDING_SIGNALS) as asked:
        try:
            with progress_told() as say:
                found = asked_sweep(
                    content,
                    over,
                    of,
                    folder=folder,
                    jobs=jobs or processors(),
                    dask=dask,
                    title=content.title or scene.stem,
                    stop=asked,
                    progress=say,
                )
        except Ended as why:
            rest = "nothing is kept without -o"
            if folder is not None:
                rest = "no run was finished"
                if folder.exists():
                    rest = f"finished runs are in {folder}; the same command goes on"
            click.echo(f"sidtool: {scene}: {why}; {rest}", err=True)
            raise click.exceptions.Exit(128 + asked.number) from None
    tell(found.report(), found.data)
    if found.failed:
        count = f"{len(found.failed)} of {len(found.points)} runs failed"
        click.echo(f"sidtool: {scene}: {count}", err=True)
    for path in outputs:
        if kind_by_ending(path, "sweep", "picture") == "sweep" or _has_numbers(found):
            found.save(path)
            click.echo(f"{path} written")
    if found.failed:
        raise click.exceptions.Exit(1)


def _has_numbers(found: object) -> bool:
    points = getattr(found, "points", ())
    return any(not point.message for point in points)
