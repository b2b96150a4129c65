"""A scene with the SIDs and the rigid bodies that a call or a command asks for."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID

from .made import converted
from .other_shapes import other_shapes
from .rigid import as_rigid, told_left_out, told_rigid
from .swaps import swapped


def chosen(
    scene: SceneFile,
    folder: Path,
    sids: Mapping[str, SID | str | os.PathLike[str]],
    rigid: Iterable[str],
) -> tuple[SceneFile, dict[str, SID], list[str]]:
    """The scene, the SIDs that replace its own, and sentences about both.

    folder : relative paths of the scene begin here

    Raises
    ------
    InputError : a file cannot be read, or a name is not that of a body with a SID.
    """
    plain = as_rigid(scene, rigid)
    content, replaced = swapped(plain, sids, folder)
    content, made, notes = converted(content, folder)
    told = [*other_shapes(plain, folder, replaced), *told_rigid(plain), *notes]
    replaced |= made
    told += told_left_out(plain)
    return content, replaced, told
