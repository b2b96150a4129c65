"""What a unit can do of a scene; all else is refused by name."""

from collections.abc import Iterator
from dataclasses import replace

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import SceneFile
from sidtool.solver.initial_state.integrator_start import RunSettings
from sidtool.solver.integrators.registry import AUTO, INTEGRATORS
from sidtool.solver.system.system import System

#: Integrators of units: those with one step loop for all positions.
UNIT_INTEGRATORS = ("radau5", "radau9", "radau13")


def unit_settings(settings: RunSettings) -> RunSettings:
    """Settings with an integrator that units have: of `auto` the one for stiff scenes.

    Raises
    ------
    InputError : the scene asks for another integrator.
    """
    if settings.integrator in UNIT_INTEGRATORS:
        return replace(settings, when_stiff="")
    if settings.requested == AUTO and settings.when_stiff in UNIT_INTEGRATORS:
        return replace(settings, integrator=settings.when_stiff, when_stiff="")
    title = INTEGRATORS[settings.integrator].title
    raise InputError(
        f"{settings.integrator} ({title}) is no integrator of an FMU",
        place="accuracy.integrator",
        expected=f"auto, {', '.join(UNIT_INTEGRATORS[:-1])} or {UNIT_INTEGRATORS[-1]}",
    )


def refuse_unsupported(system: System) -> None:
    """Refuse a scene that a unit cannot move as a run does.

    Raises
    ------
    InputError : names all that stands against it.
    """
    found = list(_unsupported(system))
    if found:
        raise InputError(
            f"an FMU cannot have {'; '.join(text for text, _ in found)}",
            place=", ".join(dict.fromkeys(place for _, place in found)),
            expected="a scene without, see docs/howto/fmu.md",
        )


def _unsupported(system: System) -> Iterator[tuple[str, str]]:
    """What stands against a unit, and where it is in the scene."""
    if system.friction_joints:
        names = ", ".join(joint.joint for joint in system.friction_joints)
        yield f"joints that stick and slip ({names})", "joints"
    if system.natives:
        names = ", ".join(
            dict.fromkeys(
                e.name for e in system.forces if e.control and e.control.natives
            )
        )
        yield f"control laws that are Python functions ({names})", "forces"


def ignored_parts(scene: SceneFile) -> Iterator[Diagnostic]:
    """What of a scene has no effect in a unit (N601, N602)."""
    for name, event in scene.events.items():
        if event.action == "record":
            yield diagnose("N601", name)
    for name, signal in scene.inputs.items():
        if signal.times:
            yield diagnose("N602", name)
