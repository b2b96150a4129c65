"""Scenes that start in static equilibrium, or deformed by their steady rotation."""

from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import SceneFile

from ..initial_state.assembly import StateVectors, assemble
from ..initial_state.displacement_report import position_notes
from ..initial_state.given_state import whole_turns
from ..spatial import system_arrays as at
from ..system.characteristic_sizes import coordinate_sizes
from ..system.errors import SimulationError
from ..system.system import System
from ..system.work_arrays import new_work_arrays
from .dense_equations import DenseEquations, least_squares, null_space
from .frozen_inputs import is_state, with_integrated_drives
from .inverse_dynamics import PrescribedMotion, refuse_law_states, relative_equilibrium
from .joint_friction import friction_forces, with_friction_states_of
from .static_equilibrium import static_equilibrium

#: Rounds in which what sticks and slides has to agree with the deformation.
MAX_ROUNDS = 8


def start_in_equilibrium(
    system: System,
) -> tuple[SceneFile, tuple[Diagnostic, ...]]:
    """The scene of a system with its bodies and the states of its laws in equilibrium,
    and what is reported of it.

    Gravity and loads are those at the start, drives hold their values there. Stated
    velocities stay as they are; see `start_in_steady_rotation` for what they do. Where
    drives prescribe all motion and move at once, as in steady spin, bodies are in
    equilibrium with the loads of that motion, too.

    Parameters
    ----------
    system
        With all of its joints.

    Raises
    ------
    InputError
        There is no equilibrium near the start.
    """
    try:
        integrated = with_integrated_drives(system)
        z = relative_equilibrium(integrated)
        if z is not None:
            found = with_bodies(system, scene_at(integrated, z))
            return found, assembly_notes(*assemble(integrated))
        equilibrium = static_equilibrium(system)
    except SimulationError as error:
        raise InputError(
            str(error), place="initial.state", expected="a scene that can rest"
        ) from None
    system = equilibrium.system
    found = scene_at(system, equilibrium.z)
    states = {
        data.name: float(equilibrium.v[system.arrays.body[b, at.VEL]])
        for b, data in enumerate(system.bodies)
        if is_state(system, b)
    }
    if states:
        start = found.initial.model_copy(update={"states": states})
        found = found.model_copy(update={"initial": start})
    return found, equilibrium.diagnostics


def assembly_notes(system: System, start: StateVectors) -> tuple[Diagnostic, ...]:
    """Bodies that the assembly moved or deformed, of its result (N221, N222)."""
    least = system.scene.accuracy.rtol
    return tuple(position_notes(system, new_work_arrays(system), start, least))


def with_bodies(system: System, other: SceneFile) -> SceneFile:
    """The scene of a system with bodies that start as those of another scene, turned as
    often, and do not deform further where nothing else is stated."""
    bodies = dict(other.bodies)
    for data in system.flexible:
        start = bodies[data.name].initial
        if getattr(start, "elastic_velocity", None) is None:
            initial = start.model_copy(
                update={"elastic_velocity": (0.0,) * data.sid.nq}
            )
            bodies[data.name] = bodies[data.name].model_copy(
                update={"initial": initial}
            )
    return system.scene.model_copy(update={"bodies": bodies, "initial": other.initial})


def scene_at(system: System, z: Array) -> SceneFile:
    """The scene with its bodies at some positions, and their whole turns."""
    bodies = dict(system.scene.bodies)
    for b, data in enumerate(system.bodies):
        if data.name in bodies:
            start = bodies[data.name].initial
            pose = _body_pose(system, z, b)
            initial = start.model_copy(update=pose)
            bodies[data.name] = bodies[data.name].model_copy(
                update={"initial": initial}
            )
    of_scene = system.scene.initial
    if turns := whole_turns(system, z):
        turns = {**(of_scene.rotations or {}), **turns}
        of_scene = of_scene.model_copy(update={"rotations": turns})
    return system.scene.model_copy(update={"bodies": bodies, "initial": of_scene})


def _body_pose(system: System, z: Array, b: int) -> dict[str, Any]:
    """Position, orientation and elastic coordinates of a body, as a scene says them."""
    row = system.arrays.body[b]
    first, count, nq = int(row[at.POS]), int(row[at.NP]), int(row[at.NQ])
    own = [float(x) for x in z[first : first + count]]
    rigid, elastic = own[: count - nq], tuple(own[count - nq :])
    pose: dict[str, Any] = {"elastic": elastic} if nq else {}
    if not rigid:
        return pose
    axes = 2 if system.planar else 3
    pose["position"] = tuple(rigid[:axes])
    if len(rigid) == 3 and system.planar:
        pose["angle"] = rigid[2]
    elif len(rigid) == 7:
        quaternion_ = np.array(rigid[3:])
        pose |= {"axis_angle": None, "matrix": None}
        pose["quaternion"] = tuple(
            float(x) for x in quaternion_ / np.linalg.norm(quaternion_)
        )
    return pose


