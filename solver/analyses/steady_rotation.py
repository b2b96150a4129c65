"""Starts in steady rotation of bodies that springs and bushings support.

In a steady rotation (relative equilibrium) every body rotates about an axis fixed in
space at a constant rate, or rests, and its deformation is constant. In body axes the
accelerations are zero: along the free directions of the constraints the applied forces
balance the inertia loads,

    P (M a - f) = 0,    C v + C_t = 0,    c = 0,

with the projector P onto the null space of C. The unknowns are the positions, the axes,
and the angular acceleration of bodies whose rate no drive prescribes. At one instant
many states satisfy the equations; in a steady rotation they also hold after any
rotation of the bodies. Therefore they are solved at all `ANGLES` at once by the
Gauss-Newton method. The remaining residual shows whether there is a steady rotation:
bearings with two stiffnesses allow none, nor does a flexible shaft that sags.

References
----------
J. Nocedal, S. J. Wright: Numerical Optimization, section 10.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_mass import cross

from ..initial_state.assembly import StateVectors, assemble
from ..spatial import system_arrays as at
from ..system.characteristic_sizes import coordinate_sizes
from ..system.errors import SimulationError
from ..system.sid_packing import symmetrise
from ..system.system import System
from .dense_equations import DenseEquations, least_squares, null_space
from .frozen_inputs import with_integrated_drives
from .initial_equilibrium import assembly_notes, scene_at, with_bodies
from .inverse_dynamics import refuse_law_states
from .linearisation import growing, modes_at
from .rotating_groups import (
    EQUAL_RATE,
    RotatingGroup,
    candidate_groups,
    connected_components,
    frame_positions,
)

#: Angles [rad] by which a group has turned where the equations are solved.
TEST_ANGLES = (0.0, 2.1, -2.1)
#: Perturbation of coordinates for differences, in sizes of the mechanism and radians.
PERTURBATION = 1e-5
#: Columns and singular values of the scaled Jacobian below this part of the largest are
#: errors of differences, no stiffness.
MIN_STIFFNESS = 1e-8
MAX_ITERATIONS = 25
#: Unknowns change by less, in sizes of the mechanism and radians, when they are found.
#: Frames turn by less in every step, and in all of them when the start is near enough
#: [rad].
CONVERGED, MAX_ROTATION_STEP, MAX_ROTATION = 1e-11, 0.25, 1.5
#: The rotation is steady if less than this part of the loads is left, or of the forces.
STEADY_RESIDUAL, ROUNDING = 1e-6, 1e-9
#: The speed of a group may change by this part within a turn.
SPEED_RIPPLE = 1e-3
#: Joints and drives allow no rotation if more than this part of the rates is left.
RATE_RESIDUAL = 1e-3
#: Velocity coordinates up to which a steady rotation is sought.
MAX_COORDINATES = 400
#: Steps of the descent, which ends when they are smaller, in sizes of the mechanism and
#: radians.
MAX_DESCENT_STEPS, DESCENT_CONVERGED = 25, 1e-4
#: Why there is none if frames turn by more than `MAX_ROTATION`.
TOO_SOFT = "what carries them is too soft"
#: Names that are listed of many.
LISTED = 4

#: Positions and groups in a steady rotation.
_Found = tuple[Array, tuple[RotatingGroup, ...]]


def steady_rotation(
    system: System,
) -> tuple[SceneFile | None, tuple[Diagnostic, ...]]:
    """The scene of a system that starts in steady rotation, and why there is none, or
    what the assembly moved.

    The scene is None where nothing rotates, where joints and drives leave bodies no
    motion besides the rotation, or where there is no steady rotation; the last of these
    is reported.

    Parameters
    ----------
    system
        With all of its joints.
    """
    try:
        assembled, start = assemble(with_integrated_drives(system))
    except InputError:
        return None, ()
    if system.n_velocities > MAX_COORDINATES:
        return None, _not_sought(assembled, start)
    t = system.scene.time.start
    mechanics = DenseEquations(assembled, t, float(assembled.clocks(np.array([t]))[0]))
    notes: tuple[Diagnostic, ...] = ()
    try:
        candidates = tuple(candidate_groups(mechanics, start))
    except SimulationError:  # named by the search for an equilibrium
        return None, ()
    for groups in candidates:
        search = _SteadyRotationSearch(mechanics, start.z, groups)
        if not search.has_elastic_support():
            continue
        if assembled.friction_joints:
            names = ", ".join(rub.joint for rub in assembled.friction_joints)
            return None, (_failure_note(search, f"the friction of {names} is in it"),)
        found, reason = search.solve(search.start)
        rate = search.growth_rate(*found) if found else 0.0
        if rate > 0.0 or reason == TOO_SOFT:
            downhill, _ = search.solve(search.downhill())
            if downhill and search.growth_rate(*downhill) == 0.0:
                found, rate = downhill, 0.0
        if found:
            scene = with_bodies(system, search.scene(*found))
            notes = assembly_notes(assembled, start)
            if rate > 0.0:
                notes += (diagnose("N225", ", ".join(search.names), rate=rate),)
            return scene, notes
        notes = notes or ((_failure_note(search, reason),) if reason else ())
    return None, notes


def _not_sought(system: System, start: StateVectors) -> tuple[Diagnostic, ...]:
    """A diagnostic of bodies of a large scene that rotate at its start."""
    axes = 2 if system.planar else 3
    names = [
        data.name
        for row, data in zip(system.arrays.body, system.bodies, strict=True)
        if data.is_scene_body
        and start.v[row[at.VEL] + axes : row[at.VEL] + row[at.RD]].any()
    ]
    if not names:
        return ()
    listed = ", ".join(names[:LISTED])
    listed += f" and {len(names) - LISTED} others" if len(names) > LISTED else ""
    reason = f"more than {MAX_COORDINATES} velocity coordinates"
    return (diagnose("N224", listed, reason=reason),)


def _failure_note(search: _SteadyRotationSearch, reason: str) -> Diagnostic:
    return diagnose("N224", ", ".join(search.names), reason=reason)


def _project_forces(C: Array, forces: Array) -> Array:
    """Scaled forces (..., n) without those that constraints bear."""
    if not len(C):
        return forces
    rows = C.T / np.maximum(np.linalg.norm(C, axis=1), 1e-300)
    return np.asarray(forces - (rows @ least_squares(rows, forces.T)).T)


def _rotated(matrices: Array, vectors: Array) -> Array:
    """Matrices (bodies, 3, 3) times vectors (bodies, 3)."""
    return np.asarray(np.einsum("bij,bj->bi", matrices, vectors))


@dataclass(frozen=True, eq=False)
class _Residual:
    """What is left of the equations.

    Attributes
    ----------
    closure, rates
        Of the constraints, in their sizes.
    forces
        Across the rotation of each group.
    torques : (groups,)
        Mean forces along it.
    ripple : (angles, groups)
        How these differ from their mean.
    """

    closure: Array
    rates: Array
    forces: Array
    torques: Array
    ripple: Array


class _SteadyRotationSearch:
    """A steady rotation near a position.

    Attributes
    ----------
    groups
        Bodies that rotate, all others rest.
    times
        At which the equations are solved: each group has turned by the test angles
        [s].
    """

    def __init__(
        self, mechanics: DenseEquations, z: Array, groups: tuple[RotatingGroup, ...]
    ) -> None:
        self.mechanics, self.system = mechanics, mechanics.system
        self.start, self.groups = z, groups
        self.n = self.system.n_velocities
        self.axes = 2 if self.system.planar else 3
        self.fastest = max(group.leading_axis.speed for group in groups)
        speeds = [group.leading_axis.speed for group in groups]
        self.times = sorted({a / s for a in TEST_ANGLES for s in speeds}, key=abs)
        self.sizes = coordinate_sizes(self.system)
        self._set_scale()

    @property
    def names(self) -> list[str]:
        """The bodies that rotate."""
        return [self.system.bodies[b].name for g in self.groups for b in g.axes]

    def _set_scale(self) -> None:
        """Units of equal inertia and elastic forces."""
        system, mechanics = self.system, self.mechanics
        mechanics.scale = np.ones(self.n)
        mechanics.evaluate(self.start, np.zeros(self.n))
        diagonal = self.fastest**2 * np.abs(mechanics.mass.diagonal())
        for row, data in zip(system.arrays.body, system.bodies, strict=True):
            elastic = slice(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
            diagonal[elastic] += np.abs(symmetrise(data.sid.Ke.m0).diagonal())
        mechanics.scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))

    def has_elastic_support(self) -> bool:
        """True if bodies can move in other ways than to rotate so and to deform."""
        mechanics = self.mechanics
        rotation_velocities = self._rotation_velocities(self.start, self.groups).T
        mechanics.evaluate(self.start, np.zeros(self.n))
        turning = {b for group in self.groups for b in group.axes}
        rigid = np.zeros(self.n, bool)
        for part, _ in connected_components(self.system):
            for row in self.system.arrays.body[part] if turning & set(part) else ():
                rigid[row[at.VEL] : row[at.VEL] + row[at.RD]] = True
        N = null_space(mechanics.jacobian[:, rigid])
        spins = rotation_velocities[rigid] / np.linalg.norm(
            rotation_velocities[rigid], axis=0
        )
        singular_values = np.linalg.svd(N.T @ spins, compute_uv=False)
        return bool(N.shape[1] > np.sum(singular_values > EQUAL_RATE))

    def solve(self, z: Array) -> tuple[_Found | None, str]:
        """The steady rotation next to a position, or None and why there is none; no
        reason where joints and drives allow no such rotation at all."""
        try:
            refuse_law_states(self.system)
            return self._solve(z)
        except (InputError, SimulationError, np.linalg.LinAlgError) as error:
            return None, str(error)

    def growth_rate(self, z: Array, groups: tuple[RotatingGroup, ...]) -> float:
        """The largest rate [1/s] at which small motions about it grow, 0.0 where none
        does or where their equations are not constant."""
        v = self._state(z, groups, 0.0, self._frames(z))[1]
        try:
            modes, causes = modes_at(self.system, self.system.scene.time.start, z, v)
        except (InputError, SimulationError, np.linalg.LinAlgError):
            return 0.0
        rates = modes.eigenvalues.real[growing(modes)]
        return 0.0 if causes else float(rates.max(initial=0.0))

    def downhill(self) -> Array:
        """The position with the least potential of forces and centrifugal forces that
        is reached from the start, as of a static equilibrium in axes that rotate."""
        z, groups = self.start, self.groups
        forces = self._residual(z, groups, (0.0,)).forces
        for _ in range(MAX_DESCENT_STEPS):
            spins = self._rotation_velocities(z, groups)
            self.mechanics.evaluate(z, np.zeros(self.n))
            C = self.mechanics.jacobian
            N = null_space(np.vstack([C, spins]))
            stiffness = N.T @ self._force_changes(z, N)
            values, vectors = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
            sizes = np.maximum(np.abs(values), MIN_STIFFNESS * np.abs(values).max())
            step = -N @ (vectors @ ((vectors.T @ (N.T @ forces)) / sizes))
            extent = self._extent(step)
            step *= min(1.0, MAX_ROTATION_STEP / max(extent, 1e-300))
            z = self.mechanics.closed(self.mechanics.displaced(z, step))
            forces = self._residual(z, groups, (0.0,)).forces
            if extent < DESCENT_CONVERGED:
                break
        return z

    def _force_changes(self, z: Array, directions: Array) -> Array:
        """Derivatives (n, m) of the unbalanced forces by central differences along
        scaled directions (n, m)."""
        changes = []
        for direction in directions.T:
            x = PERTURBATION / self._extent(direction) * direction
            ends = [
                self._residual(
                    self.mechanics.displaced(z, sign * x), self.groups, (0.0,)
                ).forces
                for sign in (0.5, -0.5)
            ]
            changes.append((ends[0] - ends[1]) / np.linalg.norm(x))
        return np.column_stack(changes)

    def _solve(self, z: Array) -> tuple[_Found | None, str]:
        groups = self.groups
        residual = self._residual(z, groups)
        loads = float(np.linalg.norm(residual.forces))
        matrix, change, previous_change = np.zeros((0, 0)), np.inf, np.inf
        turned = 0.0
        for _ in range(MAX_ITERATIONS):
            if not len(matrix) or change > 0.1 * previous_change:
                matrix = self._jacobian(z, groups)
            x = self._step(matrix, residual, z, groups)
            angle = self._angle(x)
            turned += min(angle, MAX_ROTATION_STEP)
            if not turned < MAX_ROTATION:
                return None, TOO_SOFT
            x *= min(1.0, MAX_ROTATION_STEP / max(angle, 1e-300))
            previous_change, change = change, self._extent(x)
            z, groups = self._displaced(z, groups, x)
            residual = self._residual(z, groups)
            if change < CONVERGED:
                break
        if np.max(np.abs(residual.rates), initial=0.0) > RATE_RESIDUAL * self.fastest:
            return None, ""
        size = self.mechanics.force_size(z)
        remaining = float(np.linalg.norm(np.append(residual.forces, residual.torques)))
        if remaining > STEADY_RESIDUAL * loads and remaining > ROUNDING * size:
            return None, self._reason(residual.forces, remaining / loads)
        if np.max(np.abs(residual.rates), initial=0.0) > STEADY_RESIDUAL * self.fastest:
            return None, ""
        for group, ripple in zip(groups, residual.ripple.T, strict=True):
            if np.max(np.abs(ripple)) > SPEED_RIPPLE * self._inertia_force(z, group):
                names = ", ".join(self.system.bodies[b].name for b in group.axes)
                return None, f"forces change the speed of {names} in each turn"
        return (z, groups), ""

    def _inertia_force(self, z: Array, group: RotatingGroup) -> float:
        """What changes the speed of a group within an angle of one radian, scaled."""
        (spin,) = self._rotation_velocities(z, (group,))
        M = self.mechanics.mass
        return float(spin @ M @ spin / np.linalg.norm(spin) * group.leading_axis.speed)

    def _reason(self, forces: Array, part: float) -> str:
        """Which body is out of balance as all turn."""
        rows = np.abs(forces.reshape(len(self.times), self.n)).max(axis=0)
        worst = int(rows.argmax())
        names = [
            data.name
            for row, data in zip(
                self.system.arrays.body, self.system.bodies, strict=True
            )
            if row[at.VEL] <= worst < row[at.VEL] + row[at.NV]
        ]
        return (
            f"as they turn, forces on {', '.join(names)} change by {part:.1g} of the "
            "loads: bearings of two stiffnesses, gravity across the axis, parts around "
            "them without symmetry, or that whirl and do not turn, as housings do"
        )

    @np.errstate(over="ignore", invalid="ignore")  # callers judge what it becomes
    def _residual(
        self,
        z: Array,
        groups: tuple[RotatingGroup, ...],
        times: Sequence[float] | None = None,
    ) -> _Residual:
        """At some times [s], default all."""
        mechanics = self.mechanics
        closure, rates, forces, torques = np.zeros(0), [], [], []
        frames, sizes = self._frames(z), mechanics.constraint_sizes
        for time in self.times if times is None else times:
            z_there, v, a, spins = self._state(z, groups, time, frames)
            mechanics.evaluate(z_there, v)
            C = mechanics.jacobian
            if time == 0.0:
                acceleration_residual = (C @ a - mechanics.gamma) / (
                    self.fastest**2 * sizes
                )
                closure = np.concatenate(
                    [mechanics.residual / sizes, acceleration_residual]
                )
            rates.append(mechanics.constraint_rates / sizes)
            loads = mechanics.mass @ a - mechanics.force
            unbalanced, *free = _project_forces(C, np.vstack([loads, spins]))
            along = np.zeros(len(groups))
            for k, (spin, part) in enumerate(zip(spins, free, strict=True)):
                size = np.linalg.norm(part)
                if size > EQUAL_RATE * np.linalg.norm(spin):
                    along[k] = part @ unbalanced / size
                    unbalanced = unbalanced - along[k] * part / size
            forces.append(unbalanced)
            torques.append(along)
        mean = np.mean(torques, axis=0)
        ripple = np.array(torques) - mean
        return _Residual(
            closure, np.concatenate(rates), np.concatenate(forces), mean, ripple
        )

    def _rotation_velocities(
        self, z: Array, groups: tuple[RotatingGroup, ...]
    ) -> Array:
        """Scaled velocities (groups, n), each of one group that rotates alone and does
        not drift."""
        return self._state(z, groups, 0.0, self._frames(z))[3]

    def _rows(self, left: _Residual) -> Array:
        """All equations in one vector: forces per unit of the scale, the others per
        size of the mechanism."""
        unit = float(np.median(self.sizes / self.mechanics.scale))
        rates = unit / self.fastest * left.rates
        return np.concatenate([unit * left.closure, rates, left.forces, left.torques])

    def _jacobian(self, z: Array, groups: tuple[RotatingGroup, ...]) -> Array:
        """By central differences, (rows, n + unknowns of groups)."""
        units = self._units(groups)
        count = len(units)
        columns = []
        for k in range(count):
            x = np.zeros(count)
            x[k] = PERTURBATION * units[k]
            ends = [
                self._rows(self._residual(*self._displaced(z, groups, sign * x)))
                for sign in (1.0, -1.0)
            ]
            columns.append((ends[0] - ends[1]) / (2.0 * x[k]))
        return np.column_stack(columns)

    def _units(self, groups: tuple[RotatingGroup, ...]) -> Array:
        """Sizes of all unknowns: of the mechanism, a radian, the square of the rate."""
        units = [self.sizes / self.mechanics.scale]
        for group in groups:
            units += [np.array([self.system.length] * 2 + [1.0] * 2)] * len(group.axes)
            units.append(np.array([group.leading_axis.speed**2]))
        return np.concatenate(units)

    def _extent(self, x: Array) -> float:
        """The largest change of a coordinate, in sizes of the mechanism and radians."""
        return float(np.max(np.abs(x[: self.n] * self.mechanics.scale) / self.sizes))

    def _angle(self, x: Array) -> float:
        """The largest rotation of a frame [rad]."""
        largest = 0.0
        for row in self.system.arrays.body:
            rotation = slice(row[at.VEL] + self.axes, row[at.VEL] + row[at.RD])
            angles = x[: self.n][rotation] * self.mechanics.scale[rotation]
            largest = max(largest, float(np.max(np.abs(angles), initial=0.0)))
        return largest

    def _step(
        self,
        matrix: Array,
        left: _Residual,
        z: Array,
        groups: tuple[RotatingGroup, ...],
    ) -> Array:
        """The smallest change that solves the equations best, turning no free group."""
        count = matrix.shape[1]
        keep = np.eye(count)
        tangents = self._rotation_velocities(z, groups)
        self.mechanics.evaluate(z, np.zeros(self.n))
        C = self.mechanics.jacobian
        for tangent in tangents:
            constraint_part = np.linalg.norm(tangent - _project_forces(C, tangent))
            if constraint_part > EQUAL_RATE * np.linalg.norm(tangent):
                continue  # a drive or a joint determines how far it has turned
            spin = np.append(tangent, np.zeros(count - self.n))
            spin /= np.linalg.norm(spin)
            keep -= np.outer(spin, spin)
        matrix = matrix @ keep
        sizes = np.linalg.norm(matrix, axis=0)
        stiff = sizes > MIN_STIFFNESS * sizes[: self.n].max()
        columns = matrix[:, stiff] / sizes[stiff]
        x = np.zeros(count)
        x[stiff] = np.linalg.lstsq(columns, -self._rows(left), rcond=MIN_STIFFNESS)[0]
        x[stiff] /= sizes[stiff]
        return np.asarray(keep @ x)

    def _displaced(
        self, z: Array, groups: tuple[RotatingGroup, ...], x: Array
    ) -> tuple[Array, tuple[RotatingGroup, ...]]:
        displaced = self.mechanics.displaced(z, x[: self.n])
        ends = self.n + np.cumsum([group.unknowns for group in groups])
        own = np.split(x, [self.n, *ends])[1:-1]
        if self.system.planar:
            for y in own:
                y[:-1].reshape(-1, 4)[:, 2:] = 0.0  # axes stay perpendicular
        return displaced, tuple(
            g.displaced(y) for g, y in zip(groups, own, strict=True)
        )

    def _set_frame_motions(
        self, x: Array, bodies: list[int], translations: Array, rotations: Array
    ) -> None:
        """Writes motions (bodies, 3) of frames, in their axes, into velocity
        coordinates (n,)."""
        rows = self.system.arrays.body[bodies]
        for row, translation, rotation in zip(
            rows, translations, rotations, strict=True
        ):
            u, rd = int(row[at.VEL]), int(row[at.RD])
            x[u : u + self.axes] = translation[: self.axes]
            if rd > self.axes:
                x[u + self.axes : u + rd] = rotation[3 - (rd - self.axes) :]

    def _frames(self, z: Array) -> tuple[Array, Array]:
        """Origins (bodies, 3) and rotation matrices of all frames at a position."""
        self.mechanics.evaluate(z, np.zeros(self.n))
        positions, rotations = frame_positions(self.mechanics, z)
        return positions, rotations.copy()  # not those of the next evaluation

    def _state(
        self,
        z: Array,
        groups: tuple[RotatingGroup, ...],
        time: float,
        frames: tuple[Array, Array],
    ) -> tuple[Array, Array, Array, Array]:
        """Position, velocity and scaled acceleration when so much time has passed, and
        the scaled velocities (groups, n) of each group that rotates alone and does not
        drift.

        frames : those at z, see `_frames`
        """
        mechanics, system = self.mechanics, self.system
        step, v, a = np.zeros(self.n), np.zeros(self.n), np.zeros(self.n)
        spins = np.zeros((len(groups), self.n))
        positions, turns = frames
        for group, spin in zip(groups, spins, strict=True):
            bodies, axes = list(group.axes), group.axes.values()
            omega = np.array([axis.omega for axis in axes])
            arms = positions[bodies] - np.array([axis.point for axis in axes])
            is_point = (system.arrays.body[bodies, at.RD] <= self.axes)[:, None]
            R = turns[bodies].transpose(0, 2, 1)
            carried = Rotation.from_rotvec(time * omega).as_matrix()
            Q = np.where(is_point[:, None], R, R @ carried.transpose(0, 2, 1))
            there = _rotated(carried, arms)
            way = there - arms + time * group.drift
            angles = _rotated(R, time * omega)
            self._set_frame_motions(step, bodies, _rotated(R, way), angles)
            turned = cross(omega, there)
            rotation = _rotated(Q, omega)
            self._set_frame_motions(spin, bodies, _rotated(Q, turned), rotation)
            speed = _rotated(Q, turned + group.drift)
            self._set_frame_motions(v, bodies, speed, rotation)
            gain = group.acceleration * omega
            gain /= np.linalg.norm(omega, axis=1, keepdims=True)
            # axes of points do not turn, in those of other bodies drifts do
            carried_speed = np.where(is_point, turned, -group.drift)
            change = cross(gain, there) + cross(omega, carried_speed)
            angular = _rotated(Q, gain)
            self._set_frame_motions(a, bodies, _rotated(Q, change), angular)
        if time:
            n_counters = system.n_rotation_counters
            rates = mechanics.rotation_rates(StateVectors(z, v)) if n_counters else 0.0
            z = mechanics.displaced(z, step / mechanics.scale)
            z[len(z) - n_counters :] += time * rates
        return z, v, a / mechanics.scale, spins / mechanics.scale

    def scene(self, z: Array, groups: tuple[RotatingGroup, ...]) -> SceneFile:
        """The scene whose bodies start at a position, in its rotation."""
        system = self.system
        scene = scene_at(system, z)
        bodies = dict(scene.bodies)
        positions, _ = self._frames(z)
        for group in groups:
            for b, axis in group.axes.items():
                speed = group.drift + np.cross(axis.omega, positions[b] - axis.point)
                changes: dict[str, object] = {
                    "velocity": tuple(speed[: self.axes].tolist())
                }
                if system.arrays.body[b, at.RD] > self.axes:
                    spin = axis.omega.tolist()
                    changes["angular_velocity"] = (
                        spin[2] if system.planar else tuple(spin)
                    )
                name = system.bodies[b].name
                start = bodies[name].initial.model_copy(update=changes)
                bodies[name] = bodies[name].model_copy(update={"initial": start})
        return scene.model_copy(update={"bodies": bodies})
