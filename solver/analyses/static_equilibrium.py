"""Static equilibrium: no velocity, no acceleration, all constraints met.

On the null space N of the constraint Jacobian the applied forces vanish, N^T f = 0; the
constraint forces balance the rest. Newton's method uses the stiffness of f + C^T lambda
by central differences; where it is not positive definite, its absolute value, so that
stable equilibria attract and unstable ones do not. With control laws the stiffness is
not symmetric: it is shifted until x' = force decays in its neighbourhood.

Friction of joints is left out. Where there is no equilibrium without it, joints are
held where they start, if friction can.

References
----------
Y. Dauphin et al.: Identifying and attacking the saddle point problem in
high-dimensional non-convex optimization. NIPS 2014.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import (
    Diagnostic,
    WithDiagnostics,
    diagnose,
    without,
)
from sidtool.formats.result import Result
from sidtool.formats.scene.laws import Expression, Pid

from ..diagnostics.body_loads import find_state_failure, find_state_warnings
from ..diagnostics.failure_causes import lost_inertia_cause
from ..diagnostics.implausible_values import implausible_value_warnings
from ..initial_state.assembly import StateVectors, assemble
from ..initial_state.constraint_jacobian import largest_residuals_text
from ..initial_state.displacement_report import position_notes
from ..initial_state.initial_friction import with_prescribed_friction
from ..output.columns import velocity_names
from ..spatial import system_arrays as at
from ..system.characteristic_sizes import coordinate_sizes
from ..system.errors import SimulationError
from ..system.system import System
from ..system.work_arrays import new_work_arrays
from .analysis_results import MotionState, result_of_states, with_failure
from .dense_equations import DenseEquations, null_space, refuse_eliminated_joints
from .frozen_inputs import (
    state_entries,
    with_constant_drives,
    with_constant_inputs,
    with_continuous_laws,
    with_law_states,
)
from .joint_friction import HeldEquations, friction_that_holds

MAX_ITERATIONS = 300
#: Forces that drive the motion vanish when below this part of the single forces, the
#: largest ones met: nothing is left of the sum of forces that balance.
FORCE_TOLERANCE = 1e-10
#: What is left of the forces, or of the accelerations that they cause, is rounding
#: below this part of them.
FORCE_ROUNDING = 1e-12
#: Perturbation of positions, relative to the size of the mechanism.
PERTURBATION = 1e-5
#: Largest rotation [rad], and displacement in sizes of the mechanism, of one step.
LARGEST_STEP = 0.3
#: Joints are closed when they are open by less, relative to their sizes.
RESIDUAL_TOLERANCE = 1e-10
#: Scaled stiffnesses are kept above this part of the largest one and of the forces.
MIN_STIFFNESS = 1e-12
#: Along stiffnesses below this part of the largest one, forces move nothing that are
#: rounding: below this part of the single forces.
SOFT, SUM_ROUNDING = 1e-6, 1e-15
#: An equilibrium is unstable with a negative stiffness above this part of the largest
#: one: differences do not separate less from none.
UNSTABLE_STIFFNESS = 1e-8

#: A value is at a limit within this part of it, which differences do not blur.
LIMIT_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Equilibrium(WithDiagnostics):
    """A state of rest.

    Attributes
    ----------
    z, v : (n positions,)
        (n velocities,); only states of laws have a v.
    multipliers : (rows,)
        Forces of the joints and drives.
    friction : (frictions,)
        Forces of joints that friction holds, else zero.
    residual
        What is left of the forces, relative to them.
    iterations
        Newton steps taken.
    system
        The assembled scene, its drives and forces held at their values.
    diagnostics
        What has to be known of it; `notes` and `warnings` give it as sentences.
    """

    z: Array
    v: Array
    multipliers: Array
    friction: Array
    residual: float
    iterations: int
    system: System
    diagnostics: tuple[Diagnostic, ...] = ()

    def result(self) -> Result:
        """The scene's outputs in equilibrium, as a result of one time."""
        nothing = np.zeros(self.system.n_velocities)
        state = MotionState(self.z, self.v, nothing, self.multipliers, self.friction)
        times = np.array([self.system.scene.time.start])
        kind = "static equilibrium"
        return result_of_states(
            self.system, kind, times, [state], diagnostics=self.diagnostics
        )


