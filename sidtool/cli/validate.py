"""``sidtool validate``: the judgement of a SID."""

from __future__ import annotations

from json import dumps, loads
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sidtool.formats.errors import InputError

from .common import existing, for_json, is_quiet, tell_remarks
from .inputs import piped

if TYPE_CHECKING:
    from sidtool.formats.sid import SID

#: What the body is called that a SID or a model describes.
_ALONE = ""


@click.command()
@click.argument("file", metavar="FILE", type=piped)
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
    file: Path,
    reference: Path | None,
    tolerance: float | None,
    strict: bool,
    json: bool,
) -> None:
    """Judge a SID: what holds in every flexible body, and what fails here.

    FILE is a SID; a model, which is converted; or a scene, whose flexible bodies are
    judged one after the other, those that are given by models as well. Each identity is
    measured and compared with its bound; a failure is explained by what it means for a
    simulation.

    \b
    Examples:
      sidtool validate rod.SID_FEM
      sidtool validate rod.SID_FEM --reference frequencies.toml
      sidtool validate rod_q4.SID_FEM --reference rod_iga.SID_FEM
      sidtool validate rod.SID_FEM --json > verdict.json
      sidtool validate rod_iga.toml --reference frequencies.toml
      sidtool validate slider_crank.toml

    Exit status: 0 good; 1 an error was found or the reference is missed; 2 the file
    cannot be read.
    """
    from ..report.judgement import judge, judgement_as_json, judgement_as_text

    sids = _sids(file)
    if reference is not None and len(sids) != 1:
        raise InputError(
            "belongs to one body",
            place="--reference",
            expected=f"one body, where {file.name} has {', '.join(sids) or 'none'}",
        )
    judged = {n: judge(s, reference, tolerance=tolerance) for n, s in sids.items()}
    good = all(judgement.good(strict=strict) for judgement in judged.values())
    as_written = judgement_as_json if json else judgement_as_text
    if is_quiet():
        for judgement in judged.values():
            tell_remarks(judgement.remarks)
    texts = {n: as_written(j, strict=strict) for n, j in judged.items()}
    if tuple(texts) == (_ALONE,):
        click.echo(texts[_ALONE], file=for_json() if json else None)
    elif json:
        bodies = {name: loads(text) for name, text in texts.items()}
        click.echo(dumps({"passed": good, "bodies": bodies}, indent=1), file=for_json())
    else:
        click.echo("\n\n".join(f"body {n}\n\n{text}" for n, text in texts.items()))
    raise click.exceptions.Exit(0 if good else 1)


def _sids(path: Path) -> dict[str, SID]:
    """SIDs by the bodies of a scene, or the one of a SID or a model."""
    from sidtool.formats.toml.files import located
    from sidtool.solver.system.bodies.data import read_sids

    from ..kinds import expect_kind, read
    from ..made import Fineness, Source, converted

    kind = expect_kind(path, "sid", "model", "scene")
    if kind == "model":
        return {_ALONE: Source(path, path.parent).sid(Fineness()).sid}
    content = read(path)
    if kind == "sid":
        return {_ALONE: content}
    with located(content):
        scene, made, _ = converted(content, content.folder)
        return read_sids(scene, content.folder, made)
