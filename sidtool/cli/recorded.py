"""``sidtool outputs``: what a result can tell beside what was recorded."""

from __future__ import annotations

import json
from pathlib import Path

import click

from .common import check_targets, existing, for_json, force, result_target, target


@click.command()
@click.argument("result", metavar="RESULT", type=existing)
@click.option(
    "--add",
    "names",
    metavar="NAMES",
    multiple=True,
    help="Outputs to evaluate, with commas between them; `*` for any letters.",
)
@click.option(
    "-o",
    "--output",
    type=target,
    help="Write what was recorded and what was added (.h5 or .csv).",
)
@click.option("--json", "as_json", is_flag=True, help="Print the columns as JSON.")
@force
def outputs(
    result: Path,
    names: tuple[str, ...],
    output: Path | None,
    as_json: bool,
    force: bool,
) -> None:
    """Evaluate outputs of a RESULT that its run did not record.

    A result holds its scene with all SIDs, and the states at all output times, so
    that every output of the scene follows without a new run. Only energies that are
    integrals along the run (dissipated, supplied, balance) have to be recorded in it.
    Without --add the names of all outputs are listed; those recorded have a *. With -o
    or --json the recorded outputs are written or printed, --add or not.

    \b
    Examples:
      sidtool outputs result.h5
      sidtool outputs result.h5 --add rod.piston_pin.vx,rod.q*
      sidtool outputs result.h5 --add "*.vx,bearing.f*" -o more.h5
      sidtool outputs result.h5 --add "rod.*.ux" -o tip.csv
      sidtool outputs result.h5 -o recorded.csv
    """
    from sidtool.formats.errors import InputError
    from sidtool.formats.result import units_in

    from ..afterwards import outputs as evaluated
    from ..afterwards import with_outputs
    from ..api import write
    from ..kinds import expect_kind, read
    from ..report.result import ranges

    expect_kind(result, "result")
    check_targets([result_target(output)], [result], force)
    content = read(result)
    if not names and output is None and not as_json:
        click.echo(_listed(content))
        return
    try:
        if names:
            found = evaluated(content, ",".join(names))
            if not found:
                raise InputError("names no output", place="--add", expected="names")
        else:
            found = dict(zip(content.names, content.values.T, strict=True))
    except InputError as error:
        raise error.located(result) from None
    if as_json:
        columns = {"t": content.t, **found}
        numbers = {name: c.tolist() for name, c in columns.items()}
        click.echo(json.dumps(numbers), file=for_json())
    else:
        click.echo(ranges(found, units_in(content)))
    if output is None:
        return
    write(output, with_outputs(content, found))
    click.echo(f"{output} written", err=as_json)


def _listed(content: object) -> str:
    """Names of all outputs, a line for each owner."""
    from sidtool.formats.result import Result
    from sidtool.formats.scene import known_outputs, owners, rarer_outputs
    from sidtool.solver.afterwards import scene_of

    from ..report.tables import named

    assert isinstance(content, Result)
    scene = scene_of(content)
    known = dict.fromkeys([*content.names, *known_outputs(scene, content.sids)])
    lines = []
    for owner in owners(known):
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
    return named([*lines, *also])
