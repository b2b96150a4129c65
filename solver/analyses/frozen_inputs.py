"""Systems whose drives and forces keep their initial values, for equilibria.

Laws stay active: their states are unknowns of the equilibrium.
"""

from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..dynamics import control_laws
from ..dynamics.drives import function_value
from ..spatial import system_arrays as at
from ..system.force_rows import ForceLaw, polynomial_force
from ..system.system import System


def with_constant_inputs(system: System) -> System:
    """The system with all functions of time constant, at their values at the start.

    Nothing that follows from their rates is left: velocities, accelerations, inertia.
    """
    arrays, t = system.arrays, system.scene.time.start
    interval_time = 0.5 * (t + system.breaks[0])
    values = [
        function_value.py_func(arrays, row, interval_time, t)[0]
        for row in range(len(arrays.drive))
    ]
    first = len(arrays.real_data)
    table = arrays.drive.copy()
    for row in range(len(table)):
        table[row, [at.D_PIECES, at.D_TERMS]] = 1, 1
        table[row, [at.D_DATA, at.D_KIND]] = first + 2 * row, at.POLYNOMIAL
    constants = np.column_stack([np.zeros(len(values)), values]).ravel()
    real_data = np.concatenate([arrays.real_data, constants])
    return replace(system, arrays=arrays.replaced(drive=table, real_data=real_data))


def with_constant_drives(system: System) -> System:
    """The system whose drives with laws keep their values at the start, too.

    Places of states are asked, see `with_law_states`: those of drives are drawn to
    where they start.
    """
    if not system.drive_law_rows:
        return system
    arrays = system.arrays
    constraint, force = arrays.constraint.copy(), arrays.force.copy()
    constraint[:, at.C_LAW] = -1
    real_data = [arrays.real_data]
    for k, element in enumerate(system.forces):
        is_state = element.kind == at.COORDINATE_MEASURE and not element.is_measure
        if element.name in system.drive_law_rows and is_state:
            start = system.bodies[force[k, at.F_B]].initial_state
            spring = ForceLaw(rest=start, stiffness=polynomial_force((1.0,))).packed()
            force[k, [at.F_CODE, at.F_LAW]] = -1, sum(map(len, real_data))
            real_data.append(np.array(spring))
    return replace(
        system,
        arrays=arrays.replaced(
            constraint=constraint, force=force, real_data=np.concatenate(real_data)
        ),
    )


def with_law_states(system: System) -> System:
    """The system in which the places of states of laws stand for the states.

    An equilibrium is looked for among places, with all velocities zero; but a state is
    a velocity, see `system.laws`.
    """
    real_data = system.arrays.real_data.copy()
    table = system.arrays.force
    for k, element in enumerate(system.forces):
        if not element.code:
            continue
        code, n_measures = int(table[k, at.F_CODE]), int(element.code[0])
        first = code + control_laws.HEADER_SIZE
        last = first + control_laws.INSTRUCTION_SIZE * int(element.code[1])
        for instruction in real_data[first:last].reshape(
            -1, control_laws.INSTRUCTION_SIZE
        ):
            if instruction[0] == control_laws.MEASURE:
                sensor = table[k - n_measures + int(instruction[1])]
                of_state = sensor[at.F_KIND] == at.COORDINATE_MEASURE
                if of_state and is_state(system, int(sensor[at.F_B])):
                    instruction[2] = 0.0
    return replace(system, arrays=system.arrays.replaced(real_data=real_data))


def with_continuous_laws(system: System) -> tuple[System, tuple[Diagnostic, ...]]:
    """The system with laws that act all the time in place of sampled ones, and what has
    to be known of that.

    Raises
    ------
    InputError
        A sampled law keeps states that are known at samples only.
    """
    names = dict.fromkeys(e.name for e in system.forces if e.sample_period)
    if system.make_continuous is None or not names:
        return system, ()
    return system.make_continuous(), (diagnose("N513", ", ".join(names)),)


def with_integrated_drives(system: System) -> System:
    """The system whose drives of constant rate or acceleration are functions of time,
    so that they prescribe their motion as those of values do; others stay as they
    are.
    """
    if system.make_integrated is None:
        return system
    try:
        return system.make_integrated()
    except InputError:  # another law reads what the rate adds up to
        return system


def is_state(system: System, b: int) -> bool:
    """True if a body is a state of a law."""
    return bool(system.arrays.body[b, at.FLAGS] & at.LAW_STATE)


def state_entries(system: System) -> tuple[list[int], list[int]]:
    """Entries of z_I and z_II of the states of laws."""
    rows = [row for b, row in enumerate(system.arrays.body) if is_state(system, b)]
    return [int(row[at.POS]) for row in rows], [int(row[at.VEL]) for row in rows]
