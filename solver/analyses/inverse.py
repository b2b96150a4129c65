"""Inverse dynamics: all motion is prescribed, forces follow without integration."""

from __future__ import annotations

import numpy as np

from formats.errors import InputError
from formats.result import Result
from formats.scene import output_times
from formats.sid import Array

from ..assembly import Start, assemble
from ..errors import SimulationError
from ..scene import System
from .mechanics import Mechanics, least_squares, null_space, recorded, refuse_prescribed

#: Constraints are met when they are open by less than this part of the size.
CLOSED = 1e-12
#: Intervals between output times are halved at most this often.
HALVINGS = 20


def inverse_dynamics(system: System) -> Result:
    """Positions, velocities, accelerations and joint forces at the output times.

    Raises
    ------
    InputError : something can move that no drive prescribes.
    SimulationError : the drives lead to a position that cannot be reached; its
        `result` holds what comes before.
    """
    refuse_prescribed(system)
    system, start = assemble(system)
    t = system.scene.time.start
    mechanics = Mechanics(system, t, t)
    mechanics.set_scale(start.z)
    _refuse_freedom(mechanics, start)
    times = output_times(system.scene)
    states: list[Start] = []
    state = start
    for when in times:
        try:
            state = _follow(mechanics, state, float(when))
        except SimulationError as error:
            done = np.array(times[: len(states)])
            error.result = recorded(
                system, "inverse dynamics", done, states, str(error)
            )
            raise
        states.append(state)
    return recorded(system, "inverse dynamics", times, states)


def _refuse_freedom(mechanics: Mechanics, start: Start) -> None:
    mechanics.evaluate(start.z, start.v)
    free = null_space(mechanics.jacobian).shape[1]
    if free:
        raise InputError(
            f"{free} of {mechanics.system.n_velocities} coordinates can move freely",
            place="drives",
            expected="as many drives as the mechanism has degrees of freedom, and "
            "rigid bodies, for inverse dynamics",
        )


def _follow(mechanics: Mechanics, state: Start, when: float) -> Start:
    """The state at a later time, over smaller steps where one does not arrive."""
    target, halvings = when, 0
    while True:
        reached = _reach(mechanics, state, target)
        if reached is None:
            halvings += 1
            if halvings > HALVINGS:
                raise SimulationError(
                    f"stopped at t = {mechanics.t:.9g} s: the drives demand a position "
                    "that the mechanism cannot reach"
                )
            target = 0.5 * (mechanics.t + target)
            continue
        state, mechanics.t = reached, target
        if target == when:
            return state
        target = when


def _reach(mechanics: Mechanics, state: Start, when: float) -> Start | None:
    """The state at `when`, from a prediction; None if that is too far away."""
    system = mechanics.system
    before, h = mechanics.t, when - mechanics.t
    _set_clock(mechanics, 0.5 * (before + when))
    acceleration, _ = mechanics.accelerations(state.z, state.v)
    x = (h * state.v + 0.5 * h * h * acceleration) / mechanics.scale
    z = mechanics.moved(state.z, x)
    mechanics.t = when
    rest = np.zeros(system.n_velocities)
    opening = np.inf
    for iteration in range(12):
        mechanics.evaluate(z, rest)
        before_it, opening = opening, np.max(np.abs(mechanics.residual), initial=0.0)
        if opening <= CLOSED * system.length:
            return Start(z, _velocities(mechanics))
        if iteration > 2 and opening > 0.5 * before_it:
            break
        step = least_squares(mechanics.jacobian, -mechanics.residual)
        z = mechanics.moved(z, step)
    mechanics.t = before
    return None


def _velocities(mechanics: Mechanics) -> Array:
    """What the drives demand, at the position evaluated last without velocity."""
    rates = mechanics.rates
    v = least_squares(mechanics.jacobian, -rates)
    return v * mechanics.scale


def _set_clock(mechanics: Mechanics, t: float) -> None:
    edges = np.array([mechanics.system.scene.time.start, *mechanics.system.breaks])
    part = int(np.clip(np.searchsorted(edges, t) - 1, 0, len(edges) - 2))
    mechanics.work.clock[0] = 0.5 * (edges[part] + edges[part + 1])
