"""``sidtool convert``: a model or a SID into a SID file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .common import check_target, existing, target

DIALECTS = ("fembs", "pysid", "matmorembs", "fembeam")


@click.command()
@click.argument("source", metavar="MODEL_OR_SID", type=existing)
@click.option(
    "-o", "--output", required=True, type=target, help="SID to write; .h5 gives HDF5."
)
@click.option(
    "--dialect",
    type=click.Choice(DIALECTS),
    default="fembs",
    show_default=True,
    help="Dialect of an ASCII file, for readers that need another than the canonical.",
)
@click.option(
    "--repair",
    is_flag=True,
    help="Rebuild Gr and Ge, symmetrise Oe, and list every number that changes.",
)
@click.option(
    "--units", metavar="FROM:TO", help="Rescale every block, for example mm-t-s:SI."
)
@click.option(
    "--frame",
    metavar="FRAME",
    help="Refer to another body frame: tangent:NODE, chord:NODE,NODE, buckens or "
    "buckens:NODE.",
)
def convert(
    source: Path,
    output: Path,
    dialect: str,
    repair: bool,
    units: str | None,
    frame: str | None,
) -> None:
    """Convert a model file to a SID, or a SID to another SID file.

    The kind of the source is seen from its content, the format of the output from its
    name: .h5 or .hdf5 is HDF5, any other name the ASCII format.

    \b
    Examples:
      sidtool convert rod_q4.toml -o rod.SID_FEM
      sidtool convert rod.SID_FEM -o rod.h5
      sidtool convert beam.SID_FEM -o better.SID_FEM --repair
      sidtool convert beam.SID_FEM -o beam_si.SID_FEM --units mm-t-s:SI
      sidtool convert rod.h5 -o rod.SID_FEM --dialect pysid
      sidtool convert rod.SID_FEM -o mean.SID_FEM --frame buckens
    """
    from formats.sid_files import write_sid

    check_target(output)
    sid = _sid(source)
    sid = _repaired(sid) if repair else sid
    sid = _rescaled(sid, units) if units else sid
    sid = _rereferenced(sid, frame) if frame else sid
    write_sid(output, sid, dialect)
    click.echo(f"{output}: {_summary(sid)}")


def _sid(source: Path) -> Any:
    from ..kinds import expect_kind, read

    if expect_kind(source, "model", "sid") == "sid":
        return read(source)
    from ..convert import sid_from_model

    return sid_from_model(source)


def _rereferenced(sid: Any, frame: str) -> Any:
    from formats.errors import InputError

    from ..rereference import rereferenced

    try:
        return rereferenced(sid, frame)
    except InputError as error:
        raise InputError(
            error.problem, place="--frame", expected=error.expected
        ) from None


def _summary(sid: Any) -> str:
    from ..report.sid import modes_of
    from ..report.tables import plural

    text = f"{plural(len(sid.nodes), 'node')}, {plural(sid.nq, 'mode')}"
    frequencies = [f"{mode.frequency:.4f}" for mode in modes_of(sid)[:5]]
    more = ", ..." if sid.nq > 5 else ""
    return f"{text}; {', '.join(frequencies)}{more} Hz" if frequencies else text


def _repaired(sid: Any) -> Any:
    from ..report.tables import plural, table
    from ..validate import repair

    better, changes = repair(sid)
    if changes:
        rows = [
            [c.block, c.entry, f"{c.before:.11e}", f"{c.after:.11e}", c.reason]
            for c in changes
        ]
        click.echo(table(["block", "entry", "before", "after", "because"], rows))
    click.echo(f"repair: {plural(len(changes), 'number')} changed")
    return better


def _rescaled(sid: Any, units: str) -> Any:
    from formats.errors import InputError

    from ..validate import convert_units

    old, colon, new = units.partition(":")
    if not (old and colon and new):
        raise InputError(
            f"found {units!r}", place="--units", expected="FROM:TO, as in mm-t-s:SI"
        )
    return convert_units(sid, old, new)
