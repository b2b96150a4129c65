"""Where an accuracy is asked for: in the scene, by a call, on the command line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from sidtool.formats.errors import InputError
from sidtool.formats.progress import Listener, listening
from sidtool.formats.scene import SceneFile
from sidtool.formats.scene.wanted import LEAST, MOST
from sidtool.formats.sid import SID

from ..made import sources
from .plan import Plan, planned
from .wanted import Wanted


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
    """The plan of a scene, or None where no accuracy is asked for.

    Integrators, tolerances and steps that are given turn off what the scene asks for;
    they contradict an accuracy that is given, too.

    Parameters
    ----------
    sids : that replace files of the scene
    accuracy : given beside the scene, replaces what it asks for
    settings : integrator, rtol, step, ... that are given
    frames : False where bodies must stay in the frames that their SIDs have
    progress : told what the search does and which share of it is done; default whoever
        listens already

    Raises
    ------
    InputError, SimulationError : see `planned`.
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
    scene = with_wanted(scene, wanted)
    from sidtool.solver import compile_scene
    from sidtool.solver.system.bodies.data import read_sids

    known = read_sids(scene, folder, sids)

    def compiled(content: SceneFile, found: Mapping[str, SID]) -> Any:
        return compile_scene(
            content, folder, found, accept_defects, drives, forces=forces
        )

    keep = not (drives or forces)
    models = sources(scene, folder)
    with nullcontext() if progress is None else listening(progress):
        return planned(
            scene, known, wanted, compiled, models=models, keep=keep, frames=frames
        )


def with_wanted(scene: SceneFile, wanted: Wanted) -> SceneFile:
    """The scene that asks for this accuracy.

    Raises
    ------
    InputError : it cannot be asked for.
    """
    table = dict(wanted) if isinstance(wanted, Mapping) else float(wanted)
    try:
        return scene.with_({"accuracy.wanted": table})
    except InputError as error:
        place = "accuracy" if error.place is None else error.place
        raise InputError(error.problem, place=place, expected=error.expected) from None


def from_texts(texts: Iterable[str]) -> Wanted | None:
    """What `--accuracy` says: one number, or NAME=AMOUNT several times.

    Raises
    ------
    InputError : it is neither.
    """
    listed = list(texts)
    if not listed:
        return None
    if len(listed) == 1 and "=" not in listed[0]:
        return _number(listed[0])
    found: dict[str, float | str] = {}
    for text in listed:
        name, sign, amount = (part.strip() for part in text.partition("="))
        if not (name and sign and amount):
            raise _refused(text)
        try:
            found[name] = float(amount)
        except ValueError:
            found[name] = amount
    return found


def _number(text: str) -> float:
    percent = text.strip().endswith("%")
    try:
        value = float(text.strip().removesuffix("%")) / (100.0 if percent else 1.0)
    except ValueError:
        raise _refused(text) from None
    if not LEAST <= value <= MOST:
        raise _refused(text)
    return value


def _refused(text: str) -> InputError:
    return InputError(
        f"found {text!r}",
        place="--accuracy",
        expected=f"an error from {LEAST:g} to {MOST:g}, such as 1e-3 or 0.1%, or "
        'OUTPUT=ERROR, such as piston.x=1e-3 or "piston.x=1e-6 m"',
    )
