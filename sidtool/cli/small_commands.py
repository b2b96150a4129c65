"""The commands info, outputs, new, schema, demo and warmup."""

import json
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from ..pipeline.examples import EXAMPLE_TITLES, copy_example
from .common import (
    check_targets,
    existing_file,
    force_option,
    json_stream,
    output_path,
    piped_path,
    print_on_stderr,
    print_result,
    result_target,
    verbose_option,
)

KINDS = {
    "model": ("sidtool.formats.model", "ModelFile"),
    "scene": ("sidtool.formats.scene", "SceneFile"),
    "reference": ("sidtool.formats.reference", "ReferenceFile"),
    "design": ("sidtool.formats.design", "DesignFile"),
}


@click.command()
@click.argument("file", metavar="FILE", type=piped_path)
@verbose_option
def info(file: Path, verbose: bool) -> None:
    """Describe the content of a SID, model, scene or result.

    \b
    For a SID: natural modes with frequency, kind, boundary condition, effective mass
    and share of the static compliance; frame, stiffening, stress, nodes, dialect.
    For a model: geometry, material, discretisation, frame, reduction, damping, and the
    position of every marker, for which the body is discretised. For an imported mesh or
    matrices also mass, centre of mass, inertia, free frequencies (of more than 60 000
    degrees of freedom with -v) and node sets.
    For a scene: bodies, joints, drives and forces with their parameters, degrees of
    freedom, redundant constraints, total mass, which terms the simulation includes, and
    for flexible bodies frequencies, excitation and expected stiffening. Terms of the
    equations that the scene omits are "off", those that the SID does not have "-".
    For a result: range of each output, cost, drift of the constraints, and the
    contribution of each shape function. If an accuracy was requested, also the
    estimated error of each output, the error budget with its cost, and what was omitted
    and why.

    \b
    Examples:
      sidtool info rod.SID_FEM
      sidtool info slider_crank.toml

    Exit status: 0 done; 2 the file cannot be read, or the body of a model cannot be
    discretised. In the latter case the content of the model and the reason are printed.
    """
    from ..api.scene import read
    from ..pipeline.files import expect_kind
    from ..report.json_data import content_data

    kind = expect_kind(file, "sid", "model", "scene", "result")
    content = read(file)
    if kind == "model":
        _describe_model_file(content, file, verbose)
    else:
        text = DESCRIBERS[kind](content, file, verbose)
        print_result(text, lambda: content_data(content))


def _describe_sid_file(content: Any, _: Path, verbose: bool) -> str:
    from ..report.sid import describe_sid

    return describe_sid(content, verbose)


def _describe_model_file(content: Any, path: Path, verbose: bool) -> None:
    """Print the content of a model file, also if its body cannot be discretised.

    Raises
    ------
    InputError : the body cannot be discretised.
    """
    from sidtool.formats.base.errors import InputError
    from sidtool.formats.text import fit_on_screen

    from ..discretisation.registry import finite_element_model
    from ..report.input_files import (
        MAX_MARKERS,
        describe_import,
        describe_model,
        node_set_table,
    )

    body = failure = None
    imported = ""
    try:
        body = finite_element_model(content)
        if content.geometry.type in ("mesh", "matrices"):
            imported = describe_import(body, verbose)
    except InputError as error:
        failure = error

    def description(most: int | None) -> str:
        parts = [describe_model(content, body, most)]
        if body is not None and imported:
            parts += [imported, node_set_table(body, most)]
        return "\n\n".join(parts)

    text = fit_on_screen(description, MAX_MARKERS, verbose)
    print_result(text, content.file_data)
    if failure is not None:
        raise failure.located(path)


def _describe_scene_file(content: Any, path: Path, verbose: bool) -> str:
    from sidtool.formats.base.errors import InputError
    from sidtool.formats.text import fit_on_screen, wrapped
    from sidtool.solver import compile_scene, describe
    from sidtool.solver.diagnostics.run_summary import describe_bodies

    from ..pipeline.scene_changes import with_initial_state
    from ..pipeline.scene_models import convert_bodies
    from ..report.input_files import MAX_ROWS, describe_scene, equation_tables

    folder = path.parent
    try:
        whole, model_sids, notes = convert_bodies(
            with_initial_state(content, folder), folder
        )
        system = compile_scene(whole, folder, model_sids, accept_defects=True)
        lines, bodies = describe(system), describe_bodies(system)
    except InputError as error:
        raise error.located(path) from None
    converted = [each.line for of_body in notes.values() for each in of_body]
    texts = "\n".join(wrapped(line, "    ") for line in [*converted, *lines])

    def description(most: int | None) -> str:
        tables = equation_tables(bodies, most)
        return "\n\n".join([describe_scene(content, most), *tables, texts])

    return fit_on_screen(description, MAX_ROWS, verbose)


