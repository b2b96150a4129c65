"""Functions of a script or notebook: convert, validate, simulate, compare."""

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from sidtool.formats.base.sid import SID
from sidtool.formats.file_names import path_of, scene_given
from sidtool.formats.model import ModelFile
from sidtool.formats.result import Result as Stored
from sidtool.formats.scene import SceneFile, with_inputs
from sidtool.formats.sid_files import read_sid
from sidtool.formats.toml.files import locate_errors

from ..validate import check, compare, repair
from .result import Result

__all__ = ["compare", "convert", "repair", "simulate", "validate"]

Path_ = str | os.PathLike[str]


def convert(model: ModelFile | Path_) -> SID:
    """Convert a model file to a SID; see ``examples/slider_crank``.

    Raises
    ------
    InputError : the model is not valid; the error names file and key.
    """
    from ..pipeline.model_to_sid import sid_from_model
    from .result import emit_warnings

    if not isinstance(model, ModelFile):
        model = path_of(model, "model", "a sidtool.Model")
    sid = sid_from_model(model)
    emit_warnings(sid)
    return sid


def validate(sid: SID | Path_) -> Any:
    """Check the identities I1 to I21 and return one `Check` each; see `verdict`."""
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
    inputs: Mapping[str, Any] | None = None,
    unfinished: Stored | None = None,
) -> Result:
    """Compile a scene and integrate its motion.

    Parameters
    ----------
    scene : a scene file, or its content
    sids : SIDs, or files with one, that replace those of the scene, by body
    base_folder : folder of the scene's relative paths; by default the folder of
        its file, of a scene made in Python the working folder
    integrator, rtol, step, spectral_radius : replace those of the table [accuracy] of
        the scene
    rigid : bodies with a SID that are simulated as rigid, as by `rigid = true` in the
        scene
    accuracy : allowed error of the outputs, as `[accuracy] wanted` of the scene. The
        fastest model within it is found and simulated, and `result.error` holds the
        estimated errors. A number is relative to the variation of all outputs; a
        mapping such as {"piston.x": "1e-6 m", "pin.fx": "0.1 %"} selects outputs
    accept_defects : accept bodies with impossible mass matrices, and joints and forces
        on nodes that no shape function moves
    progress : called with the simulated time [s]
    searching : called with the stage of the search for `accuracy` and the completed
        fraction, 0 to 1, or None if it is unknown
    drives : functions of time f(t), or tuples of f and its first or first two
        derivatives, that replace those of the scene's drives, by name; of one with
        `of = "acceleration"` a `Law`
    forces : the same for functions that scale forces or define actuators; a `Law` also
        takes outputs of the motion
    inputs : times [s] and values, (nt,) each, or a number, of inputs of the scene, by
        name; they go on between values as `interpolation` of the input says
    unfinished : result of an interrupted run with the same scene and settings, or of a
        complete run to an earlier `time.end`; this run continues from its last state
        and returns the whole motion

    Raises
    ------
    sidtool.Interrupted : Ctrl-C; its `result` holds the motion so far.
    InputError : the scene or one of its SIDs cannot be simulated, or not with the
        requested accuracy.
    sidtool.SimulationError : the run stopped; its `result` holds the motion so far.
    """
    from .interrupts import run_interruptible, wrap_errors
    from .prepared_scene import prepare_scene
    from .result import emit_warnings, to_user_result

    content = scene_given(scene)
    folder = Path(base_folder or content.folder)
    with locate_errors(content):
        content = with_inputs(content, inputs or {})
    settings: dict[str, Any] = {"integrator": integrator, "rtol": rtol, "step": step}
    settings["spectral_radius"] = spectral_radius
    with locate_errors(content), wrap_errors(drives, forces) as stop:
        prepared = prepare_scene(
            content,
            folder,
            sids or {},
            rigid,
            accuracy,
            settings,
            accept_defects=accept_defects,
            drives=drives,
            forces=forces,
            searching=searching,
        )
        known = prepared.known_result() if unfinished is None else None
        if known is not None:
            return emit_warnings(to_user_result(known, drives, forces))
        settings |= {"progress": progress, "unfinished": unfinished}
        settings["diagnostics"] = prepared.diagnostics
        settings["all_warnings"] = True
        if prepared.plan is None:
            return run_interruptible(prepared.system, stop, drives, forces, **settings)
        settings["emit_warning"] = None  # the errors of outputs are diagnostics as well
        result = run_interruptible(prepared.system, stop, drives, forces, **settings)
        return emit_warnings(prepared.with_errors(result))
