"""The public face: the few functions that a script or a notebook needs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from sidtool.formats.arguments import path_of, scene_given
from sidtool.formats.endings import kind_by_ending
from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.result import Result as Stored
from sidtool.formats.result import write_csv, write_result
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.toml.files import located

from .chosen import chosen
from .kinds import read
from .results import Result
from .validate import check, compare, repair

__all__ = ["compare", "convert", "read", "repair", "simulate", "validate", "write"]

Path_ = str | os.PathLike[str]


def write(path: Path_, content: SID | Stored, *, dialect: str = "fembs") -> None:
    """Write a SID (``.h5`` or ASCII) or a result (``.h5`` or ``.csv``).

    Raises
    ------
    InputError : the file cannot be written, or its ending says something else.
    """
    path = path_of(path, "path")
    if isinstance(content, SID):
        write_sid(path, content, dialect)
    elif not isinstance(content, Stored):
        kind = type(content).__name__
        raise InputError(
            f"is of the type {kind}", place="content", expected="a SID or a Result"
        )
    elif kind_by_ending(path, "result", "table") == "table":
        write_csv(path, content)
    else:
        write_result(path, content)


def convert(model: ModelFile | Path_) -> SID:
    """The SID of a body from its model file; see ``examples/slider_crank``.

    Raises
    ------
    InputError : names the file and the key that is wrong.
    """
    from .convert import sid_from_model

    if not isinstance(model, ModelFile):
        model = path_of(model, "model", "a sidtool.Model")
    return sid_from_model(model)


def validate(sid: SID | Path_) -> Any:
    """The checks of identities I1 to I21, one `Check` each; see `verdict`."""
    if not isinstance(sid, SID):
        sid = read_sid(path_of(sid, "sid", "a SID"))
    return check(sid)


def simulate(
    scene: SceneFile | Path_,
    *,
    sids: Mapping[str, SID | Path_] | None = None,
    base_folder: Path_ | None = None,
    integrator: str | None = None,
    rtol: float | None = None,
    step: float | None = None,
    spectral_radius: float | None = None,
    rigid: Iterable[str] = (),
    accuracy: float | Mapping[str, float | str] | None = None,
    accept_defects: bool = False,
    progress: Callable[[float], None] | None = None,
    searching: Callable[[str, float | None], None] | None = None,
    drives: Mapping[str, Any] | None = None,
    forces: Mapping[str, Any] | None = None,
    unfinished: Stored | None = None,
) -> Result:
    """Compile a scene and integrate its motion.

    Parameters
    ----------
    scene : a scene file, or its content
    sids : SIDs, or files with one, that replace those of the scene, by body
    base_folder : where the scene's relative paths begin; by default the folder of
        its file, of a scene made in Python the working folder
    integrator, rtol, step, spectral_radius : replace those of the table [accuracy] of
        the scene
    rigid : bodies with a SID that are taken as rigid, as `rigid = true` in the scene
    accuracy : error that outputs may have, as `[accuracy] wanted` of the scene: the
        cheapest model that keeps it is found and simulated, and `result.error` tells
        what was reached; 1e-3 of the variation of all outputs, or a mapping such as
        {"piston.x": "1e-6 m", "pin.fx": "0.1 %"} of those that count
    accept_defects : simulate bodies whose mass matrix is impossible, and joints and
        forces on nodes that no shape function moves
    progress : told the time that the run has reached [s]
    searching : told what the search for `accuracy` does and which share of it is done,
        0 to 1, or None where nobody knows
    drives : functions of time f(t), or tuples of f and its first or first two
        derivatives, that replace those of the scene's drives, by name; of one with
        `of = "acceleration"` a `Law`
    forces : the same for functions that scale forces, or are actuators; a `Law` sees
        outputs of the motion as well
    unfinished : the result of a run with the same scene and settings that was ended, as
        by Ctrl-C, or is complete to an earlier `time.end`; this one goes on from its
        last state and gives the whole

    Raises
    ------
    sidtool.Interrupted : Ctrl-C; its `result` holds what there is.
    InputError : the scene or one of its SIDs cannot be simulated, or not as exactly as
        is asked for.
    sidtool.SimulationError : the run stopped; its `result` holds what there is.
    """
    from sidtool.solver import compile_scene

    from .accuracy import plan_for
    from .interrupting import answered, ran
    from .results import answering

    content = scene_given(scene)
    folder = Path(base_folder or content.folder)
    settings: dict[str, Any] = {"integrator": integrator, "rtol": rtol, "step": step}
    settings["spectral_radius"] = spectral_radius
    with located(content), answered(drives, forces) as asked:
        content, replaced, told = chosen(content, folder, sids or {}, rigid)
        plan = plan_for(
            content,
            folder,
            replaced,
            accuracy,
            settings,
            accept_defects=accept_defects,
            drives=drives,
            forces=forces,
            progress=searching,
        )
        if plan is not None:
            content, told = plan.scene, [*told, *plan.told]
            replaced = dict(plan.sids)
        system = compile_scene(
            content, folder, replaced, accept_defects, drives, forces=forces
        )
        if plan is not None and unfinished is None:
            known = plan.delivered((*system.told, *told))
            if known is not None:
                return answering(known, drives, forces)
        settings |= {"progress": progress, "unfinished": unfinished, "told": told}
        result = ran(system, asked, drives, forces, **settings)
        return result if plan is None else plan.certified(result)
