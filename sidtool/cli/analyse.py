"""``sidtool analyse``: equilibrium, modes, multipliers, inverse dynamics of a scene."""

from pathlib import Path
from typing import Any

import click

from sidtool.formats.base.numbers import real_of_text

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
    print_data,
    print_failure,
    print_result,
    read_scene_with_changes,
    result_target,
    verbose_option,
)

ACCEPT_DEFECTS_OPTION = click.option(
    "--accept-defects",
    is_flag=True,
    help=(
        "Accept impossible mass matrices, and joints or forces on nodes that no"
        " shape function moves, which are refused otherwise."
    ),
)


@click.group()
def analyse() -> None:
    """Analyse a SCENE without integrating its motion.

    \b
    static   static equilibrium, and the joint forces in it
    modes    natural frequencies, damping ratios and mode shapes
    floquet  stability of a periodic motion
    inverse  forces and torques of a motion that is prescribed by drives

    \b
    Examples:
      sidtool analyse static crane.toml
      sidtool analyse modes --help
    """


@analyse.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option("-o", "--output", type=output_path, help="Result to write (.h5 or .csv).")
@changes_option
@force_option
@verbose_option
@ACCEPT_DEFECTS_OPTION
def static(
    scene: Path,
    output: Path | None,
    changes: tuple[str, ...],
    force: bool,
    verbose: bool,
    accept_defects: bool,
) -> None:
    """Find the static equilibrium of a SCENE.

    The search starts at the initial state and lowers the potential energy. Drives and
    forces keep their values at the start time, and all velocities are zero. The command
    prints the outputs of the scene and the forces of all joints and drives. It marks
    the forces that are not determined because the mechanism is over-constrained.

    \b
    Example:
      sidtool analyse static crane.toml -o rest.h5

    Exit status: 0 an equilibrium was found; 1 there is none (a body can fall), or a
    body deforms by more than its own size; 2 the input is wrong.
    """
    from ..api.analyses import static_equilibrium
    from ..report.analyses import describe_equilibrium
    from ..report.json_data import equilibrium_data

    check_targets([result_target(output)], input_files(scene), force)
    equilibrium = run_analysis(
        static_equilibrium, scene, changes, accept_defects=accept_defects
    )
    _write_result(output, equilibrium.result())
    print_result(
        describe_equilibrium(equilibrium, verbose),
        lambda: equilibrium_data(equilibrium),
    )


