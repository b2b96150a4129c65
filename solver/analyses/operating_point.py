"""The state about which a mechanism is linearised."""

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic

from ..initial_state.assembly import assemble
from ..output.columns import position_names, velocity_names
from ..system.system import System
from .dense_equations import refuse_eliminated_joints
from .frozen_inputs import with_continuous_laws, with_integrated_drives
from .static_equilibrium import static_equilibrium

STATES = ("static", "start")


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """An assembled system in a state.

    Attributes
    ----------
    system
        With continuous control laws; about the static equilibrium with constant
        functions of time.
    z, v
        The state.
    t
        The time of the drives [s].
    diagnostics, law_diagnostics
        Of the equilibrium, and of the control laws.
    """

    system: System
    z: Array
    v: Array
    t: float
    diagnostics: tuple[Diagnostic, ...] = ()
    law_diagnostics: tuple[Diagnostic, ...] = ()


def operating_point(
    system: System,
    about: str = "static",
    state: tuple[Array, Array] | None = None,
    time: float | None = None,
) -> OperatingPoint:
    """Return the system in the state that is to be linearised.

    Parameters
    ----------
    about
        "static", the static equilibrium, or "start", the assembled start with its
        velocities.
    state : (z_I, z_II)
        Instead, as in a result's positions and velocities.
    time
        Of the drives at that state [s], default the start.

    Raises
    ------
    InputError
        There is no such state, or the start cannot be assembled.
    SimulationError
        There is no static equilibrium.
    """
    refuse_eliminated_joints(system)
    system, of_laws = with_continuous_laws(system)
    found: tuple[Diagnostic, ...] = ()
    if about not in STATES:
        expected = f"one of {', '.join(STATES)}"
        raise InputError(f"found {about!r}", place="about", expected=expected)
    if state is not None:
        system, _ = assemble(system)
        z, v = (np.array(part, float) for part in state)
        _check_size(system, z, v)
        system, z, v = _with_integrated_rates(system, z, v)
    elif about == "static":
        equilibrium = static_equilibrium(system)
        system, found = equilibrium.system, equilibrium.diagnostics
        z, v = equilibrium.z, equilibrium.v
    else:
        system, start = assemble(with_integrated_drives(system))
        z, v = start.z, start.v
    t = system.scene.time.start if time is None else time
    return OperatingPoint(system, z, v, t, found, of_laws)


def _with_integrated_rates(
    system: System, z: Array, v: Array
) -> tuple[System, Array, Array]:
    """The system whose drives of constant rate prescribe values, in the same state."""
    integrated = with_integrated_drives(system)
    if integrated is system:
        return system, z, v
    integrated, _ = assemble(integrated)
    rates = []
    for names, part in ((position_names, z), (velocity_names, v)):
        columns = {name: i for i, name in enumerate(names(system))}
        if not columns.keys() >= set(names(integrated)):
            return system, z, v
        rates.append(part[[columns[name] for name in names(integrated)]])
    return integrated, rates[0], rates[1]


def _check_size(system: System, z: Array, v: Array) -> None:
    shapes = (system.n_positions,), (system.n_velocities,)
    if (z.shape, v.shape) != shapes:
        raise InputError(
            f"the state has {z.size} positions and {v.size} velocities",
            place="state",
            expected=f"{shapes[0][0]} and {shapes[1][0]} of the same scene, compiled "
            "in the same way",
        )
