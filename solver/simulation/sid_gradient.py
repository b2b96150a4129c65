"""Gradients of functionals by all numbers of a SID at once, from an adjoint run.

The residual r of a body, eq. (10)-(12), is linear in the blocks of its SID. With the
adjoint vector as a virtual motion of the body, the sums of their products with its
motion over all stages are the gradients by the blocks; theory, section 19, lists them:

==========  ==================================================================
Symbol      Meaning
==========  ==================================================================
s, psi, xi  virtual motion: translation, rotation, elastic coordinates
a, alpha    acceleration of the frame without gravity, angular acceleration
omega       angular velocity of the frame
by_X        gradient by X of x . r at a stage
==========  ==================================================================

A number of a marker acts as a coordinate of a shape function that moves this marker
alone: the residual is differentiated by such coordinates in a second system.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sidtool.formats.base.sid import (
    BLOCK_SHAPES,
    J_INDICES,
    OE_INDICES,
    SID,
    Array,
    Node,
    Taylor,
)

from ..analyses.output_derivatives import POINTS, WEIGHTS
from ..integrators import batch_evaluation
from ..output.samples import StateSampler
from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from ..system.body_data import BodyData
from ..system.build import build_system
from ..system.rotated_markers import marker_rotations
from ..system.system import System
from ..system.work_arrays import new_work_arrays
from .linearised_run import (
    PERTURBATION,
    LinearisedRun,
    NotLinearisable,
    derivative_scratch,
)
from .motion_derivatives import AdjointGradient, MotionDerivatives

#: Flags of bodies whose residual has other terms.
OTHER_TERMS = at.HAS_CT1 | at.HAS_KE1 | at.STIFFENED
#: Blocks whose first-order terms enter.
WITH_FIRST_ORDER = "J", "Cr", "Oe"
#: Directions in which markers move: translations, then rotations.
IN_PLANE, IN_SPACE = (0, 1, 5), (0, 1, 2, 3, 4, 5)


#: Second derivatives of J by those of Oe, see `inertia_second_derivative`: (6, 6).
_SECOND_DERIVATIVE = np.zeros((6, 6))
for _k, _pair in enumerate(J_INDICES):
    _same = 2.0 if _pair[0] == _pair[1] else 1.0
    _SECOND_DERIVATIVE[_k, OE_INDICES.index(_pair)] = -_same


@dataclass(frozen=True, eq=False)
class SidGradient:
    """Gradients of functionals by the numbers of a SID, a row for each functional.

    Attributes
    ----------
    blocks : (n, .) by m0 of each block, "mass", and "Cr m1", "J m1", "Oe m1"
    nodes : (n, 3 + 6 nq) by position, phi and psi of a node, by its id
    selected : numbers of the elastic coordinates of the run in the SID
    """

    blocks: Mapping[str, Array]
    nodes: Mapping[str, Array]
    selected: IntTable

    def along(self, derivative: SID) -> Array:
        """Derivatives of the functionals by a number of which the SID has this
        derivative, (n,).
        """
        selects = len(self.selected) < derivative.nq
        q: IntTable | slice = self.selected if selects else slice(None)
        parts = [np.array([derivative.mass])]
        parts += [derivative.mdCM.m0, derivative.J.m0, derivative.ksigma.m0[q]]
        parts += [getattr(derivative, name).m0[q] for name in ("Ct", "Cr", "Oe")]
        parts += [getattr(derivative, name).m0[q][:, q] for name in ("Me", "Ke", "De")]
        for name in WITH_FIRST_ORDER:
            term = getattr(derivative, name).m1
            if term is None:
                parts.append(np.zeros(self.blocks[f"{name} m1"].shape[1]))
            else:
                parts.append(term[q] if name == "J" else term[q][:, q])
        for name in self.nodes:
            node = derivative.node(name)
            parts += [node.position, node.phi.m0[:, q], node.psi.m0[:, q]]
        return np.asarray(self._joined @ np.concatenate([x.ravel() for x in parts]))

    @cached_property
    def _joined(self) -> Array:
        """All gradients in the order of `along`, (n, .)."""
        names = "mass", "mdCM", "J", "ksigma", "Ct", "Cr", "Oe", "Me", "Ke", "De"
        first = [self.blocks[f"{name} m1"] for name in WITH_FIRST_ORDER]
        blocks = [self.blocks[name] for name in names]
        return np.concatenate([*blocks, *first, *self.nodes.values()], axis=1)


def sid_gradient(
    derivatives: MotionDerivatives, gradient: AdjointGradient, body: str
) -> SidGradient:
    """The gradients by the numbers of the SID of a body, through the motion.

    The start of the run and functionals at fixed states are taken as independent of
    these numbers.

    Raises
    ------
    NotLinearisable : the body has terms of higher order, or constraints are inactive.
    """
    system = derivatives.run.system
    data = system.bodies[system.index(body)]
    if system.arrays.body[system.index(body), at.FLAGS] & OTHER_TERMS:
        raise NotLinearisable("terms of second order")
    blocks = _block_gradients(derivatives.run, gradient, system.index(body))
    nodes = _node_gradients(derivatives, gradient, data)
    return SidGradient(blocks, nodes, np.array(data.coordinate_numbers, int) - 1)


def _as_3d(x: Array, axes: slice) -> Array:
    """Vectors (n, 3) from some of their components; the others are 0."""
    out = np.zeros((len(x), 3))
    out[:, axes] = x
    return out


def _tensor_gradient(x: Array, y: Array) -> Array:
    """Gradient of x . J y by the stored entries of J, (n, 6)."""
    entries = [x[:, a] * y[:, b] + (a != b) * x[:, b] * y[:, a] for a, b in J_INDICES]
    return np.stack(entries, axis=1)


def _block_gradients(
    run: LinearisedRun, gradient: AdjointGradient, body: int
) -> dict[str, Array]:
    """By the blocks of a body, a row for each functional."""
    system, stages = run.system, run.stages
    row = system.arrays.body[body]
    axes, turns = (slice(2), slice(2, 3)) if system.planar else (slice(3), slice(3))
    sampler = StateSampler(system, np.full((run.m, 2), np.inf))
    sampled = sampler.sample(stages.times, stages.z.copy(), stages.v.copy())
    frame = system.frames(np.ascontiguousarray(sampled.frames[:, body]))
    omega, alpha = _as_3d(frame["w"], turns), _as_3d(frame["al"], turns)
    if system.planar:
        c, s = frame["R"].T
        R = np.stack([c, -s, s, c], axis=1).reshape(-1, 2, 2)
    else:
        R = frame["R"].reshape(-1, 3, 3)
    weight = np.einsum("nji,j->ni", R, system.arrays.gravity[axes])
    motion = _Motion(
        *_elastic_motion(run, row, stages.z, stages.v),
        run.accelerations[:, _elastic(row)],
        omega,
        alpha,
        _as_3d(frame["a"] - weight, axes),
        bool(row[at.FLAGS] & at.HAS_QUADRATIC_J),
    )
    first, rigid = int(row[at.VEL]), int(row[at.RD])
    found = []
    for x in np.moveaxis(gradient.residual, 2, 0):
        s, psi = np.zeros((2, len(x), 3))
        if rigid:
            last = first + axes.stop
            s = _as_3d(x[:, first:last], axes)
            psi = _as_3d(x[:, last : first + rigid], turns)
        found.append(_blocks_along(motion, s, psi, x[:, _elastic(row)]))
    return {name: np.stack([one[name].ravel() for one in found]) for name in found[0]}


@dataclass(frozen=True, eq=False)
class _Motion:
    """Motion of a body at the stages, see the head of the module.

    Attributes
    ----------
    is_quadratic : whether J has the term q Oe1 q, and gyroscopic terms Cr m1
    """

    q: Array
    q_dot: Array
    q_ddot: Array
    omega: Array
    alpha: Array
    a: Array
    is_quadratic: bool


def _blocks_along(motion: _Motion, s: Array, psi: Array, xi: Array) -> dict[str, Array]:
    """Gradients of x . r by the blocks of a body, for a virtual motion of it."""
    q, q_dot, q_ddot = motion.q, motion.q_dot, motion.q_ddot
    omega, alpha, a = motion.omega, motion.alpha, motion.a
    n, nq = q.shape
    turned, cross = np.cross(psi, omega), np.cross
    by_md = cross(s, alpha) + cross(omega, cross(omega, s)) + cross(a, psi)
    by_J = _tensor_gradient(psi, alpha) + _tensor_gradient(turned, omega)
    by_J_dot = _tensor_gradient(psi, omega)
    squares = np.stack([omega[:, i] * omega[:, j] for i, j in OE_INDICES], axis=1)

    def product(x: Array, y: Array) -> Array:
        return np.asarray(x.T @ y.reshape(n, -1))

    def each(x: Array, y: Array) -> Array:
        """x_k y of all coordinates, (n, nq, .)."""
        return np.asarray(x[:, :, None] * y[:, None, :])

    gyroscopic = product(q_dot, each(xi, omega)).reshape(nq, nq, 3)
    by_Cr1 = product(q, each(q_ddot, psi) + each(xi, alpha)).reshape(nq, nq, 3)
    by_Oe1 = product(q, each(xi, squares)).reshape(nq, nq, 6)
    if motion.is_quadratic:
        by_Cr1 += product(q, each(q_dot, turned)).reshape(nq, nq, 3)
        quadratic = each(0.5 * q, by_J) + each(q_dot, by_J_dot)
        by_Oe1 += product(q, quadratic @ _SECOND_DERIVATIVE).reshape(nq, nq, 6)
    by_Me = product(xi, q_ddot)
    return {
        "mass": np.array([(s * a).sum()]),
        "mdCM": by_md.sum(axis=0),
        "J": by_J.sum(axis=0),
        "J m1": product(q, by_J) + product(q_dot, by_J_dot),
        "Ct": product(q, by_md)
        + 2.0 * product(q_dot, cross(s, omega))
        + product(q_ddot, s)
        + product(xi, a),
        "Cr": product(q_ddot, psi) + product(q_dot, turned) + product(xi, alpha),
        "Cr m1": by_Cr1 + gyroscopic - gyroscopic.transpose(1, 0, 2),
        "Oe": product(xi, squares),
        "Oe m1": 0.5 * (by_Oe1 + by_Oe1.transpose(1, 0, 2)),
        "ksigma": xi.sum(axis=0),
        "Me": 0.5 * (by_Me + by_Me.T),
        "Ke": product(xi, q),
        "De": product(xi, q_dot),
    }


def _elastic(row: IntTable) -> slice:
    """Velocities of the elastic coordinates of a body."""
    last = int(row[at.VEL] + row[at.NV])
    return slice(last - int(row[at.NQ]), last)


def _elastic_motion(
    run: LinearisedRun, row: IntTable, z: Array, v: Array
) -> tuple[Array, Array]:
    """Elastic coordinates of a body and their rates, (n, nq)."""
    last = int(row[at.POS] + row[at.NP])
    return z[:, last - int(row[at.NQ]) : last], v[:, _elastic(row)]


# Markers


class _MovedNodes:
    """The system with a coordinate without mass for each motion of each marker.

    Attributes
    ----------
    system : with these coordinates behind those of the body
    nodes : ids of the nodes of the markers
    directions : of each node, components of translation and rotation
    added : velocities of these coordinates
    """

    def __init__(self, system: System, data: BodyData) -> None:
        if len(system.arrays.inactive_segments) or system.natives:
            raise NotLinearisable("inactive constraints or programs")
        used = {
            row: data.node(name).id
            for (body, name), row in system.markers.items()
            if body == data.name
        }
        held = {used[row] for row in _markers_of_frames(system) if row in used}
        self.nodes = [*dict.fromkeys(n for n in used.values() if n not in held)]
        self.directions = IN_PLANE if system.planar else IN_SPACE
        bodies = [
            replace(one, sid=self._moved(one.sid)) if one.name == data.name else one
            for one in system.bodies
        ]
        self.system = build_system(
            system.source or system.scene,
            system.sids,
            before=replace(system, bodies=tuple(bodies)),
            rotations=marker_rotations(system.scene, system.bodies),
        )
        old, new = system.arrays, self.system.arrays
        count = len(self.nodes) * len(self.directions)
        tables = [np.delete(a.constraint, at.C_DATA, axis=1) for a in (old, new)]
        has_others = new.n_velocities != old.n_velocities + count
        if has_others or not np.array_equal(tables[0], tables[1]):
            raise NotLinearisable("other constraints with moved markers")
        pairs = [*zip(old.body, new.body, strict=True)]
        self._z = _places(pairs, at.POS, at.NP)
        self._v = _places(pairs, at.VEL, at.NV)
        row = new.body[system.index(data.name)]
        last = int(row[at.VEL] + row[at.NV])
        self.added = slice(last - count, last)
        last = int(row[at.POS] + row[at.NP])
        self.added_z = slice(last - count, last)

    def _moved(self, sid: SID) -> SID:
        """A SID with the coordinates."""
        nq, count = sid.nq, len(self.nodes) * len(self.directions)
        blocks: dict[str, Any] = {
            name: _padded(getattr(sid, name), shape, nq, count)
            for name, shape in BLOCK_SHAPES.items()
        }
        one = np.diag(np.repeat([0.0, 1.0], [nq, count]))
        blocks["Me"] = Taylor(blocks["Me"].m0 + one)
        nodes = []
        for node in sid.nodes:
            shapes = np.zeros((6, nq + count))
            shapes[:, :nq] = np.vstack([node.phi.m0, node.psi.m0])
            if node.id in self.nodes:
                first = nq + self.nodes.index(node.id) * len(self.directions)
                for k, direction in enumerate(self.directions):
                    shapes[direction, first + k] = 1.0
            origin, AP = Taylor(node.origin.m0), Taylor(node.AP.m0)
            phi, psi = Taylor(shapes[:3]), Taylor(shapes[3:])
            nodes.append(Node(node.id, origin, phi, psi, AP))
        labels = (*sid.labels, *[""] * count)
        return replace(sid, labels=labels, nodes=tuple(nodes), sections=(), **blocks)

    def expanded(self, z: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations with the coordinates at 0."""
        arrays = self.system.arrays
        counters = z.shape[1] - len(self._z)
        out_z = np.zeros((len(z), arrays.n_positions))
        out_z[:, self._z] = z[:, : len(self._z)]
        if counters:
            out_z[:, -counters:] = z[:, -counters:]
        return out_z, self.expanded_velocities(v), self.expanded_velocities(a)

    def expanded_velocities(self, v: Array) -> Array:
        """Velocities with those of the coordinates at 0."""
        out = np.zeros((len(v), self.system.n_velocities))
        out[:, self._v] = v
        return out


