"""Whole turns in planar scenes: what is held or driven starts at the nearest one.

The angle of a body or a marker is the number that the scene says, which may be of many
turns. Joints and drives hold orientations: the assembly turns no body by more than half
a turn for them, and the angle between two markers counts from what their joint says.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..space import layout as at
from ..space.layout import Work
from ..system import kernel_calls
from ..system.forces.elements import Element
from ..system.scene import System
from .carried import carried_rows, carrying
from .stated import guess

TURN = 2.0 * np.pi
#: Whole turns from marker to marker, rows of the marker table [rad].
Pairs = dict[tuple[int, int], float]


def with_whole_turns(system: System, work: Work) -> System:
    """A planar system whose joints and drives start in the turns of the scene.

    work : of the system, to evaluate it
    """
    if not system.planar:
        return system
    work.clock[0] = 0.5 * (system.scene.time.start + system.breaks[0])
    system, pairs = _of_frames(system, work)
    system, more = _of_constraints(system, work)
    pairs |= more
    counted = {}
    for con in system.arrays.constraint:
        if con[at.KIND] == at.COUPLED_ANGLE:
            ends = int(con[at.MARKER_A]), int(con[at.MARKER_B])
            counted[int(con[at.C_DATA])] = _between(pairs, *ends)
    twists = [*system.forces, *system.coordinates.values()]
    if all(element.kind != at.TWIST for element in twists):
        return _with_numbers(system, counted)
    known = {
        key: _counted(system, pairs, element)
        for key, element in system.coordinates.items()
    }
    forces = tuple(_counted(system, pairs, element) for element in system.forces)
    rows = np.concatenate([system.arrays.force, system.measures])
    for row, element in zip(rows, [*forces, *known.values()], strict=True):
        if element.kind == at.TWIST:
            counted[int(row[at.F_DATA])] = element.data[0]
    system = _with_numbers(system, counted)
    return replace(system, forces=forces, coordinates=known)


def _with_numbers(system: System, numbers: Mapping[int, float]) -> System:
    """The system with other numbers at some places of its pool, itself where they
    stand there already."""
    pool = system.arrays.pool
    if all(pool[place] == number for place, number in numbers.items()):
        return system
    pool = pool.copy()
    pool[list(numbers)] = list(numbers.values())
    return replace(system, arrays=system.arrays.replaced(pool=pool))


def _of_frames(system: System, work: Work) -> tuple[System, Pairs]:
    """Keeps carried bodies in their turns, each after its base."""
    prescribing, pairs = carrying(system), Pairs()
    start, z = system.scene.time.start, np.zeros(system.n_positions)
    body = prescribing.arrays.body
    for b in carried_rows(body):
        kernel_calls.evaluate(
            prescribing, work, start, z, np.zeros(system.n_velocities)
        )
        stated = system.scene.initial_of(system.bodies[b].name).angle or 0.0
        entry = int(body[b, at.FRAME]) + 1
        angle = float(system.frames(work.frame[b])["angle"])
        turns = float(system.arrays.pool[entry]) + _whole(stated - angle)
        system = _with_numbers(system, {entry: turns})
        prescribing = carrying(system)
        pairs[int(body[b, at.BASE]), int(body[b, at.TIP])] = turns
    return system, pairs


def _of_constraints(system: System, work: Work) -> tuple[System, Pairs]:
    """Lets angles that are held or driven count from the turns of the start."""
    held = [con for con in system.arrays.constraint if con[at.KIND] == at.ANGLE]
    if not held:
        return system, {}
    start, numbers, pairs = guess(system), {}, Pairs()
    kernel_calls.evaluate(system, work, system.scene.time.start, start.z, start.v)
    for con in held:
        place, value = int(con[at.C_DATA]), work.row[con[at.ROW], at.C_VALUE]
        numbers[place] = float(system.arrays.pool[place]) + _whole(value)
        ends = int(con[at.MARKER_A]), int(con[at.MARKER_B])
        pairs[ends] = numbers[place]
    return _with_numbers(system, numbers), pairs


def _whole(angle: float) -> float:
    return TURN * float(np.round(angle / TURN))


def _counted(system: System, pairs: Pairs, element: Element) -> Element:
    """The element with the turns from which its angle counts."""
    if element.kind != at.TWIST:
        return element
    assert element.a is not None
    ends = system.markers[element.a], system.markers[element.b]
    return replace(element, data=(_between(pairs, *ends), *element.data[1:]))


def _between(pairs: Pairs, a: int, b: int) -> float:
    return pairs[a, b] if (a, b) in pairs else -pairs.get((b, a), 0.0)
