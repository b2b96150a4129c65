"""The full fields of flexible bodies: named, beside their SIDs, or of their models."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from sidtool.formats.errors import InputError
from sidtool.formats.field import Field, mismatch, read_field
from sidtool.formats.scene import SceneFile, SidBody
from sidtool.formats.sid import SID

from ..made import ENDING, Source

Given = Mapping[str, Field | str | os.PathLike[str]]


def companions(
    scene: SceneFile, sids: Mapping[str, SID], given: Given, folders: list[Path]
) -> tuple[dict[str, Field], list[str]]:
    """Fields by body, and sentences about those that were found but do not fit.

    given : fields, or files with one, by body
    folders : where paths of the scene may begin

    Raises
    ------
    InputError : a given field is not that of its SID, or there is no such body.
    """
    found: dict[str, Field] = {}
    told: list[str] = []
    for body, content in given.items():
        if body not in sids:
            raise InputError(
                f"there is no flexible body {body!r}",
                place="--field",
                expected=f"BODY=FILE with a BODY out of {', '.join(sids) or 'none'}",
            )
        field = content if isinstance(content, Field) else read_field(content)
        wrong = mismatch(field, sids[body])
        if wrong:
            raise InputError(
                f"the field {wrong}",
                place=f"--field {body}",
                expected="the field that was written with this SID",
            )
        found[body] = kept(field, scene, body)
    for body, path, read in _beside(scene, folders):
        if body in found or body not in sids:
            continue
        field = read()
        wrong = mismatch(field, sids[body])
        if wrong:
            told.append(f"{path} is not the field of {body}: it {wrong}")
        else:
            found[body] = kept(field, scene, body)
    return found, told


def kept(field: Field, scene: SceneFile, body: str) -> Field:
    """The field of the shape functions that the scene keeps."""
    described = scene.bodies[body]
    if not isinstance(described, SidBody) or described.shape_functions is None:
        return field
    rows = [number - 1 for number in described.numbers(field.nq)]
    stress = None if field.stress is None else field.stress[..., rows]
    return replace(field, shapes=field.shapes[..., rows], stress=stress)


def _beside(
    scene: SceneFile, folders: list[Path]
) -> Iterator[tuple[str, Path, Callable[[], Field]]]:
    """Files NAME.field.h5 beside the SIDs of a scene, and models of its bodies."""
    for name, body in scene.sid_bodies.items():
        for folder in folders:
            path = (folder / body.sid).with_suffix(ENDING)
            if path.is_file():
                yield name, path, partial(read_field, path)
                break
            if body.model and (folder / body.model).is_file():
                source = Source(folder / body.model, folder)
                yield name, source.path, source.field
                break