def start_in_steady_rotation(
    system: System,
) -> tuple[SceneFile, tuple[Diagnostic, ...]]:
    """The scene of a system with its bodies deformed by the loads of its motion at the
    start, and why they are not where that cannot be had.

    Parameters
    ----------
    system
        With all of its joints.
    """
    flexible = [
        data.name for data in system.bodies if data.is_scene_body and data.sid.nq
    ]
    assembled, start = assemble(with_integrated_drives(system))
    if not flexible or not _has_rigid_velocity(assembled, start.v):
        return system.scene, ()
    try:
        refuse_law_states(assembled)
        deformed = _deformed_start(assembled, start)
    except (InputError, SimulationError) as error:
        return system.scene, (diagnose("N224", ", ".join(flexible), reason=str(error)),)
    return with_bodies(system, scene_at(assembled, deformed.z)), ()


def _deformed_start(system: System, start: StateVectors) -> StateVectors:
    """The start with its bodies deformed, what sticks and slides there decided.

    Raises
    ------
    InputError
        The load of a joint with friction is not determined.
    SimulationError
        There is no such state.
    """
    t = system.scene.time.start
    clock = float(system.clocks(np.array([t]))[0])
    if system.friction_joints:
        system = with_friction_states_of(system, t, start)
    for _ in range(MAX_ROUNDS):
        mechanics = DenseEquations(system, t, clock)
        mechanics.scale = coordinate_sizes(system)
        z = _SpecifiedVelocities(mechanics, start.v).deformed(start.z)
        if z is None:
            raise SimulationError(diagnose("N722", t=t))
        if not system.friction_joints:
            return z
        next_system = with_friction_states_of(system, t, z)
        if (
            next_system.arrays.friction_state[:, at.SLIP_DIRECTION]
            == system.arrays.friction_state[:, at.SLIP_DIRECTION]
        ).all():
            return z
        system = next_system
    joints = tuple(rub.joint for rub in system.friction_joints)
    raise SimulationError(diagnose("N501", t=t, joints=joints))


def _has_rigid_velocity(system: System, v: Array) -> bool:
    """True if a body has a velocity, other than that of its elastic coordinates."""
    rows = zip(system.arrays.body, system.bodies, strict=True)
    return any(
        v[row[at.VEL] : row[at.VEL] + row[at.RD]].any()
        for row, data in rows
        if data.is_scene_body
    )


class _SpecifiedVelocities(PrescribedMotion):
    """States with given velocities of bodies, as far as joints and drives leave them.

    Attributes
    ----------
    v : (n velocities,)
        Which those of the elastic coordinates count as zero.
    friction : (frictions,)
        Forces of joints in the accelerations found last.
    """

    def __init__(self, mechanics: DenseEquations, v: Array) -> None:
        super().__init__(mechanics, quasi_static=True)
        self.scaled_velocities = np.where(self.driven, v / mechanics.scale, 0.0)
        self.friction = np.zeros(len(self.system.friction_joints))

    def velocities(self, z: Array) -> Array:
        mechanics = self.mechanics
        mechanics.evaluate(z, np.zeros(self.system.n_velocities))
        rate_error = (
            mechanics.constraint_rates + mechanics.jacobian @ self.scaled_velocities
        )
        return (
            self.scaled_velocities + self.driven_solution(-rate_error)
        ) * mechanics.scale

    def accelerations(self, state: StateVectors) -> Array:
        """Scaled accelerations of bodies whose elastic coordinates have none."""
        mechanics, driven = self.mechanics, self.driven
        mechanics.evaluate(state.z, state.v)
        C, f = mechanics.jacobian[:, driven], mechanics.force[driven]
        M = mechanics.mass[np.ix_(driven, driven)]
        constrained_part, N = least_squares(C, mechanics.gamma), null_space(C)

        def all_accelerations(a: Array, f: Array) -> Array:
            """Of a that constraints demand, and forces f."""
            total = np.zeros(self.system.n_velocities)
            total[driven] = a
            if N.shape[1]:
                free = mechanics.solve_inertia(N.T @ M @ N, N.T @ (f - M @ a))
                total[driven] += N @ free
            return total

        a = all_accelerations(constrained_part, f)
        if self.system.friction_joints:
            directions = mechanics.directions[:, driven]
            unit = np.array(
                [all_accelerations(np.zeros(len(M)), row) for row in directions]
            )
            multipliers = mechanics.multipliers(M @ a[driven] - f, driven)
            responses = np.array(
                [
                    mechanics.multipliers(M @ x[driven] - row, driven)
                    for x, row in zip(unit, directions, strict=True)
                ]
            )
            memory, scale = mechanics.memory, mechanics.scale
            memory.acceleration[:], memory.friction_X[:] = a * scale, unit * scale
            self.friction = friction_forces(mechanics, multipliers, responses)
            a = a + self.friction @ unit
        return a

    def forces(self, a: Array) -> tuple[Array, Array]:
        """Multipliers and friction of accelerations that were just found."""
        mechanics, driven = self.mechanics, self.driven
        unbalanced = mechanics.mass @ a - mechanics.force
        unbalanced -= self.friction @ mechanics.directions
        return mechanics.multipliers(unbalanced[driven], driven), self.friction