def _markers_of_frames(system: System) -> set[int]:
    """Rows of the markers on which prescribed frames stand; these do not deform."""
    body = system.arrays.body
    prescribed = body[~np.isin(body[:, at.MOTION], [at.FREE, at.GROUND])]
    return {*prescribed[:, [at.BASE, at.TIP]].ravel().tolist()}


def _places(pairs: list[tuple[IntTable, IntTable]], first: int, count: int) -> IntTable:
    """Where the coordinates of bodies are in a second system."""
    return np.concatenate([new[first] + np.arange(old[count]) for old, new in pairs])


def _padded(
    block: Taylor, shape: tuple[int | str, int | str], nq: int, count: int
) -> Taylor:
    """A block with zeros for more coordinates."""

    def padded(x: Array, kinds: tuple[int | str, ...]) -> Array:
        for axis, kind in enumerate(kinds):
            if kind == "3q":
                x = x.reshape(*x.shape[:axis], 3, nq, *x.shape[axis + 1 :])
                widths = [(0, count * (k == axis + 1)) for k in range(x.ndim)]
                x = np.pad(x, widths)
                x = x.reshape(*x.shape[:axis], -1, *x.shape[axis + 2 :])
            elif kind == "q":
                x = np.pad(x, [(0, count * (k == axis)) for k in range(x.ndim)])
        return np.array(x)

    m1 = None if block.m1 is None else padded(block.m1, ("q", *shape))
    return Taylor(padded(block.m0, shape), m1)


