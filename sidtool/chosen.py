"""A scene with the SIDs and the rigid bodies that a call or a command asks for."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID

from .made import converted
from .other_shapes import other_shapes
from .rigid import as_rigid, told_left_out, told_rigid
from .swaps import sid_of, swapped


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
    lines = [line for of_body in notes.values() for line in of_body]
    others = {name: replaced[name] for name in sids}
    told = [*told_of_others(plain, folder, others), *told_rigid(plain), *lines]
    return content, replaced | made, [*told, *told_left_out(plain)]


def told_of_others(
    scene: SceneFile, folder: Path, sids: Mapping[str, SID]
) -> Iterator[str]:
    """What other SIDs change of the meaning of a scene, see `other_shapes`."""
    return other_shapes(
        scene, sids, lambda name: sid_of(scene.sid_bodies[name], folder)
    )
