"""``sidtool validate`` and ``sidtool trim``: check a SID, reduce it for a scene."""

from __future__ import annotations

from json import dumps, loads
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sidtool.formats.base.errors import InputError

from .common import (
    Real,
    Target,
    check_targets,
    existing_file,
    force_option,
    input_files,
    is_quiet,
    json_stream,
    output_path,
    piped_path,
    print_failure,
    print_result,
    print_warnings,
)

if TYPE_CHECKING:
    from sidtool.formats.base.sid import SID

    from ..accuracy.trimmed_sid import TrimmedSid

#: Name of the body of a single SID or model.
_SINGLE_BODY = ""


@click.command()
@click.argument("file", metavar="FILE", type=piped_path)
@click.option(
    "--reference",
    type=existing_file,
    help="Compare with another SID, or a TOML or CSV table of frequencies and blocks.",
)
@click.option(
    "--tolerance",
    type=Real(),
    metavar="X",
    help=(
        "Accepted relative deviation from another SID; without it deviations "
        "are only printed."
    ),
)
@click.option(
    "--all",
    "all_rows",
    is_flag=True,
    help="Print every identity and every compared number, not only what failed.",
)
@click.option("--strict", is_flag=True, help="Warnings count as failures.")
@click.option("--json", is_flag=True, help="Print the result as JSON, always complete.")
def validate(
    file: Path,
    reference: Path | None,
    tolerance: float | None,
    all_rows: bool,
    strict: bool,
    json: bool,
) -> None:
    """Validate a SID by identities that hold for every flexible body.

    FILE is a SID; a model, which is converted; or a scene, whose flexible bodies are
    checked one by one, including those given by models. The residual of each identity
    is compared with its bound. For each failure the consequence for a simulation is
    explained.

    \b
    Examples:
      sidtool validate rod.SID_FEM
      sidtool validate rod.SID_FEM --reference frequencies.toml --all
      sidtool validate rod_q4.SID_FEM --reference rod_iga.SID_FEM
      sidtool validate rod.SID_FEM --json > verdict.json
      sidtool validate rod_iga.toml --reference frequencies.toml
      sidtool validate slider_crank.toml

    Exit status: 0 good; 1 an error was found or the reference is missed; 2 the file
    cannot be read.
    """
    from ..report.validation import judge_sid, judgement_as_json, judgement_as_text

    sids = _sids_of_file(file)
    if reference is not None and len(sids) != 1:
        raise InputError(
            "belongs to one body",
            place="--reference",
            expected=f"one body, where {file.name} has {', '.join(sids) or 'none'}",
        )
    judged = {n: judge_sid(s, reference, tolerance=tolerance) for n, s in sids.items()}
    good = all(judgement.good(strict=strict) for judgement in judged.values())
    for name, judgement in judged.items():
        failed = {check.diagnostic for check in judgement.checks if check.failed}
        shown = failed if not is_quiet() and not json else ()
        about = [d.within(name) if name else d for d in judgement.diagnostics]
        print_warnings(about, {d.within(name) if name else d for d in shown})
    texts = {
        name: judgement_as_json(judgement, strict=strict)
        if json
        else judgement_as_text(judgement, strict=strict, all_rows=all_rows)
        for name, judgement in judged.items()
    }
    if tuple(texts) == (_SINGLE_BODY,):
        click.echo(texts[_SINGLE_BODY], file=json_stream() if json else None)
    elif json:
        bodies = {name: loads(text) for name, text in texts.items()}
        click.echo(
            dumps({"passed": good, "bodies": bodies}, indent=1), file=json_stream()
        )
    else:
        click.echo("\n\n".join(f"body {n}\n\n{text}" for n, text in texts.items()))
    raise click.exceptions.Exit(0 if good else 1)


