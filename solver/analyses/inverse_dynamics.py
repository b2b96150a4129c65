"""Inverse dynamics: the motion is prescribed, forces follow without integration.

Drives do not prescribe the vibration of flexible bodies. The result contains the
quasi-static deformation: elastic coordinates without velocity and acceleration, in
equilibrium with the elastic, inertia and joint forces of the prescribed motion. A
transient run approaches it when the motion is slow compared with the vibrations.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import diagnose
from sidtool.formats.result import Result
from sidtool.formats.scene import output_times

from ..diagnostics.body_loads import find_state_failure
from ..diagnostics.failure_causes import dependent_row_names
from ..initial_state.assembly import StateVectors, assemble
from ..initial_state.displacement_report import position_notes
from ..initial_state.given_state import store_rotations
from ..spatial import system_arrays as at
from ..system.characteristic_sizes import coordinate_sizes
from ..system.errors import SimulationError
from ..system.sid_packing import symmetrise
from ..system.system import System
from ..system.work_arrays import new_work_arrays
from .analysis_results import MotionState, result_of_states, with_failure
from .dense_equations import (
    DenseEquations,
    least_squares,
    null_space,
    refuse_eliminated_joints,
)
from .frozen_inputs import is_state, with_integrated_drives
from .joint_friction import prescribed_friction, with_prescribed_motion

#: Constraints are met when they are open by less, relative to their sizes.
RESIDUAL_TOLERANCE = 1e-12
#: Least independence of the constraints at which they decide motion and forces to six
#: digits: rounding of positions counts with the inverse of its square.
MIN_INDEPENDENCE = 1e-5
#: Intervals between output times are halved at most this often.
MAX_HALVINGS = 20
#: Elastic coordinates are in equilibrium when they change by less, relative to all.
CONVERGED = 1e-11
#: Changes that no longer shrink are rounding below this part of the mechanism's size.
ROUNDING = 1e-13
#: Turns are counted when they differ less from what the mean speed makes them [rad].
MAX_ROTATION_ERROR = 1.0
MAX_ITERATIONS = 40
#: Changes that shrink by less in an iteration ask for a better stiffness, measured by
#: moving elastic coordinates by a part of the largest.
CONTRACTION, PROBE_SIZE = 0.25, 1e-3
#: Changes grow by more where there is no equilibrium.
DIVERGENCE_FACTOR = 1e6
SIMULATE_INSTEAD = (
    ", or simulate, which knows it and has the forces of joints and drives as outputs"
)


def inverse_dynamics(system: System, *, quasi_static: bool = False) -> Result:
    """Positions, velocities, accelerations and joint forces at the output times.

    Parameters
    ----------
    quasi_static
        Flexible bodies take their quasi-static deformation; its velocity and
        acceleration are left out.

    Raises
    ------
    InputError
        Something can move that no drive prescribes, or the load of a joint with
        friction is not determined.
    SimulationError
        The drives lead to a position that cannot be reached or to a singular
        configuration, or a body is too soft for a quasi-static deformation or deforms
        by more than its own size; its `result` holds what there is.
    """
    refuse_eliminated_joints(system)
    system = with_integrated_drives(system)
    refuse_law_states(system, SIMULATE_INSTEAD)
    motion, state = _initial_motion(system, quasi_static)
    motion.refuse_freedom(state)
    motion.set_friction(state)
    system = motion.system
    least = system.scene.accuracy.rtol
    moved = tuple(position_notes(system, new_work_arrays(system), state, least))
    times = output_times(system.scene)
    kind = "inverse dynamics" + (", quasi-static deformation" if quasi_static else "")
    states: list[MotionState] = []
    for target_time in times:
        try:
            state = _advance_to(motion, state, float(target_time))
            states.append(motion.with_accelerations(state))
        except SimulationError as error:
            done = np.array(times[: len(states)])
            error.result = result_of_states(
                system, kind, done, states, error.diagnostics
            )
            raise
    result = result_of_states(system, kind, times, states, diagnostics=moved)
    if failure := find_state_failure(system, result.positions):
        raise SimulationError(failure, with_failure(result, failure))
    return result


def refuse_law_states(system: System, instead: str = "") -> None:
    """Raises laws whose states no prescribed motion decides.

    Parameters
    ----------
    instead
        What else would do, as the end of a sentence.
    """
    for b, data in enumerate(system.bodies):
        if is_state(system, b):
            raise InputError(
                f"{data.name} is no function of the motion that is prescribed, but "
                "follows from all of it before",
                place="forces, drives",
                expected=f"laws without states and sample time{instead}",
            )


def relative_equilibrium(system: System) -> Array | None:
    """Positions at the start of a scene whose drives move it at once, (n,), its bodies
    in equilibrium with the loads of that motion; None of other scenes.

    None, too, where something moves that no drive prescribes.

    Raises
    ------
    SimulationError
        A body is too soft for a quasi-static deformation.
    """
    refuse_eliminated_joints(system)
    motion, start = _initial_motion(system, quasi_static=True)
    try:
        refuse_law_states(system)
        motion.refuse_freedom(start)
        motion.set_friction(start)
    except InputError:
        return None
    if motion.driven.all() or not motion.velocities(start.z).any():
        return None
    z = motion.deformed(start.z)
    return None if z is None else z.z


def _initial_motion(
    system: System, quasi_static: bool
) -> tuple[PrescribedMotion, StateVectors]:
    system, start = assemble(system)
    t = system.scene.time.start
    mechanics = DenseEquations(system, t, float(system.clocks(np.array([t]))[0]))
    mechanics.scale = coordinate_sizes(system)
    return PrescribedMotion(mechanics, quasi_static), start


class PrescribedMotion:
    """States that the drives demand.

    Attributes
    ----------
    driven : (n,)
        True for the velocity coordinates that the drives decide.
    """

    def __init__(self, mechanics: DenseEquations, quasi_static: bool) -> None:
        self.mechanics, self.system = mechanics, mechanics.system
        self.driven = np.ones(self.system.n_velocities, bool)
        if quasi_static:
            for row in self.system.arrays.body:
                self.driven[row[at.VEL] + row[at.RD] : row[at.VEL] + row[at.NV]] = False
        self.stiffness = self._stiffness()[np.ix_(~self.driven, ~self.driven)]

    def refuse_freedom(self, start: StateVectors) -> None:
        self.mechanics.evaluate(start.z, start.v)
        free = null_space(self.mechanics.jacobian[:, self.driven]).shape[1]
        if not free:
            return
        expected = "as many drives as the mechanism has degrees of freedom"
        if self.system.flexible and self.driven.all():
            expected += ", and the option quasi-static, which leaves out vibrations"
        raise InputError(
            f"{free} of {int(self.driven.sum())} coordinates can move freely",
            place="drives",
            expected=expected,
        )

    def set_friction(self, start: StateVectors) -> None:
        """Takes friction of joints as that of prescribed motions."""
        self.system = with_prescribed_motion(self.system, start, self.driven)
        self.mechanics.system = self.system

    def _stiffness(self) -> Array:
        """Ke of all bodies, scaled."""
        n, scale = self.system.n_velocities, self.mechanics.scale
        K = np.zeros((n, n))
        for row, body in zip(self.system.arrays.body, self.system.bodies, strict=True):
            elastic = slice(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
            K[elastic, elastic] = symmetrise(body.sid.Ke.m0)
        return K * np.outer(scale, scale)

    def driven_solution(self, right: Array) -> Array:
        """What the drives make of all scaled coordinates, the elastic ones at zero."""
        x = np.zeros(self.system.n_velocities)
        x[self.driven] = least_squares(self.mechanics.jacobian[:, self.driven], right)
        return x

    def closed(self, z: Array) -> Array | None:
        """z moved onto the constraints; None if it is too far away."""
        mechanics, zero = self.mechanics, np.zeros(self.system.n_velocities)
        opening = np.inf
        for iteration in range(12):
            mechanics.evaluate(z, zero)
            before, opening = opening, mechanics.scaled_residual
            if iteration > 2 and opening > max(RESIDUAL_TOLERANCE, 0.5 * before):
                return None
            z = mechanics.displaced(z, self.driven_solution(-mechanics.residual))
            if (
                opening <= RESIDUAL_TOLERANCE
            ):  # and with the last step as far as rounding allows
                return z
        return None

    def velocities(self, z: Array) -> Array:
        self.mechanics.evaluate(z, np.zeros(self.system.n_velocities))
        return (
            self.driven_solution(-self.mechanics.constraint_rates)
            * self.mechanics.scale
        )

    def accelerations(self, state: StateVectors) -> Array:
        """Scaled accelerations that the drives demand."""
        self.mechanics.evaluate(state.z, state.v)
        return self.driven_solution(self.mechanics.gamma)

    def with_accelerations(self, state: StateVectors) -> MotionState:
        """A state with the accelerations that the drives demand, and their forces.

        Raises
        ------
        SimulationError
            The configuration is singular: the drives do not decide the motion, or
            demand what the mechanism cannot do.
        """
        mechanics = self.mechanics
        mechanics.evaluate(state.z, np.zeros(self.system.n_velocities))
        C = mechanics.jacobian[:, self.driven]
        norms = np.linalg.norm(C, axis=1, keepdims=True)
        rows = C / np.where(norms > 0.0, norms, 1.0)
        sizes = np.linalg.svd(rows, compute_uv=False)
        if np.min(sizes, initial=1.0) < MIN_INDEPENDENCE:
            joints = dependent_row_names(self.system, rows)
            remedy = "Shift the output times: drives do not decide the motion here."
            raise SimulationError(
                diagnose("N310", t=mechanics.t, joints=joints, remedy=remedy)
            )
        mechanics.solve_demanded(C, -mechanics.constraint_rates, 1)
        mechanics.evaluate(state.z, state.v)
        a = np.zeros(self.system.n_velocities)
        a[self.driven] = mechanics.solve_demanded(C, mechanics.gamma, 2)
        return MotionState(state.z, state.v, a * mechanics.scale, *self.forces(a))

    def forces(self, a: Array) -> tuple[Array, Array]:
        """Multipliers and friction of scaled accelerations a, at the state evaluated
        last."""
        mechanics, driven = self.mechanics, self.driven
        unbalanced = mechanics.mass @ a - mechanics.force
        multipliers = mechanics.multipliers(unbalanced[driven], driven)
        if not self.system.friction_joints:
            return multipliers, np.zeros(0)
        along = mechanics.directions[:, driven]
        responses = np.array([mechanics.multipliers(-row, driven) for row in along])
        friction = prescribed_friction(mechanics, multipliers, responses)
        return multipliers + friction @ responses, friction

    @np.errstate(over="ignore", invalid="ignore")  # of what is not finite, see below
    def deformed(self, z: Array) -> StateVectors | None:
        """The closed state near z whose elastic coordinates are in equilibrium."""
        size, first, measured = np.inf, np.inf, False
        for _ in range(MAX_ITERATIONS):
            state = self._closed_state(z)
            if state is None or self.driven.all():
                return state
            left = self._unbalanced_force(state)
            if not np.isfinite(left).all():
                break
            before, size = size, self._correction(left)[1]
            if not size <= CONTRACTION * before:
                if measured and size <= ROUNDING:
                    return state
                self._measure_stiffness(state, left)
                measured = True
                size = self._correction(left)[1]
            first = min(first, max(size, self._elastic_size(state.z)))
            if not size <= DIVERGENCE_FACTOR * first:
                break
            z = self.mechanics.displaced(state.z, self._correction(left)[0])
            if size <= CONVERGED * max(self._elastic_size(z), 1e-300):
                return state
        raise SimulationError(diagnose("N721", t=self.mechanics.t))

    def _closed_state(self, z: Array) -> StateVectors | None:
        closed = self.closed(z)
        return None if closed is None else StateVectors(closed, self.velocities(closed))

    def _unbalanced_force(self, state: StateVectors) -> Array:
        """Scaled forces f + C^T lambda - M a that deform the bodies further."""
        a = self.accelerations(state)
        unbalanced = self.mechanics.mass @ a - self.mechanics.force
        C, driven = self.mechanics.jacobian, self.driven
        multipliers, friction = self.forces(a)
        left = unbalanced[~driven] - C[:, ~driven].T @ multipliers
        return -left + self.mechanics.directions[:, ~driven].T @ friction

    def _correction(self, left: Array) -> tuple[Array, float]:
        """What unbalanced forces ask for, of all scaled coordinates, and its size."""
        change = np.zeros(self.system.n_velocities)
        change[~self.driven] = least_squares(self.stiffness, left)
        return change, float(np.max(np.abs(change)))

    def _measure_stiffness(self, state: StateVectors, left: Array) -> None:
        """Takes the stiffness of bodies under their loads at a state, by differences.

        It is Ke alone at first, which leads away where loads stiffen by more than Ke.
        """
        h = PROBE_SIZE * max(self._elastic_size(state.z), self._correction(left)[1])
        K = np.zeros_like(self.stiffness)
        for k, coordinate in enumerate(np.flatnonzero(~self.driven)):
            x = np.zeros(self.system.n_velocities)
            x[coordinate] = h
            near = self._closed_state(self.mechanics.displaced(state.z, x))
            if near is None:
                return
            K[:, k] = (left - self._unbalanced_force(near)) / h
        self.stiffness = K

    def _elastic_size(self, z: Array) -> float:
        """The largest scaled elastic coordinate."""
        size = 0.0
        for row in self.system.arrays.body:
            nq = row[at.NQ]
            q = z[row[at.POS] + row[at.NP] - nq : row[at.POS] + row[at.NP]]
            scale = self.mechanics.scale[row[at.VEL] + row[at.RD] :][:nq]
            size = max(size, float(np.max(np.abs(q) / scale, initial=0.0)))
        return size


def _advance_to(
    motion: PrescribedMotion, state: StateVectors, target_time: float
) -> StateVectors:
    """The state at a later time, over smaller steps where one does not arrive."""
    mechanics = motion.mechanics
    target, halvings = target_time, 0
    while halvings <= MAX_HALVINGS:
        state_reached = _predict_and_correct(motion, state, target)
        if state_reached is None:
            halvings += 1
            target = 0.5 * (mechanics.t + target)
        elif target == target_time:
            return state_reached
        else:
            state, target = state_reached, target_time
    raise SimulationError(diagnose("N722", t=mechanics.t))


def _predict_and_correct(
    motion: PrescribedMotion, state: StateVectors, target_time: float
) -> StateVectors | None:
    """The state at `target_time`, from a prediction; None if that is too far away."""
    mechanics = motion.mechanics
    before, h = mechanics.t, target_time - mechanics.t
    mechanics.work.interval_time[:1] = mechanics.system.clocks(np.array([target_time]))
    x = h * state.v / mechanics.scale + 0.5 * h * h * motion.accelerations(state)
    z = mechanics.displaced(state.z, x)
    rates = mechanics.rotation_rates(state)
    first = len(z) - len(rates)
    z[first:] += h * rates
    mechanics.t = target_time
    state_reached = motion.deformed(z)
    if state_reached is not None:
        rates = 0.5 * (rates + mechanics.rotation_rates(state_reached))
        store_rotations(mechanics.system, mechanics.work, state_reached.z)
        rotation_error = state_reached.z[first:] - state.z[first:] - h * rates
        if np.max(np.abs(rotation_error), initial=0.0) < MAX_ROTATION_ERROR:
            return state_reached
    mechanics.t = before
    return None
