"""SIDs that replace those of a scene."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from sidtool.formats.errors import printable
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile, SidBody
from sidtool.formats.sid import SID
from sidtool.formats.sid_files import read_sid
from sidtool.formats.storage.operating_system import path_from
from sidtool.formats.toml.objects import name_object, named_object

#: What stands in the scene of a result for a SID that came from a program.
FROM_PROGRAM = "(given by a program)"
#: SIDs of models that are objects, by the texts that stand for these.
_MADE: dict[str, SID] = {}


def sid_of(body: SidBody, folder: Path) -> SID:
    """The SID of a body: of its file, or the object that stands in its place.

    Raises
    ------
    InputError : the file cannot be read, or the model not converted.
    """
    given = named_object(body.sid)
    if given is None:
        given = named_object(body.model)
    return read_sid(folder / body.sid) if given is None else _converted(given)


def _objects(scene: SceneFile) -> dict[str, SID]:
    """SIDs of bodies for which a program gave an object."""
    return {
        name: sid_of(body, scene.folder)
        for name, body in scene.sid_bodies.items()
        if named_object(body.sid) is not None or named_object(body.model) is not None
    }


def _converted(given: SID | ModelFile) -> SID:
    """The SID that an object is, or that is made of a model, once."""
    from .convert import sid_from_model

    if isinstance(given, SID):
        return given
    key = name_object(given)
    if key not in _MADE:
        _MADE[key] = sid_from_model(given)
    return _MADE[key]


def swapped(
    scene: SceneFile, sids: Mapping[str, SID | str | os.PathLike[str]], folder: Path
) -> tuple[SceneFile, dict[str, SID]]:
    """The scene that names what it is simulated with, and the SIDs by body.

    folder : relative paths of the scene begin here

    Raises
    ------
    InputError : a file cannot be read, or a name is not that of a flexible body.
    """
    from sidtool.solver.advice.checks import check_replaced

    sids = {**_objects(scene), **sids}
    if not sids:
        return scene, {}
    check_replaced(scene, sids)
    bodies, found = dict(scene.bodies), {}
    for name, given in sids.items():
        if isinstance(given, SID):
            found[name], text = given, FROM_PROGRAM
        else:
            found[name] = read_sid(given)
            # Results keep the name as text, which bytes that are not UTF-8 are not.
            text = printable(path_from(folder, Path(given)))
        bodies[name] = bodies[name].model_copy(update={"sid": text, "model": None})
    return scene.model_copy(update={"bodies": bodies}), found