def _describe_result_file(content: Any, _: Path, verbose: bool) -> str:
    from ..report.result import describe_result

    return describe_result(content, verbose)


DESCRIBERS: dict[str, Callable[[Any, Path, bool], str]] = {
    "sid": _describe_sid_file,
    "scene": _describe_scene_file,
    "result": _describe_result_file,
}


_WIDTH = max(map(len, EXAMPLE_TITLES)) + 2
_LIST = "\n      ".join(
    f"{name:{_WIDTH}}{text}" for name, text in EXAMPLE_TITLES.items()
)


def _examples_help() -> str:
    return f"""Make the folder NAME with a commented start: model, scene, README.

    The README of the folder has its equation or a sketch, and the commands to go on
    with, step by step. The starts are the examples of sidtool:

    \b
      {_LIST}

    \b
    Examples:
      sidtool new my_arm --from robot_arm
      cd my_arm
    """


@click.command(help=_examples_help())
@click.argument("name", metavar="NAME", type=click.Path(path_type=Path))
@click.option(
    "--from",
    "start",
    type=click.Choice(list(EXAMPLE_TITLES)),
    default="slider_crank",
    show_default=True,
    help="Example to copy.",
)
def new(name: Path, start: str) -> None:
    """Copy an example; `_examples_help` gives the help text."""
    for file in copy_example(name, start):
        click.echo(f"  {name / file}")
    click.echo(f"Go on in the folder {name}: README.md has the commands, step by step.")


@click.command()
@click.argument("kind", type=click.Choice(list(KINDS)))
def schema(kind: str) -> None:
    """Print the JSON Schema of a kind of file, for editors.

    \b
    Example:
      sidtool schema scene > scene.schema.json
    """
    module, name = KINDS[kind]
    file = getattr(import_module(module), name)
    click.echo(json.dumps(file.model_json_schema(), indent=2))


@click.command()
@click.option(
    "-o",
    "--output",
    type=output_path,
    default=Path("demo"),
    show_default=True,
    help="Folder for the plots, SIDs and results.",
)
def demo(output: Path) -> None:
    """Run the demonstration: a slider-crank with a flexible rod, discretised twice.

    The rod is converted to a SID by bilinear quadrilaterals (Q4) and by isogeometric
    analysis (IGA). Its frequencies are compared with published ones, the mechanism is
    simulated with both rods, and cost is tabulated over error. With `pip install
    "sidtool[view]"` motion.html in the folder shows the motion in a browser.
    """
    from .demo_run import run_demo

    run_demo(output, click.echo)


@click.command()
@click.argument("code", required=False)
def explain(code: str | None) -> None:
    """Explain the diagnostic with a CODE: its meaning, its numbers, what to do.

    Without CODE all diagnostics are listed.

    \b
    Examples:
      sidtool explain N411
      sidtool explain
    """
    from ..report.diagnostics import explain as explanation, list_codes

    click.echo(explanation(code) if code else list_codes())


@click.command()
@click.option("--fmu", is_flag=True, help="Also those of FMUs for this platform.")
def warmup(fmu: bool) -> None:
    """Compile all kernels in advance, so that no simulation waits for it.

    This covers planar and spatial equations and all integrators, on all processors. The
    compiled kernels are stored in the package, in your cache folder, or in the folder
    of the environment variable NUMBA_CACHE_DIR. Other scenes do not need a new
    compilation; a new version of sidtool does.

    \b
    Example, after an installation:
      sidtool warmup && sidtool simulate slider_crank.toml -o motion.csv

    Exit status: 0 all kernels are on disk; 1 they cannot be stored.
    """
    from sidtool.solver.compiler.kernel_cache import has_failed_to_write
    from sidtool.solver.compiler.precompile import precompile_all
    from sidtool.solver.integrators.registry import all_step_loops

    from ..fmu.linking import precompile_units

    begin = time.perf_counter()
    count = precompile_all(all_step_loops(), print_on_stderr)
    if fmu:
        count += precompile_units()
    if count == 0:
        click.echo("all kernels are ready; there was nothing to compile")
        return
    click.echo(f"{count} kernels compiled in {time.perf_counter() - begin:.1f} s")
    if has_failed_to_write():
        raise click.exceptions.Exit(1)


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
    from ..pipeline.extra_outputs import outputs as evaluated, with_outputs
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
