"""SIDs that replace those of a scene."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID
from sidtool.formats.sid_files import read_sid
from sidtool.formats.storage.operating_system import path_from

#: What stands in the scene of a result for a SID that came from a program.
FROM_PROGRAM = "(given by a program)"


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

    if not sids:
        return scene, {}
    check_replaced(scene, sids)
    bodies, found = dict(scene.bodies), {}
    for name, given in sids.items():
        found[name] = given if isinstance(given, SID) else read_sid(given)
        text = (
            FROM_PROGRAM if isinstance(given, SID) else path_from(folder, Path(given))
        )
        bodies[name] = bodies[name].model_copy(update={"sid": text, "model": None})
    return scene.model_copy(update={"bodies": bodies}), found
