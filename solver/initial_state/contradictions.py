"""Constraints that contradict each other: where they are least violated, and why.

In the state of least squares the weighted residuals r are balanced, C^T r = 0. The
joints and drives whose residuals remain are reduced to a set that still contradicts.

References
----------
K. Levenberg: A Method for the Solution of Certain Non-Linear Problems in Least
Squares. Quart. Appl. Math. 2 (1944).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import marker_names, marker_reference

from ..spatial import system_arrays as at
from ..spatial.coordinates import retract
from ..system import work_arrays
from ..system.characteristic_sizes import coordinate_sizes
from ..system.system import System
from ..system.work_arrays import new_work_arrays
from .constraint_jacobian import InitialState, assemble_position
from .displacement_report import displacements
from .given_state import StateVectors, initial_estimate, set_prescribed_frame
from .sparse_jacobian import LARGE_SCENE_ROWS, sparse_constraint_jacobian

#: Steps, and the gradient at which they end, relative to the cost.
MAX_STEPS, GRADIENT_TOLERANCE = 60, 1e-14
#: Damping at the beginning and at the end of rates, that of coordinates at a limit.
INITIAL_DAMPING, MIN_DAMPING, MAX_DAMPING = 1.0, 1e-9, 1e12

#: Constraints that are open by more, relative to their sizes, are not met.
VIOLATED = 1e-7
#: Joints and drives that are tried one by one, in scenes of up to so many constraints,
#: and in larger ones, where that part of what is open counts.
MAX_TESTED, LARGE_SCENE = 60, 200
FEW_NAMES, RELEVANT_PART = 12, 1e-4
#: Names that are listed of many.
LISTED_NAMES = 4
#: What joints that are met weigh against the one that is not, where their markers are
#: nearest, one weight after the other.
WEIGHTS = (3.0, 30.0, 300.0, 1e4)
#: Places from which the nearest one is sought, and how far they lie beside, relative.
TRIAL_STATES, TRIAL_DISTANCE = 3, 0.05
#: Parts of the time span after which drives are asked what they demand next.
LATER_FRACTIONS = (1e-3, 1e-2, 5e-2)
#: Markers that come as near, relative to the size of the mechanism, meet.
COINCIDENT_DISTANCE = 1e-4
COMPATIBLE = "lengths, drives and joints that fit together"
#: Joints that hold two points together.
POINT_JOINTS = ("revolute", "spherical", "universal", "fixed", "coincident")


def least_squares_state(state: InitialState, weight: Array) -> None:
    """Moves the state to where the weighted residuals are least.

    Source: K. Levenberg, Quart. Appl. Math. 2 (1944): damped least squares.
    """
    damping = INITIAL_DAMPING
    for _ in range(MAX_STEPS):
        r = weight * state.residual
        A, sizes = _weighted_jacobian(state, weight)
        cost, right = float(r @ r), -(A.T @ r)
        if np.linalg.norm(right) <= GRADIENT_TOLERANCE * max(cost, 1.0):
            return
        base, frame = state.z.copy(), state.work.frame.copy()
        while damping < MAX_DAMPING:
            state.z[:] = base
            step = sizes * _solve_damped(A, damping, right)
            retract(state.system.arrays, frame, state.z, step)
            state.evaluate()
            weighted = weight * state.residual
            if float(weighted @ weighted) < cost:
                damping = max(0.2 * damping, MIN_DAMPING)
                break
            damping *= 4.0
        else:
            state.z[:] = base
            state.evaluate()
            return


def velocity_residual(state: InitialState, rates: Array) -> Array:
    """What remains of rates of the constraints at the velocities that suit them best,
    relative to the sizes of the rows."""
    weight = np.where(state.ignored, 0.0, 1.0 / state.sizes)
    A, _ = _weighted_jacobian(state, weight)
    r = weight * rates
    return np.asarray(r - A @ _solve_damped(A, MIN_DAMPING**1.5, A.T @ r))


def _weighted_jacobian(state: InitialState, weight: Array) -> tuple[Any, Array]:
    """The weighted Jacobian for relative changes of what may move, and their sizes."""
    sizes = coordinate_sizes(state.system) * state.free
    if state.system.n_rows < LARGE_SCENE_ROWS:
        return weight[:, None] * state.dense_jacobian() * sizes, sizes
    from scipy.sparse import diags_array

    C = sparse_constraint_jacobian(state.system, state.work.C)
    used = np.where(state.ignored, 0.0, weight)
    return (diags_array(used) @ C @ diags_array(sizes)).tocsr(), sizes


def _solve_damped(A: Any, damping: float, right: Array) -> Array:
    """x of (A^T A + damping) x = right."""
    if isinstance(A, np.ndarray):
        normal = A.T @ A + damping * np.eye(A.shape[1])
        return np.asarray(np.linalg.solve(normal, right), np.float64)
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import spsolve

    normal = (A.T @ A + damping * eye_array(A.shape[1])).tocsc()
    return np.asarray(spsolve(normal, right), np.float64)


def initial_contradiction(system: System) -> tuple[str, str]:
    """Why the start position is not reached, and what would do, in words; both are
    empty where that is not known."""
    full = system.full_joint_system
    state = InitialState(full, initial_estimate(full))
    names, is_satisfied = _contradiction_test(state)
    why = _contradiction_text(full, names)
    gap = _smallest_gap(state, is_satisfied, names)
    if gap is None:
        return why, COMPATIBLE if names else ""
    if gap.gap > COINCIDENT_DISTANCE * full.length:
        return f"{why}; {gap}", COMPATIBLE
    return (
        "the way from the initial positions to where joints and drives are met was not "
        "found",
        "initial positions near a start that meets them, such as "
        f"{_positions_text(state)}",
    )


@dataclass(frozen=True)
class Contradiction:
    """Joints and drives that cannot be met from a time [s] on.

    Attributes
    ----------
    statement
        In words, with a gap or a point mass where one is known.
    """

    t: float
    names: tuple[str, ...]
    statement: str

    def __str__(self) -> str:
        return f"at t = {self.t:.4g} s {self.statement}"


def later_contradiction(
    system: System, t: float, z: Array, v: Array
) -> Contradiction | None:
    """What cannot be met a little after a time t [s] of a run in the state z, v."""
    span = system.scene.time
    for share in LATER_FRACTIONS:
        later_time = min(t + share * (span.end - span.start), span.end)
        state = undeformed_state(system, later_time, z, v)
        names, is_satisfied = _contradiction_test(state)
        gap = _smallest_gap(state, is_satisfied, names) if names else None
        if names and (gap is None or gap.gap > COINCIDENT_DISTANCE * system.length):
            text = _contradiction_text(state.system, names)
            return Contradiction(later_time, tuple(names), text)
    return None


def velocity_contradiction(system: System, t: float, z: Array, v: Array) -> str:
    """Why no velocities meet all joints and drives in a state at a time t [s]."""
    state = undeformed_state(system, t, z, v)
    state.ignored[:] = False
    state.evaluate()
    rates = state.work.row[:, at.C_RATE].copy()
    size = max(1.0 / state.duration, state.largest_relative(rates))

    def has_velocities() -> bool:
        if _is_large_scene(state):
            return (
                float(np.abs(velocity_residual(state, rates)).max()) <= VIOLATED * size
            )
        residual = state.minimum_norm(np.where(state.ignored, 0.0, -rates))[1]
        return state.largest_relative(residual) <= VIOLATED * size

    if has_velocities():
        return ""
    names = _candidate_names(state, velocity_residual(state, rates))
    return _contradiction_text(
        state.system, _contradicting_names(state, names, has_velocities)
    )


def undeformed_state(system: System, t: float, z: Array, v: Array) -> InitialState:
    """The scene with all of its joints at a time t, its bodies where a run has them."""
    work, full = new_work_arrays(system), system.full_joint_system
    work.interval_time[0] = float(system.clocks(np.array([t]))[0])
    work_arrays.evaluate(system, work, t, z, v)
    start = initial_estimate(full)
    for b, body in enumerate(full.bodies):
        if not body.is_scene_body:
            continue
        frame = work.frame[system.index(body.name)]
        set_prescribed_frame(full, b, frame, start.z, start.v)
    if full.n_rotation_counters == system.n_rotation_counters:
        start.z[len(start.z) - full.n_rotation_counters :] = z[
            len(z) - full.n_rotation_counters :
        ]
    state = InitialState(full, StateVectors(start.z, start.v))
    state.t = t
    state.work.interval_time[0] = work.interval_time[0]
    return state


def _is_large_scene(state: InitialState) -> bool:
    return state.system.n_rows > LARGE_SCENE


def _candidate_names(state: InitialState, residual: Array) -> list[str]:
    """Joints and drives that may have a part in a contradiction.

    Parameters
    ----------
    residual : (rows,)
        Residuals where they are least, relative to sizes; in large scenes only what is
        open there has a part.
    """
    rows, drives = state.system.rows, state.system.scene.drives
    if not _is_large_scene(state):
        return list(dict.fromkeys(row.name for row in rows))
    open_ = np.abs(residual) > RELEVANT_PART * np.abs(residual).max()
    candidates = [r.name for r in rows if open_[r.first : r.first + r.count].any()]
    return sorted(dict.fromkeys(candidates), key=lambda name: name not in drives)


def _contradicting_names(
    state: InitialState, names: list[str], is_satisfied: Callable[[], bool]
) -> list[str]:
    """Those of some joints and drives without each of which something holds.

    All of them where they are too many to be tried.
    """
    if _is_large_scene(state) and len(names) > FEW_NAMES:
        return names
    ignored_before, contradicting = state.ignored.copy(), []
    for name in names[:MAX_TESTED]:
        state.ignored[_row_mask(state.system, name)] = True
        if is_satisfied():
            contradicting.append(name)
        state.ignored[:] = ignored_before
    return contradicting


def _contradiction_text(system: System, names: list[str]) -> str:
    if system.n_rows > LARGE_SCENE and len(names) > FEW_NAMES:
        more = len(names) - LISTED_NAMES
        return (
            f"{', '.join(names[:LISTED_NAMES])} and {more} others contradict each other"
        )
    return _names_text(names) + _point_mass_text(system, names)


def _point_mass_text(system: System, names: list[str]) -> str:
    """Point masses whose angle a drive of one of the joints or drives prescribes."""
    scene = system.scene
    driven = [d.joint for n, d in scene.drives.items() if n in names and d.joint]
    ends = {
        marker_reference(text)[0]
        for joint in driven
        if scene.joints[joint].type == "revolute"
        for text in marker_names(scene.joints[joint])
    }
    masses = [d.name for d in system.bodies if d.name in ends and not d.rotates]
    masses = [name for name in masses if name in scene.bodies]
    return f"; {masses[0]} is a point mass, which does not rotate" if masses else ""


def _names_text(names: list[str]) -> str:
    """ "a, b and c contradict each other ..."; empty without names."""
    if not names:
        return ""
    if len(names) == 1:
        return f"{names[0]} cannot be met, which all the others can without it"
    return (
        f"{', '.join(names[:-1])} and {names[-1]} contradict each other (without any "
        "one of them the rest can be met)"
    )


def _contradiction_test(state: InitialState) -> tuple[list[str], Callable[[], bool]]:
    """What contradicts what, empty if all can be met; and the test of what is met, from
    where the state is now."""
    remove_deformation(state)
    z = state.z.copy()

    def is_satisfied() -> bool:
        state.z[:] = z
        state.evaluate()
        if _is_large_scene(state):
            least_squares_state(state, 1.0 / state.sizes)
            return state.scaled_residual <= VIOLATED
        return assemble_position(state) <= VIOLATED

    if is_satisfied():
        return [], is_satisfied
    names = _candidate_names(state, state.residual / state.sizes)
    return _contradicting_names(state, names, is_satisfied), is_satisfied


def remove_deformation(state: InitialState) -> None:
    """Takes the deformation from a state, and from what may move it."""
    for row in state.system.arrays.body:
        nq = int(row[at.NQ])
        if nq:
            last, end = int(row[at.VEL] + row[at.NV]), int(row[at.POS] + row[at.NP])
            state.free[last - nq : last] = False
            state.z[end - nq : end] = 0.0
    state.evaluate()


def _row_mask(system: System, name: str) -> NDArray[np.bool_]:
    """(rows,) true for those of a joint or a drive."""
    mask = np.zeros(system.n_rows, bool)
    for row in system.rows:
        if row.name == name:
            mask[row.first : row.first + row.count] = True
    return mask


@dataclass(frozen=True)
class JointGap:
    """How far the markers of a joint stay apart when all the others are met [m]."""

    name: str
    markers: tuple[str, str]
    gap: float

    def __str__(self) -> str:
        a, b = self.markers
        return f"{a} and {b} ({self.name}) come no nearer than {self.gap:.3g} m"


def _smallest_gap(
    state: InitialState, is_satisfied: Callable[[], bool], names: list[str]
) -> JointGap | None:
    """Of joints that contradict each other, the last that holds points together.

    Ends in the state where its markers are nearest.
    """
    joints = state.system.scene.joints
    for name in reversed([row.name for row in state.system.rows]):
        joint = joints.get(name)
        if joint is None or joint.type not in POINT_JOINTS or name not in names:
            continue
        mask = _row_mask(state.system, name)
        state.ignored[mask] = True
        alone = is_satisfied()
        state.ignored[mask] = False
        if alone:
            a, b = marker_names(joint)
            return JointGap(name, (a, b), _minimal_distance(state, mask, a, b))
    return None


def _positions_text(state: InitialState) -> str:
    """Where the bodies are that lie elsewhere than the scene puts them, in words."""
    system = state.system
    displacements_of_bodies = displacements(system, state.work)
    displaced = [
        n
        for n, (way, turn) in displacements_of_bodies.items()
        if max(way / system.length, turn) > COINCIDENT_DISTANCE
    ]
    texts = []
    for name in displaced[:3]:
        row = system.arrays.body[system.index(name)]
        p, axes = int(row[at.POS]), 2 if system.planar else 3
        position = state.z[p : p + axes]
        position = np.where(
            np.abs(position) > COINCIDENT_DISTANCE * system.length, position, 0.0
        )
        text = ", ".join(f"{x:.4g}" for x in position)
        text = f"{name}.initial.position = [{text}]"
        if system.planar and row[at.NP] - row[at.NQ] > axes:
            text += f" and angle = {state.z[p + 2]:.4g}"
        texts.append(text)
    return ", ".join(texts)


def _minimal_distance(
    state: InitialState, rows: NDArray[np.bool_], a: str, b: str
) -> float:
    """Distance of two markers where they are nearest, sought from some places."""
    z, random = state.z.copy(), np.random.default_rng(0)
    least, nearest_z = np.inf, z
    for _ in range(1 if _is_large_scene(state) else TRIAL_STATES):
        state.z[:] = z
        state.evaluate()
        step = TRIAL_DISTANCE * random.standard_normal(len(state.v)) * state.free
        step *= coordinate_sizes(state.system)
        retract(state.system.arrays, state.work.frame.copy(), state.z, step)
        state.evaluate()
        _minimise_gap(state, rows)
        gap = _marker_distance(state, a, b)
        if gap < least:
            least, nearest_z = gap, state.z.copy()
    state.z[:] = nearest_z
    state.evaluate()
    return least


def _marker_distance(state: InitialState, a: str, b: str) -> float:
    axes = 2 if state.system.planar else 3
    ends = [
        state.work.point[state.system.markers[marker_reference(text)]][:axes]
        for text in (a, b)
    ]
    return float(np.linalg.norm(ends[1] - ends[0]))


def _minimise_gap(state: InitialState, rows: NDArray[np.bool_]) -> None:
    """Moves the state to where some rows are least open while the others are met."""
    for weight in WEIGHTS:
        least_squares_state(state, np.where(rows, 1.0, weight) / state.sizes)
