"""``sidtool export``: the motion of a result, or a body, for other programs.

``sidtool fmu``: a scene as a functional mock-up unit.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sidtool.formats.base.errors import InputError

from .common import (
    Real,
    Target,
    changes_option,
    check_targets,
    existing_file,
    files_by_body,
    force_option,
    full_fields,
    ignored_codes,
    input_files,
    json_stream,
    listed_names,
    output_path,
    print_remarks,
    print_result,
    print_warnings,
    read_scene_with_changes,
    rigid_option,
)

if TYPE_CHECKING:
    from ..fmu.export import ExportedUnit
    from ..fmu.model_description import Variable
    from ..view.body_fields import StressPeak


@click.command()
@click.argument("source", metavar="RESULT_OR_BODY", type=existing_file)
@click.option(
    "-o",
    "--output",
    type=output_path,
    help=(
        "File to write. Of a result: .vtkhdf, or .pvd with a folder of .vtu files. Of "
        "a body: .mat, .op4, .dmig, .bdf, .dat, .fem or .npz."
    ),
)
@full_fields
@click.option("--peak", is_flag=True, help="Print the peak stress of flexible bodies.")
@click.option("--json", "as_json", is_flag=True, help="Print the peaks as JSON.")
@click.option(
    "--interfaces",
    metavar="NAMES",
    help=(
        "Interfaces of a body in their order, separated by commas: markers of a model, "
        "nodes of a SID. Default: the interfaces of the reduction and the markers of "
        "the body frame; all nodes of a SID."
    ),
)
@click.option(
    "--fixed",
    metavar="NAMES",
    help="Interfaces of a superelement that are fixed to the ground.",
)
@changes_option
@force_option
def export(
    source: Path,
    output: Path | None,
    fields: tuple[str, ...],
    peak: bool,
    as_json: bool,
    interfaces: str | None,
    fixed: str | None,
    changes: tuple[str, ...],
    force: bool,
) -> None:
    """Write the motion of a result, or a body, for other programs.

    A RESULT is written in motion for ParaView and VTK. The file holds the elastic
    displacement and velocity of every point in inertial axes. For flexible bodies with
    a full field (see `sidtool convert --field`) it also holds all stress components in
    the axes of the body and the von Mises stress; these are NaN elsewhere. Cell data
    `body` is the number of the body. Bodies without a full field are drawn as by
    `sidtool animate`. Springs, dampers, actuators and distance rods between markers are
    lines; their numbers follow those of the bodies. The dataset /bodies of a .vtkhdf
    file holds all names.

    --peak prints the largest von Mises stress of each body over all points of its field
    and over time, with its position in the body frame and its time. Stresses of the
    field are averaged over the elements that meet at a node. BODY.peak_von_mises is
    different: it is evaluated at the markers and at the `peak_points` of the model,
    which include points inside elements. Those have larger stresses near sharp corners
    of coarse meshes.

    A BODY is a model file or a SID. The ending of the output determines the program:

    \b
      .mat          superelement for Simscape: M, K, C, interface frames P
      .op4          superelement for Nastran: KAAX, MAAX, BAAX (OUTPUT4)
      .dmig, .bdf   superelement for Nastran: GRID, SPOINT, DMIG
      .dat          superelement for OpenFAST: reduced file of ExtPtfm
      .fem          flexible body for MBDyn (modal joint)
      .npz          flexible body for Exudyn (ObjectFFRFreducedOrder)

    A superelement has six coordinates for each interface and modes with fixed
    interfaces. It needs shape functions that represent six motions of each interface,
    as [reduction] method = "craig_bampton" makes them. Symmetry, definiteness, rigid
    motions, mass and inertia are checked before a file is written.

    \b
    Examples:
      sidtool export result.h5 -o motion.vtkhdf
      sidtool export result.h5 -o motion.pvd --field rod=rod.field.h5
      sidtool export result.h5 --peak --json
      sidtool export rod.toml -o rod.mat
      sidtool export rod.SID_FEM -o rod.op4 --interfaces 1,2
      sidtool export tower.toml -o tower.dat --fixed base
    """
    from ..pipeline.files import expect_kind

    kind = expect_kind(source, "result", "model", "sid")
    of_body = {"--interfaces": interfaces, "--fixed": fixed, "--set": changes}
    of_result = {"--field": fields, "--peak": peak, "--json": as_json}
    unsuited = of_body if kind == "result" else of_result
    for option, value in unsuited.items():
        if value:
            expected = "a model or a SID" if kind == "result" else "a result"
            raise InputError(
                f"is no option for a {kind}", place=option, expected=expected
            )
    if kind == "result":
        _export_result(source, output, fields, peak, as_json, force)
    else:
        names = [_listed_names(text) for text in (interfaces, fixed)]
        _export_body(source, kind, output, names[0], names[1] or [], changes, force)


def _listed_names(text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",")]


def _export_body(
    source: Path,
    kind: str,
    output: Path | None,
    interfaces: list[str] | None,
    fixed: list[str],
    changes: tuple[str, ...],
    force: bool,
) -> None:
    from ..api.bodies import body_with_interfaces, missing_static_motions
    from ..superelement.body_files import BODY_FORMATS, write_body

    if output is None:
        raise InputError("is missing", place="-o", expected="-o FILE")
    check_targets([Target("-o", output, "body")], input_files(source), force)
    try:
        body = _read_body(source, kind, changes)
        sid, nodes, names = body_with_interfaces(body, interfaces)
        print_warnings(sid.diagnostics)
        if BODY_FORMATS[output.suffix.lower()].write_element is not None:
            print_warnings(missing_static_motions(body, nodes, names))
        element = write_body(output, sid, nodes, names=names, fixed=fixed)
    except InputError as error:
        raise error.located(source) from None
    program = BODY_FORMATS[output.suffix.lower()].program
    if element is None:
        listed = ", ".join(names.get(node, node) for node in nodes)
        click.echo(
            f"{output} written for {program}: {sid.nq} shape functions, {listed}"
        )
        return
    click.echo(
        f"{output} written for {program}: interfaces {', '.join(element.interfaces)}, "
        f"{element.n_modes} modes"
    )


def _read_body(source: Path, kind: str, changes: tuple[str, ...]) -> Any:
    from sidtool.formats.model import read_model
    from sidtool.formats.sid_files import read_sid
    from sidtool.formats.toml.files import ignoring, parse_settings

    if kind == "model":
        return ignoring(read_model(source, parse_settings(changes)), ignored_codes())
    if changes:
        raise InputError("is no option for a SID", place="--set", expected="a model")
    return read_sid(source)


def _export_result(
    result: Path,
    output: Path | None,
    fields: tuple[str, ...],
    peak: bool,
    as_json: bool,
    force: bool,
) -> None:
    from ..api.scene import read

    given = files_by_body("--field", fields)
    check_targets([Target("-o", output, "export")], [result, *given.values()], force)
    if output is None and not (peak or as_json):
        raise InputError(
            "there is nothing to do", place="-o", expected="-o FILE, --peak or both"
        )
    from ..view.body_fields import peak_stresses
    from ..view.export import export_mesh, write_export

    content, folder = read(result), result.parent
    try:
        if output is not None:
            mesh = export_mesh(content, given, folder)
            write_export(output, mesh)
            print_remarks(mesh.notes, as_json)
            click.echo(
                f"{output} written: {len(mesh.t)} times, {mesh.n_points} points",
                err=as_json,
            )
        if peak or as_json:
            _print_peaks(peak_stresses(content, given, folder), as_json)
    except InputError as error:
        raise error.located(result) from None


def _print_peaks(peaks: dict[str, StressPeak], as_json: bool) -> None:
    from ..report.tables import text_table

    if as_json:
        click.echo(
            json.dumps(
                {
                    name: {
                        "von_mises": peak.stress,
                        "time": peak.time,
                        "place": peak.place.tolist(),
                        "stress": peak.components.tolist(),
                    }
                    for name, peak in peaks.items()
                }
            ),
            file=json_stream(),
        )
        return
    rows = [
        [name, f"{p.stress:.6g}", f"{p.time:.6g}", *(f"{x:.6g}" for x in p.place)]
        for name, p in peaks.items()
    ]
    click.echo(text_table(["body", "von Mises Pa", "t s", "x m", "y m", "z m"], rows))


@click.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "-o",
    "--output",
    type=output_path,
    required=True,
    help="File to write, NAME.fmu.",
)
@click.option(
    "--fmi",
    "version",
    type=click.Choice(["2.0", "3.0"]),
    default="2.0",
    show_default=True,
    help="Version of the standard.",
)
@click.option(
    "--platforms",
    metavar="NAMES",
    default="",
    help="Where the FMU runs, separated by commas: linux64, win64, darwin64 (macOS), "
    "aarch64-linux, aarch64-darwin (Apple silicon); default this machine.",
)
@click.option(
    "--outputs",
    "names",
    metavar="NAMES",
    help="Outputs of the FMU in place of those of the scene, separated by commas; "
    "`*` for any letters.",
)
@click.option(
    "--sid",
    "swaps",
    metavar="BODY=FILE",
    multiple=True,
    help="Take another SID for a body; may be given several times.",
)
@rigid_option
@click.option(
    "--integrator", help="radau5, radau9 or radau13; default as in the scene."
)
@click.option("--rtol", type=Real(), help="Relative tolerance of a step.")
@click.option(
    "--step",
    type=Real(),
    help="Fixed step [s] in place of the error control, for real time.",
)
@click.option(
    "--linker",
    type=click.Choice(["cc", "zig"]),
    help="C compiler: cc for this machine, zig (package ziglang) for all; default what "
    "is there.",
)
@changes_option
@force_option
def fmu(
    scene: Path,
    output: Path,
    version: str,
    platforms: str,
    names: str | None,
    swaps: tuple[str, ...],
    rigid: tuple[str, ...],
    integrator: str | None,
    rtol: float | None,
    step: float | None,
    linker: str | None,
    changes: tuple[str, ...],
    force: bool,
) -> None:
    """Write a SCENE as a functional mock-up unit (FMU), for co-simulation.

    Simulink, Dymola, OpenModelica, fmpy and others import the file. It holds the
    integrator and the scene as machine code: it needs neither Python nor files. Its
    inputs are the tables [inputs.NAME] of the scene, its outputs those of the scene.
    Steps are those of `sidtool simulate`, whatever the communication step is. States
    can be stored, restored and serialised; several instances share nothing.

    The library is linked by the C compiler `cc` of this machine, or, for all platforms,
    by the package ziglang (`pip install "sidtool[fmu]"`). The first FMU compiles the
    equations for the platform, once, in about a minute.

    Joints that stick and slip and control laws in Python are refused by name. An FMU
    ends at the end time of its scene: --set time.end=1000.

    \b
    Examples:
      sidtool fmu slider_crank.toml -o machine.fmu
      sidtool fmu slider_crank.toml -o machine.fmu --fmi 3.0
      sidtool fmu arm.toml -o arm.fmu --platforms linux64,win64
      sidtool fmu arm.toml -o arm.fmu --outputs "shoulder.angle,load.*"
      sidtool fmu arm.toml -o arm.fmu --set time.end=1000 --step 1e-3

    Exit status: 0 done; 2 the scene has parts that an FMU cannot have, or there is no
    C compiler.
    """
    from ..report.diagnostics import diagnostic_line

    named = [text.partition("=")[2] for text in (*swaps, *changes)]
    target = Target("-o", output, "unit")
    check_targets([target], [*input_files(scene), *named], force)
    content = read_scene_with_changes(scene, changes)
    unit = content.fmu(
        output,
        version=version,
        platforms=listed_names(platforms),
        outputs=None if names is None else listed_names(names),
        sids=files_by_body("--sid", swaps, content.flexible),
        rigid=rigid,
        integrator=integrator,
        rtol=rtol,
        step=step,
        linker=linker,
    )
    print_warnings(unit.diagnostics)
    print_result(_summary(unit), lambda: _data(unit))
    for each in unit.diagnostics:
        if not each.is_warning:
            click.echo(diagnostic_line(each))


def _summary(unit: ExportedUnit) -> str:
    method = f"{unit.integrator}, rtol {unit.rtol:g}"
    if unit.step is not None:
        method = f"{unit.integrator}, fixed step {unit.step:g} s"
    sizes = (f"{name} {size / 1e3:.0f} kB" for name, size in unit.libraries.items())
    lines = [
        f"{unit.path}: FMI {unit.version} for co-simulation, {unit.size / 1e3:.0f} kB",
        f"  integrator  {method}",
        f"  libraries   {', '.join(sizes)}",
        f"  inputs      {_variables_text(unit.inputs)}",
        f"  outputs     {_variables_text(unit.outputs)}",
    ]
    return "\n".join(lines)


def _variables_text(variables: Sequence[Variable]) -> str:
    texts = [f"{v.name} [{v.unit}]" if v.unit else v.name for v in variables]
    return ", ".join(texts) or "none"


def _data(unit: ExportedUnit) -> dict[str, Any]:
    def data(variables: Sequence[Variable]) -> list[dict[str, Any]]:
        return [{"name": v.name, "unit": v.unit} for v in variables]

    return {
        "file": str(unit.path),
        "fmi": unit.version,
        "bytes": unit.size,
        "libraries": unit.libraries,
        "integrator": unit.integrator,
        "rtol": unit.rtol,
        "step": unit.step,
        "inputs": data(unit.inputs),
        "outputs": data(unit.outputs),
        "diagnostics": [each.as_data() for each in unit.diagnostics],
    }