@analyse.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "--about",
    type=click.Choice(["static", "start"]),
    default="static",
    show_default=True,
    help=(
        "State to linearise about: the static equilibrium, or the initial state"
        " with its velocities."
    ),
)
@click.option(
    "--frozen",
    is_flag=True,
    help=(
        "Print the values at one instant if there are no modes: if the "
        "equations of small motions change as bodies rotate, or the initial "
        "state is no steady motion."
    ),
)
@click.option(
    "--over",
    metavar="KEY=FROM:TO:COUNT",
    help=(
        "Follow the modes over a key of the scene, such as"
        " parameters.speed=0:400:41 (Campbell diagram)."
    ),
)
@click.option(
    "--orders",
    metavar="NUMBERS",
    default="1",
    show_default=True,
    help=(
        "With --over: times per revolution that an excitation acts, separated by"
        " commas; critical speeds are listed for each."
    ),
)
@click.option(
    "-o",
    "--output",
    type=output_path,
    help=(
        "File to write: modes with their shapes (.json); with --over a picture (.png,"
        " .svg, .pdf), .csv or .json."
    ),
)
@changes_option
@force_option
@verbose_option
@ACCEPT_DEFECTS_OPTION
def modes(
    scene: Path,
    about: str,
    frozen: bool,
    over: str | None,
    orders: str,
    output: Path | None,
    changes: tuple[str, ...],
    force: bool,
    verbose: bool,
    accept_defects: bool,
) -> None:
    """Find the natural modes of the assembled SCENE.

    The equations are linearised about the static equilibrium, or with --about start
    about the initial state, for example that of a rotor at its speed. For rotating
    bodies two frequencies are printed: in inertial axes, as fixed sensors and Campbell
    diagrams show it, with the direction of the whirl, and in the axes of the body, as a
    strain gauge on it shows it. Both are those of the damped motion; where one is
    printed it is |eigenvalue| / 2 pi. Each rigid motion is printed once, at 0 Hz.

    --over follows the modes over a parameter, by the agreement of their shapes. Over
    the speed of a rotor that gives its Campbell diagram and its critical speeds.

    \b
    Examples:
      sidtool analyse modes crane.toml
      sidtool analyse modes rotor.toml --about start -o modes.json
      sidtool analyse modes rotor.toml --about start \\
          --over parameters.speed=0:400:41 -o campbell.png
      sidtool analyse modes rotor.toml --about start --over parameters.speed=1:400:80 \\
          --orders 1,3 -o campbell.csv

    Exit status: 0 modes were found; 1 there is no equilibrium, or the state has no
    modes (a singular configuration, no inertia, no steady motion, equations that change
    in time); 2 the input is wrong.
    """
    from ..api.analyses import linearise
    from ..report.analyses import describe_modes, modes_as_data

    if over is not None:
        settings = {"about": about, "frozen": frozen, "accept_defects": accept_defects}
        _analyse_over(scene, over, orders, output, changes, force, settings)
        return
    check_targets([Target("-o", output, "modes")], input_files(scene), force)
    natural_modes = run_analysis(
        linearise,
        scene,
        changes,
        about=about,
        frozen=frozen,
        accept_defects=accept_defects,
    )
    if output is not None:
        from ..report.json_data import write_json

        write_json(output, modes_as_data(natural_modes))
        click.echo(f"{output} written")
    text = describe_modes(natural_modes, about, verbose)
    print_result(text, lambda: modes_as_data(natural_modes))


def _analyse_over(
    scene: Path,
    over: str,
    orders: str,
    output: Path | None,
    changes: tuple[str, ...],
    force: bool,
    settings: dict[str, Any],
) -> None:
    """Follow the modes over a key; print and write their diagram."""
    from ..api.analyses import campbell
    from ..report.analyses import campbell_data, describe_campbell

    check_targets([picture_target(output, "campbell")], input_files(scene), force)
    numbers = [_order(text) for text in listed_names(orders)]
    found = run_analysis(
        campbell, scene, changes, over=over, orders=numbers, **settings
    )
    if output is not None:
        found.save(output)
        click.echo(f"{output} written")
    print_result(describe_campbell(found), lambda: campbell_data(found))


def _order(text: str) -> float:
    """Return a number of times per revolution.

    Raises
    ------
    click.BadParameter : it is not positive.
    """
    try:
        order = real_of_text(text)
    except ValueError:
        order = 0.0
    if not order > 0.0:
        message = f"found {text!r}, expected numbers above 0 such as 1,3"
        raise click.BadParameter(message, param_hint="--orders")
    return order


