"""Consistent initial conditions: positions and velocities that meet the constraints.

Positions are found by a damped Gauss-Newton iteration, velocities by a linear
projection, both with the smallest change in the metric M + tau^2 K and without moving
bodies that the user fixed. Velocities that a scene states give way where those that it
leaves open cannot meet the constraints. Redundant constraints are found by rank.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import Array

from ..space import layout as at
from ..system import kernel_calls
from ..system.scene import System
from ..system.storage import new_work
from .alignment import align, check_alignment
from .conflicts import conflict_at_start, conflict_of_rates, conflict_soon
from .consistent import (
    State,
    close,
    dense_jacobian,
    names_of_rows,
    widest_open,
)
from .displacements import displacements
from .overconstraint import relax
from .planar_turns import with_whole_turns
from .redundancy import mark_redundant
from .stated import Start, guess, stated_velocities
from .turn_counts import keep_turns

__all__ = ["Start", "assemble", "dense_jacobian", "guess", "names_of_rows"]

#: Bodies that are fixed may lie off by this part of the size of the mechanism.
HELD = 1e-10
#: Constraints are met when they are open by less, relative to their sizes.
CLOSE = 1e-10
#: Shares of the stiffness in the metric that are tried, one after the other.
SOFTER = (1.0, 1e-3, 1e-6)
#: Each leaves less of what stated velocities give way without need, a millionth between
#: bodies of like inertia; and when they change no more, relative to the largest one.
PASSES, SETTLED = 30, 1e-13
#: Times of each smooth interval at which prescribed frames are compared.
SAMPLES = 21


def assemble(system: System) -> tuple[System, Start]:
    """A consistent start, and the system with its redundant constraints marked.

    Raises
    ------
    InputError : the start position cannot be reached, or constraints contradict.
    """
    work = new_work(system)
    system = with_whole_turns(system, work)
    state = State(system, guess(system), work)
    _check_held(state)
    if system.n_rows > 0:
        system = _closed(system, state)
    keep_turns(system, state.work, state.z)
    _check_springs(system, state)
    if system.whole is not None:
        system = replace(system, whole=assemble(system.whole)[0])
    return system, Start(state.z, state.v)


def _check_held(state: State) -> None:
    """Raises bodies that the user fixed elsewhere than joints and drives put them."""
    system = state.system
    fixed = [name for name, body in system.scene.bodies.items() if body.initial.fixed]
    ways = displacements(system, state.work) if fixed else {}
    for name in fixed:
        way, angle = ways[name]
        if way > HELD * system.length or angle > HELD:
            raise InputError(
                f"the start position cannot be assembled: joints and drives put {name} "
                f"{way:.3g} m and {angle:.3g} rad away from where it is fixed",
                place=f"bodies.{name}.initial",
                expected="the position that they prescribe, or fixed = false",
            )


def _closed(system: System, state: State) -> System:
    """Moves the state onto the constraints; the system with redundant ones marked."""
    align(system, state.work, state.z)
    state.evaluate()
    _check_rods(state)
    _reach_positions(state)
    system = state.system
    check_alignment(system, state.work)
    if system.from_start:
        _measure_start(state)
    _reach_velocities(state)
    system = state.system
    _check_prescribed(state)
    system = mark_redundant(state)
    state.start()
    return system


def _reach_positions(state: State) -> None:
    guessed = state.z.copy()
    _close_softly(state, guessed)
    if relax(state, guessed):
        close(state)
    if state.opening > CLOSE:
        why, wanted = conflict_at_start(state.system)
        raise InputError(
            "the start position cannot be assembled: "
            f"{why or widest_open(state.system, state.residual)}",
            place="bodies.*.initial",
            expected=wanted
            or "initial positions from which all joints and drives can be met",
        )


def _close_softly(state: State, guessed: Array) -> None:
    """Moves the state onto the constraints, deforming bodies as much as that takes.

    Where rigid motions hardly close a gap, as along a rod between two pins, the metric
    with all of the stiffness leads far away: bodies that count as softer deform there.
    """
    found = []
    for share in SOFTER if state.metric.any() else SOFTER[:1]:
        state.stiffness = share
        opening = close(state)
        found.append(state.z.copy())
        if opening <= CLOSE:
            break
        state.z[:] = guessed
        state.evaluate()
    else:
        state.z[:] = found[0]
        state.evaluate()
    state.stiffness = 1.0


def _measure_start(state: State) -> None:
    """Constants of constraints that keep what they are at the start."""
    system = state.system
    pool = system.arrays.pool.copy()
    for entry, row in system.from_start:
        pool[entry] = state.work.row[row, at.C_VALUE]
    _check_rods(state)
    arrays = system.arrays.replaced(pool=pool)
    state.system = replace(system, arrays=arrays, from_start=())
    state.ignored[:], state.is_apart = False, False
    state.evaluate()


def _check_rods(state: State) -> None:
    """Raises constraints without a direction: the two ends of a rod coincide."""
    if np.isfinite(state.work.row).all():
        return
    for row in state.system.rows:
        values = state.work.row[row.first : row.first + row.count]
        if not np.isfinite(values).all():
            raise InputError(
                f"the markers of {row.name} coincide at the start",
                place=f"joints.{row.name}",
                expected="two points at a distance",
            )


def _check_springs(system: System, state: State) -> None:
    """Raises forces along a line without a direction: their markers coincide."""
    axes = 2 if system.planar else 3
    for element in system.forces:
        if element.kind != at.SPAN or element.a is None or element.is_read:
            continue
        ends = [state.work.point[system.markers[m]] for m in (element.a, element.b)]
        gap = np.linalg.norm(ends[1][:axes] - ends[0][:axes])
        law = element.law
        pushes = law.applied != 0.0 or law.stiffness.value(np.array([-law.rest]))[0]
        if gap <= 1e-12 * system.length and pushes:
            raise InputError(
                f"the markers of {element.name} coincide at the start, where its force "
                "has no direction",
                place=f"forces.{element.name}",
                expected="two points at a distance, or no force at none",
            )


def _reach_velocities(state: State) -> None:
    state.evaluate()
    system = state.system
    rates = state.work.row[:, at.C_RATE].copy()
    if not rates.any():
        return
    state.kept = stated_velocities(system)
    wanted = state.v[state.kept]
    for _ in range(PASSES if state.kept.any() else 1):
        before = state.v.copy()
        state.v[state.kept] = wanted
        state.evaluate()
        change, left = state.smallest(-state.work.row[:, at.C_RATE])
        state.v += change
        if state.speed_of(state.v - before) <= SETTLED * state.speed:
            break
    state.kept = np.zeros_like(state.kept)
    state.evaluate()
    size = max(1.0 / state.duration, state.speed, state.relative(rates))
    if state.relative(left) > 1e-8 * size:
        residual = state.work.row[:, at.C_RATE]
        why = conflict_soon(system, state.t, state.z, state.v)
        why = why or conflict_of_rates(system, state.t, state.z, state.v)
        raise InputError(
            "no velocities meet all joints and drives: "
            f"{why or widest_open(system, residual) + ' per second'}",
            place="joints",
            expected="drives and joints that can move together",
        )


def _check_prescribed(state: State) -> None:
    """Constraints between prescribed frames must hold all the time: nothing can give.

    Raises
    ------
    InputError : drives and joints prescribe different motions.
    """
    system, time = state.system, state.system.scene.time
    held = np.zeros(system.n_rows, bool)
    held[system.arrays.segment[:, at.S_ROW]] = True
    if held.all():
        return
    edges = (time.start, *system.breaks)
    for begin, end in pairwise(edges):
        state.work.clock[0] = 0.5 * (begin + end)
        for t in np.linspace(begin, end, SAMPLES):
            kernel_calls.evaluate(system, state.work, t, state.z, state.v)
            open_rows = np.where(held, 0.0, state.residual)
            if state.relative(open_rows) > 1e-8:
                raise InputError(
                    f"the mechanism is over-constrained: at t = {t:.6g} s "
                    f"{widest_open(system, open_rows)}, and no coordinate can give way",
                    place="joints",
                    expected="drives and joints that prescribe the same motion",
                )
    state.start()
