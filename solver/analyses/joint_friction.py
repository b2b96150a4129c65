"""Equations of motion of analyses with friction in joints.

A sticking joint is a constraint. A sliding one has a force t that follows from the
multipliers, eq. (32), and thus depends on all that changes the load of the joint.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..initial_state.assembly import StateVectors
from ..initial_state.initial_friction import with_prescribed_friction
from ..integrators.output_sampling import OUTPUT_FRICTION, OUTPUT_LOAD, OUTPUT_RATE
from ..linear.accelerations import solve_prescribed_friction
from ..linear.joint_friction import friction_limit
from ..output.stick_slip import StickSlipDecision, sticking_joints, with_friction_states
from ..spatial import system_arrays as at
from ..system.characteristic_sizes import friction_coordinate_sizes, resting_rates
from ..system.errors import SimulationError
from ..system.system import System
from .dense_equations import DenseEquations, null_space

#: Joints with less load are not loaded, relative to the largest multiplier.
UNLOADED = 1e-12


def with_prescribed_motion(
    system: System, start: StateVectors, driven: Array
) -> System:
    """The system in which no joint with friction is free to stick.

    Parameters
    ----------
    driven : (n,)
        True for the velocity coordinates that move.

    Raises
    ------
    InputError
        The load of a joint is statically indeterminate.
    """
    if not system.friction_joints:
        return system
    system = with_prescribed_friction(system, start, driven)
    friction_state = system.arrays.friction_state.copy()
    friction_state[:, at.REST_RATE] = resting_rates(system)
    return replace(system, arrays=system.arrays.replaced(friction_state=friction_state))


def prescribed_friction(
    mechanics: DenseEquations, multipliers: Array, responses: Array
) -> Array:
    """Friction forces (frictions,) of a known motion at the state evaluated last.

    Parameters
    ----------
    multipliers : (rows,)
        Without friction.
    responses : (frictions, rows)
        What unit forces along the coordinates add to them.

    Raises
    ------
    SimulationError
        Friction has no solution, or several.
    """
    mechanics.memory.friction_X[:] = 0.0
    return friction_forces(mechanics, multipliers, responses)


def friction_forces(
    mechanics: DenseEquations, multipliers: Array, responses: Array
) -> Array:
    """Friction forces (frictions,), of accelerations and what unit forces add to them
    in the memory of the mechanics.

    Parameters and errors as of `prescribed_friction`.
    """
    system, work, memory = mechanics.system, mechanics.work, mechanics.memory
    memory.multiplier[:], memory.friction_L[:] = multipliers, responses
    if solve_prescribed_friction(system.arrays, work, memory) != 0:
        raise SimulationError(_no_solution(system, mechanics.t))
    return np.array(work.friction_force)


def _no_solution(system: System, t: float) -> Diagnostic:
    joints = tuple(rub.joint for rub in system.friction_joints)
    return diagnose("N501", t=t, joints=joints)


def with_friction_states_of(system: System, t: float, start: StateVectors) -> System:
    """The system with joints that stick and slide as they do in a state.

    Raises
    ------
    InputError
        The load of a joint is statically indeterminate.
    SimulationError
        Friction has no solution there.
    """
    system = with_friction_states(with_prescribed_friction(system, start))
    decision = StickSlipDecision(system)
    reason = decision.choose_states(t, start.z, start.v)
    if reason is not None:
        raise SimulationError(reason)
    return system


class StickingEquations(DenseEquations):
    """The equations in which some joints with friction do not move.

    Attributes
    ----------
    sticking_joints
        Their rows among the joints with friction.
    """

    sticking_joints: NDArray[np.intp]

    @property
    def jacobian(self) -> Array:
        return np.vstack([super().jacobian, self.directions[self.sticking_joints]])

    @property
    def constraint_rates(self) -> Array:
        return np.append(super().constraint_rates, self._sticking_rows(at.C_RATE))

    @property
    def gamma(self) -> Array:
        return np.append(super().gamma, self._sticking_rows(at.C_GAMMA))

    def _sticking_rows(self, column: int) -> Array:
        return np.asarray(
            self.work.friction_subsystem.row[self.sticking_joints, column]
        )

    @property
    def constraint_sizes(self) -> Array:
        return np.append(
            super().constraint_sizes,
            friction_coordinate_sizes(self.system)[self.sticking_joints],
        )


class HeldEquations(StickingEquations):
    """The equations in which joints with friction stay where they were in a position.

    Parameters
    ----------
    joints
        Their rows among the joints with friction.
    z : (n positions,)
        The position.
    """

    def __init__(
        self, system: System, t: float, clock: float, joints: NDArray[np.intp], z: Array
    ) -> None:
        super().__init__(system, t, clock)
        self.sticking_joints = joints
        self.evaluate(z, np.zeros(system.n_velocities))
        self._places = self._sticking_rows(at.C_VALUE).copy()

    @property
    def residual(self) -> Array:
        moved = self._sticking_rows(at.C_VALUE) - self._places
        return np.append(super().residual, moved)


class FrictionEquations(StickingEquations):
    """The equations near a state in which joints stick or slide.

    Attributes
    ----------
    sliding_joints
        Joints with friction and a load that slide.

    Raises
    ------
    InputError
        A joint breaks loose in the state, or carries no load.
    SimulationError
        Friction has no solution there.
    """

    def __init__(
        self, system: System, t: float, clock: float, z: Array, v: Array
    ) -> None:
        system = with_friction_states(
            with_prescribed_friction(system, StateVectors(z, v))
        )
        super().__init__(system, t, clock)
        self._decide_states(z, v)

    def _decide_states(self, z: Array, v: Array) -> None:
        system = self.system
        decision = StickSlipDecision(system)
        reason = decision.choose_states(self.t, z, v)
        if reason is not None:
            raise SimulationError(reason)
        output = decision.friction_output(np.array([self.t]), z[None], v[None])[0]
        self._loads = output[:, OUTPUT_LOAD]
        largest = np.abs(decision.memory.multiplier).max(initial=0.0)
        self._changes = np.array(decision.work.friction_limit_derivative)
        is_at_rest = np.abs(output[:, OUTPUT_RATE]) <= resting_rates(system)
        self._directions_of_sliding = np.where(
            decision.prescribed & is_at_rest,
            0.0,
            decision.friction_state[:, at.SLIP_DIRECTION],
        )
        unloaded = ~decision.prescribed & (self._loads <= UNLOADED * largest)
        self._refuse_undecided(is_at_rest, unloaded)
        self.sticking_joints = np.flatnonzero(
            (self._directions_of_sliding == 0.0) & ~decision.prescribed
        )
        self.sliding_joints = np.flatnonzero(self._directions_of_sliding)

    def _refuse_undecided(self, rests: Array, unloaded: Array) -> None:
        """States beside which friction has no derivative."""
        for j, friction_joint in enumerate(self.system.friction_joints):
            place = f"joints.{friction_joint.joint}.friction"
            if unloaded[j]:
                raise InputError(
                    f"{friction_joint.joint} carries no load in this state: its "
                    "friction holds nothing, and has no derivative",
                    place=place,
                    expected="a state in which it is loaded, or no friction",
                )
            if rests[j] and self._directions_of_sliding[j] != 0.0:
                raise InputError(
                    f"{friction_joint.joint} rests in this state, but its friction "
                    "cannot hold it "
                    "there: where it breaks loose friction has no derivative",
                    place=place,
                    expected="a state in which it sticks or slides, such as the static "
                    "equilibrium, or a state of a run",
                )

    @property
    def force(self) -> Array:
        """With that of what slides, of the loads in the state."""
        return (
            super().force
            + self._sliding_friction @ self.directions[self.sliding_joints]
        )

    @property
    def _sliding_friction(self) -> Array:
        arrays, columns = self.system.arrays, []
        for j in self.sliding_joints:
            rate = float(self.work.friction_subsystem.row[j, at.C_RATE])
            size = (
                self._directions_of_sliding[j]
                * friction_limit.py_func(arrays, j, rate)[0]
            )
            viscous = arrays.real_data[arrays.friction[j, at.R_LAW] + at.L_VISCOUS]
            columns.append(-size * self._loads[j] - viscous * rate)
        return np.array(columns)

    def test_directions(self, motion: Array) -> Array:
        """With friction t = -R lambda, those along which C^T - B^T R has no part."""
        if not len(self.sliding_joints):
            return motion
        C = self.jacobian
        for j, direction in zip(
            self.sliding_joints, self.directions[self.sliding_joints], strict=True
        ):
            row = self.system.arrays.friction[j]
            for r in range(row[at.R_COUNT]):
                C[row[at.R_ROWS + r]] -= self._changes[j, r] * direction
        directions = null_space(C)
        if directions.shape != motion.shape:
            raise SimulationError(_no_solution(self.system, self.t))
        return directions

    def solve_inertia(self, inertia: Array, right: Array) -> Array:
        """Solve in the unconstrained directions, where the matrix is not symmetric."""
        if not len(self.sliding_joints):
            return super().solve_inertia(inertia, right)
        return np.asarray(np.linalg.solve(inertia, right), np.float64)

    def notes(self) -> tuple[Diagnostic, ...]:
        """Joints that stick and slide in the state (N514)."""
        names = [rub.joint for rub in self.system.friction_joints]
        sticking = ", ".join(names[j] for j in self.sticking_joints)
        sliding = ", ".join(names[j] for j in self.sliding_joints)
        states = ((sticking, "holds"), (sliding, "slides"))
        return tuple(
            diagnose("N514", names, state=state) for names, state in states if names
        )


def friction_that_holds(
    system: System, t: float, z: Array
) -> tuple[NDArray[np.bool_], Array]:
    """Which joints friction holds at rest in a position (frictions,), and its forces.

    Raises
    ------
    InputError
        The load of a joint is statically indeterminate.
    SimulationError
        Friction has no solution there.
    """
    rest = StateVectors(z, np.zeros(system.n_velocities))
    system = with_friction_states_of(system, t, rest)
    sticks = sticking_joints(system.arrays.friction_state)
    decision = StickSlipDecision(system)
    output = decision.friction_output(np.array([t]), z[None], rest.v[None])[0]
    return sticks, output[:, OUTPUT_FRICTION]


def equations_at(system: System, t: float, z: Array, v: Array) -> DenseEquations:
    """The equations near a state, with what sticks there held.

    Raises as `FrictionEquations`.
    """
    clock = float(system.clocks(np.array([t]))[0])
    if system.friction_joints:
        return FrictionEquations(system, t, clock, z, v)
    return DenseEquations(system, t, clock)
