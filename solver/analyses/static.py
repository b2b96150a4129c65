"""Static equilibrium: no velocity, no acceleration, all joints closed.

On the null space N of the constraint Jacobian the applied forces vanish, N^T f = 0,
and the constraint forces balance the rest. Newton's method with the exact stiffness of
f + C^T lambda by central differences; where that stiffness is not positive, its
absolute value (Y. Dauphin et al., NIPS 2014: saddle-free Newton), so that stable
equilibria attract and unstable ones do not. With laws, such as those of controllers, it
is not symmetric: it is shifted until x' = force decays in its neighbourhood.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.result import Result
from sidtool.formats.scene.laws import Expression, Pid
from sidtool.formats.sid import Array

from ..advice.asked.questions import questions
from ..advice.body_measures import find_state_failure, find_state_warnings
from ..advice.stopping import lost_inertia
from ..errors import SimulationError
from ..recording.outputs import velocity_names
from ..space import layout as at
from ..start.assembly import assemble
from ..start.consistent import widest_open
from ..start.displacements import position_notes
from ..system.scene import System
from ..system.sizes import coordinate_sizes
from ..system.storage import new_work
from .held import held, places_for_states, state_entries, unsampled, with_held_drives
from .mechanics import Mechanics, null_space, refuse_prescribed
from .recorded import Found, recorded

ITERATIONS = 300
#: Forces that drive the motion vanish when below this part of the single forces, the
#: largest ones met: nothing is left of the sum of forces that balance.
BALANCED = 1e-10
#: Perturbation of positions, relative to the size of the mechanism.
PERTURBATION = 1e-5
#: Largest rotation [rad], and displacement in sizes of the mechanism, of one step.
LARGEST_STEP = 0.3
#: Joints are closed when they are open by less, relative to their sizes.
CLOSED = 1e-10
#: Scaled stiffnesses are kept above this part of the largest one and of the forces.
SOFTEST = 1e-12
#: An equilibrium is unstable with a negative stiffness above this part of the largest
#: one: differences do not tell less from none.
UNSTABLE = 1e-8


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A state of rest.

    z, v : (n positions,), (n velocities,); only states of laws have a v
    multipliers : (rows,) forces of the joints and drives
    residual : what is left of the forces, relative to them
    iterations : Newton steps taken
    system : the assembled scene, its drives and forces held at their values
    notes : what has to be known of it
    warnings : those of the notes that say that numbers may be wrong
    """

    z: Array
    v: Array
    multipliers: Array
    residual: float
    iterations: int
    system: System
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def result(self) -> Result:
        """The scene's outputs in equilibrium, as a result of one time."""
        nothing = np.zeros(self.system.n_velocities)
        unrubbed = np.zeros(len(self.system.rubbing))
        rest = Found(self.z, self.v, nothing, self.multipliers, unrubbed)
        times = np.array([self.system.scene.time.start])
        kind = "static equilibrium"
        return recorded(self.system, kind, times, [rest], notes=self.notes)


