"""Floating-frame multibody solver for bodies given as SIDs.

The equation numbers in the docstrings are those of ``docs/theory.md``. Packages, from
the lowest to the highest; each one imports only from those listed before it:

- `compiler`: compiles Python functions (kernels) to machine code and caches them
- `spatial`: algebra of plane and space, coordinates, the arrays of the kernels
- `linear`: linear systems: accelerations, projections, Newton matrices, eq. (17)
- `dynamics`: kinematics, eq. (4)-(7); equations of bodies, eq. (10)-(12); constraints,
  eq. (14); forces, eq. (16)
- `functions`: functions of time, tables, callables and control laws
- `system`: from a scene and its SIDs to the arrays that the kernels read
- `integrators`: step loops, eq. (18)-(22)
- `initial_state`: consistent initial conditions, redundant constraints
- `output`: output quantities, energies, dense output and events
- `diagnostics`: notes and warnings on a scene and on a run, causes of failure
- `analyses`: static equilibrium, natural modes, inverse dynamics
- `simulation`: one run from the initial state to the result

References
----------
A. Held, A. Hildebrandt: Flexible Multibody Simulations with Global Shape Functions
Obtained from Isogeometric Finite Element Models.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sidtool.formats.base.sid import SID, Array
    from sidtool.formats.scene import SceneFile

    from .analyses.inverse_dynamics import inverse_dynamics as inverse_dynamics
    from .analyses.linearisation import linearise as linearise
    from .analyses.static_equilibrium import static_equilibrium as static_equilibrium
    from .diagnostics.run_summary import describe as describe
    from .functions.callables import Derivatives, Timed as Timed
    from .functions.control_laws import Law as Law
    from .simulation.simulate import simulate as simulate
    from .system.system import System

_ELSEWHERE = {
    "simulate": "sidtool.solver.simulation.simulate",
    "describe": "sidtool.solver.diagnostics.run_summary",
    "static_equilibrium": "sidtool.solver.analyses.static_equilibrium",
    "linearise": "sidtool.solver.analyses.linearisation",
    "inverse_dynamics": "sidtool.solver.analyses.inverse_dynamics",
    "Law": "sidtool.solver.functions.control_laws",
    "Timed": "sidtool.solver.functions.callables",
}


def compile_scene(
    scene: SceneFile,
    base_folder: str | Path = ".",
    sids: Mapping[str, SID] | None = None,
    accept_defects: bool = False,
    drives: Mapping[str, Derivatives | Law] | None = None,
    keep_joints: bool = False,
    forces: Mapping[str, Derivatives | Law] | None = None,
    before: System | None = None,
) -> System:
    """Compiles a scene into the tables that the kernels integrate.

    Parameters
    ----------
    base_folder
        Paths of SID files in the scene are relative to it.
    sids
        SIDs that replace the files of the bodies with these names.
    accept_defects
        Take SIDs whose coupled mass matrix is indefinite, and joints and forces on
        nodes where all shape functions vanish.
    drives
        Callables that replace the functions of the drives with these names: f(t), or a
        tuple of f and its first, or first two, derivatives, or one of these as
        `Timed(f, times=..., shortest=...)`: a feature that lasts less than 1/4096 of
        the run may be missed unless that says where or how short it is. A `Law` gives
        what a drive with `of = "acceleration"` prescribes.
    keep_joints
        Keep all joints as constraints, whose forces are then known, also those that
        prescribe a frame.
    forces
        Callables f(t) that scale the forces, or are the actuators, with these names;
        their value must be continuous, their rate may jump. A `Law` sees outputs of the
        motion as well.
    before
        A system of this scene with other numbers, made with the same other arguments,
        whose SIDs are taken where the files have the same names, and what it was made
        of where that is the same objects.

    Raises
    ------
    InputError
        A SID cannot be read or describes an impossible body, a marker does not exist,
        an output asks for what there is not, or a scene that is to start in its static
        equilibrium has none.
    """
    from .diagnostics.checks import (
        check_attachments,
        check_masses,
        check_outputs,
        check_replaced_sids,
        check_same_sids,
        check_started,
    )
    from .system.body_data import read_sids
    from .system.build import build_system
    from .system.rotated_markers import marker_rotations, original_scene
    from .system.update import updated_system

    rotations: dict[str, Array] | None = None

    def checked(scene: SceneFile, keep_joints: bool) -> System:
        if before is not None and not (drives or forces or keep_joints or rotations):
            system = updated_system(before, scene, known)
            if system is not None:
                if not accept_defects:
                    check_masses(system)
                return system
        system = build_system(
            original_scene(scene),
            known,
            drives,
            keep_joints,
            forces,
            before=before,
            rotations=rotations,
        )
        check_outputs(system)
        if not accept_defects:
            check_masses(system)
            check_attachments(system)
        return system

    check_started(scene)
    check_replaced_sids(scene, sids or {})
    if before is not None:
        sids = _same_files(before, scene) | dict(sids or {})
    known = read_sids(scene, Path(base_folder), sids or {})
    check_same_sids(scene, known)
    if scene.initial.state != "static":
        return checked(scene, keep_joints)
    from .analyses.initial_equilibrium import (
        start_in_equilibrium,
        start_in_steady_rotation,
    )
    from .analyses.steady_rotation import steady_rotation

    system = checked(scene, True)
    rotations = marker_rotations(system.scene, system.bodies)
    rotating, rotation_notes = steady_rotation(system)
    if rotating is not None:
        return replace(checked(rotating, keep_joints), diagnostics=rotation_notes)
    equilibrium_scene, equilibrium_notes = start_in_equilibrium(system)
    rotation_scene, velocity_notes = start_in_steady_rotation(
        checked(equilibrium_scene, True)
    )
    return replace(
        checked(rotation_scene, keep_joints),
        diagnostics=(*rotation_notes, *equilibrium_notes, *velocity_notes),
    )


def _same_files(before: System, scene: SceneFile) -> dict[str, SID]:
    """The SIDs of a system of bodies that still name the same files."""
    previous = before.scene.sid_bodies
    return {
        name: before.sids[name]
        for name, body in scene.sid_bodies.items()
        if name in previous
        and (body.sid, body.model) == (previous[name].sid, previous[name].model)
    }


def __getattr__(name: str) -> object:
    if name in _ELSEWHERE:
        return getattr(import_module(_ELSEWHERE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
