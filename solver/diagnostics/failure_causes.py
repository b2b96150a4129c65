"""Causes of a failed run, as sentences."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.result import FlexibleBody
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, coupled_mass_matrix, free_motion

from ..initial_state.contradictions import later_contradiction
from ..integrators import loop_state
from ..linear.factor_storage import Memory
from ..spatial import system_arrays as at
from ..system.body_data import BodyData
from ..system.characteristic_sizes import coordinate_sizes
from ..system.system import System
from .singular_configurations import undetermined_friction_notes

#: Determinant of the equations of friction near a state without a solution.
MIN_FRICTION_DETERMINANT = 0.1
CAUSES = {
    loop_state.TOO_SMALL: "the step size fell below what the time resolves: the motion "
    "is not smooth here, or a body is blocked",
    loop_state.OFF_CONSTRAINTS: "the constraints could not be met at the end of a step",
    loop_state.NOT_FINITE: "a coordinate became infinite or undefined",
    loop_state.NO_CONVERGENCE: "the Newton iteration diverged with the fixed step",
    loop_state.TOO_STIFF: "the scene is stiff: stability, not accuracy, keeps the "
    "steps "
    "of this explicit method so short that the run would take hundreds of thousands; "
    "use radau5 or radau9",
    loop_state.BELOW_ROUNDING: "rounding hides from this method errors as small as the "
    "tolerance asks for: it cannot be met; ask for a larger one, or use radau9",
}

#: What may help, unless no step can.
REMEDIES = {
    loop_state.OFF_CONSTRAINTS: "; a smaller fixed step may help",
    loop_state.NO_CONVERGENCE: "; a smaller one may help",
}

#: What is said where a body has deformed beyond what its inertia holds for.
INERTIA_LOST_TEXT = "so far that"
#: Part of the smallest eigenvalue of a mass matrix that is left of a lost inertia.
LOST_INERTIA = 1e-2
#: Of the inertia of two bodies in a mechanism, the ratio that rounding begins to hide.
LIGHT_BODY_RATIO = 1e-9
#: Part of the independence of the constraints that is left near a singular position.
NEARLY_SINGULAR = 0.01


def explain_failure(failure: str, bodies: Mapping[str, FlexibleBody]) -> str:
    """The failure, and the bodies that were found to deform without bound.

    Where the failure is that of lost inertia, loads and stiffness at the end are those
    of no body, and nothing is reported of them.
    """
    if not failure or INERTIA_LOST_TEXT in failure:
        return failure
    for name, body in bodies.items():
        if body.found is not None and body.found.diverges:
            failure += f"; {name} {body.found.sentence()}"
    return failure


def lost_inertia_cause(
    system: System, work: at.WorkArrays, t: float | None = None
) -> str:
    """What to know where a body has deformed so far that it has no inertia left.

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
            return (
                f"; the SID of {body.name} has a defect that was accepted: "
                f"{motion.reason}, undeformed as well, so that its frame has no motion "
                "of its own; it can be taken where the frame is prescribed "
                '(frame = "held", or a joint that holds the node in which it rests)'
            )
        if is_lost:
            return (
                f"; {_deformation_text(system, body, t)} its moments of inertia are no "
                "longer positive: J and Oe m1 of its SID hold for small deformations"
            )
        if _smallest_scaled_eigenvalue(M) < LOST_INERTIA * _smallest_scaled_eigenvalue(
            _undeformed_mass_matrix(body.sid, axes)
        ):
            text = (
                f"; {_deformation_text(system, body, t)} the inertia of its SID, which "
                "holds for small deformations, is no longer positive"
            )
            if (
                not body.quadratic_inertia
                and body.sid.Oe.first_order(body.sid.nq).any()
            ):
                text += " (quadratic_inertia = true of the body keeps more of it)"
            return text
    return ""


def _deformation_text(system: System, body: BodyData, t: float | None) -> str:
    scene = system.scene
    initial = scene.initial_of(body.name) if body.is_scene_body else None
    by_assembly = scene.initial.state != "static" and (
        getattr(initial, "elastic", None) is None
    )
    if t == scene.time.start and by_assembly:
        return (
            "the places of bodies and markers in the scene do not meet its joints and "
            f"drives, and to meet them the assembly deforms {body.name} "
            f"{INERTIA_LOST_TEXT}"
        )
    return f"{body.name} has deformed {INERTIA_LOST_TEXT}"


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


def infeasible_drive_cause(system: System, t: float, z: Array, v: Array) -> str:
    """What to know where joints and drives ask for more than the mechanism can do."""
    if not np.isfinite(z).all() or not system.n_rows:
        return ""
    contradiction = later_contradiction(system, t, z, v)
    if not contradiction:
        return ""
    flexible = [body.name for body in system.bodies if body.sid.nq]
    remedy = f"; only deforming {', '.join(flexible)} can help" if flexible else ""
    return f"{contradiction}{remedy}"


def mass_rounding_cause(system: System, work: at.WorkArrays) -> str:
    """What to know where rounding of large inertia hides that of a body.

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
        return ""
    heaviest = max(diagonals, key=lambda name: diagonals[name].max())
    ratio = diagonals[lightest].min() / largest
    return (
        f"; the inertia of {lightest} is {ratio:.1g} of that of {heaviest}, which "
        "rounding hides: give it more, or put a joint in its place (a massless rod is "
        "one of type distance)"
    )


def friction_lock_cause(
    system: System, memory: Memory, t: float, control: loop_state.StepLoopState
) -> str:
    """What to know where friction has hardly a solution, as evaluated last.

    The determinant of its equations, 1 without friction, passes zero there, and loads
    grow without bound (theory, section 14).
    """
    if (
        not system.friction_joints
        or system.arrays.friction_state[:, at.SHARES_MOTION].any()
    ):
        return ""
    swaps = np.sum(memory.friction_pivots != np.arange(len(memory.friction_pivots)))
    factors = memory.friction_A.diagonal()
    if (-1.0) ** swaps * np.prod(factors) > MIN_FRICTION_DETERMINANT:
        return ""
    joint_names = ", ".join(rub.joint for rub in system.friction_joints)
    return (
        f"; friction ({joint_names}) has no solution here or close by, or several: "
        "the load that it makes feeds it, and grows without bound"
        f"{undetermined_friction_notes(system, t, control.z, control.v)}"
    )


def near_singular_cause(control: loop_state.StepLoopState, passes: bool) -> str:
    """What to know where a run stops close to a singular configuration.

    Parameters
    ----------
    passes
        Whether the method passes such positions, as those of Radau IIA do.
    """
    clearest = control.largest_independence
    if control.independence >= NEARLY_SINGULAR * clearest:
        return ""
    remedy = "another step" if control.fixed_step == 1 else "another tolerance"
    if not passes:
        remedy += " or radau9"
    return (
        "; the constraints hardly differ from each other here (singular position): "
        f"{remedy} may pass it"
    )


def singular_system_message(
    system: System, work: at.WorkArrays, t: float, status: int
) -> str:
    lost = lost_inertia_cause(system, work, t) if status == 1 else ""
    if lost:
        return f"stopped at t = {t:.9g} s{lost}"
    if status == 1:
        return (
            f"stopped at t = {t:.9g} s: the mass matrix of a body is singular; a body "
            "that can rotate needs inertia, a flexible one shape functions with mass"
        )
    return (
        f"stopped at t = {t:.9g} s: the constraints depend on each other here "
        "(singular position)"
    )
