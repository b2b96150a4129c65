"""``sidtool fmu``: a scene as a functional mock-up unit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import (
    Target,
    changes_option,
    check_targets,
    existing_file,
    files_by_body,
    force_option,
    input_files,
    listed_names,
    output_path,
    print_result,
    print_warnings,
    read_scene_with_changes,
    rigid_option,
)

if TYPE_CHECKING:
    from ..fmu.export import ExportedUnit
    from ..fmu.model_description import Variable


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
@click.option("--rtol", type=float, help="Relative tolerance of a step.")
@click.option(
    "--step",
    type=float,
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
