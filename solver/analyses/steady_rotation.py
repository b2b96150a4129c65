"""Starts in steady rotation of bodies that springs and bushings carry.

In a steady rotation (relative equilibrium) every body turns about an axis fixed in
space at a constant rate, or rests, and no body deforms any further. In body axes its
accelerations are zero: along the free directions of the constraints the applied forces
balance the inertia loads,

    P (M a - f) = 0,    C v + C_t = 0,    c = 0,

with the projector P onto the null space of C. Unknown are the positions, the axes, and
the angular acceleration of bodies that no drive holds at their rate. At one instant the
equations hold for many states. For a steady rotation they hold after any rotation of
the bodies as well: they are solved at `ANGLES` at once by the Gauss-Newton method
(J. Nocedal, S. J. Wright, Numerical Optimization, section 10.3). What remains of them
tells whether there is a steady rotation. Bearings of two stiffnesses allow none, nor
does a flexible shaft that sags.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sidtool.formats.errors import InputError
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import Array

from ..errors import SimulationError
from ..space import layout as at
from ..start.assembly import Start, assemble
from ..system.bodies.packing import symmetric
from ..system.scene import System
from ..system.sizes import coordinate_sizes
from .held import with_integrated_rates
from .inverse import refuse_states
from .mechanics import Mechanics, least_squares, null_space
from .resting import scene_at, with_bodies
from .rotating_groups import SAME_RATE, Group, components, hypotheses, places

#: Angles [rad] by which the fastest body has turned where the equations are solved.
ANGLES = (0.0, 2.1, -2.1)
#: Perturbation of coordinates for differences, in sizes of the mechanism and radians.
PERTURBATION = 1e-5
#: Columns and singular values of the scaled Jacobian below this part of the largest are
#: errors of differences, no stiffness.
SOFTEST = 1e-8
ITERATIONS = 25
#: Unknowns change by less, in sizes of the mechanism and radians, when they are found.
#: Frames turn by less in every step when the start is near enough [rad].
SETTLED, FAR = 1e-11, 0.5
#: The rotation is steady if less than this part of the loads is left, or of the forces.
STEADY, ROUNDING = 1e-6, 1e-9
#: The speed of a group may change by this part within a turn.
RIPPLE = 1e-3
#: Joints and drives allow no rotation if more than this part of the rates is left.
POSSIBLE = 1e-3
#: Velocity coordinates up to which a steady rotation is sought.
LARGEST = 400
#: Names that are listed of many.
LISTED = 4


def steady_rotation(system: System) -> tuple[SceneFile | None, tuple[str, ...]]:
    """The scene of a system that starts in steady rotation, and why there is none.

    The scene is None where nothing rotates, where joints and drives leave bodies no
    motion besides the rotation, or where there is no steady rotation; the last of these
    is told.

    system : with all of its joints
    """
    try:
        assembled, start = assemble(with_integrated_rates(system))
    except InputError:
        return None, ()
    if system.n_velocities > LARGEST:
        return None, _not_sought(assembled, start)
    t = system.scene.time.start
    mechanics = Mechanics(assembled, t, float(assembled.clocks(np.array([t]))[0]))
    told: tuple[str, ...] = ()
    for groups in hypotheses(mechanics, start):
        search = _Search(mechanics, start.z, groups)
        if not search.is_carried():
            continue
        if assembled.rubbing:
            names = ", ".join(rub.joint for rub in assembled.rubbing)
            return None, (_no_steady(search, f"the friction of {names} is in it"),)
        try:
            refuse_states(assembled)
            found, reason = search.solved()
        except (InputError, SimulationError, np.linalg.LinAlgError) as error:
            found, reason = None, str(error)
        if found is not None:
            return with_bodies(system, found), ()
        told = told or ((_no_steady(search, reason),) if reason else ())
    return None, told


def _not_sought(system: System, start: Start) -> tuple[str, ...]:
    """A sentence on bodies of a large scene that rotate at its start."""
    axes = 2 if system.planar else 3
    names = [
        data.name
        for row, data in zip(system.arrays.body, system.bodies, strict=True)
        if data.of_scene
        and start.v[row[at.VEL] + axes : row[at.VEL] + row[at.RD]].any()
    ]
    if not names:
        return ()
    listed = ", ".join(names[:LISTED])
    listed += f" and {len(names) - LISTED} others" if len(names) > LISTED else ""
    return (
        f"no steady rotation of {listed} was sought in a scene of more than {LARGEST} "
        "velocity coordinates: they start in static equilibrium with the velocities "
        "that are stated, and vibrate where springs carry them",
    )


def _no_steady(search: _Search, reason: str) -> str:
    return (
        f"no steady rotation of {', '.join(search.names)} was found to start in "
        f"({reason}): they start in static equilibrium with the velocities that are "
        "stated, and vibrate"
    )


def _projected(C: Array, forces: Array) -> Array:
    """Scaled forces (n,) without those that constraints bear."""
    if not len(C):
        return forces
    rows = C.T / np.maximum(np.linalg.norm(C, axis=1), 1e-300)
    return np.asarray(forces - rows @ least_squares(rows, forces))


@dataclass(frozen=True, eq=False)
class _Residual:
    """What is left of the equations.

    closure, rates : of the constraints, in their sizes
    forces : across the rotation of each group
    torques : (groups,) mean forces along it
    ripple : (angles, groups) how these differ from their mean
    """

    closure: Array
    rates: Array
    forces: Array
    torques: Array
    ripple: Array


class _Search:
    """A steady rotation near a position.

    groups : bodies that rotate, all others rest
    """

    def __init__(
        self, mechanics: Mechanics, z: Array, groups: tuple[Group, ...]
    ) -> None:
        self.mechanics, self.system = mechanics, mechanics.system
        self.start, self.groups = z, groups
        self.n = self.system.n_velocities
        self.axes = 2 if self.system.planar else 3
        self.fastest = max(group.first.rate for group in groups)
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
            diagonal[elastic] += np.abs(symmetric(data.sid.Ke.m0).diagonal())
        mechanics.scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))

    def is_carried(self) -> bool:
        """Whether bodies can move in other ways than to rotate so and to deform."""
        mechanics = self.mechanics
        spun = np.array(self._spins(self.start, self.groups)).T
        mechanics.evaluate(self.start, np.zeros(self.n))
        turning = {b for group in self.groups for b in group.axes}
        rigid = np.zeros(self.n, bool)
        for part, _ in components(self.system):
            for row in self.system.arrays.body[part] if turning & set(part) else ():
                rigid[row[at.VEL] : row[at.VEL] + row[at.RD]] = True
        N = null_space(mechanics.jacobian[:, rigid])
        spins = spun[rigid] / np.linalg.norm(spun[rigid], axis=0)
        seen = np.linalg.svd(N.T @ spins, compute_uv=False)
        return bool(N.shape[1] > np.sum(seen > SAME_RATE))

    def solved(self) -> tuple[SceneFile | None, str]:
        """The scene that starts in it, or None and why there is none; no reason where
        joints and drives allow no such rotation at all."""
        z, groups = self.start, self.groups
        left = self._left(z, groups)
        loads = float(np.linalg.norm(left.forces))
        matrix, change, before = np.zeros((0, 0)), np.inf, np.inf
        for _ in range(ITERATIONS):
            if not len(matrix) or change > 0.1 * before:
                matrix = self._jacobian(z, groups)
            x = self._step(matrix, left, z, groups)
            before, change = change, self._extent(x)
            if not self._angle(x) < FAR:
                return None, "what carries them is too soft"
            z, groups = self._moved(z, groups, x)
            left = self._left(z, groups)
            if change < SETTLED:
                break
        if np.max(np.abs(left.rates), initial=0.0) > POSSIBLE * self.fastest:
            return None, ""
        size = self.mechanics.force_size(z)
        remaining = float(np.linalg.norm(np.append(left.forces, left.torques)))
        if remaining > STEADY * loads and remaining > ROUNDING * size:
            return None, self._reason(left.forces, remaining / loads)
        if np.max(np.abs(left.rates), initial=0.0) > STEADY * self.fastest:
            return None, ""
        for group, ripple in zip(groups, left.ripple.T, strict=True):
            if np.max(np.abs(ripple)) > RIPPLE * self._inertia_force(z, group):
                names = ", ".join(self.system.bodies[b].name for b in group.axes)
                return None, f"forces change the speed of {names} in each turn"
        return self._scene(z, groups), ""

    def _inertia_force(self, z: Array, group: Group) -> float:
        """What changes the speed of a group within an angle of one radian, scaled."""
        (spin,) = self._spins(z, (group,))
        M = self.mechanics.mass
        return float(spin @ M @ spin / np.linalg.norm(spin) * group.first.rate)

    def _reason(self, forces: Array, part: float) -> str:
        """Which body is out of balance as all turn."""
        rows = np.abs(forces.reshape(len(ANGLES), self.n)).max(axis=0)
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

    def _left(self, z: Array, groups: tuple[Group, ...]) -> _Residual:
        mechanics = self.mechanics
        closure, rates, forces, torques = np.zeros(0), [], [], []
        for angle in ANGLES:
            time = angle / self.fastest
            there, v, a = self._state(z, groups, time)
            mechanics.evaluate(there, v)
            C, sizes = mechanics.jacobian, mechanics.sizes
            if angle == 0.0:
                demanded = (C @ a - mechanics.gamma) / (self.fastest**2 * sizes)
                closure = np.concatenate([mechanics.residual / sizes, demanded])
            rates.append(mechanics.rates / sizes)
            left = _projected(C, mechanics.mass @ a - mechanics.force)
            along = np.zeros(len(groups))
            for k, spin in enumerate(self._spins(there, groups, time)):
                free = _projected(C, spin)
                size = np.linalg.norm(free)
                if size > SAME_RATE * np.linalg.norm(spin):
                    along[k] = free @ left / size
                    left = left - along[k] * free / size
            forces.append(left)
            torques.append(along)
        mean = np.mean(torques, axis=0)
        ripple = np.array(torques) - mean
        return _Residual(
            closure, np.concatenate(rates), np.concatenate(forces), mean, ripple
        )

    def _spins(
        self, z: Array, groups: tuple[Group, ...], time: float = 0.0
    ) -> list[Array]:
        """Scaled velocities (n,) of each group that rotates alone, and does not drift.

        time : that has passed since the axes were where the groups say
        """
        resting = (group.at(time) for group in groups)
        velocities = (self._state(z, (group,), 0.0)[1] for group in resting)
        return [v / self.mechanics.scale for v in velocities]

    def _rows(self, left: _Residual) -> Array:
        """All equations in one vector: forces per unit of the scale, the others per
        size of the mechanism."""
        unit = float(np.median(self.sizes / self.mechanics.scale))
        rates = unit / self.fastest * left.rates
        return np.concatenate([unit * left.closure, rates, left.forces, left.torques])

    def _jacobian(self, z: Array, groups: tuple[Group, ...]) -> Array:
        """By central differences, (rows, n + unknowns of groups)."""
        units = self._units(groups)
        count = len(units)
        columns = []
        for k in range(count):
            x = np.zeros(count)
            x[k] = PERTURBATION * units[k]
            ends = [
                self._rows(self._left(*self._moved(z, groups, sign * x)))
                for sign in (1.0, -1.0)
            ]
            columns.append((ends[0] - ends[1]) / (2.0 * x[k]))
        return np.column_stack(columns)

    def _units(self, groups: tuple[Group, ...]) -> Array:
        """Sizes of all unknowns: of the mechanism, a radian, the square of the rate."""
        found = [self.sizes / self.mechanics.scale]
        for group in groups:
            found += [np.array([self.system.length] * 2 + [1.0] * 2)] * len(group.axes)
            found.append(np.array([group.first.rate**2]))
        return np.concatenate(found)

    def _extent(self, x: Array) -> float:
        """The largest change of a coordinate, in sizes of the mechanism and radians."""
        return float(np.max(np.abs(x[: self.n] * self.mechanics.scale) / self.sizes))

    def _angle(self, x: Array) -> float:
        """The largest rotation of a frame [rad]."""
        found = 0.0
        for row in self.system.arrays.body:
            turn = slice(row[at.VEL] + self.axes, row[at.VEL] + row[at.RD])
            angles = x[: self.n][turn] * self.mechanics.scale[turn]
            found = max(found, float(np.max(np.abs(angles), initial=0.0)))
        return found

    def _step(
        self, matrix: Array, left: _Residual, z: Array, groups: tuple[Group, ...]
    ) -> Array:
        """The smallest change that solves the equations best, turning no free group."""
        count = matrix.shape[1]
        keep = np.eye(count)
        tangents = self._spins(z, groups)
        self.mechanics.evaluate(z, np.zeros(self.n))
        C = self.mechanics.jacobian
        for tangent in tangents:
            held = np.linalg.norm(tangent - _projected(C, tangent))
            if held > SAME_RATE * np.linalg.norm(tangent):
                continue  # a drive or a joint says how far it has turned
            spin = np.append(tangent, np.zeros(count - self.n))
            spin /= np.linalg.norm(spin)
            keep -= np.outer(spin, spin)
        matrix = matrix @ keep
        sizes = np.linalg.norm(matrix, axis=0)
        stiff = sizes > SOFTEST * sizes[: self.n].max()
        columns = matrix[:, stiff] / sizes[stiff]
        x = np.zeros(count)
        x[stiff] = np.linalg.lstsq(columns, -self._rows(left), rcond=SOFTEST)[0]
        x[stiff] /= sizes[stiff]
        return np.asarray(keep @ x)

    def _moved(
        self, z: Array, groups: tuple[Group, ...], x: Array
    ) -> tuple[Array, tuple[Group, ...]]:
        moved = self.mechanics.moved(z, x[: self.n])
        ends = self.n + np.cumsum([group.unknowns for group in groups])
        own = np.split(x, [self.n, *ends])[1:-1]
        if self.system.planar:
            for y in own:
                y[:-1].reshape(-1, 4)[:, 2:] = 0.0  # axes stay perpendicular
        return moved, tuple(g.changed(y) for g, y in zip(groups, own, strict=True))

    def _put(self, x: Array, b: int, way: Array, turn: Array) -> None:
        """Writes the motion of a frame, in its axes, into velocity coordinates."""
        row = self.system.arrays.body[b]
        u, rd = int(row[at.VEL]), int(row[at.RD])
        x[u : u + self.axes] = way[: self.axes]
        if rd > self.axes:
            x[u + self.axes : u + rd] = turn[3 - (rd - self.axes) :]

    def _state(
        self, z: Array, groups: tuple[Group, ...], time: float
    ) -> tuple[Array, Array, Array]:
        """Position, velocity and scaled acceleration when so much time has passed."""
        mechanics, system = self.mechanics, self.system
        step, v, a = np.zeros(self.n), np.zeros(self.n), np.zeros(self.n)
        mechanics.evaluate(z, np.zeros(self.n))
        positions, turns = places(mechanics, z)
        for group in groups:
            for b, axis in group.axes.items():
                carried = Rotation.from_rotvec(time * axis.spin).as_matrix()
                arm, R = positions[b] - axis.point, turns[b]
                is_point = system.arrays.body[b, at.RD] <= self.axes
                Q = R if is_point else carried @ R
                there = carried @ arm
                way = there - arm + time * group.drift
                self._put(step, b, R.T @ way, R.T @ (time * axis.spin))
                speed = group.drift + np.cross(axis.spin, there)
                self._put(v, b, Q.T @ speed, Q.T @ axis.spin)
                gain = group.acceleration * axis.spin / axis.rate
                change = np.cross(gain, there)
                # axes of points do not turn, in those of other bodies drifts do
                turned = speed - group.drift if is_point else -group.drift
                change += np.cross(axis.spin, turned)
                self._put(a, b, Q.T @ change, Q.T @ gain)
        if time:
            rates = mechanics.turn_rates(Start(z, v))
            z = mechanics.moved(z, step / mechanics.scale)
            z[len(z) - len(rates) :] += time * rates
        return z, v, a / mechanics.scale

    def _scene(self, z: Array, groups: tuple[Group, ...]) -> SceneFile:
        """The scene whose bodies start at a position, in its rotation."""
        system = self.system
        scene = scene_at(system, z)
        bodies = dict(scene.bodies)
        self.mechanics.evaluate(z, np.zeros(self.n))
        positions, _ = places(self.mechanics, z)
        for group in groups:
            for b, axis in group.axes.items():
                speed = group.drift + np.cross(axis.spin, positions[b] - axis.point)
                changes: dict[str, object] = {
                    "velocity": tuple(speed[: self.axes].tolist())
                }
                if system.arrays.body[b, at.RD] > self.axes:
                    spin = axis.spin.tolist()
                    changes["angular_velocity"] = (
                        spin[2] if system.planar else tuple(spin)
                    )
                name = system.bodies[b].name
                start = bodies[name].initial.model_copy(update=changes)
                bodies[name] = bodies[name].model_copy(update={"initial": start})
        return scene.model_copy(update={"bodies": bodies})
