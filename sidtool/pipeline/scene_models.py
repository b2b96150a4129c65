"""Models of the bodies of a scene; scenes without one do not import what reads them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.scene import SceneFile

if TYPE_CHECKING:
    from .model_cache import BodyModel


def body_models(scene: SceneFile, folder: Path) -> dict[str, BodyModel]:
    """Return the bodies that are described by models.

    Raises
    ------
    InputError : a model cannot be read.
    """
    models = {n: body.model for n, body in scene.sid_bodies.items() if body.model}
    if not models:
        return {}
    from .model_cache import BodyModel

    return {name: BodyModel(folder / file, folder) for name, file in models.items()}


def convert_bodies(
    scene: SceneFile, folder: Path
) -> tuple[SceneFile, dict[str, SID], dict[str, list[Diagnostic]]]:
    """Convert the models of a scene.

    The model of a body that also has a SID is not converted.

    Returns
    -------
    the scene that names the SIDs, the SIDs, and diagnostics, by body

    Raises
    ------
    InputError : a model cannot be read or converted.
    """
    bodies: dict[str, Any] = dict(scene.bodies)
    sids: dict[str, SID] = {}
    notes: dict[str, list[Diagnostic]] = {}
    for name, source in body_models(scene, folder).items():
        if bodies[name].sid:
            continue
        body = source.sid()
        text = body.file or f"(made of {source.path.name})"
        bodies[name] = bodies[name].model_copy(update={"sid": text})
        sids[name] = body.sid
        notes[name] = [each.within(name) for each in body.sid.diagnostics]
    if not sids:
        return scene, {}, {}
    return scene.model_copy(update={"bodies": bodies}), sids, notes
