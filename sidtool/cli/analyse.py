"""``sidtool analyse``: what a scene says without integrating its motion."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from .common import (
    Target,
    changes,
    check_targets,
    existing,
    files_of,
    force,
    read_changed,
    result_target,
    target,
    tell,
    tell_notes,
)

_ACCEPT = click.option(
    "--accept-defects",
    is_flag=True,
    help="Use what is refused otherwise: impossible mass matrices, and joints or "
    "forces on nodes that no shape function moves.",
)


@click.group()
def analyse() -> None:
    """Analyse a SCENE without integrating its motion.

    \b
    static   where it comes to rest, and the forces of its joints there
    modes    natural frequencies, damping ratios and mode shapes
    inverse  the forces of a motion that drives prescribe completely

    \b
    Examples:
      sidtool analyse static crane.toml
      sidtool analyse modes --help
    """


@analyse.command()
@click.argument("scene", metavar="SCENE", type=existing)
@click.option("-o", "--output", type=target, help="Result to write (.h5 or .csv).")
@changes
@force
@_ACCEPT
def static(
    scene: Path,
    output: Path | None,
    changes: tuple[str, ...],
    force: bool,
    accept_defects: bool,
) -> None:
    """Find the static equilibrium of a SCENE, downhill from its start.

    Drives and forces keep the values that they have at the start; nothing moves.
    Shown are the scene's outputs and the forces of all joints and drives, and which of
    them are not determined because the mechanism is over-constrained.

    \b
    Example:
      sidtool analyse static crane.toml -o rest.h5

    Exit status: 0 found, 1 there is none (a body can fall), or a body deforms by more
    than its own size, 2 the input is wrong.
    """
    from ..analysing import static_equilibrium
    from ..report.analysis import describe_equilibrium
    from ..report.data import equilibrium_data

    check_targets([result_target(output)], files_of(scene), force)
    found = _attempt(static_equilibrium, scene, changes, accept_defects=accept_defects)
    _write_result(output, found.result())
    tell_notes(found, warn=False)
    tell(describe_equilibrium(found), lambda: equilibrium_data(found))


@analyse.command()
@click.argument("scene", metavar="SCENE", type=existing)
@click.option(
    "--about",
    type=click.Choice(["static", "start"]),
    default="static",
    show_default=True,
    help="The state: static equilibrium, or the start with its velocities.",
)
@click.option(
    "--frozen",
    is_flag=True,
    help="Show the values of one instant where there are no modes: where the equations "
    "of small motions change as bodies turn, or the start is no steady motion.",
)
@click.option("-o", "--output", type=target, help="Modes with their shapes (JSON).")
@changes
@force
@_ACCEPT
def modes(
    scene: Path,
    about: str,
    frozen: bool,
    output: Path | None,
    changes: tuple[str, ...],
    force: bool,
    accept_defects: bool,
) -> None:
    """Find the natural modes of the assembled SCENE.

    The equations are linearised about the static equilibrium, or about the start, for
    example that of a rotor at its speed. Of what spins two frequencies are shown: in
    inertial axes, as fixed sensors and Campbell diagrams have it, with the direction of
    the whirl, and in the axes of the body, as a strain gauge on it does. Rigid motions
    are shown once each, at 0 Hz.

    \b
    Examples:
      sidtool analyse modes crane.toml
      sidtool analyse modes rotor.toml --about start -o modes.json

    Exit status: 0 found, 1 there is no equilibrium or none that has modes (a singular
    configuration, no inertia, no steady motion, equations that change in time), 2 the
    input is wrong.
    """
    from ..analysing import linearise
    from ..report.analysis import describe_modes, modes_as_data

    check_targets([Target("-o", output, "modes")], files_of(scene), force)
    found = _attempt(
        linearise,
        scene,
        changes,
        about=about,
        frozen=frozen,
        accept_defects=accept_defects,
    )
    if output is not None:
        from sidtool.formats.storage.atomic import atomic_path

        with atomic_path(output) as path:
            Path(path).write_text(
                json.dumps(modes_as_data(found), indent=1) + "\n", encoding="utf-8"
            )
        click.echo(f"{output} written")
    tell_notes(found, warn=False)
    tell(describe_modes(found), lambda: modes_as_data(found))


@analyse.command()
@click.argument("scene", metavar="SCENE", type=existing)
@click.option(
    "--quasi-static",
    is_flag=True,
    help="Flexible bodies deform without vibrating: at each time they are in "
    "equilibrium with the inertia, gravity and joint forces of the motion.",
)
@click.option("-o", "--output", type=target, help="Result to write (.h5 or .csv).")
@changes
@force
@_ACCEPT
def inverse(
    scene: Path,
    quasi_static: bool,
    output: Path | None,
    changes: tuple[str, ...],
    force: bool,
    accept_defects: bool,
) -> None:
    """Find the forces of a SCENE whose motion is prescribed completely.

    Needs as many drives as the mechanism has degrees of freedom. Record outputs such
    as JOINT.fx or DRIVE.f1 to get forces and drive torques.

    No drive prescribes the vibrations of flexible bodies. --quasi-static leaves them
    out, velocities and accelerations of the elastic coordinates with them: what a
    transient run comes to when the motion is slow against all natural frequencies and
    vibrations have died out. Softer bodies need sidtool simulate.

    \b
    Examples:
      sidtool analyse inverse press.toml -o forces.csv
      sidtool analyse inverse slider_crank.toml --quasi-static -o forces.csv

    Exit status: 0 done, 1 the motion is impossible or leads to a singular
    configuration (the file holds what comes before), 2 the input is wrong.
    """
    from ..analysing import inverse_dynamics
    from ..report.analysis import describe_inverse
    from ..report.data import result_data

    check_targets([result_target(output)], files_of(scene), force)
    result = _attempt(
        inverse_dynamics,
        scene,
        changes,
        output,
        quasi_static=quasi_static,
        accept_defects=accept_defects,
    )
    _write_result(output, result)
    tell_notes(result, warn=False)
    tell(describe_inverse(result), lambda: result_data(result))


def _attempt(
    analysis: Any,
    scene: Path,
    changes: tuple[str, ...],
    output: Path | None = None,
    **settings: Any,
) -> Any:
    """Runs an analysis; one line and status 1 when physics does not allow it.

    What there is of a result goes to `output` then.
    """
    from sidtool.solver.errors import SimulationError

    try:
        return analysis(read_changed(scene, changes), **settings)
    except SimulationError as error:
        click.echo(f"sidtool: {scene}: {error}", err=True)
        if error.result is not None:
            _write_result(output, error.result)
        raise click.exceptions.Exit(1) from None


def _write_result(output: Path | None, result: Any) -> None:
    from ..api import write

    if output is not None:
        write(output, result)
        click.echo(f"{output} written", err=not result.completed)