def _node_gradients(
    derivatives: MotionDerivatives, gradient: AdjointGradient, data: BodyData
) -> dict[str, Array]:
    """By the numbers of the nodes of a body, a row for each functional."""
    run = derivatives.run
    moved = _MovedNodes(run.system, data)
    if not moved.nodes:
        return {}
    row = run.system.arrays.body[run.system.index(data.name)]
    at_stages = _StageDerivatives(run, moved)
    at_ends = _EndDerivatives(derivatives, moved)
    q, q_dot = _elastic_motion(run, row, run.stages.z, run.stages.v)
    q_ddot = run.accelerations[:, _elastic(row)]
    ends = derivatives.ends
    q_ends, rates = _elastic_motion(run, row, ends.z, ends.v)
    rows = []
    columns = (
        np.moveaxis(gradient.residual, 2, 0),
        np.moveaxis(gradient.constraint, 2, 0),
    )
    for x, mu in zip(*columns, strict=True):
        by_position, by_velocity, by_acceleration = at_stages.along(x)
        shapes = by_position.T @ q + by_velocity.T @ q_dot
        shapes += by_acceleration.T @ q_ddot + at_stages.forces.T @ x[:, _elastic(row)]
        value, rate = at_ends.along(mu)
        shapes += value.T @ q_ends + rate.T @ rates
        rows.append((by_position.sum(axis=0) + value.sum(axis=0), shapes))
    found = {}
    width = len(moved.directions)
    for k, node in enumerate(moved.nodes):
        part = slice(k * width, (k + 1) * width)
        both = np.zeros((len(rows), 6)), np.zeros((len(rows), 6, q.shape[1]))
        for out, (position, shapes) in enumerate(rows):
            both[0][out, moved.directions] = position[part]
            both[1][out, moved.directions] = shapes[part]
        parts = both[0][:, :3], both[1].reshape(len(rows), -1)
        found[node] = np.concatenate(parts, axis=1)
    return found


