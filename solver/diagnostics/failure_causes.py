"""Causes of a failed run, as diagnostics.

Passages of singular configurations, and dead points of friction.

At a bifurcation the motion is not determined; a passage is reported with its time.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import marker_names, marker_reference
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, coupled_mass_matrix, free_motion

from ..initial_state import sparse_jacobian
from ..initial_state.constraint_jacobian import (
    InitialState,
    dense_jacobian,
    friction_directions,
    normalised_rows,
    row_names,
)
from ..initial_state.contradictions import LARGE_SCENE, later_contradiction
from ..initial_state.given_state import StateVectors
from ..initial_state.integrator_start import RunSettings
from ..initial_state.overconstraint import restore_constraints
from ..integrators import loop_state, output_sampling
from ..integrators.singular_configurations import (
    MAX_CROSSINGS,
    STEP_LENGTH,
    STEP_START,
    STEP_STATES,
)
from ..linear.factor_storage import Kernels, Memory
from ..spatial import system_arrays as at
from ..spatial.coordinates import rate
from ..spatial.system_arrays import WorkArrays
from ..system import work_arrays
from ..system.body_data import BodyData
from ..system.characteristic_sizes import constraint_sizes, coordinate_sizes
from ..system.system import System
from ..system.work_arrays import new_memory, new_work_arrays

#: Passages that are reported one by one.
MAX_REPORTED = 3
#: Independence below which motions can be confused, or this times the root of the
#: tolerated error, and at most the last: with it a mechanism misses the configuration
#: by ten times the tolerated error.
NEAR_INDEPENDENCE, TOLERANCE_FACTOR, MAX_INDEPENDENCE = 3e-3, 20.0**0.5, 0.05
#: Parts of the independence at other times that are not near.
USUAL_FRACTION = 0.5
#: Constraints have a part in a dependency when their share of it is larger.
INVOLVED_SHARE = 0.05
#: Points of a step at which its course is seen, by which its way is longer at most.
COARSE_POINTS, PATH_FACTOR = 3, 2.0
#: Points of a step that are compared, and halvings around the best one, which end when
#: independence changes by less than this part, or as little is left. With less, large
#: scenes do not separate its rows from redundant ones.
POINTS, HALVINGS, RELATIVE_CHANGE, ZERO_INDEPENDENCE = 33, 40, 1e-6, 1e-6
#: Of a rate, for its derivative by differences.
STEP = 1e-6

#: Constraints that follow from others; and how little of what could move a joint does,
#: near a dead point, relative to what the scale of its bodies would.
DEPENDENCE_TOLERANCE, DEAD_POINT_TOLERANCE = 1e-6, 1e-3
#: Determinant of the equations of friction near a state without a solution.
MIN_FRICTION_DETERMINANT = 0.1
#: Part of the smallest eigenvalue of a mass matrix that is left of a lost inertia.
LOST_INERTIA = 1e-2
#: Of the inertia of two bodies in a mechanism, the ratio that rounding begins to hide.
LIGHT_BODY_RATIO = 1e-9
#: Part of the independence of the constraints that is left near a singular position.
NEARLY_SINGULAR = 0.01


@dataclass(frozen=True)
class SingularPassage:
    """The nearest point of a passage.

    Attributes
    ----------
    independence
        Least singular value of the constraints, rows and coordinates scaled; of a step
        over a configuration that meets them, or nearly.
    names
        Of joints and drives that depend on each other there.
    """

    t: float
    independence: float
    names: tuple[str, ...]


def singular_passage_notes(
    system: System,
    kernels: Kernels,
    control: loop_state.StepLoopState,
    rtol: float,
    begin: Array,
) -> Iterator[Diagnostic]:
    """Passages of a run that are too near to be sure of what follows (N329).

    Parameters
    ----------
    rtol
        Tolerated error.
    begin
        z_I at the beginning.
    """
    steps = control.n_crossings
    if not steps:
        return
    limit = min(MAX_INDEPENDENCE, max(NEAR_INDEPENDENCE, TOLERANCE_FACTOR * rtol**0.5))
    usual = _independence_at(system, begin)
    passages: list[SingularPassage] = []
    for row in control.crossing_steps[: min(MAX_CROSSINGS, steps)]:
        nearest = _StepMotion(system, kernels, row).nearest_passage(limit, usual)
        if nearest is None:
            continue
        if passages and nearest.t - passages[-1].t < 2.0 * row[STEP_LENGTH]:
            passages[-1] = min(passages[-1], nearest, key=lambda p: p.independence)
        else:
            passages.append(nearest)
    for passage in passages[:MAX_REPORTED]:
        yield diagnose(
            "N329",
            t=passage.t,
            joints=passage.names,
            independence=passage.independence,
            count=len(passages),
        )


class _StepMotion:
    """Motion inside a step: quintic through the states and slopes at its ends."""

    def __init__(self, system: System, kernels: Kernels, row: Array) -> None:
        self.system, self.kernels = system, kernels
        self.work, self.memory = new_work_arrays(system), new_memory(system, 0)
        self.begin, self.h = float(row[STEP_START]), float(row[STEP_LENGTH])
        n, m = system.n_positions, system.n_velocities
        first, last = row[STEP_STATES : STEP_STATES + n + m], row[STEP_STATES + n + m :]
        middle = np.array([self.begin + 0.5 * self.h])
        self.work.interval_time[0] = system.clocks(middle)[0]
        self.ends = [
            self._slopes(self.begin, first[:n], first[n:]),
            self._slopes(self.begin + self.h, last[:n], last[n:]),
        ]

    def nearest_passage(self, limit: float, usual: float) -> SingularPassage | None:
        """Where the constraints are least independent, if that is near.

        Parameters
        ----------
        limit
            Independence that is not near.
        usual
            Independence at another time.
        """
        coarse_rows = [
            self._rows_at_fraction(x) for x in np.linspace(0.0, 1.0, COARSE_POINTS)
        ]
        values = [_least_independence(self.system, B)[1] for B in coarse_rows]
        limit = min(limit, USUAL_FRACTION * max(usual, *values))
        bounds = [
            PATH_FACTOR * _spectral_distance(A, B) for A, B in pairwise(coarse_rows)
        ]
        sums = [a + b for a, b in pairwise(values)]
        if all(s - way > 2.0 * limit for s, way in zip(sums, bounds, strict=True)):
            return None
        best, least = self._minimum()
        B = self._rows_at_fraction(best)
        sizes = constraint_sizes(self.system)
        residuals = np.abs(self.work.row[:, at.C_VALUE]) / sizes
        independence = max(least, float(np.sqrt(2.0 * residuals.max())))
        if independence > limit:
            return None
        t = self.begin + best * self.h
        return SingularPassage(t, independence, dependent_row_names(self.system, B))

    def _minimum(self) -> tuple[float, float]:
        """The share of the step with the least independence, and that."""
        shares = np.linspace(0.0, 1.0, POINTS)
        heights = [self._independence(x) for x in shares]
        k, reach = int(np.argmin(heights)), 1.0 / (POINTS - 1)
        best, least = float(shares[k]), heights[k]
        for _ in range(HALVINGS):
            if least <= ZERO_INDEPENDENCE:
                break
            sides = [max(0.0, best - reach), min(1.0, best + reach)]
            beside = [self._independence(x) for x in sides]
            if np.ptp([least, *beside]) <= RELATIVE_CHANGE * least:
                break
            if min(beside) < least:
                best, least = sides[int(np.argmin(beside))], min(beside)
            reach *= 0.5
        return best, least

    def _slopes(self, t: float, z: Array, v: Array) -> tuple[Array, Array, Array]:
        """z and its first two derivatives."""
        system = self.system
        output_sampling.evaluate_start(
            self.kernels, system.arrays, self.work, self.memory, t, z.copy(), v.copy()
        )
        first, ahead = np.zeros_like(z), np.zeros_like(z)
        rate(system.arrays, z.copy(), v.copy(), first)
        a, small = self.memory.acceleration, STEP * self.h
        rate(system.arrays, z + small * first, v + small * a, ahead)
        return z, first, (ahead - first) / small

    def _independence(self, share: float) -> float:
        return _least_independence(self.system, self._rows_at_fraction(share))[1]

    def _rows_at_fraction(self, share: float) -> Any:
        """Constraints evaluated at a share of the step."""
        z0, d0, c0 = self.ends[0]
        z1, d1, c1 = self.ends[1]
        h, x = self.h, share
        start = z0 + h * d0 * x + 0.5 * h * h * c0 * x * x
        gap = z1 - z0 - h * d0 - 0.5 * h * h * c0
        slope, bend = h * (d1 - d0 - h * c0), h * h * (c1 - c0)
        z = start + x**3 * (
            (10.0 - 15.0 * x + 6.0 * x * x) * gap
            + (-4.0 + 7.0 * x - 3.0 * x * x) * slope
            + 0.5 * (1.0 - 2.0 * x + x * x) * bend
        )
        return _scaled_rows(self.system, self.work, self.begin + x * h, z)


def _independence_at(system: System, begin: Array) -> float:
    """Independence at the beginning of a run."""
    work, t = new_work_arrays(system), system.scene.time.start
    work.interval_time[0] = 0.5 * (t + system.breaks[0])
    return _least_independence(system, _scaled_rows(system, work, t, begin))[1]


def _scaled_rows(system: System, work: WorkArrays, t: float, z: Array) -> Any:
    """Constraints for relative changes, rows of length 1; sparse in large scenes."""
    work_arrays.evaluate(system, work, t, z, np.zeros(system.n_velocities))
    if system.n_rows >= sparse_jacobian.LARGE_SCENE_ROWS:
        return sparse_jacobian.normalised_sparse_rows(
            sparse_jacobian.scaled_sparse_jacobian(system, work.C)
        )
    return normalised_rows(dense_jacobian(system, work.C) * coordinate_sizes(system))


def _least_independence(system: System, B: Any) -> tuple[Array, float]:
    """Rows (rows,) that depend on each other most, and how little they do not."""
    last = system.n_rows - len(system.redundant) - 1
    if not 0 <= last < min(B.shape):
        return np.zeros(system.n_rows), 1.0
    if system.n_rows >= sparse_jacobian.LARGE_SCENE_ROWS:
        return sparse_jacobian.least_independent_combination(B, len(system.redundant))
    left, sizes, _ = np.linalg.svd(B, full_matrices=False)
    return left[:, last], float(sizes[last])


def dependent_names(system: System, t: float, z: Array) -> tuple[str, ...]:
    """Joints and drives that depend on each other most at positions z."""
    work = new_work_arrays(system)
    work.interval_time[0] = float(system.clocks(np.array([t]))[0])
    return dependent_row_names(system, _scaled_rows(system, work, t, z))


def dependent_row_names(system: System, B: Any) -> tuple[str, ...]:
    """Names of normalised rows with a part in their least independent combination."""
    combination, _ = _least_independence(system, B)
    rows = np.flatnonzero(np.abs(combination) > INVOLVED_SHARE)
    return tuple(sorted(set(row_names(system, tuple(map(int, rows))))))


def _spectral_distance(A: Any, B: Any) -> float:
    """More than singular values of matrices can differ by, in the spectral norm."""
    difference = abs(A - B)
    ways = [float(difference.sum(axis=k).max()) for k in (0, 1)]
    return float(np.sqrt(ways[0] * ways[1]))


def joints_at_dead_points(
    system: System, t: float, z: Array, v: Array
) -> tuple[str, ...]:
    """Joints with friction that the motion of their mechanism leaves at rest.

    The rate is that of the joint beside the motion that its constraints leave; joints
    whose motion drives prescribe are not among them.
    """
    if not system.friction_joints or not np.isfinite(z).all():
        return ()
    if system.full_joint_system.n_rows > LARGE_SCENE:
        return ()
    state = InitialState(restore_constraints(system), StateVectors(z, v))
    state.t = t
    state.evaluate()
    scale = coordinate_sizes(system)
    C = state.dense_jacobian() * scale / constraint_sizes(system)[:, None]
    _, sizes, right = np.linalg.svd(C, full_matrices=True)
    rank = int(np.sum(sizes > DEPENDENCE_TOLERANCE * max(1.0, sizes.max(initial=0.0))))
    free = right[rank:]
    if not len(free):
        return ()
    directions = friction_directions(state.system, state.work.C) * scale
    mobility = np.abs(directions @ free.T).max(axis=1)
    is_at_rest = mobility <= DEAD_POINT_TOLERANCE * np.abs(directions).max(axis=1)
    is_prescribed = system.arrays.friction_state[:, at.REST_RATE] > 0.0
    names = [rub.joint for rub in system.friction_joints]
    return tuple(names[j] for j in np.flatnonzero(is_at_rest & ~is_prescribed))


def dead_point_causes(system: System, t: float, z: Array, v: Array) -> list[Diagnostic]:
    """Joints at dead points, where friction is not decided (N504)."""
    names = joints_at_dead_points(system, t, z, v)
    if not names:
        return []
    joints = [system.scene.joints[name] for name in names]
    ends = [marker_reference(m)[0] for joint in joints for m in marker_names(joint)]
    bodies = dict.fromkeys(end for end in ends if end != "ground")
    return [diagnose("N504", t=t, joints=names, bodies=tuple(bodies))]


def step_loop_failure(
    code: int, fastest: str, settings: RunSettings, t: float
) -> Diagnostic:
    """What ended a step loop, of its code (N301 to N306).

    Parameters
    ----------
    fastest
        Body with the fastest change.
    """
    method, rtol = settings.integrator, settings.rtol
    if code == loop_state.TOO_SMALL:
        return diagnose("N302", t=t, fastest=fastest)
    if code == loop_state.OFF_CONSTRAINTS:
        return diagnose("N303", t=t, fastest=fastest)
    if code == loop_state.NO_CONVERGENCE:
        return diagnose("N304", t=t, fastest=fastest, step=settings.step or 0.0)
    if code == loop_state.TOO_STIFF:
        return diagnose("N305", t=t, fastest=fastest, method=method)
    if code == loop_state.BELOW_ROUNDING:
        return diagnose("N306", t=t, method=method, rtol=rtol)
    return diagnose("N301", t=t, fastest=fastest)


def lost_inertia_cause(
    system: System, work: at.WorkArrays, t: float | None = None
) -> Diagnostic | None:
    """A body that has deformed so far that it has no inertia left (N307, N308, N312).

    The mass of a stiffened body is minus infinity then, see
    `dynamics.geometric_stiffening`.

    Parameters
    ----------
    t
        Of a motion [s]; at its start the assembly has deformed what the scene has not.
    """
    for row, body in zip(system.arrays.body, system.bodies, strict=True):
        n, first = int(row[at.NV]), int(row[at.BLOCK])
        M = work.M[first : first + n * n].reshape(n, n)
        is_lost = n > 0 and bool(np.isneginf(M[-1, -1]))
        if n == 0 or body.sid.nq == 0 or not (is_lost or np.isfinite(M).all()):
            continue
        axes = list(IN_PLANE[2] if system.planar else SPATIAL)[: int(row[at.RD])]
        motion = free_motion(body.sid, tuple(axes)) if axes else None
        if motion is not None and not motion.possible:
            return diagnose("N308", body.name, t=t, reason=motion.reason)
        if is_lost or _smallest_scaled_eigenvalue(
            M
        ) < LOST_INERTIA * _smallest_scaled_eigenvalue(
            _undeformed_mass_matrix(body.sid, axes)
        ):
            return _lost_inertia(system, body, t)
    return None


def _lost_inertia(system: System, body: BodyData, t: float | None) -> Diagnostic:
    scene = system.scene
    initial = scene.initial_of(body.name) if body.is_scene_body else None
    by_assembly = scene.initial.state != "static" and (
        getattr(initial, "elastic", None) is None
    )
    if t == scene.time.start and by_assembly:
        return diagnose("N312", body.name, t=t)
    may_help = not body.quadratic_inertia and body.sid.Oe.first_order(body.sid.nq).any()
    remedy = "Set quadratic_inertia = true, or cut" if may_help else "Cut"
    return diagnose("N307", body.name, t=t, remedy=f"{remedy} the body into parts.")


def _smallest_scaled_eigenvalue(M: Array) -> float:
    """The smallest eigenvalue of a mass matrix with ones on its diagonal.

    Minus infinity where an element of the diagonal has no such scale.
    """
    if not (M.diagonal() > 0.0).all():
        return -np.inf
    size = np.sqrt(M.diagonal())
    scaled = M / size / size[:, None]
    if not np.isfinite(scaled).all():
        return -np.inf
    return float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0])


def _undeformed_mass_matrix(sid: SID, axes: list[int]) -> Array:
    """Mass matrix of a body at q = 0 with these coordinates of its frame."""
    keep = [*axes, *range(6, 6 + sid.nq)]
    return coupled_mass_matrix(sid)[np.ix_(keep, keep)]


def infeasible_drive_cause(
    system: System, t: float, z: Array, v: Array
) -> Diagnostic | None:
    """Joints and drives that ask for more than the mechanism can do (N313)."""
    if not np.isfinite(z).all() or not system.n_rows:
        return None
    found = later_contradiction(system, t, z, v)
    if found is None:
        return None
    statement, names = found.statement, found.names
    return diagnose("N313", later=found.t, contradiction=statement, joints=names)


def mass_rounding_cause(system: System, work: at.WorkArrays) -> Diagnostic | None:
    """A body whose inertia is hidden by the rounding of that of another (N309).

    Compared are mass and moments of inertia over the size of the mechanism squared.
    """
    sizes, diagonals = coordinate_sizes(system), {}
    for row, body in zip(system.arrays.body, system.bodies, strict=True):
        n, rd, first = int(row[at.NV]), int(row[at.RD]), int(row[at.BLOCK])
        M = work.M[first : first + n * n].reshape(n, n)
        if rd and np.isfinite(M).all():
            diagonals[body.name] = (M.diagonal() * sizes[row[at.VEL] :][:n] ** 2)[:rd]
    largest = max((inertia.max() for inertia in diagonals.values()), default=0.0)
    lightest = min(diagonals, key=lambda name: diagonals[name].min(), default="")
    if not lightest or diagonals[lightest].min() > LIGHT_BODY_RATIO * largest:
        return None
    heaviest = max(diagonals, key=lambda name: diagonals[name].max())
    ratio = diagonals[lightest].min() / largest
    return diagnose("N309", lightest, ratio=ratio, heaviest=heaviest)


def friction_lock_causes(
    system: System, memory: Memory, t: float, control: loop_state.StepLoopState
) -> list[Diagnostic]:
    """Friction that has hardly a solution, as evaluated last (N501, N504).

    The determinant of its equations, 1 without friction, passes zero there, and loads
    grow without bound (theory, section 14).
    """
    if (
        not system.friction_joints
        or system.arrays.friction_state[:, at.SHARES_MOTION].any()
    ):
        return []
    swaps = np.sum(memory.friction_pivots != np.arange(len(memory.friction_pivots)))
    factors = memory.friction_A.diagonal()
    if (-1.0) ** swaps * np.prod(factors) > MIN_FRICTION_DETERMINANT:
        return []
    joints = tuple(rub.joint for rub in system.friction_joints)
    return [
        diagnose("N501", t=t, joints=joints),
        *dead_point_causes(system, t, control.z, control.v),
    ]


def near_singular_cause(
    system: System, control: loop_state.StepLoopState, passes: bool
) -> Diagnostic | None:
    """A singular configuration close to which a run stops (N310).

    Parameters
    ----------
    passes
        Whether the method passes such configurations, as those of Radau IIA do.
    """
    clearest = control.largest_independence
    if control.independence >= NEARLY_SINGULAR * clearest:
        return None
    remedy = "another step" if control.fixed_step == 1 else "another tolerance"
    if not passes:
        remedy += " or radau9"
    return _singular_cause(system, control.time, control.z, f"Try {remedy}.")


def _singular_cause(system: System, t: float, z: Array, remedy: str) -> Diagnostic:
    joints = dependent_names(system, t, z) if np.isfinite(z).all() else ()
    names = joints or ("the mechanism",)
    return diagnose("N310", t=t, joints=names, remedy=remedy)


def singular_start_causes(
    system: System, work: at.WorkArrays, t: float, z: Array, status: int
) -> tuple[Diagnostic, ...]:
    """Why equations have no solution at the start of an interval (N307 to N312, N719).

    Parameters
    ----------
    status
        1 if a mass matrix is singular, else the constraints are.
    """
    if status != 1:
        remedy = "Start beside it, or change a length or a drive."
        return (_singular_cause(system, t, z, remedy),)
    lost = lost_inertia_cause(system, work, t)
    return (lost or diagnose("N719", t=t),)
