"""Systems whose drives and forces keep their initial values, for equilibria.

Laws stay active: their states are unknowns of the equilibrium.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..dynamics import control_laws
from ..dynamics.drives import function_value
from ..functions.piecewise import N_INPUT_TERMS
from ..spatial import system_arrays as at
from ..system.force_rows import ForceLaw, polynomial_force
from ..system.system import System


def with_constant_inputs(system: System) -> System:
    """The system with all functions of time constant, at their values at the start.

    Nothing that follows from their rates is left: velocities, accelerations, inertia.
    """
    rows = range(len(system.arrays.drive))
    of_time = [row for row in rows if row not in system.lookup_rows]
    return _with_polynomials(system, of_time, 1)


def with_polynomial_inputs(system: System, t: float) -> tuple[System, dict[str, slice]]:
    """The system whose inputs are polynomials about a time, to change them in place.

    Returns
    -------
    system
        With real data of its own.
    coefficients
        By input, the entries of the real data with its value, its rate and half its
        second derivative at that time.
    """
    table = system.arrays.drive
    of_input = {
        name: np.flatnonzero(_same_function(table, row))
        for name, row in system.input_rows.items()
    }
    rows = sorted({int(row) for found in of_input.values() for row in found})
    changed = _with_polynomials(system, rows, N_INPUT_TERMS, t)
    firsts = {name: changed.input_data(name).start + 1 for name in system.input_rows}
    return changed, {name: slice(k, k + 3) for name, k in firsts.items()}


def _same_function(table: at.IntTable, row: int) -> np.ndarray:
    """True for the rows of functions that have the numbers of one of them."""
    columns = [at.D_DATA, at.D_KIND]
    return np.asarray((table[:, columns] == table[row, columns]).all(axis=1))


def _with_polynomials(
    system: System, rows: Iterable[int], terms: int, t: float | None = None
) -> System:
    """The system in which rows of functions are polynomials about a time, by default
    the start; functions that share their numbers still do, and sums stay sums."""
    arrays, start = system.arrays, system.scene.time.start
    at_time = start if t is None else t
    clock = 0.5 * (start + system.breaks[0])
    if t is not None:
        clock = float(system.clocks(np.array([t]))[0])
    table, first = arrays.drive.copy(), len(arrays.real_data)
    real_data, known = [arrays.real_data], dict[tuple[int, int], int]()
    for row in rows:
        if arrays.drive[row, at.D_KIND] == at.SUM:
            continue
        data, kind = (int(k) for k in arrays.drive[row, [at.D_DATA, at.D_KIND]])
        if (data, kind) not in known:
            known[data, kind] = first + (len(real_data) - 1) * (terms + 1)
            values = function_value.py_func(arrays, row, clock, at_time)
            numbers = np.zeros(terms + 1)
            numbers[0] = at_time
            derivatives = (values[0], values[1], 0.5 * values[2])[:terms]
            numbers[1 : 1 + len(derivatives)] = derivatives
            real_data.append(numbers)
        table[row, [at.D_PIECES, at.D_TERMS]] = 1, terms
        table[row, [at.D_DATA, at.D_KIND]] = known[data, kind], at.POLYNOMIAL
    changed = arrays.replaced(drive=table, real_data=np.concatenate(real_data))
    return replace(system, arrays=changed)


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