class _StageDerivatives:
    """Residuals at the stages by the coordinates of moved markers.

    Attributes
    ----------
    forces : (stages, added) residuals of these coordinates
    """

    def __init__(self, run: LinearisedRun, moved: _MovedNodes) -> None:
        self._run, self._moved = run, moved
        system, stages = moved.system, run.stages
        z, v, a = moved.expanded(stages.z, stages.v, run.accelerations)
        self._states = stages.clocks, stages.times, z, v, a
        self._given = run.kernels, system.arrays, new_work_arrays(system)
        n = len(z)
        nv, rows = system.n_velocities, system.n_velocities + run.m
        added = np.r_[moved.added]
        chosen = np.concatenate([added, nv + added])
        directions = np.zeros((0, 2 * nv))
        duals = directions
        if len(run.directions):
            lengths = np.where(np.array(moved.directions) < 3, system.length, 1.0)
            sizes = PERTURBATION * np.tile(lengths, len(moved.nodes))
            duration = run.times[-1] - run.times[0]
            steps, one = np.concatenate([sizes, sizes / duration]), np.eye(2 * nv)
            directions = one[chosen] * steps[:, None]
            duals = one[chosen] / steps[:, None]
        tangent = np.zeros((n, 2 * nv, rows))
        batch_evaluation.linearise_states(
            *(*self._given, *self._states, run.multipliers),
            *(directions, duals, *run.difference),
            *(derivative_scratch(system), tangent),
        )
        self._by = tangent[:, chosen]
        self.forces = self._residuals(run.multipliers)
        self._without_multipliers = self._residuals(np.zeros_like(run.multipliers))

    def _residuals(self, multipliers: Array) -> Array:
        """Residuals of the added coordinates."""
        nv = self._moved.system.n_velocities
        out = np.zeros((len(multipliers), nv + multipliers.shape[1]))
        batch_evaluation.residuals_of_states(
            *self._given, *self._states, np.ascontiguousarray(multipliers), out
        )
        return out[:, self._moved.added].copy()

    def along(self, x: Array) -> tuple[Array, Array, Array]:
        """Derivatives of x . (r, g) by positions, velocities and accelerations of the
        added coordinates, (stages, added) each.
        """
        nv = self._run.nv
        rows = [self._moved.expanded_velocities(x[:, :nv]), x[:, nv:]]
        by = np.einsum("nar,nr->na", self._by, np.concatenate(rows, axis=1))
        count = by.shape[1] // 2
        by_acceleration = self._without_multipliers - self._residuals(x[:, nv:])
        return by[:, :count], by[:, count:], by_acceleration


