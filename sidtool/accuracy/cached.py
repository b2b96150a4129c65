"""What was chosen before: kept in the user's cache, by content."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from pydantic import ValidationError

from sidtool.formats.errors import InputError
from sidtool.formats.result import AccuracyReport
from sidtool.formats.scene import SceneFile
from sidtool.formats.scene.base import Table
from sidtool.formats.sid import SID
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.storage.operating_system import cache_folder
from sidtool.formats.storage.sid_content import content_digest

#: How choices are made; a choice of another one is not used.
METHOD = 19


class Kept(Table):
    """The chosen scene, with its integrator and tolerance, and what it came to.

    models : level of the mesh, modes and nodes with static shape functions, by bodies
        that are made of models
    frames : that bodies were put in
    """

    scene: SceneFile
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
    """What is kept under a key, if it is whole."""
    path = _path(key)
    try:
        return (
            Kept.model_validate_json(path.read_text(encoding="utf-8")) if path else None
        )
    except (OSError, ValueError, ValidationError, InputError):
        return None


def write(key: str, kept: Kept) -> None:
    """Keep a choice where that is possible; elsewhere the search is made again."""
    path = _path(key)
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path, keep_beside=False) as temporary:
            temporary.write_text(kept.model_dump_json(by_alias=True), encoding="utf-8")
    except (OSError, InputError):
        return


def _path(key: str) -> Path | None:
    there = folder()
    return None if there is None else there / f"{key}.json"
