"""Cache of selected models in the user's cache folder, by content."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.result import AccuracyReport
from sidtool.formats.scene import SceneFile
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.storage.cache import content_digest
from sidtool.formats.storage.operating_system import (
    PRIVATE,
    cache_folder,
    make_trusted_folder,
    read_trusted,
)

from .candidates import Choice
from .runs import Setting

#: Version of the search; entries of another version are not used.
METHOD_VERSION = 21


class CacheEntry(BaseModel, frozen=True, extra="forbid"):
    """A selected model, its integrator and tolerance, and its measured errors.

    key : digest of the scene, SIDs and accuracy
    models : level of the mesh, modes and nodes with static shape functions, for bodies
        given by models
    frames : changed frames of bodies
    diagnostics : records of the search, and of the run of the finest model
    """

    key: str
    choice: Choice
    setting: Setting
    report: AccuracyReport
    models: dict[str, tuple[int, int | None, tuple[int, ...]]] = {}
    frames: dict[str, str] = {}
    diagnostics: tuple[dict[str, Any], ...] = ()
    reference_diagnostics: tuple[dict[str, Any], ...] = ()


def cache_path() -> Path | None:
    """Return the folder of the cache, or None if the user has no home folder."""
    users = cache_folder()
    return None if users is None else users / "accuracy"


def cache_key(
    scene: SceneFile,
    sids: Mapping[str, SID],
    wanted: object,
    models: Mapping[str, object],
) -> str:
    """Return a digest of everything that a selection depends on, except paths.

    models : bodies given by models, with the SIDs of the unchanged models
    """
    from .. import __version__

    digest = hashlib.sha256(f"{METHOD_VERSION} {__version__} {wanted!r}".encode())
    bodies = dict(scene.bodies)
    for name in sids:
        model = "x" if name in models else None
        bodies[name] = bodies[name].model_copy(update={"sid": "x", "model": model})
    plain = scene.model_copy(update={"bodies": bodies, "title": ""})
    digest.update(plain.model_dump_json(exclude={"accuracy"}).encode())
    for name in sorted(sids):
        digest.update(f"{name} {content_digest(sids[name])}".encode())
    return digest.hexdigest()[:32]


def read_entry(key: str) -> CacheEntry | None:
    """Read the entry of a key if it is complete and only this user can have
    written it.
    """
    path = _entry_path(key)
    if path is None:
        return None
    try:
        seal, _, content = read_trusted(path).partition(b"\n")
        if seal != _checksum(content):
            return None
        entry = CacheEntry.model_validate_json(content)
    except (OSError, ValueError, ValidationError, InputError):
        return None
    return entry if entry.key == key else None


def write_entry(entry: CacheEntry) -> None:
    """Store a selection if possible; otherwise the next search starts anew."""
    path, content = (
        _entry_path(entry.key),
        entry.model_dump_json(by_alias=True).encode(),
    )
    if path is None:
        return
    try:
        make_trusted_folder(path.parent)
        with atomic_path(path, keep_beside=False, mode=PRIVATE) as temporary:
            temporary.write_bytes(_checksum(content) + b"\n" + content)
    except (OSError, InputError):
        return


def _checksum(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def _entry_path(key: str) -> Path | None:
    there = cache_path()
    return None if there is None else there / f"{key}.json"