def static_equilibrium(system: System) -> Equilibrium:
    """The static equilibrium nearest downhill from the start of a scene.

    Drives and functions of time hold their values at the start: nothing moves, and no
    inertia of their rates is left. So do the states of the laws of drives.

    Raises
    ------
    InputError
        The start position cannot be assembled.
    SimulationError
        There is no equilibrium near, a body may fall freely, joints come apart on the
        way there, or a body deforms by more than its own size; its `result` holds such
        a state.
    """
    refuse_eliminated_joints(system)
    system, law_notes = with_continuous_laws(system)
    system, start = assemble(system)
    least = system.scene.accuracy.rtol
    assembly_notes = tuple(
        position_notes(system, new_work_arrays(system), start, least)
    )
    system, t = with_constant_inputs(system), system.scene.time.start
    at_rest = with_constant_drives(with_law_states(system))
    clock = 0.5 * (t + system.breaks[0])
    state_positions, velocities = state_entries(system)
    start.z[state_positions] = start.v[velocities]
    mechanics = DenseEquations(at_rest, t, clock)
    mechanics.set_scale(start.z)
    try:
        balance = _balance(mechanics, start.z)
    except SimulationError as error:
        balance = _held_by_friction(mechanics, clock, start.z, error)
    z, mechanics, motion = balance.z, balance.mechanics, balance.motion
    found = (
        *find_state_warnings(system, z[None]),
        *_check_equilibrium(mechanics, motion),
        *force_limit_notes(system, mechanics.work),
        *_stability_notes(mechanics, z, motion, balance.multipliers),
        *implausible_value_warnings(system),
        *assembly_notes,
        *law_notes,
        *_friction_notes(system, mechanics),
    )
    diagnostics = without(found, system.scene.diagnostics.ignore)
    v = np.zeros(system.n_velocities)
    v[velocities] = z[state_positions]
    multipliers = balance.multipliers[: system.n_rows]
    equilibrium = Equilibrium(
        z,
        v,
        multipliers,
        balance.friction,
        balance.residual,
        balance.iterations,
        system,
        diagnostics,
    )
    if failure := find_state_failure(system, z[None]):
        meaningless = with_failure(equilibrium.result(), failure)
        raise SimulationError(failure, meaningless)
    return equilibrium


@dataclass(frozen=True, eq=False)
class _Balance:
    """A position in which forces balance.

    Attributes
    ----------
    mechanics
        The equations, evaluated there.
    motion : (n velocities, n free)
        Directions that the constraints leave.
    multipliers : (rows,)
    friction : (frictions,)
        Forces of joints that friction holds.
    """

    z: Array
    mechanics: DenseEquations
    motion: Array
    multipliers: Array
    residual: float
    iterations: int
    friction: Array


def _balance(mechanics: DenseEquations, z: Array) -> _Balance:
    """The position nearest downhill in which forces balance.

    Raises
    ------
    SimulationError
        There is none (N701).
    """
    system = mechanics.system
    z = mechanics.closed(z)
    best, largest, is_refined = np.inf, mechanics.force_size(z), False
    for iteration in range(MAX_ITERATIONS):
        motion, force, multipliers, size = _force_balance(mechanics, z)
        largest = max(largest, size)
        if np.linalg.norm(force) >= FORCE_TOLERANCE * largest:
            largest = max(largest, mechanics.force_size(z))
        residual = float(np.linalg.norm(force) / max(largest, 1e-300))
        may_refine = not is_refined and iteration + 1 < MAX_ITERATIONS
        if FORCE_ROUNDING < residual < FORCE_TOLERANCE and may_refine:
            # one step more, which is quadratic here, as derivatives see what is left
            step = motion @ _newton_step(
                mechanics, z, motion, force, multipliers, largest
            )
            refined = mechanics.closed(mechanics.displaced(z, step))
            remaining = _force_balance(mechanics, refined)[1]
            if np.linalg.norm(remaining) < np.linalg.norm(force):
                z = refined
            is_refined = True
            continue
        if motion.shape[1] == 0 or residual < FORCE_TOLERANCE or size == 0.0:
            no_friction = np.zeros(len(system.friction_joints))
            return _Balance(
                z, mechanics, motion, multipliers, residual, iteration, no_friction
            )
        step = motion @ _newton_step(mechanics, z, motion, force, multipliers, largest)
        z = _line_search(mechanics, z, step, motion @ force)
        best = min(best, residual)
    none = diagnose(
        "N701",
        iterations=MAX_ITERATIONS,
        residual=best,
        body=_most_loaded_body(system, motion @ force),
    )
    limits = force_limit_notes(system, mechanics.work)
    raise SimulationError((none, *limits, *implausible_value_warnings(system)))


