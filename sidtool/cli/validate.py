"""``sidtool validate``: the judgement of a SID."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .common import existing
from .inputs import piped


@click.command()
@click.argument("sid", metavar="SID", type=piped)
@click.option(
    "--reference",
    type=existing,
    help="Compare with another SID, or a TOML or CSV table of frequencies and blocks.",
)
@click.option(
    "--tolerance",
    type=float,
    metavar="X",
    help="Accepted relative deviation from another SID, which is else only shown.",
)
@click.option("--strict", is_flag=True, help="Warnings count as failures.")
@click.option("--json", is_flag=True, help="The same as JSON, for programs.")
def validate(
    sid: Path,
    reference: Path | None,
    tolerance: float | None,
    strict: bool,
    json: bool,
) -> None:
    """Judge a SID: what holds in every flexible body, and what fails here.

    Each identity is measured and compared with its bound; a failure is explained by
    what it means for a simulation.

    \b
    Examples:
      sidtool validate rod.SID_FEM
      sidtool validate rod.SID_FEM --reference frequencies.toml
      sidtool validate rod_q4.SID_FEM --reference rod_iga.SID_FEM
      sidtool validate rod.SID_FEM --json > verdict.json

    Exit status: 0 good; 1 an error was found or the reference is missed; 2 the file
    cannot be read.
    """
    from ..report.judgement import judge, judgement_as_json, judgement_as_text

    judgement = judge(_read(sid), reference, tolerance=tolerance)
    good = judgement.good(strict=strict)
    as_written = judgement_as_json if json else judgement_as_text
    click.echo(as_written(judgement, strict=strict))
    raise click.exceptions.Exit(0 if good else 1)


def _read(path: Path) -> Any:
    from ..kinds import expect_kind, read

    expect_kind(path, "sid")
    return read(path)