def static_equilibrium(system: System) -> Equilibrium:
    """The static equilibrium nearest downhill from the start of a scene.

    Drives and functions of time hold their values at the start: nothing moves, and no
    inertia of their rates is left. So do the states of the laws of drives.

    Raises
    ------
    InputError : the start position cannot be assembled.
    SimulationError : there is no equilibrium near, a body may fall freely, joints come
        apart on the way there, or a body deforms by more than its own size; its
        `result` holds such a state.
    """
    refuse_prescribed(system)
    system, told = unsampled(system)
    system, start = assemble(system)
    least = system.scene.accuracy.rtol
    moved = tuple(position_notes(system, new_work(system), start, least))
    system, t = held(system), system.scene.time.start
    at_rest = with_held_drives(places_for_states(system))
    mechanics = Mechanics(at_rest, t, 0.5 * (t + system.breaks[0]))
    mechanics.set_scale(start.z)
    places, velocities = state_entries(system)
    start.z[places] = start.v[velocities]
    z = mechanics.closed(start.z)
    best, largest = np.inf, mechanics.force_size(z)
    for iteration in range(ITERATIONS):
        motion, force, left, size = _balance(mechanics, z)
        largest = max(largest, size)
        if np.linalg.norm(force) >= BALANCED * largest:
            largest = max(largest, mechanics.force_size(z))
        residual = float(np.linalg.norm(force) / max(largest, 1e-300))
        if motion.shape[1] == 0 or residual < BALANCED or size == 0.0:
            warnings = find_state_warnings(system, z[None])
            notes = (
                *warnings,
                *_checked(mechanics, motion),
                *at_limits(system, mechanics.work),
            )
            notes += _unstable(mechanics, z, motion, left)
            notes += (*questions(system), *moved, *told)
            notes += _without_friction(system)
            v = np.zeros(system.n_velocities)
            v[velocities] = z[places]
            found = Equilibrium(
                z, v, left, residual, iteration, system, notes, warnings
            )
            if failure := find_state_failure(system, z[None]):
                useless = replace(found.result(), completed=False, message=failure)
                raise SimulationError(failure, useless)
            return found
        step = motion @ _newton_step(mechanics, z, motion, force, left)
        z = _line_search(mechanics, z, step, motion @ force)
        best = min(best, residual)
    cause = "; ".join(at_limits(system, mechanics.work)) or (
        "a body may be free to fall or to fly away"
    )
    raise SimulationError(
        f"no static equilibrium found in {ITERATIONS} steps: the unbalanced part of "
        f"the forces is {best:.1e}, largest at {_pushed(system, motion @ force)}; "
        f"{cause}" + "".join(f"; {text}" for text in questions(system))
    )


def _pushed(system: System, force: Array) -> str:
    """The body that unbalanced forces (n velocities,) push most."""
    work = np.abs(force) * coordinate_sizes(system)
    largest = int(np.argmax(work))
    for row, body in zip(system.arrays.body, system.bodies, strict=True):
        if row[at.VEL] <= largest < row[at.VEL] + row[at.NV]:
            return body.name
    return "no body"


def _checked(mechanics: Mechanics, motion: Array) -> tuple[str, ...]:
    """What has to be known of the equilibrium that was evaluated last.

    motion : (n velocities, n free) the directions that the constraints leave

    Raises
    ------
    SimulationError : joints are open in it.
    """
    if mechanics.opening > CLOSED:
        where = widest_open(mechanics.system, mechanics.residual)
        raise SimulationError(f"no static equilibrium keeps the joints closed: {where}")
    cause = lost_inertia(mechanics.system, mechanics.work)
    if not cause or _has_inertia(mechanics, motion):
        return ()
    return (f"simulate cannot start in this equilibrium: {cause.removeprefix('; ')}",)


def _has_inertia(mechanics: Mechanics, motion: Array) -> bool:
    """Whether the mass matrix is positive definite along the free directions.

    A body whose own mass matrix is not may have a prescribed frame.
    """
    mass = motion.T @ mechanics.mass @ motion
    if not np.isfinite(mass).all():
        return False
    values = np.linalg.eigvalsh(0.5 * (mass + mass.T))
    return bool((values > 0.0).all())


def _without_friction(system: System) -> tuple[str, ...]:
    """What joints with friction leave open."""
    names = ", ".join(rub.joint for rub in system.rubbing)
    if not names:
        return ()
    return (
        f"the equilibrium is that without friction; with the friction of {names} the "
        "scene rests in states around it, too",
    )


def _unstable(
    mechanics: Mechanics, z: Array, motion: Array, multipliers: Array
) -> tuple[str, ...]:
    """Whether the least disturbance leads away, and what moves most then."""
    states = len(state_entries(mechanics.system)[0])
    if motion.shape[1] == 0 or states:
        return ()
    stiffness = tangent_stiffness(mechanics, z, motion, multipliers)
    values, vectors = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
    if values[0] >= -UNSTABLE * np.abs(values).max():
        return ()
    way = np.abs(motion @ vectors[:, 0])
    name = velocity_names(mechanics.system)[int(way.argmax())]
    return (f"the equilibrium is unstable: the least disturbance moves {name} away",)