def _held_by_friction(
    plain: DenseEquations,
    clock: float,
    start: Array,
    error: SimulationError,
) -> _Balance:
    """The balance of forces with joints that stick where they start.

    Joints that their friction does not hold there are released, without friction.

    Parameters
    ----------
    plain
        The equations without friction.
    error
        Why there is no balance without friction.

    Raises
    ------
    SimulationError
        Friction does not hold the joints that have to stick (`error` with N517), or
        does not matter.
    """
    system, t = plain.system, plain.t
    z = plain.closed(start)
    rest = StateVectors(z, np.zeros(system.n_velocities))
    prescribed = with_prescribed_friction(system, rest).arrays.friction_state
    may_stick = np.flatnonzero(prescribed[:, at.REST_RATE] == 0.0)
    held = may_stick
    while len(held):
        mechanics = HeldEquations(system, t, clock, held, z)
        mechanics.scale = plain.scale
        try:
            balance = _balance(mechanics, z)
        except SimulationError:
            break
        sticks, friction = friction_that_holds(system, t, balance.z)
        if sticks[held].all():
            plain.evaluate(balance.z, rest.v)
            rest_of_force = plain.force + friction @ plain.directions
            multipliers = plain.multipliers(-rest_of_force), friction[held]
            mechanics.evaluate(balance.z, rest.v)
            return replace(
                balance, multipliers=np.concatenate(multipliers), friction=friction
            )
        held = held[sticks[held]]
    slipping = [system.friction_joints[j].joint for j in np.setdiff1d(may_stick, held)]
    if not slipping:
        raise error
    raise SimulationError((*error.diagnostics, diagnose("N517", ", ".join(slipping))))


def _most_loaded_body(system: System, force: Array) -> str:
    """The body that unbalanced forces (n velocities,) push most."""
    work = np.abs(force) * coordinate_sizes(system)
    largest = int(np.argmax(work))
    for row, body in zip(system.arrays.body, system.bodies, strict=True):
        if row[at.VEL] <= largest < row[at.VEL] + row[at.NV]:
            return body.name
    return "no body"


def _check_equilibrium(
    mechanics: DenseEquations, motion: Array
) -> tuple[Diagnostic, ...]:
    """What has to be known of the equilibrium that was evaluated last.

    Parameters
    ----------
    motion : (n velocities, n free)
        The directions that the constraints leave.

    Raises
    ------
    SimulationError
        Joints are open in it.
    """
    if mechanics.scaled_residual > RESIDUAL_TOLERANCE:
        rows = mechanics.residual[: mechanics.system.n_rows]
        where = largest_residuals_text(mechanics.system, rows)
        raise SimulationError(diagnose("N702", gaps=where))
    cause = lost_inertia_cause(mechanics.system, mechanics.work)
    if cause is None or _has_inertia(mechanics, motion):
        return ()
    return (diagnose("N703", reason=replace(cause, code="", remedy="").line),)


def _has_inertia(mechanics: DenseEquations, motion: Array) -> bool:
    """True if the mass matrix is positive definite along the free directions.

    A body whose own mass matrix is not may have a prescribed frame.
    """
    mass = motion.T @ mechanics.mass @ motion
    if not np.isfinite(mass).all():
        return False
    values = np.linalg.eigvalsh(0.5 * (mass + mass.T))
    return bool((values > 0.0).all())


def _friction_notes(system: System, mechanics: DenseEquations) -> Iterator[Diagnostic]:
    """Joints that friction holds (N516), and whose friction is left out (N515)."""
    names = [rub.joint for rub in system.friction_joints]
    held = list[str]()
    if isinstance(mechanics, HeldEquations):
        held = [names[j] for j in mechanics.sticking_joints]
    others = [name for name in names if name not in held]
    for code, joints in (("N516", held), ("N515", others)):
        if joints:
            yield diagnose(code, ", ".join(joints))


def _stability_notes(
    mechanics: DenseEquations, z: Array, motion: Array, multipliers: Array
) -> Iterator[Diagnostic]:
    """An equilibrium from which the least disturbance leads away (N704)."""
    states = len(state_entries(mechanics.system)[0])
    if motion.shape[1] == 0 or states:
        return
    stiffness = tangent_stiffness(mechanics, z, motion, multipliers)
    values, vectors = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
    if values[0] >= -UNSTABLE_STIFFNESS * np.abs(values).max():
        return
    direction = vectors[:, 0]
    if _has_inertia(mechanics, motion):
        # Forces that follow a body give no symmetric stiffness: motions decide
        mass = motion.T @ mechanics.mass @ motion
        squares, shapes = np.linalg.eig(np.linalg.solve(mass, stiffness))
        if squares.real.min() >= 0.0:
            return
        direction = shapes[:, squares.real.argmin()].real
    name = velocity_names(mechanics.system)[int(np.abs(motion @ direction).argmax())]
    yield diagnose("N704", coordinate=name)


