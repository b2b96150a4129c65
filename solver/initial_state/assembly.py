"""Consistent initial conditions: positions and velocities that meet the constraints.

Positions are found by a damped Gauss-Newton iteration, velocities by a linear
projection, both with the smallest change in the metric M + tau^2 K and without moving
bodies that the user fixed. Velocities that the scene states are changed only where
those that it leaves open cannot meet the constraints. Redundant constraints are found
by the rank of the Jacobian.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ..spatial import system_arrays as at
from ..system import work_arrays
from ..system.system import System
from ..system.work_arrays import new_work_arrays
from .constraint_jacobian import (
    InitialState,
    assemble_position,
    dense_jacobian,
    largest_residuals_text,
    row_names,
)
from .contradictions import (
    initial_contradiction,
    later_contradiction,
    velocity_contradiction,
)
from .displacement_report import displacements
from .given_state import (
    StateVectors,
    align_bodies,
    check_alignment,
    initial_estimate,
    is_velocity_specified,
    store_rotations,
    with_full_turns,
)
from .overconstraint import remove_redundant
from .redundant_constraints import mark_redundant_constraints

__all__ = [
    "StateVectors",
    "assemble",
    "dense_jacobian",
    "initial_estimate",
    "row_names",
]

#: Bodies that are fixed may lie off by this part of the size of the mechanism.
FIXED_TOLERANCE = 1e-10
#: Constraints are met when they are open by less, relative to their sizes.
MAX_RESIDUAL = 1e-10
#: Shares of the stiffness in the metric that are tried, one after the other.
STIFFNESS_FRACTIONS = (1.0, 1e-3, 1e-6)
#: Each leaves less of what stated velocities give way without need, a millionth between
#: bodies of like inertia; and when they change no more, relative to the largest one.
MAX_PASSES, CONVERGED = 30, 1e-13
#: Times of each smooth interval at which prescribed frames are compared.
SAMPLES = 21


def assemble(system: System) -> tuple[System, StateVectors]:
    """A consistent start, and the system with its redundant constraints marked.

    Raises
    ------
    InputError
        The start position cannot be reached, or constraints contradict.
    """
    work = new_work_arrays(system)
    system = with_full_turns(system, work)
    state = InitialState(system, initial_estimate(system), work)
    _check_fixed_bodies(state)
    if system.n_rows > 0:
        system = _satisfy_constraints(system, state)
    store_rotations(system, state.work, state.z)
    _check_force_directions(system, state)
    if system.full_system is not None:
        system = replace(system, full_system=assemble(system.full_system)[0])
    return system, StateVectors(state.z, state.v)


def _check_fixed_bodies(state: InitialState) -> None:
    """Raises bodies that the user fixed elsewhere than joints and drives put them."""
    system = state.system
    fixed = [name for name, body in system.scene.bodies.items() if body.initial.fixed]
    displacements_of_bodies = displacements(system, state.work) if fixed else {}
    for name in fixed:
        displacement, angle = displacements_of_bodies[name]
        if displacement > FIXED_TOLERANCE * system.length or angle > FIXED_TOLERANCE:
            raise InputError(
                f"the start position cannot be assembled: joints and drives put {name} "
                f"{displacement:.3g} m and {angle:.3g} rad away from where it is fixed",
                place=f"bodies.{name}.initial",
                expected="the position that they prescribe, or fixed = false",
            )


def _satisfy_constraints(system: System, state: InitialState) -> System:
    """Moves the state onto the constraints; the system with redundant ones marked."""
    align_bodies(system, state.work, state.z)
    state.evaluate()
    _check_directions(state)
    _assemble_positions(state)
    system = state.system
    check_alignment(system, state.work)
    if system.set_at_start:
        _set_initial_constants(state)
    _assemble_velocities(state)
    system = state.system
    _check_prescribed_frames(state)
    system = mark_redundant_constraints(state)
    state.start()
    return system


def _assemble_positions(state: InitialState) -> None:
    initial_z = state.z.copy()
    _assemble_with_softer_bodies(state, initial_z)
    if remove_redundant(state, initial_z):
        assemble_position(state)
    if state.scaled_residual > MAX_RESIDUAL:
        why, expected = initial_contradiction(state.system)
        raise InputError(
            "the start position cannot be assembled: "
            f"{why or largest_residuals_text(state.system, state.residual)}",
            place="bodies.*.initial",
            expected=expected
            or "initial positions from which all joints and drives can be met",
        )


def _assemble_with_softer_bodies(state: InitialState, initial_z: Array) -> None:
    """Moves the state onto the constraints, deforming bodies as much as that takes.

    Where rigid motions hardly close a gap, as along a rod between two pins, the metric
    with all of the stiffness leads far away: bodies that count as softer deform there.
    """
    trials = []
    for share in STIFFNESS_FRACTIONS if state.metric.any() else STIFFNESS_FRACTIONS[:1]:
        state.stiffness = share
        residual = assemble_position(state)
        trials.append(state.z.copy())
        if residual <= MAX_RESIDUAL:
            break
        state.z[:] = initial_z
        state.evaluate()
    else:
        state.z[:] = trials[0]
        state.evaluate()
    state.stiffness = 1.0


def _set_initial_constants(state: InitialState) -> None:
    """Constants of constraints that keep what they are at the start."""
    system = state.system
    pool = system.arrays.real_data.copy()
    for entry, row in system.set_at_start:
        pool[entry] = state.work.row[row, at.C_VALUE]
    _check_directions(state)
    arrays = system.arrays.replaced(real_data=pool)
    state.system = replace(system, arrays=arrays, set_at_start=())
    state.ignored[:], state.is_independent = False, False
    state.evaluate()


def _check_directions(state: InitialState) -> None:
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


def _check_force_directions(system: System, state: InitialState) -> None:
    """Raises forces along a line without a direction: their markers coincide."""
    axes = 2 if system.planar else 3
    for element in system.forces:
        if (
            element.kind != at.DISTANCE_MEASURE
            or element.a is None
            or element.is_measure
        ):
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


def _assemble_velocities(state: InitialState) -> None:
    state.evaluate()
    system = state.system
    rates = state.work.row[:, at.C_RATE].copy()
    if not rates.any():
        return
    state.is_preserved = is_velocity_specified(system)
    expected = state.v[state.is_preserved]
    for _ in range(MAX_PASSES if state.is_preserved.any() else 1):
        before = state.v.copy()
        state.v[state.is_preserved] = expected
        state.evaluate()
        change, residual_rates = state.minimum_norm(-state.work.row[:, at.C_RATE])
        state.v += change
        if state.scaled_speed(state.v - before) <= CONVERGED * state.speed:
            break
    state.is_preserved = np.zeros_like(state.is_preserved)
    state.evaluate()
    size = max(1.0 / state.duration, state.speed, state.largest_relative(rates))
    if state.largest_relative(residual_rates) > 1e-8 * size:
        residual = state.work.row[:, at.C_RATE]
        where = system, state.t, state.z, state.v
        why = later_contradiction(*where) or velocity_contradiction(*where)
        raise InputError(
            "no velocities meet all joints and drives: "
            f"{why or largest_residuals_text(system, residual) + ' per second'}",
            place="joints",
            expected="drives and joints that can move together",
        )


def _check_prescribed_frames(state: InitialState) -> None:
    """Constraints between prescribed frames must hold all the time: nothing can give.

    Raises
    ------
    InputError
        Drives and joints prescribe different motions.
    """
    system, time = state.system, state.system.scene.time
    has_coordinates = np.zeros(system.n_rows, bool)
    has_coordinates[system.arrays.segment[:, at.S_ROW]] = True
    if has_coordinates.all():
        return
    edges = (time.start, *system.breaks)
    for begin, end in pairwise(edges):
        state.work.interval_time[0] = 0.5 * (begin + end)
        for t in np.linspace(begin, end, SAMPLES):
            work_arrays.evaluate(system, state.work, t, state.z, state.v)
            open_rows = np.where(has_coordinates, 0.0, state.residual)
            if state.largest_relative(open_rows) > 1e-8:
                raise InputError(
                    f"the mechanism is over-constrained: at t = {t:.6g} s "
                    f"{largest_residuals_text(system, open_rows)}, and no coordinate "
                    "can give way",
                    place="joints",
                    expected="drives and joints that prescribe the same motion",
                )
    state.start()
