"""What moves SIDs: the floating-frame integrator, in the order of docs/theory.md.

Rooms, from the lowest to the highest; each imports from those above it in this list:

    compiler/     from a function in Python to a kernel: values, records, machine code
    space/        plane and space: their algebra, coordinates, the arrays of kernels
    linear/       the linear systems, eq. (17): accelerations, projections, Newton
    equations/    motion of frames and markers, eq. (4) to (7); M and f of every body,
                  eq. (10) and (11); constraints, eq. (14); forces, eq. (16)
    functions/    functions of time: drives, tables, callables
    system/       from a scene and its SIDs to the tables that kernels read
    integrators/  eq. (3) in time, eq. (18) to (22)
    start/        consistent initial conditions: assembly, redundant constraints
    recording/    outputs, forces, energies and events of a run
    advice/       what a run says of its scene, and why it stopped
    analyses/     equilibrium, natural modes, inverse dynamics
    run           a run: start, integrate, record, tell

Source: A. Held, A. Hildebrandt, "Flexible Multibody Simulations with Global Shape
Functions Obtained from Isogeometric Finite Element Models".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sidtool.formats.scene import SceneFile
    from sidtool.formats.sid import SID

    from .advice.description import describe as describe
    from .analyses.inverse import inverse_dynamics as inverse_dynamics
    from .analyses.linear import linearise as linearise
    from .analyses.static import static_equilibrium as static_equilibrium
    from .functions.callables import Derivatives
    from .functions.callables import Timed as Timed
    from .functions.laws import Law as Law
    from .run import simulate as simulate
    from .system.scene import System


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
    base_folder : paths of SID files in the scene are relative to it
    sids : SIDs that replace the files of the bodies with these names
    accept_defects : take SIDs whose coupled mass matrix is indefinite, and joints and
        forces on nodes where all shape functions vanish
    drives : callables that replace the functions of the drives with these names:
        f(t), or a tuple of f and its first, or first two, derivatives, or one of these
        as `Timed(f, times=..., shortest=...)`: a feature that lasts less than 1/4096 of
        the run may be missed unless that says where or how short it is. A `Law` gives
        what a drive with `of = "acceleration"` prescribes
    keep_joints : keep all joints as constraints, whose forces are then known, also
        those that prescribe a frame
    forces : callables f(t) that scale the forces, or are the actuators, with these
        names; their value must be continuous, their rate may jump. A `Law` sees
        outputs of the motion as well
    before : a system of this scene with other numbers, made with the same other
        arguments, whose SIDs are taken where the files have the same names, and what it
        was made of where that is the same objects

    Raises
    ------
    InputError : a SID cannot be read or describes an impossible body, a marker does
        not exist, an output asks for what there is not, or a scene that is to start in
        its static equilibrium has none.
    """
    from .advice.checks import (
        check_attachments,
        check_masses,
        check_outputs,
        check_replaced,
        check_same_sids,
        check_started,
    )
    from .system.bodies.data import read_sids
    from .system.building import build_system
    from .system.renumbered import renumbered

    def checked(scene: SceneFile, keep_joints: bool) -> System:
        if before is not None and not (drives or forces or keep_joints):
            system = renumbered(before, scene, known)
            if system is not None:
                if not accept_defects:
                    check_masses(system)
                return system
        system = build_system(scene, known, drives, keep_joints, forces, before=before)
        check_outputs(system)
        if not accept_defects:
            check_masses(system)
            check_attachments(system)
        return system

    check_started(scene)
    check_replaced(scene, sids or {})
    if before is not None:
        sids = _same_files(before, scene) | dict(sids or {})
    known = read_sids(scene, Path(base_folder), sids or {})
    check_same_sids(scene, known)
    if scene.initial.state != "static":
        return checked(scene, keep_joints)
    from .analyses.resting import resting
    from .analyses.spinning import spinning
    from .analyses.steady_rotation import steady_rotation

    system = checked(scene, True)
    rotating, unsteady = steady_rotation(system)
    if rotating is not None:
        return checked(rotating, keep_joints)
    rested, states, told = resting(system)
    spun, more = spinning(checked(rested, True))
    made = checked(spun, keep_joints).with_states(states)
    return replace(made, told=(*unsteady, *told, *more))


def _same_files(before: System, scene: SceneFile) -> dict[str, SID]:
    """The SIDs of a system of bodies that still name the same files."""
    was = before.scene.sid_bodies
    return {
        name: before.sids[name]
        for name, body in scene.sid_bodies.items()
        if name in was and (body.sid, body.model) == (was[name].sid, was[name].model)
    }


_ELSEWHERE = {
    "simulate": "sidtool.solver.run",
    "describe": "sidtool.solver.advice.description",
    "static_equilibrium": "sidtool.solver.analyses.static",
    "linearise": "sidtool.solver.analyses.linear",
    "inverse_dynamics": "sidtool.solver.analyses.inverse",
    "Law": "sidtool.solver.functions.laws",
    "Timed": "sidtool.solver.functions.callables",
}


def __getattr__(name: str) -> object:
    if name in _ELSEWHERE:
        return getattr(import_module(_ELSEWHERE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
