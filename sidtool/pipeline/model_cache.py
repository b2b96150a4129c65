"""SIDs and fields of models, converted once and cached."""

import hashlib
import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.field import Field, read_field, write_field
from sidtool.formats.model import ModelFile, Stiffening, read_model
from sidtool.formats.model.refine import (
    refine_model,
    requested_modes,
    with_modes,
    with_static_shapes,
)
from sidtool.formats.sid_files import read_sid, write_sid

from ..mesh.deck_text import deck_files

#: Cache folder, next to the scene.
CACHE_FOLDER = ".sidtool"
#: Ending of full fields, which are stored next to their SIDs.
FIELD_ENDING = ".field.h5"
#: Endings of meshes that may include other files.
_DECKS = (".inp", ".bdf", ".nas", ".dat")


@dataclass(frozen=True)
class Refinement:
    """Refinement of a model relative to its file.

    Attributes
    ----------
    level : number of halvings of the mesh
    modes : number of modes, None for that of the model
    static : nodes with static shape functions for loads at them
    stiffened : True to add geometric stiffening by all loads, which the model lacks
    """

    level: int = 0
    modes: int | None = None
    static: tuple[int, ...] = ()
    stiffened: bool = False


#: No refinement.
UNREFINED = Refinement()


@dataclass(frozen=True)
class ConvertedBody:
    """A SID, its file relative to the scene, and the notes on its conversion.

    Attributes
    ----------
    file : path relative to the scene, empty if the SID could not be stored
    """

    sid: SID
    file: str


class BodyModel:
    """The model of one body, and its converted and cached SIDs.

    Raises
    ------
    InputError : the model cannot be read.
    """

    def __init__(self, path: Path, folder: Path) -> None:
        self.path, self.folder = path, folder
        self.model = read_model(path)

    @property
    def modes(self) -> int | None:
        """Number of normal modes of the model, if its reduction has such a number."""
        return requested_modes(self.model)

    def point_markers(self, nodes: Collection[str]) -> tuple[str, ...]:
        """Return markers at single points of a plane body or a solid.

        The displacement under a point force is finite for beams, but diverges with mesh
        refinement for continua. Markers that are clamped in the frame are not affected.
        """
        from ..discretisation.registry import finite_element_model
        from ..reduction.body_frames import FRAMES, clamped_dofs
        from ..reduction.reduced_basis import point_markers

        body = finite_element_model(self.model)
        frame = FRAMES[self.model.frame.type](body, self.model.frame)
        held = clamped_dofs(body, frame, self.model.reduction.fixed_names)
        markers = point_markers(body, held)
        return tuple(n for n in markers if str(self.model.markers[n].node) in nodes)

    def can_refine(self) -> bool:
        """Whether the mesh can be refined; False for imported meshes and matrices."""
        return refine_model(self.model, 1) is not None

    def can_have_static_shapes(self, nodes: Collection[int]) -> bool:
        """Return whether static shape functions can be added at nodes."""
        return with_static_shapes(self.model, nodes) is not None

    def sid(self, fineness: Refinement = UNREFINED) -> ConvertedBody:
        """Convert the model, or read the SID from the cache.

        Raises
        ------
        InputError : the model cannot be converted.
        """
        from .model_to_sid import sid_from_model

        model = self.refined(fineness)
        name, file = self._cached_sid_file(model)
        with suppress(InputError):
            return ConvertedBody(read_sid(file), name)
        try:
            sid = sid_from_model(model)
        except InputError as error:
            raise error.located(self.path) from None
        try:
            file.parent.mkdir(exist_ok=True)
            write_sid(file, sid)
        except (OSError, InputError):
            return ConvertedBody(sid, "")
        return ConvertedBody(sid, name)

    def field(self) -> Field:
        """Return the full field of the body, cached beside its SID.

        Raises
        ------
        InputError : the model cannot be converted.
        """
        from .model_to_sid import field_from_model

        file = self._cached_sid_file(self.model)[1].with_suffix(FIELD_ENDING)
        with suppress(InputError):
            return read_field(file)
        field = field_from_model(self.model)[1]
        with suppress(OSError, InputError):
            file.parent.mkdir(exist_ok=True)
            write_field(file, field)
        return field

    def refined(self, fineness: Refinement) -> ModelFile:
        """Return the model with the mesh, modes and shape functions of a refinement."""
        model = refine_model(self.model, fineness.level)
        if model is not None and fineness.static:
            model = with_static_shapes(model, fineness.static)
        if model is not None and fineness.modes is not None:
            model = with_modes(model, fineness.modes)
        assert model is not None
        if fineness.stiffened:
            model = model.model_copy(update={"stiffening": Stiffening()})
        return model

    def _cached_sid_file(self, model: ModelFile) -> tuple[str, Path]:
        """Return the file of the cached SID, as the scene names it and as a
        full path.
        """
        name = f"{CACHE_FOLDER}/{self.path.stem}-{model_digest(model)}.h5"
        return name, self.folder / name


def model_digest(model: ModelFile) -> str:
    """Return a digest of a model, the files that it names and what these include."""
    from .. import __version__

    digest = hashlib.sha256(f"{__version__} {model.model_dump_json()}".encode())
    contents = dict[Path, bytes]()
    for path in _named_files(model):
        contents[path] = path.read_bytes()
        if path.suffix.lower() in _DECKS and _may_include(contents[path]):
            others = filter(Path.is_file, deck_files(path)[1:])
            contents |= {other: other.read_bytes() for other in others}
    for path in sorted(contents):
        digest.update(contents[path])
    return digest.hexdigest()[:16]


def _may_include(deck: bytes) -> bool:
    """Return whether a deck has words by which others are included."""
    text = deck.lower()
    return b"include" in text or b"input" in text


def _named_files(value: Any) -> Iterator[Path]:
    """Yield the texts of a model that are names of files, also in tables by name."""
    if isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _named_files(getattr(value, name))
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from _named_files(part)
    elif isinstance(value, str) and os.path.isfile(value):
        yield Path(value)