def _balance(mechanics: Mechanics, z: Array) -> tuple[Array, Array, Array, float]:
    """Free directions, force along them, multipliers, and the size of all forces."""
    mechanics.evaluate(z, np.zeros(mechanics.system.n_velocities))
    C, f = mechanics.jacobian, mechanics.force
    motion = null_space(C)
    return motion, motion.T @ f, mechanics.multipliers(-f), float(np.linalg.norm(f))


def _newton_step(
    mechanics: Mechanics, z: Array, motion: Array, force: Array, multipliers: Array
) -> Array:
    stiffness = tangent_stiffness(mechanics, z, motion, multipliers)
    softest = SOFTEST * max(np.abs(stiffness).max(), float(np.linalg.norm(force)))
    if any(element.code for element in mechanics.system.forces):
        least = float(np.linalg.eigvals(stiffness).real.min())
        shift = max(0.0, softest - 2.0 * least) if least < softest else 0.0
        shifted = stiffness + shift * np.eye(len(force))
        return np.asarray(np.linalg.solve(shifted, force), np.float64)
    values, vectors = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
    if values[0] > softest:
        return np.asarray(np.linalg.solve(stiffness, force), np.float64)
    positive = np.maximum(np.abs(values), softest)
    return vectors @ ((vectors.T @ force) / positive)


def tangent_stiffness(
    mechanics: Mechanics, z: Array, motion: Array, multipliers: Array
) -> Array:
    """-N^T d(f + C^T lambda)/dz N at rest, by central differences."""
    system = mechanics.system
    rest = np.zeros(system.n_velocities)
    columns = []
    for direction in motion.T:
        delta = PERTURBATION / max(_extent(mechanics, direction), 1e-300)
        forces = []
        for sign in (1.0, -1.0):
            moved = mechanics.moved(z, sign * delta * direction)
            mechanics.evaluate(moved, rest)
            forces.append(mechanics.force + mechanics.jacobian.T @ multipliers)
        columns.append((forces[1] - forces[0]) / (2.0 * delta))
    return motion.T @ np.column_stack(columns)


def _extent(mechanics: Mechanics, x: Array) -> float:
    """Largest share of the size of the mechanism, or of a radian, in a tangent."""
    return float(
        np.max(np.abs(x * mechanics.scale) / coordinate_sizes(mechanics.system))
    )


def _line_search(mechanics: Mechanics, z: Array, step: Array, force: Array) -> Array:
    """A step that is not too large, and at whose end the force is not reversed."""
    step = step * min(1.0, LARGEST_STEP / max(_extent(mechanics, step), 1e-300))
    work = float(force @ step)
    moved = z
    for _ in range(12):
        moved = mechanics.closed(mechanics.moved(z, step))
        motion, left, _, _ = _balance(mechanics, moved)
        if float((motion @ left) @ step) > -0.5 * abs(work) or work <= 0.0:
            return moved
        step, work = 0.5 * step, 0.5 * work
    return moved


#: A value is at a limit within this part of it, which differences do not blur.
NEAR = 1e-9


def at_limits(system: System, work: at.Work) -> Iterator[str]:
    """What is said of forces that are at a limit in the state evaluated last."""
    for k, element in enumerate(system.forces):
        force = system.scene.forces.get(element.name) if element.acts else None
        law = getattr(force, "function", None)
        limits = law.limits if isinstance(law, Expression | Pid) else None
        if not element.code or limits is None:
            continue
        value = float(work.factor[k])
        for limit in limits:
            if abs(value - limit) <= NEAR * abs(limit):
                yield f"{element.name} is at its limit of {limit:g}"
