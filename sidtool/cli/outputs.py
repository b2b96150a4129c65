"""``sidtool outputs``: evaluate outputs that a run did not record."""

import json
from pathlib import Path

import click

from .common import (
    check_targets,
    existing_file,
    force_option,
    json_stream,
    output_path,
    result_target,
)


@click.command()
@click.argument("result", metavar="RESULT", type=existing_file)
@click.option(
    "--add",
    "names",
    metavar="NAMES",
    multiple=True,
    help="Outputs to evaluate, separated by commas; `*` for any letters.",
)
@click.option(
    "-o",
    "--output",
    type=output_path,
    help="File to write with the recorded and the added outputs (.h5 or .csv).",
)
@click.option("--json", "as_json", is_flag=True, help="Print the columns as JSON.")
@force_option
def outputs(
    result: Path,
    names: tuple[str, ...],
    output: Path | None,
    as_json: bool,
    force: bool,
) -> None:
    """Evaluate outputs of a RESULT that its run did not record.

    A result holds its scene with all SIDs and the states at all output times, so every
    output of the scene can be evaluated without a new run. Only energies that are
    integrals along the run (dissipated, supplied, balance) must be recorded in the run.
    Without --add the names of all outputs are listed; recorded ones have a *. With -o
    or --json the recorded outputs are written or printed, with or without --add.

    \b
    Examples:
      sidtool outputs result.h5
      sidtool outputs result.h5 --add rod.piston_pin.vx,rod.q*
      sidtool outputs result.h5 --add "*.vx,bearing.f*" -o more.h5
      sidtool outputs result.h5 --add "rod.*.ux" -o tip.csv
      sidtool outputs result.h5 -o recorded.csv
    """
    from sidtool.formats.base.errors import InputError
    from sidtool.formats.result import units_in

    from ..api.scene import read
    from ..pipeline.extra_outputs import outputs as evaluated
    from ..pipeline.extra_outputs import with_outputs
    from ..pipeline.files import expect_kind, write
    from ..report.result import output_ranges

    expect_kind(result, "result")
    check_targets([result_target(output)], [result], force)
    content = read(result)
    if not names and output is None and not as_json:
        click.echo(_output_names_text(content))
        return
    try:
        if names:
            evaluated_outputs = evaluated(content, ",".join(names))
            if not evaluated_outputs:
                raise InputError("names no output", place="--add", expected="names")
        else:
            evaluated_outputs = dict(zip(content.names, content.values.T, strict=True))
    except InputError as error:
        raise error.located(result) from None
    if as_json:
        columns = {"t": content.t, **evaluated_outputs}
        numbers = {name: c.tolist() for name, c in columns.items()}
        click.echo(json.dumps(numbers), file=json_stream())
    else:
        click.echo(output_ranges(evaluated_outputs, units_in(content)))
    if output is None:
        return
    write(output, with_outputs(content, evaluated_outputs))
    click.echo(f"{output} written", err=as_json)


def _output_names_text(content: object) -> str:
    """Return the names of all outputs, one line per owner."""
    from sidtool.formats.result import Result
    from sidtool.formats.scene import known_outputs, owners_of, rarer_outputs
    from sidtool.solver.simulation.replay import scene_of

    from ..report.tables import named_values

    assert isinstance(content, Result)
    scene = scene_of(content)
    known = dict.fromkeys([*content.names, *known_outputs(scene, content.sids)])
    lines = []
    for owner in owners_of(known):
        quantities = [
            n.rpartition(".")[2] for n in known if n.rpartition(".")[0] == owner
        ]
        marks = ["*" if f"{owner}.{q}" in content.names else "" for q in quantities]
        pairs = zip(quantities, marks, strict=True)
        lines.append((owner, " ".join(q + mark for q, mark in pairs)))
    rare: dict[str, list[str]] = {"BODY": [], "BODY.MARKER": []}
    for name in rarer_outputs(scene):
        owner, _, quantity = name.rpartition(".")
        kind = rare["BODY.MARKER" if "." in owner else "BODY"]
        if quantity not in kind:
            kind.append(quantity)
    also = [(f"each {kind}", " ".join(names)) for kind, names in rare.items() if names]
    return named_values([*lines, *also])