def _sids_of_file(path: Path) -> dict[str, SID]:
    """Return SIDs by body for a scene, or the single SID of a SID or model file."""
    from sidtool.formats.toml.files import locate_errors
    from sidtool.solver.system.body_data import read_sids

    from ..api.scene import read
    from ..pipeline.files import expect_kind
    from ..pipeline.model_cache import BodyModel, Refinement
    from ..pipeline.scene_models import convert_bodies

    kind = expect_kind(path, "sid", "model", "scene")
    if kind == "model":
        return {_SINGLE_BODY: BodyModel(path, path.parent).sid(Refinement()).sid}
    content = read(path)
    if kind == "sid":
        return {_SINGLE_BODY: content}
    with locate_errors(content):
        scene, model_sids, _ = convert_bodies(content, content.folder)
        return read_sids(scene, content.folder, model_sids)


@click.command()
@click.argument("sid", metavar="SID", type=existing_file)
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "-o", "--output", type=output_path, required=True, help="SID file to write."
)
@click.option(
    "--accuracy",
    metavar="ERROR",
    multiple=True,
    help="As in `sidtool simulate`; default the request of the scene, else 1e-3.",
)
@force_option
def trim(
    sid: Path, scene: Path, output: Path, accuracy: tuple[str, ...], force: bool
) -> None:
    """Remove from a SID the shape functions and nodes that a SCENE does not need.

    The search is that of `sidtool simulate --accuracy`. A shape function is retained if
    a body of the scene with this SID needs it, and a node if such a body uses it. The
    retained data are copied unchanged. The command prints what was removed, the errors
    that this causes in the outputs of the scene, and the new numbers of the elastic
    coordinates. Exit status 2: wrong input, nothing is written.

    \b
    Examples:
      sidtool trim rod.SID_FEM slider_crank.toml -o small.SID_FEM
      sidtool trim rod.SID_FEM slider_crank.toml --accuracy piston.x=1e-5 -o small.h5
    """
    from sidtool.formats.scene import read_scene
    from sidtool.formats.sid_files import write_sid
    from sidtool.solver.system.errors import SimulationError

    from ..accuracy.options import parse_accuracy_options
    from ..accuracy.trimmed_sid import trim_sid
    from ..pipeline.files import expect_kind

    check_targets([Target("-o", output, "sid")], [sid, *input_files(scene)], force)
    expect_kind(sid, "sid")
    expect_kind(scene, "scene")
    wanted = parse_accuracy_options(accuracy)
    try:
        trimmed = trim_sid(sid, read_scene(scene), scene.parent, wanted)
    except InputError as error:
        raise error.located(scene) from None
    except SimulationError as error:
        print_failure(error, scene)
        raise click.exceptions.Exit(1) from None
    write_sid(output, trimmed.sid)
    print_warnings(trimmed.diagnostics)
    print_result(_trim_summary(trimmed), trimmed.data)
    click.echo(f"{output} written")


def _trim_summary(trimmed: TrimmedSid) -> str:
    """Describe what was removed, the new numbers of coordinates, and the errors."""
    from ..report.diagnostics import severity_counts
    from ..report.tables import named_values, text_table

    modes, nodes = trimmed.sizes
    kept = f"{trimmed.sid.nq} of {modes} shape functions, "
    kept += f"{len(trimmed.sid.nodes)} of {nodes} nodes of {', '.join(trimmed.bodies)}"
    numbers = enumerate(trimmed.numbers, 1)
    moved = [f"q{new} was q{old}" for new, old in numbers if new != old]
    rows = [
        [o.name, f"{trimmed.errors[o.name]:.1e}", f"{o.allowed:.1e}", o.unit]
        for o in trimmed.report.outputs
    ]
    head = [("kept", kept if trimmed.numbers else f"{kept}: rigid")]
    head += [("numbers", ", ".join(moved))] if moved else []
    counts = severity_counts(trimmed.diagnostics)
    return "\n".join(
        [
            named_values(head),
            text_table(["output", "error by removal", "allowed", "unit"], rows),
            named_values([("diagnostics", counts)]),
        ]
    )
