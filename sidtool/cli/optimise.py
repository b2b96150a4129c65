"""``sidtool optimise``: the best design within limits."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .common import (
    check_targets,
    existing_file,
    force_option,
    input_files,
    is_quiet,
    method_option,
    output_path,
    picture_target,
    print_on_stderr,
    print_result,
    threads_option,
)

if TYPE_CHECKING:
    from ..sensitivity.optimisation import Iteration


@click.command()
@click.argument("design", metavar="DESIGN", type=existing_file)
@click.option(
    "-o",
    "--output",
    "outputs",
    type=output_path,
    multiple=True,
    help=(
        "File to write: history (.json) or its picture (.png, .svg, .pdf); may be given"
        " for each."
    ),
)
@click.option(
    "--continue",
    "continues",
    is_flag=True,
    help="Start at the last point of the history that -o names.",
)
@threads_option
@method_option
@force_option
def optimise(
    design: Path,
    outputs: tuple[Path, ...],
    continues: bool,
    jobs: int | None,
    method: str,
    force: bool,
) -> None:
    """Find the best numbers of a scene within limits.

    DESIGN is a file that names a scene, the numbers that vary with their ranges, what
    is to be as small or as large as possible, and limits:

    \b
      format = "sidtool design"
      version = 1
      scene = "slider_crank.toml"
      changes = { "rod.model" = "rod_q4.toml" }

    \b
      [variables.thickness]
      key = "rod.model.geometry.thickness"
      min = 0.005
      max = 0.02

    \b
      [objective]
      minimise = "mass(rod)"

    \b
      [[limits]]
      of = "max_abs(rod.q1)"
      max = 8e-4

    Keys and functionals are those of `sidtool sensitivity`. The optimiser (SLSQP or
    trust-constr of SciPy) follows the gradients of the motion and finds a local
    optimum. The history is written after each iteration; --continue starts at its last
    point, also with other limits.

    \b
    Examples:
      sidtool optimise design.toml
      sidtool optimise design.toml -o history.json -o history.png
      sidtool optimise design.toml -o history.json --continue

    Exit status: 0 done; 1 not converged, or a limit is exceeded, or the run of the
    start stops; 2 the input is wrong.
    """
    from sidtool.formats.design import read_design

    from ..api.optimise import optimise as search
    from ..pipeline.files import expect_kind
    from ..sensitivity.design_result import read_history, write_history

    targets = [picture_target(path, "optimisation") for path in outputs]
    check_targets(targets, input_files(design), force)
    expect_kind(design, "design")
    content = read_design(design)
    start: dict[str, float] = {}
    histories = [
        path
        for path, target in zip(outputs, targets, strict=True)
        if target.kind == "optimisation"
    ]
    if continues and histories and histories[0].exists():
        names = [*content.variables]
        start = dict(zip(names, read_history(histories[0], names), strict=True))

    points: list[Iteration] = []

    def say(point: Iteration, number: int) -> None:
        points.append(point)
        for path in histories[:1]:
            write_history(path, [*content.variables], points)
        if not is_quiet():
            numbers = ", ".join(
                f"{name} = {x:.6g}"
                for name, x in zip(content.variables, point.x, strict=True)
            )
            line = f"iteration {number}: {content.objective.of} = {point.values[0]:.6g}"
            print_on_stderr(f"{line}; {numbers}")

    found = search(content, start=start, jobs=jobs, method=method, progress=say)
    print_result(found.report(), found.data)
    for path in outputs:
        found.save(path)
        click.echo(f"{path} written")
    if not (found.converged and found.is_feasible):
        raise click.exceptions.Exit(1)
