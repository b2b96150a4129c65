"""Why a run stopped, in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sidtool.formats.result import FlexibleBody
from sidtool.formats.sid import SID, Array
from sidtool.formats.sid_mass import IN_PLANE, SPATIAL, coupled_mass_matrix, free_motion

from ..integrators import stepping
from ..linear.memory import Memory
from ..space import layout as at
from ..start.conflicts import conflict_soon
from ..system.bodies.data import BodyData
from ..system.scene import System
from ..system.sizes import coordinate_sizes
from .dead_points import undecided

#: Determinant of the equations of friction near a state without a solution.
NEARLY_JAMMED = 0.1
CAUSES = {
    stepping.TOO_SMALL: "the step size fell below what the time resolves: the motion "
    "is not smooth here, or a body is blocked",
    stepping.OFF_CONSTRAINTS: "the constraints could not be met at the end of a step",
    stepping.NOT_FINITE: "a coordinate became infinite or undefined",
    stepping.NO_CONVERGENCE: "the Newton iteration diverged with the fixed step",
    stepping.CRAWLING: "the scene is stiff: stability, not accuracy, keeps the steps "
    "of this explicit method so short that the run would take hundreds of thousands; "
    "use radau5 or radau9",
    stepping.BLURRED: "rounding hides from this method errors as small as the "
    "tolerance asks for: it cannot be met; ask for a larger one, or use radau9",
}

#: What may help, unless no step can.
REMEDIES = {
    stepping.OFF_CONSTRAINTS: "; a smaller fixed step may help",
    stepping.NO_CONVERGENCE: "; a smaller one may help",
}

#: What is said where a body has deformed beyond what its inertia holds for.
INERTIA_LOST = "so far that"
#: Part of the smallest eigenvalue of a mass matrix that is left of a lost inertia.
LOST = 1e-2
#: Of the inertia of two bodies in a mechanism, the ratio that rounding begins to hide.
LIGHT = 1e-9
#: Part of the independence of the constraints that is left near a singular position.
NEARLY_SINGULAR = 0.01


def explained(failure: str, bodies: Mapping[str, FlexibleBody]) -> str:
    """The failure, and the bodies that were found to deform without bound.

    Where the failure is that of lost inertia, loads and stiffness at the end are those
    of no body, and nothing is told of them.
    """
    if not failure or INERTIA_LOST in failure:
        return failure
    for name, body in bodies.items():
        if body.found is not None and body.found.diverges:
            failure += f"; {name} {body.found.sentence()}"
    return failure


def lost_inertia(system: System, work: at.Work, t: float | None = None) -> str:
    """What to know where a body has deformed so far that it has no inertia left.

    The mass of a stiffened body is minus infinity then, see `kernels.stiffened`.

    t : of a motion [s]; at its start the assembly has deformed what the scene has not
    """
    for row, body in zip(system.arrays.body, system.bodies, strict=True):
        n, first = int(row[at.NV]), int(row[at.BLOCK])
        M = work.M[first : first + n * n].reshape(n, n)
        lost = n > 0 and bool(np.isneginf(M[-1, -1]))
        if n == 0 or body.sid.nq == 0 or not (lost or np.isfinite(M).all()):
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
        if lost:
            return (
                f"; {_deformed(system, body, t)} its moments of inertia are no "
                "longer positive: J and Oe m1 of its SID hold for small deformations"
            )
        if _least(M) < LOST * _least(_undeformed(body.sid, axes)):
            text = (
                f"; {_deformed(system, body, t)} the inertia of its SID, which "
                "holds for small deformations, is no longer positive"
            )
            if (
                not body.quadratic_inertia
                and body.sid.Oe.first_order(body.sid.nq).any()
            ):
                text += " (quadratic_inertia = true of the body keeps more of it)"
            return text
    return ""


def _deformed(system: System, body: BodyData, t: float | None) -> str:
    scene = system.scene
    stated = scene.initial_of(body.name) if body.of_scene else None
    by_assembly = scene.initial.state != "static" and (
        getattr(stated, "elastic", None) is None
    )
    if t == scene.time.start and by_assembly:
        return (
            "the places of bodies and markers in the scene do not meet its joints and "
            f"drives, and to meet them the assembly deforms {body.name} {INERTIA_LOST}"
        )
    return f"{body.name} has deformed {INERTIA_LOST}"


def _least(M: Array) -> float:
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


def _undeformed(sid: SID, axes: list[int]) -> Array:
    """Mass matrix of a body at q = 0 with these coordinates of its frame."""
    keep = [*axes, *range(6, 6 + sid.nq)]
    return coupled_mass_matrix(sid)[np.ix_(keep, keep)]


def demanded_too_much(system: System, t: float, z: Array, v: Array) -> str:
    """What to know where joints and drives ask for more than the mechanism can do."""
    if not np.isfinite(z).all() or not system.n_rows:
        return ""
    why = conflict_soon(system, t, z, v)
    if not why:
        return ""
    flexible = [body.name for body in system.bodies if body.sid.nq]
    bent = f"; only deforming {', '.join(flexible)} can help" if flexible else ""
    return f"{why}{bent}"


def too_light(system: System, work: at.Work) -> str:
    """What to know where rounding of large inertia hides that of a body.

    Compared are mass and moments of inertia over the size of the mechanism squared.
    """
    sizes, found = coordinate_sizes(system), {}
    for row, body in zip(system.arrays.body, system.bodies, strict=True):
        n, rd, first = int(row[at.NV]), int(row[at.RD]), int(row[at.BLOCK])
        M = work.M[first : first + n * n].reshape(n, n)
        if rd and np.isfinite(M).all():
            found[body.name] = (M.diagonal() * sizes[row[at.VEL] :][:n] ** 2)[:rd]
    largest = max((inertia.max() for inertia in found.values()), default=0.0)
    lightest = min(found, key=lambda name: found[name].min(), default="")
    if not lightest or found[lightest].min() > LIGHT * largest:
        return ""
    heaviest = max(found, key=lambda name: found[name].max())
    ratio = found[lightest].min() / largest
    return (
        f"; the inertia of {lightest} is {ratio:.1g} of that of {heaviest}, which "
        "rounding hides: give it more, or put a joint in its place (a massless rod is "
        "one of type distance)"
    )


def jammed(system: System, memory: Memory, t: float, control: stepping.Control) -> str:
    """What to know where friction has hardly a solution, as evaluated last.

    The determinant of its equations, 1 without friction, passes zero there, and loads
    grow without bound (theory, section 14).
    """
    if not system.rubbing or system.arrays.grip[:, at.SHARED].any():
        return ""
    swaps = np.sum(memory.rub_pivots != np.arange(len(memory.rub_pivots)))
    factors = memory.rub_A.diagonal()
    if (-1.0) ** swaps * np.prod(factors) > NEARLY_JAMMED:
        return ""
    names = ", ".join(rub.joint for rub in system.rubbing)
    return (
        f"; friction ({names}) has no solution here or close by, or several: the load "
        "that it makes feeds it, and grows without bound"
        f"{undecided(system, t, control.z, control.v)}"
    )


def near_singular(control: stepping.Control, passes: bool) -> str:
    """What to know where a run stops close to a singular position.

    passes : whether the method passes such positions, as those of Radau IIA do
    """
    clearest = control.clearest
    if control.independence >= NEARLY_SINGULAR * clearest:
        return ""
    remedy = "another step" if control.fixed_step == 1 else "another tolerance"
    if not passes:
        remedy += " or radau9"
    return (
        "; the constraints hardly differ from each other here (singular position): "
        f"{remedy} may pass it"
    )


def singular(system: System, work: at.Work, t: float, status: int) -> str:
    lost = lost_inertia(system, work, t) if status == 1 else ""
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