@analyse.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "--quasi-static",
    is_flag=True,
    help="Flexible bodies deform without vibrating: at each time they are in "
    "equilibrium with the inertia, gravity and joint forces of the motion.",
)
@click.option("-o", "--output", type=output_path, help="Result to write (.h5 or .csv).")
@changes_option
@force_option
@verbose_option
@ACCEPT_DEFECTS_OPTION
def inverse(
    scene: Path,
    quasi_static: bool,
    output: Path | None,
    changes: tuple[str, ...],
    force: bool,
    verbose: bool,
    accept_defects: bool,
) -> None:
    """Find the forces of a SCENE whose motion is prescribed completely.

    The mechanism needs as many drives as it has degrees of freedom. Record outputs such
    as JOINT.fx or DRIVE.f1 to get forces and drive torques.

    Drives do not prescribe the vibrations of flexible bodies. --quasi-static neglects
    them: the velocities and accelerations of the elastic coordinates are set to zero. A
    transient run approaches this solution if the motion is slow compared with all
    natural frequencies and vibrations have decayed. For softer bodies use sidtool
    simulate.

    \b
    Examples:
      sidtool analyse inverse press.toml -o forces.csv
      sidtool analyse inverse slider_crank.toml --quasi-static -o forces.csv

    Exit status: 0 done, 1 the motion is impossible or leads to a singular
    configuration (the file holds what comes before), 2 the input is wrong.
    """
    from ..api.analyses import inverse_dynamics
    from ..report.analyses import describe_inverse
    from ..report.json_data import result_data

    check_targets([result_target(output)], input_files(scene), force)
    result = run_analysis(
        inverse_dynamics,
        scene,
        changes,
        output,
        quasi_static=quasi_static,
        accept_defects=accept_defects,
    )
    _write_result(output, result)
    print_result(describe_inverse(result, verbose), lambda: result_data(result))


@analyse.command()
@click.argument("scene", metavar="SCENE", type=existing_file)
@click.option(
    "--period",
    metavar="SECONDS",
    required=True,
    help="Period of the motion, or a formula of parameters such as 2*pi/speed.",
)
@click.option(
    "-o", "--output", type=output_path, help="File to write: multipliers (.json)."
)
@changes_option
@force_option
@ACCEPT_DEFECTS_OPTION
def floquet(
    scene: Path,
    period: str,
    output: Path | None,
    changes: tuple[str, ...],
    force: bool,
    accept_defects: bool,
) -> None:
    """Find whether small motions about a periodic motion of the SCENE grow.

    The motion begins at the start of the scene and has to return to it after the
    period, but for whole revolutions. The command prints Floquet's multipliers, by
    which modes grow in a period, and their frequencies: those of the largest harmonic
    of the displacements, in inertial axes and in the axes of the bodies. Those of other
    sensors differ by multiples of 1 / period. A motion is stable if no multiplier is
    larger than one. Functions of time have to repeat, and to be known over two periods.
    For systems without constant axes, such as a flat shaft in bearings of two
    stiffnesses, where analyse modes has no modes.

    \b
    Examples:
      sidtool analyse floquet rotor.toml --period 2*pi/speed
      sidtool analyse floquet swing.toml --period 0.8 -o multipliers.json

    Exit status: 0 multipliers were found; 1 the motion or its equations do not return,
    or have no variational equations (friction, events, corners of forces); 2 the input
    is wrong.
    """
    from ..api.analyses import floquet as find_multipliers
    from ..report.analyses import describe_floquet, floquet_data

    check_targets([Target("-o", output, "modes")], input_files(scene), force)
    found = run_analysis(
        find_multipliers, scene, changes, period=period, accept_defects=accept_defects
    )
    if output is not None:
        from ..report.json_data import write_json

        write_json(output, floquet_data(found))
        click.echo(f"{output} written")
    print_result(describe_floquet(found), lambda: floquet_data(found))


def run_analysis(
    analysis: Any,
    scene: Path,
    changes: tuple[str, ...],
    output: Path | None = None,
    **settings: Any,
) -> Any:
    """Run an analysis; on a physical failure print one line and exit with status 1.

    The incomplete result is then written to `output`.
    """
    from sidtool.solver.system.errors import SimulationError

    from ..report.json_data import result_data

    try:
        return analysis(read_scene_with_changes(scene, changes), **settings)
    except SimulationError as error:
        print_failure(error, scene)
        result = error.result
        if result is not None:
            _write_result(output, result)
            print_data(lambda: result_data(result))
        raise click.exceptions.Exit(1) from None


def _write_result(output: Path | None, result: Any) -> None:
    from ..pipeline.files import write

    if output is not None:
        write(output, result)
        click.echo(f"{output} written", err=not result.completed)
