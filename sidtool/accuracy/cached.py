"""What was chosen before: kept in the user's cache, by content.

A file holds a check sum, the key that it was kept under and the choice. The scene that
is simulated is made anew from the scene asked for: nothing of it is taken from a file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel, ValidationError

from sidtool.formats.errors import InputError
from sidtool.formats.result import AccuracyReport
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.storage.operating_system import (
    PRIVATE,
    cache_folder,
    make_trusted_folder,
    read_trusted,
)
from sidtool.formats.storage.sid_content import content_digest

from .candidates import Choice
from .runs import Setting

#: How choices are made; a choice of another one is not used.
METHOD = 20


class Kept(BaseModel, frozen=True, extra="forbid"):
    """A choice, with its integrator and tolerance, and what it came to.

    key : of the scene, SIDs and accuracy that it was made for
    models : level of the mesh, modes and nodes with static shape functions, by bodies
        that are made of models
    frames : that bodies were put in
    """

    key: str
    choice: Choice
    setting: Setting
    report: AccuracyReport
    models: dict[str, tuple[int, int | None, tuple[int, ...]]] = {}
    frames: dict[str, str] = {}


def folder() -> Path | None:
    """Where choices are kept; None where the user has no home."""
    users = cache_folder()
    return None if users is None else users / "accuracy"


def key_of(
    scene: SceneFile,
    sids: Mapping[str, SID],
    wanted: object,
    models: Mapping[str, object],
) -> str:
    """A digest of all that a choice depends on; paths do not count.

    models : bodies that are made of models, by the SIDs that these make as they are
    """
    from .. import __version__

    digest = hashlib.sha256(f"{METHOD} {__version__} {wanted!r}".encode())
    bodies = dict(scene.bodies)
    for name in sids:
        model = "x" if name in models else None
        bodies[name] = bodies[name].model_copy(update={"sid": "x", "model": model})
    plain = scene.model_copy(update={"bodies": bodies, "title": ""})
    digest.update(plain.model_dump_json(exclude={"accuracy"}).encode())
    for name in sorted(sids):
        digest.update(f"{name} {content_digest(sids[name])}".encode())
    return digest.hexdigest()[:32]


def read(key: str) -> Kept | None:
    """What is kept under a key, if it is whole, and nobody else can have written it."""
    path = _path(key)
    if path is None:
        return None
    try:
        seal, _, content = read_trusted(path).partition(b"\n")
        if seal != _seal(content):
            return None
        kept = Kept.model_validate_json(content)
    except (OSError, ValueError, ValidationError, InputError):
        return None
    return kept if kept.key == key else None


def write(kept: Kept) -> None:
    """Keep a choice where that is possible; elsewhere the search is made again."""
    path, content = _path(kept.key), kept.model_dump_json(by_alias=True).encode()
    if path is None:
        return
    try:
        make_trusted_folder(path.parent)
        with atomic_path(path, keep_beside=False, mode=PRIVATE) as temporary:
            temporary.write_bytes(_seal(content) + b"\n" + content)
    except (OSError, InputError):
        return


def _seal(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def _path(key: str) -> Path | None:
    there = folder()
    return None if there is None else there / f"{key}.json"
