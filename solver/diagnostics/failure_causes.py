"""Causes of a failed run, as diagnostics."""

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, coupled_mass_matrix, free_motion

from ..initial_state.contradictions import later_contradiction
from ..initial_state.integrator_start import RunSettings
from ..integrators import loop_state
from ..linear.factor_storage import Memory
from ..spatial import system_arrays as at
from ..system.body_data import BodyData
from ..system.characteristic_sizes import coordinate_sizes
from ..system.system import System
from .singular_configurations import dead_point_causes, dependent_names

#: Determinant of the equations of friction near a state without a solution.
MIN_FRICTION_DETERMINANT = 0.1
#: Part of the smallest eigenvalue of a mass matrix that is left of a lost inertia.
LOST_INERTIA = 1e-2
#: Of the inertia of two bodies in a mechanism, the ratio that rounding begins to hide.
LIGHT_BODY_RATIO = 1e-9
#: Part of the independence of the constraints that is left near a singular position.
NEARLY_SINGULAR = 0.01


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
