"""``sidtool linearise`` and ``sidtool response``: state space, frequency response."""

from pathlib import Path

import click

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import real_of_text

from .analyse import ACCEPT_DEFECTS_OPTION, run_analysis
from .common import (
    Target,
    changes_option,
    check_targets,
    existing_file,
    force_option,
    input_files,
    listed_names,
    output_path,
    picture_target,
    print_result,
)

_about_option = click.option(
    "--about",
    metavar="static|start|TIME",
    default="static",
    show_default=True,
    help=(
        "State to linearise about: the static equilibrium, the initial state with its"
        " velocities, or the state of a run at a time [s]."
    ),
)


@click.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@_about_option
@click.option(
    "--inputs",
    metavar="NAMES",
    help="Inputs of the scene, separated by commas. Default all.",
)
@click.option(
    "--outputs",
    metavar="NAMES",
    help=(
        "Outputs, separated by commas, `*` for any letters; any output of `sidtool"
        " outputs`, forces and accelerations included. Default those of the scene."
    ),
)
@click.option(
    "--descriptor",
    is_flag=True,
    help="Also write the form with all coordinates and multipliers, E x' = A x + B u.",
)
@click.option(
    "-o",
    "--output",
    type=output_path,
    help=(
        "File to write: .npz (NumPy), .mat (MATLAB), .json, or .fmu, a functional"
        " mock-up unit for model exchange and co-simulation."
    ),
)
@click.option(
    "--fmi",
    "version",
    type=click.Choice(["2.0", "3.0"]),
    help="Version of the standard of an .fmu, default 2.0.",
)
@click.option(
    "--platforms",
    metavar="NAMES",
    help="Where an .fmu runs, see `sidtool fmu`, separated by commas; default "
    "this machine.",
)
@changes_option
@force_option
@ACCEPT_DEFECTS_OPTION
def linearise(
    scene: Path,
    about: str,
    inputs: str | None,
    outputs: str | None,
    descriptor: bool,
    output: Path | None,
    version: str | None,
    platforms: str | None,
    changes: tuple[str, ...],
    force: bool,
    accept_defects: bool,
) -> None:
    """Linearise a SCENE between its inputs and outputs.

    The state space x' = A x + B u, y = C x + D u has independent coordinates, their
    velocities and the states of control laws as its states; closed loops are included.
    The file also holds the second-order form M p'' + C p' + K p = B u, y = F p + G p' +
    D u, names and units, and the operating point. The table [inputs] of the scene names
    the inputs, such as a motor torque.

    A state that is not steady, as in the middle of a motion, gives the equations of
    that instant (warning N715).

    \b
    Examples:
      sidtool linearise arm.toml -o plant.npz
      sidtool linearise arm.toml --about 0.5 --inputs torque --outputs tip.y,pin.fx
      sidtool linearise rotor.toml --about start -o rotor.mat
      sidtool linearise arm.toml -o plant.fmu --fmi 3.0

    Exit status: 0 done; 1 there is no equilibrium, the run to the time stopped, or the
    state is a singular configuration; 2 the input is wrong.
    """
    from ..api.state_space import state_space
    from ..report.state_space import describe_state_space, state_space_data

    check_targets([Target("-o", output, "state_space")], input_files(scene), force)
    is_unit = output is not None and output.suffix.lower() == ".fmu"
    if (version or platforms) and not is_unit:
        place = "--fmi" if version else "--platforms"
        raise InputError("belongs to an .fmu", place=place, expected="-o NAME.fmu")
    space = run_analysis(
        state_space,
        scene,
        changes,
        about=parse_about(about),
        inputs=None if inputs is None else listed_names(inputs),
        outputs=None if outputs is None else listed_names(outputs),
        descriptor=descriptor,
        accept_defects=accept_defects,
    )
    if output is not None and is_unit:
        space.fmu(
            output,
            version=version or "2.0",
            platforms=listed_names(platforms or ""),
        )
    elif output is not None:
        space.save(output)
    if output is not None:
        click.echo(f"{output} written")
    print_result(describe_state_space(space), lambda: state_space_data(space))


@click.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "--from",
    "of",
    metavar="INPUT",
    help=(
        "Input of the scene, or a sum with complex factors such as 'fx - 1j*fy' for a"
        " force that turns from x to y. Default the only input."
    ),
)
@click.option(
    "--to",
    "outputs",
    metavar="OUTPUTS",
    help="Outputs, separated by commas, as of `sidtool linearise`. Default those of the"
    " scene.",
)
@click.option(
    "--frequencies",
    metavar="FIRST:LAST[:log|lin[:COUNT]]",
    default="1:1000:log",
    show_default=True,
    help="Range [Hz]; points about the resonances are added.",
)
@click.option(
    "--unbalance",
    is_flag=True,
    help=(
        "The amplitude is an unbalance, mass times distance [kg m]: it is multiplied by"
        " the square of the angular frequency."
    ),
)
@_about_option
@click.option(
    "-o",
    "--output",
    type=output_path,
    help="File to write: a picture (.png, .svg, .pdf), .csv or .json.",
)
@changes_option
@force_option
@ACCEPT_DEFECTS_OPTION
def response(
    scene: Path,
    of: str | None,
    outputs: str | None,
    frequencies: str,
    unbalance: bool,
    about: str,
    output: Path | None,
    changes: tuple[str, ...],
    force: bool,
    accept_defects: bool,
) -> None:
    """Find the response of a SCENE to a harmonic input.

    The scene is linearised with its damping as it is. Magnitude and phase are those of
    an output over those of the input. Peaks are listed with the mode that has the
    largest part in them: its frequency and its damping ratio.

    A harmonic force is an input that a force takes. A base acceleration is the input
    of a drive with of = "acceleration"; the motion of a base is a smooth input of a
    drive. An unbalance is a force that turns: two inputs across the axis, and
    --unbalance.

    \b
    Examples:
      sidtool response arm.toml --from torque --to tip.y --frequencies 1:2000:log
      sidtool response arm.toml --from torque --to tip.y -o bode.png
      sidtool response rotor.toml --from "fx - 1j*fy" --unbalance -o unbalance.csv

    Exit status as of sidtool linearise.
    """
    from ..api.state_space import state_space
    from ..report.state_space import describe_response, response_data

    check_targets([picture_target(output, "response")], input_files(scene), force)
    space = run_analysis(
        state_space,
        scene,
        changes,
        about=parse_about(about),
        outputs=None if outputs is None else listed_names(outputs),
        accept_defects=accept_defects,
    )
    found = space.response(frequencies, of, unbalance=unbalance)
    if output is not None:
        found.save(output)
        click.echo(f"{output} written")
    print_result(describe_response(found), lambda: response_data(found))


def parse_about(text: str) -> str | float:
    """Return the state of --about: a word, or a time [s].

    Raises
    ------
    click.BadParameter : it is neither.
    """
    if text in ("static", "start"):
        return text
    try:
        return real_of_text(text)
    except ValueError:
        message = f"found {text!r}, expected static, start or a time [s]"
        raise click.BadParameter(message, param_hint="--about") from None
