"""The equations of motion of a scene, eq. (3): evaluation and linearisation.

The kernels are compiled for plane and space; `kernel_pointers` gives the function
pointers through which Python and the integrators call them.
"""

from functools import cache
from typing import Any

from ..compiler.arrays import Pointer
from ..compiler.kernels import Entry, entry, inner
from ..compiler.types import float64, int64
from ..linear import accelerations, newton_matrix
from ..linear.factor_storage import COMPLETE, EVALUATE, KERNELS, LINEARISE, Kernels
from ..linear.joint_friction import linearise_friction, stick_constraints
from ..spatial.algebra import load, size
from ..spatial.coordinates import rate, retract
from ..spatial.dimension import BySpace, as_planar, as_spatial
from ..spatial.system_arrays import FREE, STIFFENED, SYSTEM, WORK
from .body import evaluate_body
from .body_derivatives import linearise_body, linearise_stiffened_inertia
from .body_frames import free_frame, prescribed_frame
from .constraint_rows import clear_inactive_derivatives, clear_inactive_rows
from .constraints import evaluate_constraints, linearise_constraints
from .control_laws import law_value
from .force_measures import update_rotations
from .forces import evaluate_forces, linearise_forces
from .geometric_stiffening import add_stiffened_inertia
from .marker_forces import marker_acceleration
from .markers import evaluate_marker


@inner()
def _keep_planar_rotations(system, work, z):
    pass


update_rotation_counters = BySpace(plane=_keep_planar_rotations, space=update_rotations)


@inner()
def _evaluate_bodies(system, work, t, z, v):
    """Frames, markers, mass matrices and forces of all bodies.

    Bodies are sorted so that a prescribed frame comes after its base; markers are
    sorted by body.
    """
    m, markers = 0, len(system.marker)
    for b in range(len(system.body)):
        if system.body[b].motion == FREE:
            free_frame(system, work, b, z, v)
        else:
            prescribed_frame(system, work, b, t)
        while m < markers and system.marker[m].body == b:
            evaluate_marker(system, work, m, z, v)
            m += 1
        evaluate_body(system, work, b, z, v)
        if system.body[b].flags & STIFFENED:
            add_stiffened_inertia(system, work, b, z, v)


@inner()
def _evaluate_state(system, work, t, z, v):
    _evaluate_bodies(system, work, t, z, v)
    update_rotation_counters(system, work, z)
    evaluate_forces(system, work, t, z, v)
    evaluate_constraints(system, work, t)


@entry(float64(SYSTEM, WORK, int64, float64))
def law_value_at(system, work, k, t):
    """Value of the law of row k at the state that was just evaluated."""
    return law_value(system, as_planar(work), k, t, False)


@inner()
def _linearise_state(system, work, t, z, v, acc, lambda_):
    for b in range(len(system.body)):
        linearise_body(system, work, b, z, v, acc)
        if system.body[b].flags & STIFFENED:
            linearise_stiffened_inertia(system, work, b, z, v, acc)
    linearise_constraints(system, work, t, v, acc, lambda_)
    linearise_forces(system, work, t, v)


@inner()
def _complete_accelerations(system, work, acc):
    for m in range(len(system.marker)):
        point = work.point[m]
        a, al = marker_acceleration(system, work, m, acc)
        point.a, point.al = a, al
    for b in range(len(system.body)):
        row, frame, n = system.body[b], work.frame[b], size(work.frame[b].x)
        if row.rd >= n:
            frame.a = frame.a + load(frame.a, acc, row.vel)
        if row.rd > n:
            frame.al = frame.al + load(frame.al, acc, row.vel + n)


def _entry_kernels(view: Any, space: str) -> tuple[Entry, Entry, Entry]:
    """The kernels of plane or space.

    Parameters
    ----------
    view
        How they see works.
    """

    def evaluate(system, work, t, z, v):
        """Everything that eq. (11) needs at one state: M, f, C, c, dc/dt and gamma."""
        _evaluate_state(system, view(work), t, z, v)
        clear_inactive_rows(system, work)
        stick_constraints(system, work)

    def linearise(system, work, t, z, v, acc, lambda_):
        """Rp, Rv, Gp, Gv at a state just evaluated, see constraints and forces."""
        _linearise_state(system, view(work), t, z, v, acc, lambda_)
        clear_inactive_derivatives(system, work)
        linearise_friction(system, work)

    def complete(system, work, acc):
        """Adds what z_II' contributes to the accelerations of frames and markers."""
        _complete_accelerations(system, view(work), acc)

    for kernel in (evaluate, linearise, complete):
        kernel.__qualname__ = f"{kernel.__name__}_in_{space}"
    return (
        entry(EVALUATE)(evaluate),
        entry(LINEARISE)(linearise),
        entry(COMPLETE)(complete),
    )


evaluate_in_plane, linearise_in_plane, complete_in_plane = _entry_kernels(
    as_planar, "plane"
)
evaluate_in_space, linearise_in_space, complete_in_space = _entry_kernels(
    as_spatial, "space"
)


def kernels_by_name(planar: bool) -> dict[str, Entry]:
    """The kernels of planar or spatial scenes, by the fields of `Kernels`."""
    in_plane = evaluate_in_plane, linearise_in_plane
    in_space = evaluate_in_space, linearise_in_space
    evaluate, linearise = in_plane if planar else in_space
    complete = complete_in_plane if planar else complete_in_space
    return {
        "evaluate": evaluate,
        "linearise": linearise,
        "solve_accelerations": accelerations.solve_accelerations,
        "project_once": accelerations.project_once,
        "store_linearisation": newton_matrix.store_linearisation,
        "factor_real": newton_matrix.newton_factor,
        "factor_complex": newton_matrix.newton_factor,
        "solve_real": newton_matrix.newton_solve,
        "solve_complex": newton_matrix.newton_solve,
        "rate": rate,
        "retract": retract,
        "complete": complete,
    }


@cache
def kernel_pointers(planar: bool) -> Kernels:
    """Pointers to the kernels of planar or spatial scenes; they are loaded or compiled
    once.
    """
    pointers = {}
    for name, kernel in kernels_by_name(planar).items():
        signature = KERNELS.members[name].signature
        pointers[name] = Pointer(kernel.address(signature), signature)
    return Kernels(**pointers)
