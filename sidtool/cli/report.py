"""``sidtool report``: a run as a page to file or to print."""

from __future__ import annotations

from pathlib import Path

import click

from sidtool.formats.errors import InputError

from .body_files import files_by_body, full_fields
from .common import Target, check_targets, existing, force, target, tell_remarks


@click.command()
@click.argument("result", metavar="RESULT", type=existing)
@click.option(
    "-o", "--output", required=True, type=target, help="Page to write (.html)."
)
@full_fields
@force
def report(result: Path, output: Path, fields: tuple[str, ...], force: bool) -> None:
    """Write what an engineer files of a RESULT, as one page (HTML).

    Scene and bodies, what was modelled and what was left out, accuracy and cost,
    events, outputs as tables and curves, pictures of the mechanism, versions. The page
    needs nothing beside it and prints on A4 or to PDF.

    \b
    Examples:
      sidtool report result.h5 -o report.html
      chromium --headless --print-to-pdf=report.pdf report.html
    """
    from ..filing.page import write_report
    from ..kinds import expect_kind, read

    expect_kind(result, "result")
    given = files_by_body("--field", fields)
    check_targets(
        [Target("-o", output, "page")], [result, *map(str, given.values())], force
    )
    try:
        told = write_report(output, read(result), given, result.parent)
    except InputError as error:
        raise error.located(result) from None
    tell_remarks(told)
    click.echo(f"{output} written")
