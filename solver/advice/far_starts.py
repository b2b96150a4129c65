"""Starts in which flexible bodies are let go far from what their loads ask for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from sidtool.formats.result import FlexibleBody
from sidtool.formats.scene import SidBody
from sidtool.formats.sid import Array

from ..integrators.recording import RUB_FORCE
from ..linear.accelerations import solve_accelerations
from ..recording.sampling import Samples
from ..space import layout as at
from ..system.bodies.packing import symmetric
from ..system.kernel_calls import evaluate
from ..system.scene import System
from ..system.storage import new_memory, new_work
from .body_measures import deflection

#: Part of the largest deformation of a run that counts as far, and of the size of the
#: body that counts at all.
FAR, SEEN = 0.1, 1e-6
#: Squares of frequencies that joints leave no motion, relative to the largest one.
HELD = 1e-10
#: Unit forces times this are asked for: friction of loads is linear near a state alone.
SMALL = 1e-5


def far_starts(
    system: System,
    first: Samples,
    bodies: Mapping[str, FlexibleBody],
    can_rest: Callable[[], bool],
) -> Iterator[str]:
    """One line on bodies that are far from quasi-static equilibrium at the start.

    dq is the deformation whose elastic forces would leave the elastic coordinates no
    acceleration: q'' = W Ke dq, W being what unit forces on them accelerate, frames and
    joints moving along. Ke dq = Me q'' is looked at first, and is dq where the frame
    does not move; a light end that a torque turns moves the frame against the body.
    Bodies whose deformation the scene states are where they are meant to be.

    first : the state at the start (nt = 1) with its accelerations
    can_rest : whether the scene has a static equilibrium to start in
    """
    told = []
    for name, body in bodies.items():
        b = system.index(name)
        described, sid = system.scene.bodies[name], system.bodies[b].sid
        start = system.scene.initial_of(name)
        stated = isinstance(described, SidBody) and any(
            getattr(start, key, None) is not None
            for key in ("elastic", "elastic_velocity")
        )
        if stated or not body.deflection > SEEN:
            continue
        row = system.arrays.body[b]
        last, nq = int(row[at.VEL] + row[at.NV]), int(row[at.NQ])
        pushed = first.accelerations[0, last - nq : last]
        mass, stiffness = symmetric(sid.Me.m0), symmetric(sid.Ke.m0)
        missing = np.linalg.lstsq(stiffness, mass @ pushed, rcond=None)[0]
        away = deflection(sid, np.asarray(missing, np.float64)[None], 0.0)
        if np.isfinite(away) and away > FAR * body.deflection:
            missing = _missing(system, slice(last - nq, last), stiffness, first)
            away = deflection(sid, missing[None], 0.0)
        if np.isfinite(away) and away > FAR * body.deflection:
            told.append(f"{name} by {away:.2g} of its size")
    if told:
        rest = 'initial = {state = "static"} starts at rest, ' if can_rest() else ""
        yield (
            "the run starts far from equilibrium: the loads at the start ask for other "
            f"deformations of {', '.join(told)}, and what it shows rings about them; "
            f"{rest}loads that grow smoothly excite less"
        )


def _gripped(system: System, first: Samples) -> System:
    """The system with joints that stick and slide as they do in a state."""
    if not system.rubbing:
        return system
    grip = system.arrays.grip.copy()
    sense = -np.sign(first.friction[0, :, RUB_FORCE])
    grip[:, at.SENSE] = np.where(first.sticking[0], 0.0, sense)
    grip[:, at.SIDE :] = 0.0
    return replace(system, arrays=system.arrays.replaced(grip=grip))


def _missing(system: System, elastic: slice, stiffness: Array, first: Samples) -> Array:
    """dq (nq,) of a body in a state, see `far_starts`; of least energy."""
    system = _gripped(system, first)
    work, memory = new_work(system), new_memory(system, 0)
    t = system.scene.time.start
    work.clock[0] = system.clocks(np.array([t]))[0]
    evaluate(system, work, t, first.z[0], first.v[0])

    def accelerated(force: Array) -> Array:
        work.f[elastic] += force
        solve_accelerations(system.arrays, work, memory)
        work.f[elastic] -= force
        return np.array(memory.acceleration[elastic])

    values, U = np.linalg.eigh(stiffness)
    values = np.maximum(values, HELD * values[-1])
    root = U * np.sqrt(values)
    rest = accelerated(np.zeros(len(values)))
    answers = np.array([accelerated(SMALL * column) - rest for column in root.T]).T
    answers /= SMALL
    squares = root.T @ answers
    y = np.linalg.pinv((squares + squares.T) / 2, rcond=HELD, hermitian=True)
    found: Array = U @ (
        y @ (root.T @ first.accelerations[0, elastic]) / np.sqrt(values)
    )
    return found
