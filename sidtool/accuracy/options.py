"""Requests of an accuracy: in the scene, by a call, on the command line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import real_of_text
from sidtool.formats.base.progress import Listener, use_listener
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile
from sidtool.formats.scene.tables import MAX_RELATIVE_ERROR, MIN_RELATIVE_ERROR

from ..measurement.request import Wanted
from ..pipeline.scene_models import body_models

if TYPE_CHECKING:
    from .plan import Plan


def plan_for(
    scene: SceneFile,
    folder: Path,
    sids: Mapping[str, SID],
    accuracy: Wanted | None,
    settings: Mapping[str, Any],
    *,
    accept_defects: bool = False,
    drives: Mapping[str, Any] | None = None,
    forces: Mapping[str, Any] | None = None,
    frames: bool = True,
    progress: Listener | None = None,
) -> Plan | None:
    """Make the accuracy plan of a scene, or return None if no accuracy is requested.

    Explicit integrators, tolerances and steps switch off the request of the scene; they
    contradict an explicit accuracy.

    Parameters
    ----------
    folder : folder of the relative paths of the scene
    sids : SIDs that replace files of the scene
    accuracy : request that replaces that of the scene
    settings : explicit integrator, rtol, step, ...
    frames : False if bodies must stay in the frames of their SIDs
    progress : called with a text and the completed fraction of the search; default is
        the current listener

    Raises
    ------
    InputError, SimulationError : see `make_accuracy_plan`.
    """
    given = [name for name, value in settings.items() if value is not None]
    if accuracy is not None and given:
        raise InputError(
            f"is given together with {', '.join(given)}, which it chooses",
            place="accuracy",
            expected="one of the two",
        )
    wanted = accuracy if accuracy is not None else scene.accuracy.wanted
    if wanted is None or given:
        return None
    scene = with_requested_accuracy(scene, wanted)
    from sidtool.solver import compile_scene
    from sidtool.solver.system.body_data import read_sids

    from .plan import make_accuracy_plan

    known = read_sids(scene, folder, sids)

    def compiled(content: SceneFile, sids_by_body: Mapping[str, SID]) -> Any:
        return compile_scene(
            content, folder, sids_by_body, accept_defects, drives, forces=forces
        )

    keep = not (drives or forces)
    models = body_models(scene, folder)
    with nullcontext() if progress is None else use_listener(progress):
        return make_accuracy_plan(
            scene, known, wanted, compiled, models=models, keep=keep, frames=frames
        )


def with_requested_accuracy(scene: SceneFile, wanted: Wanted) -> SceneFile:
    """Return the scene with a requested accuracy.

    Raises
    ------
    InputError : the request is not valid.
    """
    table = dict(wanted) if isinstance(wanted, Mapping) else float(wanted)
    try:
        return scene.with_({"accuracy.wanted": table})
    except InputError as error:
        place = "accuracy" if error.place is None else error.place
        raise InputError(error.problem, place=place, expected=error.expected) from None


def parse_accuracy_options(texts: Iterable[str]) -> Wanted | None:
    """Parse the option `--accuracy`: one number, or NAME=AMOUNT several times.

    Raises
    ------
    InputError : the text is neither.
    """
    listed = list(texts)
    if not listed:
        return None
    if len(listed) == 1 and "=" not in listed[0]:
        return _number(listed[0])
    amounts: dict[str, float | str] = {}
    for text in listed:
        name, sign, amount = (part.strip() for part in text.partition("="))
        if not (name and sign and amount):
            raise _invalid_option(text)
        try:
            amounts[name] = real_of_text(amount)
        except ValueError:
            amounts[name] = amount
    return amounts


def _number(text: str) -> float:
    percent = text.strip().endswith("%")
    try:
        value = real_of_text(text.strip().removesuffix("%"))
    except ValueError:
        raise _invalid_option(text) from None
    value /= 100.0 if percent else 1.0
    if not MIN_RELATIVE_ERROR <= value <= MAX_RELATIVE_ERROR:
        raise _invalid_option(text)
    return value


def _invalid_option(text: str) -> InputError:
    return InputError(
        f"found {text!r}",
        place="--accuracy",
        expected=f"an error from {MIN_RELATIVE_ERROR:g} to {MAX_RELATIVE_ERROR:g}, "
        "such as 1e-3 or 0.1%, or "
        'OUTPUT=ERROR, such as piston.x=1e-3 or "piston.x=1e-6 m"',
    )