def _force_balance(
    mechanics: DenseEquations, z: Array
) -> tuple[Array, Array, Array, float]:
    """Free directions, force along them, multipliers, and the size of all forces."""
    mechanics.evaluate(z, np.zeros(mechanics.system.n_velocities))
    C, f = mechanics.jacobian, mechanics.force
    motion = null_space(C)
    return motion, motion.T @ f, mechanics.multipliers(-f), float(np.linalg.norm(f))


def _newton_step(
    mechanics: DenseEquations,
    z: Array,
    motion: Array,
    force: Array,
    multipliers: Array,
    largest: float,
) -> Array:
    """A step along the free directions.

    Parameters
    ----------
    largest
        Size of the single forces.
    """
    stiffness = tangent_stiffness(mechanics, z, motion, multipliers)
    size = max(np.abs(stiffness).max(), float(np.linalg.norm(force)))
    softest = MIN_STIFFNESS * size
    has_laws = any(element.code for element in mechanics.system.forces)
    symmetric = 0.5 * (stiffness + stiffness.T)
    values, vectors = (
        np.linalg.eig(stiffness) if has_laws else np.linalg.eigh(symmetric)
    )
    is_soft = np.abs(values) <= SOFT * size
    if is_soft.any():
        parts = np.linalg.lstsq(vectors, force, rcond=None)[0]
        parts[is_soft & (np.abs(parts) <= SUM_ROUNDING * largest)] = 0.0
        force = (vectors @ parts).real
    if has_laws:
        least = float(values.real.min())
        shift = max(0.0, softest - 2.0 * least) if least < softest else 0.0
        stiffness = stiffness + shift * np.eye(len(force))
    elif values[0] <= softest:
        return np.asarray(
            vectors @ (vectors.T @ force / np.maximum(np.abs(values), softest))
        )
    return np.asarray(np.linalg.solve(stiffness, force), np.float64)


def tangent_stiffness(
    mechanics: DenseEquations, z: Array, motion: Array, multipliers: Array
) -> Array:
    """-N^T d(f + C^T lambda)/dz N at rest, by central differences.

    Raises
    ------
    SimulationError
        A law or a force gives no finite number near the position.
    """
    system = mechanics.system
    zero = np.zeros(system.n_velocities)
    columns = []
    for direction in motion.T:
        delta = PERTURBATION / max(_largest_extent(mechanics, direction), 1e-300)
        forces = []
        for sign in (1.0, -1.0):
            displaced = mechanics.displaced(z, sign * delta * direction)
            mechanics.evaluate(displaced, zero)
            forces.append(mechanics.force + mechanics.jacobian.T @ multipliers)
        columns.append((forces[1] - forces[0]) / (2.0 * delta))
    derivatives = np.column_stack(columns)
    mechanics.refuse_infinite(derivatives)
    return motion.T @ derivatives


def _largest_extent(mechanics: DenseEquations, x: Array) -> float:
    """Largest share of the size of the mechanism, or of a radian, in a tangent."""
    return float(
        np.max(np.abs(x * mechanics.scale) / coordinate_sizes(mechanics.system))
    )


def _line_search(
    mechanics: DenseEquations, z: Array, step: Array, force: Array
) -> Array:
    """A step that is not too large, and at whose end the force is not reversed."""
    step = step * min(1.0, LARGEST_STEP / max(_largest_extent(mechanics, step), 1e-300))
    work = float(force @ step)
    displaced = z
    for _ in range(12):
        displaced = mechanics.closed(mechanics.displaced(z, step))
        motion, remaining, _, _ = _force_balance(mechanics, displaced)
        if float((motion @ remaining) @ step) > -0.5 * abs(work) or work <= 0.0:
            return displaced
        step, work = 0.5 * step, 0.5 * work
    return displaced


def force_limit_notes(system: System, work: at.WorkArrays) -> Iterator[Diagnostic]:
    """Forces that are at a limit in the state evaluated last (N511)."""
    for k, element in enumerate(system.forces):
        force = system.scene.forces.get(element.name) if element.is_force else None
        law = getattr(force, "function", None)
        limits = law.limits if isinstance(law, Expression | Pid) else None
        if not element.code or limits is None:
            continue
        value = float(work.force_scale[k])
        for limit in limits:
            if abs(value - limit) <= LIMIT_TOLERANCE * abs(limit):
                yield diagnose("N511", element.name, limit=limit)
