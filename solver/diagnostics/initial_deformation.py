"""Initial deformations of flexible bodies that are far from their equilibrium."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.result import FlexibleBody
from sidtool.formats.scene import SidBody

from ..integrators.output_sampling import OUTPUT_FRICTION
from ..linear.accelerations import solve_accelerations
from ..output.samples import Samples
from ..spatial import system_arrays as at
from ..system.sid_packing import symmetrise
from ..system.system import System
from ..system.work_arrays import evaluate, new_memory, new_work_arrays
from .body_loads import relative_deflection

#: Part of the largest deformation of a run that counts as far, and of the size of the
#: body that counts at all.
LARGE_FRACTION, MIN_DEFLECTION = 0.1, 1e-6
#: A vibration by more than this part of the size is a warning.
LARGE_VIBRATION = 0.01
#: Squares of frequencies that joints leave no motion, relative to the largest one.
CONSTRAINED_FREQUENCY = 1e-10
#: Unit forces times this are applied: friction of loads is linear near a state alone.
UNIT_FORCE_FACTOR = 1e-5


def initial_deformation_notes(
    system: System, first: Samples, bodies: Mapping[str, FlexibleBody]
) -> Iterator[Diagnostic]:
    """Bodies that are far from quasi-static equilibrium at the start (N220).

    dq is the deformation whose elastic forces would leave the elastic coordinates no
    acceleration: q'' = W Ke dq, W being what unit forces on them accelerate, frames and
    joints moving along. Ke dq = Me q'' is looked at first, and is dq where the frame
    does not move; a light end that a torque turns moves the frame against the body.
    Bodies whose deformation the scene states are where they are meant to be.

    Parameters
    ----------
    first
        The state at the start (nt = 1) with its accelerations.
    """
    shares = {}
    for name, body in bodies.items():
        b = system.index(name)
        described, sid = system.scene.bodies[name], system.bodies[b].sid
        start = system.scene.initial_of(name)
        is_specified = isinstance(described, SidBody) and any(
            getattr(start, key, None) is not None
            for key in ("elastic", "elastic_velocity")
        )
        if is_specified or not body.deflection > MIN_DEFLECTION:
            continue
        row = system.arrays.body[b]
        last, nq = int(row[at.VEL] + row[at.NV]), int(row[at.NQ])
        elastic_acceleration = first.accelerations[0, last - nq : last]
        mass, stiffness = symmetrise(sid.Me.m0), symmetrise(sid.Ke.m0)
        missing_deformation = np.linalg.lstsq(
            stiffness, mass @ elastic_acceleration, rcond=None
        )[0]
        distance = relative_deflection(
            sid, np.asarray(missing_deformation, np.float64)[None], 0.0
        )
        if np.isfinite(distance) and distance > LARGE_FRACTION * body.deflection:
            missing_deformation = _missing_deformation(
                system, slice(last - nq, last), stiffness, first
            )
            distance = relative_deflection(sid, missing_deformation[None], 0.0)
        if np.isfinite(distance) and distance > LARGE_FRACTION * body.deflection:
            shares[name] = float(distance)
    for name, share in shares.items():
        code = "N220" if share > LARGE_VIBRATION else "N219"
        yield diagnose(code, name, share=share)


def may_vibrate_from_start(
    system: System, first: Samples, bodies: Mapping[str, FlexibleBody], z: Array
) -> bool:
    """True if `initial_deformation_notes` may warn of a body; False is certain.

    Its deformation in one state is less than that in the run, and more bodies seem far
    from equilibrium then.

    Parameters
    ----------
    z : (nt, n positions)
        States of the run.
    """
    least = {}
    for name, body in bodies.items():
        row = system.arrays.body[system.index(name)]
        end = int(row[at.POS] + row[at.NP])
        q = z[:, end - int(row[at.NQ]) : end]
        k = int(np.abs(q).max(axis=1).argmax()) if len(q) else 0
        sid = system.bodies[system.index(name)].sid
        least_deflection = float(np.nextafter(MIN_DEFLECTION, np.inf))
        deflection = relative_deflection(sid, q[k : k + 1], least_deflection)
        least[name] = replace(body, deflection=deflection)
    notes = initial_deformation_notes(system, first, least)
    return any(each.is_warning for each in notes)


def _with_sampled_friction_states(system: System, first: Samples) -> System:
    """The system with joints that stick and slide as they do in a state."""
    if not system.friction_joints:
        return system
    friction_state = system.arrays.friction_state.copy()
    slip_direction = -np.sign(first.friction[0, :, OUTPUT_FRICTION])
    friction_state[:, at.SLIP_DIRECTION] = np.where(
        first.sticking[0], 0.0, slip_direction
    )
    friction_state[:, at.CONTACT_SIDE :] = 0.0
    return replace(system, arrays=system.arrays.replaced(friction_state=friction_state))


def _missing_deformation(
    system: System, elastic: slice, stiffness: Array, first: Samples
) -> Array:
    """dq (nq,) of a body in a state, see `initial_deformation_notes`; of
    least energy.
    """
    system = _with_sampled_friction_states(system, first)
    work, memory = new_work_arrays(system), new_memory(system, 0)
    t = system.scene.time.start
    work.interval_time[0] = system.clocks(np.array([t]))[0]
    evaluate(system, work, t, first.z[0], first.v[0])

    def acceleration_under(force: Array) -> Array:
        work.f[elastic] += force
        solve_accelerations(system.arrays, work, memory)
        work.f[elastic] -= force
        return np.array(memory.acceleration[elastic])

    values, U = np.linalg.eigh(stiffness)
    values = np.maximum(values, CONSTRAINED_FREQUENCY * values[-1])
    root = U * np.sqrt(values)
    free_acceleration = acceleration_under(np.zeros(len(values)))
    responses = np.array(
        [
            acceleration_under(UNIT_FORCE_FACTOR * column) - free_acceleration
            for column in root.T
        ]
    ).T
    responses /= UNIT_FORCE_FACTOR
    squares = root.T @ responses
    y = np.linalg.pinv(
        (squares + squares.T) / 2, rcond=CONSTRAINED_FREQUENCY, hermitian=True
    )
    q: Array = U @ (y @ (root.T @ first.accelerations[0, elastic]) / np.sqrt(values))
    return q
