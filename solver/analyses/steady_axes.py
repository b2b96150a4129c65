"""Axes in which the equations of small motions are constant.

The motion is followed by a test angle. The equations are constant in axes in which the
modes after it are those before it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, expm
from scipy.spatial.transform import Rotation

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.sid_mass import skew

from ..spatial import system_arrays as at
from ..system.errors import SimulationError
from ..system.rotated_markers import to_3d, to_rotation_matrices
from .dense_equations import DenseEquations
from .multi_blade import BladeGroup, blade_groups, rotated_tangents
from .reference_axes import (
    axis_angular_velocities,
    body_axes,
    frame_rotation_matrix,
    independent_rows,
    shared_axes,
    unpaired_frequency,
)
from .state_matrix import (
    LinearEquations,
    SmallMotions,
    elastic_coordinates,
    small_motions,
    state_matrix,
)

#: The motion is followed by so large an angle [rad] of each body.
TEST_ANGLE = 0.4
#: Bodies that are slower by this part than the fastest one do not turn.
NO_ROTATION = 1e-6
#: Rotations during a run below this angle [rad] are rounding.
ROTATION_ROUNDING = 1e-9
#: Changes of modes by this part, or by rounding of the matrix, are none.
MODE_TOLERANCE, ROUNDING = 1e-3, 1e-8
#: Modes may change above this part of the frequency of a shape without partner.
UNPAIRED_MODE = 0.5


@dataclass(frozen=True, eq=False)
class SteadyAxes:
    """Axes in which the equations of small motions are constant.

    Attributes
    ----------
    omegas : (bodies, 3)
        Spins of the axes in which each body is described; its own if there are none.
    diagnostics
        What is to be known of them.
    changing
        Why the equations change as the bodies turn, if they do.
    highest
        Angular frequency [rad/s] from which on modes change as the bodies turn, inf if
        none does.
    blades
        Groups of bodies that are described in multi-blade coordinates.
    """

    omegas: Array
    diagnostics: tuple[Diagnostic, ...] = ()
    changing: tuple[Diagnostic, ...] = ()
    highest: float = np.inf
    blades: tuple[BladeGroup, ...] = ()


def steady_axes(
    mechanics: DenseEquations, equations: LinearEquations, *, multi_blade: bool = False
) -> SteadyAxes:
    """Return axes in which modes are those of a constant matrix.

    Of a round body whose reduction keeps one of a pair of shape functions only, higher
    modes change, and lower ones do not.

    Parameters
    ----------
    equations
        Linearised equations at the state, in any axes.
    multi_blade
        Whether equal bodies around an axis may have coordinates in common.
    """
    own = body_axes_at(mechanics, equations)
    time = mechanics.system.scene.time
    if np.abs(own).max(initial=0.0) * (time.end - time.start) < ROTATION_ROUNDING:
        return SteadyAxes(np.zeros_like(own))
    # First: only in them a mode of the blades has one frequency in inertial axes.
    if multi_blade:
        for axes in _multi_blade_axes(mechanics, equations, own):
            return axes
    if lowest_changing_mode(mechanics, equations, own) == np.inf:
        return SteadyAxes(own)
    for axes in shared_steady_axes(mechanics, equations, own):
        return axes
    cause, unpaired = "", np.inf
    for omegas, _ in shared_axes(mechanics, own):
        mechanics.evaluate(equations.z, equations.v)
        unpaired = min(unpaired, unpaired_frequency(mechanics, omegas))
    if 0.0 < unpaired < np.inf:
        cause = f" (the shape of {unpaired / (2.0 * np.pi):.4g} Hz has no partner)"
    return SteadyAxes(own, changing=(diagnose("N713", cause=cause),))


def body_axes_at(mechanics: DenseEquations, equations: LinearEquations) -> Array:
    """Angular velocities (bodies, 3) of the axes of each body, see `body_axes`."""
    mechanics.evaluate(equations.z, equations.v)
    slow = equations.v / mechanics.scale
    return body_axes(mechanics, slow, mechanics.accelerations()[0])


def shared_steady_axes(
    mechanics: DenseEquations, equations: LinearEquations, own: Array
) -> Iterator[SteadyAxes]:
    """Axes that bodies share and in which the equations of small motions are constant.

    Parameters
    ----------
    equations
        Linearised equations at the state, in any axes.
    own : (bodies, 3)
        Of the axes of each body, see `body_axes`.
    """
    mechanics.evaluate(equations.z, equations.v)
    unpaired = np.inf
    for omegas, name in list(shared_axes(mechanics, own)):
        lowest = lowest_changing_mode(mechanics, equations, omegas)
        mechanics.evaluate(equations.z, equations.v)
        of_shapes = unpaired_frequency(mechanics, omegas)
        unpaired = min(unpaired, of_shapes)
        is_partly_steady = 0.0 < UNPAIRED_MODE * of_shapes <= lowest
        if lowest < np.inf and not is_partly_steady:
            continue
        axes = "that do not turn" if name == "ground" else f"that turn with {name}"
        alike = not np.ptp(omegas, axis=0).any()
        bodies, rest = (
            ("bodies", "") if alike else ("rigid bodies", ", others in theirs")
        )
        found = [diagnose("N712", bodies=bodies, axes=axes, rest=rest)]
        if lowest < np.inf:
            shape = unpaired / (2.0 * np.pi)
            first = lowest / (2.0 * np.pi)
            found.append(diagnose("N717", first=first, shape=shape))
        yield SteadyAxes(omegas, tuple(found), highest=lowest)


def _multi_blade_axes(
    mechanics: DenseEquations, equations: LinearEquations, own: Array
) -> Iterator[SteadyAxes]:
    """Axes that all bodies share but equal ones around an axis, which have multi-blade
    coordinates, and in which the equations of small motions are constant."""
    mechanics.evaluate(equations.z, equations.v)
    blades = blade_groups(mechanics)
    if not blades:
        return
    members = [k for group in blades for k in group.bodies]
    names = [body.name for body in mechanics.system.bodies]
    listed = ", ".join(names[k] for k in members)
    mechanics.evaluate(equations.z, equations.v)
    for shared, _ in list(shared_axes(mechanics, own)):
        omegas = shared.copy()
        omegas[members] = own[members]
        if lowest_changing_mode(mechanics, equations, omegas, blades) == np.inf:
            found = diagnose("N744", bodies=listed)
            yield SteadyAxes(omegas, (found,), blades=blades)


def turning_times(own: Array, omegas: Array) -> list[float]:
    """Times [s] in which bodies turn by the test angle, those of fast bodies first.

    Parameters
    ----------
    own, omegas : (bodies, 3)
        Angular velocities of the bodies and of the axes in which they are described.
    """
    turning = np.vstack([own, omegas, own - omegas])
    times: list[float] = []
    speeds = np.sort(np.linalg.norm(turning, axis=1))[::-1]
    for speed in speeds[speeds > NO_ROTATION * speeds[0]]:
        if not times or speed * times[-1] < 0.5 * TEST_ANGLE:
            times.append(float(TEST_ANGLE / speed))
    return times


def lowest_changing_mode(
    mechanics: DenseEquations,
    equations: LinearEquations,
    omegas: Array,
    blades: tuple[BladeGroup, ...] = (),
) -> float:
    """Angular frequency of the lowest mode that changes along a motion that is steady
    in these axes, inf if none does."""
    seen = equations.in_axes(mechanics, omegas, blades)
    small = small_motions(mechanics, seen)
    mechanics.evaluate(small.z, small.v)
    times = turning_times(axis_angular_velocities(mechanics), omegas)
    return min(_changing_mode(mechanics, small, dt) for dt in times)


def _changing_mode(mechanics: DenseEquations, small: SmallMotions, dt: float) -> float:
    """The same of a motion of some time [s], as large parts of the frequency or of the
    angular velocity that belongs to this time."""
    matrix, N = small.matrix, small.free_directions
    spin = TEST_ANGLE / dt
    try:
        later_matrix, N_there, rotation = _after_steady_motion(mechanics, small, dt)
    except SimulationError:
        return 0.0
    if later_matrix.shape != matrix.shape:
        return 0.0
    n_positions = len(matrix) - N.shape[1]
    X, misfit = turned_states(mechanics, N, N_there, rotation, n_positions)
    if not len(X) or np.linalg.svd(X, compute_uv=False)[-1] < 0.5:
        return np.inf if not len(X) else 0.0
    change = np.linalg.solve(X, later_matrix @ X) - matrix
    values, vectors = np.linalg.eig(matrix)

    def speeds(positions: np.ndarray, velocities: np.ndarray) -> Array:
        norms = [np.linalg.norm(part, axis=0) for part in (positions, velocities)]
        return np.asarray(spin * norms[0] + norms[1])

    sizes = speeds(vectors[:n_positions], vectors[n_positions:])
    outside = speeds(*np.split(misfit @ vectors, 2))
    noise = ROUNDING * np.linalg.norm(matrix, 2)
    changes = np.linalg.norm(change @ vectors, axis=0) - noise
    changes = (changes / np.maximum(np.abs(values), spin) + outside) / sizes
    changing = np.abs(values)[~(changes < MODE_TOLERANCE)]
    return float(changing.min(initial=np.inf))


def turned_states(
    mechanics: DenseEquations, N: Array, N_there: Array, rotation: Array, n_y: int
) -> tuple[Array, Array]:
    """(y, w) of the free directions after a steady motion by those before it, and what
    of positions and velocities before it no free direction after it has.

    Two bodies that tilt together, such as a wheel and its frame, have no free
    directions in common in axes of which one turns in the other.

    Parameters
    ----------
    N, N_there
        Free directions before and after it, of which n_y are no states of laws.
    rotation : (n, n)
        How scaled tangents turn, see `steady_motion`.
    """
    rows, counts = independent_rows(mechanics), (n_y, N.shape[1])
    before = [(rotation @ N)[rows][:, :count] for count in counts]
    after = [N_there[rows][:, :count] for count in counts]
    parts = [*zip(after, before, strict=True)]
    fits = [np.linalg.lstsq(a, b, rcond=None)[0] for a, b in parts]
    misfits = [b - a @ x for (a, b), x in zip(parts, fits, strict=True)]
    return block_diag(*fits), block_diag(*misfits)


def _after_steady_motion(
    mechanics: DenseEquations, small: SmallMotions, dt: float
) -> tuple[Array, Array, Array]:
    """Matrix and free directions after a steady motion, and how tangents (n,), scaled,
    in the axes turn into those of the bodies there."""
    start, omegas, blades = mechanics.t, small.omegas, small.blades
    mechanics.evaluate(small.z, small.v)
    later_z, later_v, rotation = steady_motion(mechanics, small.z, small.v, omegas, dt)
    rotation = rotated_tangents(mechanics, blades, dt, rotation)
    try:
        mechanics.t = start + dt
        small = state_matrix(mechanics, later_z, later_v, omegas, blades)
    finally:
        mechanics.t = start
    scale = mechanics.scale
    return small.matrix, small.free_directions, rotation * scale / scale[:, None]


def steady_motion(
    mechanics: DenseEquations, z: Array, v: Array, omegas: Array, dt: float
) -> tuple[Array, Array, Array]:
    """The state after a motion that is steady in axes, and how tangents (n,) in the
    axes turn into those of the bodies there.

    The state is the one evaluated last.
    """
    step, after, rotation_ = np.zeros(len(v)), v.copy(), np.eye(len(v))
    scale = mechanics.scale
    rates = frame_rotation_matrix(mechanics, omegas) * scale[:, None] / scale
    for positions, elastic in elastic_coordinates(mechanics.system):
        turned = expm(dt * rates[elastic, elastic])
        step[elastic] = turned @ z[positions] - z[positions]
        after[elastic], rotation_[elastic, elastic] = turned @ v[elastic], turned
    for row, motion in _steady_motions(mechanics, omegas, dt):
        u, rd, size = int(row[at.VEL]), int(row[at.RD]), len(motion[0])
        displacement, rotation, velocity, rate, block = motion
        step[u : u + size], after[u : u + size] = displacement, velocity
        rotation_[u : u + size, u : u + size] = block[:size, :size]
        if rd == 6:
            rotation_[u + 3 : u + 6, u + 3 : u + 6] = block
        rest = slice(u + size, u + rd)
        step[rest], after[rest] = rotation[3 - rd + size :], rate[3 - rd + size :]
    return mechanics.displaced(z, step / scale), after, rotation_


def _steady_motions(
    mechanics: DenseEquations, omegas: Array, dt: float
) -> Iterator[tuple[Array, tuple[Array, ...]]]:
    """Row of each body that moves, and in its axes the way of its frame and its
    rotation vector; velocity and angular velocity after it, in the axes there; what
    turns from the axes of the given spin into these."""
    system = mechanics.system
    size = 2 if system.planar else 3
    frames, own = (
        system.frames(mechanics.work.frame),
        axis_angular_velocities(mechanics),
    )
    rotations, velocities = to_rotation_matrices(frames["R"]), to_3d(frames["v"])
    leads = independent_rows(mechanics)
    for k, row in enumerate(system.arrays.body):
        if row[at.RD] == 0:
            continue
        axes = omegas[k] if leads[row[at.VEL]] else own[k]
        R = np.eye(3) if row[at.RD] == size else rotations[k]
        velocity_matrix = np.zeros((4, 4))
        velocity_matrix[:3, :3], velocity_matrix[:3, 3] = skew(axes), R @ velocities[k]
        pose = expm(dt * velocity_matrix)
        relative_rotation = expm(dt * skew(own[k] - axes))
        A = pose[:3, :3]
        Q = np.eye(3) if row[at.RD] == size else A @ relative_rotation @ R
        displacement = R.T @ pose[:3, 3]
        rotation = Rotation.from_matrix(R.T @ Q).as_rotvec()
        velocity, rate = Q.T @ A @ velocity_matrix[:3, 3], Q.T @ A @ own[k]
        block = R.T @ relative_rotation.T @ R
        yield row, (displacement[:size], rotation, velocity[:size], rate, block)
