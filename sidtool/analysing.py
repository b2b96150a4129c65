"""Analyses of scenes for scripts: equilibrium, natural modes, inverse dynamics."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidtool.formats.arguments import path_of, scene_given
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID
from sidtool.formats.toml.files import located

from .kinds import expect_kind
from .made import converted
from .results import Result, answering, warned
from .swaps import swapped

if TYPE_CHECKING:
    from sidtool.solver.system.scene import System

    from .states import Equilibrium, Linearisation

Path_ = str | os.PathLike[str]
Sids = Mapping[str, SID | Path_]
Programs = Mapping[str, Any]


def static_equilibrium(
    scene: SceneFile | Path_,
    *,
    sids: Sids | None = None,
    base_folder: Path_ | None = None,
    accept_defects: bool = False,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> Equilibrium:
    """The state of rest downhill from the start of a scene.

    Its `result()` holds the outputs of the scene and the forces of all joints. The
    other arguments are those of `simulate`, also callables and laws of programs.

    Raises
    ------
    InputError : the scene or one of its SIDs cannot be used.
    sidtool.SimulationError : no equilibrium was found.
    """
    from sidtool.solver.analyses.static import static_equilibrium as analyse

    from .states import Equilibrium, for_users

    programs = drives, forces
    with _compiled(scene, sids, base_folder, accept_defects, programs) as system:
        return warned(for_users(analyse(system), Equilibrium))


def linearise(
    scene: SceneFile | Path_,
    *,
    about: str = "static",
    frozen: bool = False,
    sids: Sids | None = None,
    base_folder: Path_ | None = None,
    accept_defects: bool = False,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> Linearisation:
    """Frequencies, damping ratios and shapes of the natural modes of a scene.

    about : "static", its static equilibrium, or "start", its start with velocities
    frozen : give the values of one instant where equations of small motions change in
        time, or the state is no steady motion; they do not describe a motion

    `inertial_frequencies` are those that fixed sensors see, `rotating_frequencies`
    those that sensors on the body that turns see, `whirl` is "forward", "backward"
    or "".

    Raises
    ------
    InputError : the scene or one of its SIDs cannot be used.
    sidtool.SimulationError : no equilibrium was found, or the state has no modes.
    """
    from sidtool.solver.analyses.linear import linearise as analyse

    from .states import Linearisation, for_users

    programs = drives, forces
    with _compiled(scene, sids, base_folder, accept_defects, programs) as system:
        return warned(for_users(analyse(system, about, frozen=frozen), Linearisation))


def inverse_dynamics(
    scene: SceneFile | Path_,
    *,
    quasi_static: bool = False,
    sids: Sids | None = None,
    base_folder: Path_ | None = None,
    accept_defects: bool = False,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> Result:
    """Motion and joint forces of a scene whose drives prescribe everything.

    quasi_static : flexible bodies deform without vibrating; velocities and
        accelerations of their elastic coordinates are left out

    Raises
    ------
    InputError : something can move freely, or the scene cannot be used.
    sidtool.SimulationError : the drives demand what the mechanism cannot do; its
        `result` holds what comes before.
    """
    from sidtool.solver.analyses.inverse import inverse_dynamics as analyse

    programs = drives, forces
    with _compiled(scene, sids, base_folder, accept_defects, programs) as system:
        found = analyse(system, quasi_static=quasi_static)
        return warned(answering(found, drives, forces))


@contextmanager
def _compiled(
    scene: SceneFile | Path_,
    sids: Sids | None,
    base_folder: Path_ | None,
    accept_defects: bool,
    programs: tuple[Programs | None, Programs | None],
) -> Iterator[System]:
    """A scene with all its joints; input errors name its file."""
    from sidtool.solver import compile_scene

    if not isinstance(scene, SceneFile):
        expect_kind(path_of(scene, "scene", "a sidtool.Scene"), "scene")
    scene = scene_given(scene)
    folder = Path(base_folder or scene.folder)
    with located(scene):
        content, replaced = swapped(scene, sids or {}, folder)
        content, made, _ = converted(content, folder)
        yield compile_scene(
            content,
            folder,
            replaced | made,
            accept_defects=accept_defects,
            drives=programs[0],
            keep_joints=True,
            forces=programs[1],
        )
