"""A mechanism whose drives and forces hold their values at the start, and whose laws
find their states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.errors import InputError

from ..equations.drives import drive_value
from ..equations.forces import programs
from ..space import layout as at
from ..system.forces.force_laws import Law, powers
from ..system.scene import System


def held(system: System) -> System:
    """The system with all functions of time constant, at their values at the start.

    Nothing that follows from their rates is left: velocities, accelerations, inertia.
    """
    arrays, t = system.arrays, system.scene.time.start
    clock = 0.5 * (t + system.breaks[0])
    values = [
        drive_value.py_func(arrays, row, clock, t)[0]
        for row in range(len(arrays.drive))
    ]
    first = len(arrays.pool)
    table = arrays.drive.copy()
    for row in range(len(table)):
        table[row, [at.D_PIECES, at.D_TERMS]] = 1, 1
        table[row, [at.D_DATA, at.D_KIND]] = first + 2 * row, at.POLYNOMIAL
    constants = np.column_stack([np.zeros(len(values)), values]).ravel()
    pool = np.concatenate([arrays.pool, constants])
    return replace(system, arrays=arrays.replaced(drive=table, pool=pool))


def with_held_drives(system: System) -> System:
    """The system whose drives with laws keep their values at the start, too.

    Places of states are asked, see `places_for_states`: those of drives are drawn to
    where they start.
    """
    if not system.led:
        return system
    arrays = system.arrays
    constraint, force = arrays.constraint.copy(), arrays.force.copy()
    constraint[:, at.C_LAW] = -1
    pool = [arrays.pool]
    for k, element in enumerate(system.forces):
        is_state = element.kind == at.COORDINATE and not element.is_read
        if element.name in system.led and is_state:
            start = system.bodies[force[k, at.F_B]].starts_at
            spring = Law(rest=start, stiffness=powers((1.0,))).packed()
            force[k, [at.F_CODE, at.F_LAW]] = -1, sum(map(len, pool))
            pool.append(np.array(spring))
    return replace(
        system,
        arrays=arrays.replaced(
            constraint=constraint, force=force, pool=np.concatenate(pool)
        ),
    )


def places_for_states(system: System) -> System:
    """The system in which the places of states of laws stand for the states.

    An equilibrium is looked for among places, with all velocities zero; but a state is
    a velocity, see `system.laws`.
    """
    pool = system.arrays.pool.copy()
    table = system.arrays.force
    for k, element in enumerate(system.forces):
        if not element.code:
            continue
        code, read = int(table[k, at.F_CODE]), int(element.code[0])
        first = code + programs.HEAD
        last = first + programs.WIDTH * int(element.code[1])
        for word in pool[first:last].reshape(-1, programs.WIDTH):
            if word[0] == programs.MEASURE:
                sensor = table[k - read + int(word[1])]
                of_state = sensor[at.F_KIND] == at.COORDINATE
                if of_state and is_state(system, int(sensor[at.F_B])):
                    word[2] = 0.0
    return replace(system, arrays=system.arrays.replaced(pool=pool))


def unsampled(system: System) -> tuple[System, tuple[str, ...]]:
    """The system with laws that act all the time in the place of sampled ones, and what
    has to be known of that.

    Raises
    ------
    InputError : a sampled law keeps states that are known at samples only.
    """
    names = dict.fromkeys(e.name for e in system.forces if e.sampled)
    if system.unsampled is None or not names:
        return system, ()
    listed = ", ".join(names)
    told = (
        f"the sampled laws of {listed} are taken as continuous: what sampling and "
        "holding delay is left out",
    )
    return system.unsampled(), told


def with_integrated_rates(system: System) -> System:
    """The system whose drives of constant rate or acceleration are functions of time,
    so that they prescribe their motion as those of values do; others stay as they are.
    """
    if system.integrated is None:
        return system
    try:
        return system.integrated()
    except InputError:  # another law reads what the rate adds up to
        return system


def is_state(system: System, b: int) -> bool:
    """Whether a body is a state of a law."""
    return bool(system.arrays.body[b, at.FLAGS] & at.STATE)


def state_entries(system: System) -> tuple[list[int], list[int]]:
    """Entries of z_I and z_II of the states of laws."""
    rows = [row for b, row in enumerate(system.arrays.body) if is_state(system, b)]
    return [int(row[at.POS]) for row in rows], [int(row[at.VEL]) for row in rows]