class _EndDerivatives:
    """Constraints and their rates at the ends of steps by moved markers."""

    def __init__(self, derivatives: MotionDerivatives, moved: _MovedNodes) -> None:
        run, ends, system = derivatives.run, derivatives.ends, moved.system
        z, v, _ = moved.expanded(ends.z, ends.v, ends.v)
        work = new_work_arrays(system)
        count = moved.added.stop - moved.added.start
        self._by = np.zeros((count, len(z), 2 * run.m))
        for k in range(count):
            size = (
                system.length if moved.directions[k % len(moved.directions)] < 3 else 1
            )
            step = 1e3 * PERTURBATION * size
            for point, weight in zip(POINTS, WEIGHTS, strict=True):
                changed = z.copy()
                changed[:, moved.added_z.start + k] += point * step
                states = replace(ends, z=changed, v=v)
                self._by[k] += weight / step * run.constraints(system, states, work)

    def along(self, mu: Array) -> tuple[Array, Array]:
        """Derivatives of mu . (c, c') by positions and velocities of the added
        coordinates, (ends, added) each.
        """
        m = mu.shape[1] // 2
        by_position = np.einsum("anr,nr->na", self._by, mu)
        by_velocity = np.einsum("anr,nr->na", self._by[:, :, :m], mu[:, m:])
        return by_position, by_velocity
