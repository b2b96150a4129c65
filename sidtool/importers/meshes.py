"""Mesh files by their endings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from sidtool.formats.errors import InputError

from .bdf.reading import read_bdf
from .cdb.reading import read_cdb
from .imported import ImportedMesh
from .inp.reading import read_inp
from .msh import read_msh
from .parts import part_of

#: One line adds a format.
MESH_READERS: dict[str, Callable[[str | Path, frozenset[str]], ImportedMesh]] = {
    ".inp": read_inp,
    ".msh": read_msh,
    ".bdf": read_bdf,
    ".nas": read_bdf,
    ".dat": read_bdf,
    ".cdb": read_cdb,
}


def read_mesh(
    path: str | Path, ignored: Iterable[str] = (), part: str | None = None
) -> ImportedMesh:
    """The mesh of a file.

    Parameters
    ----------
    ignored : keywords, cards or commands that are left out on purpose
    part : the instance, the set or component of elements, or the number of the
        property, that is the body; None for all

    Raises
    ------
    InputError : the ending is unknown, or names file, line and expectation.
    """
    ending = Path(path).suffix.lower()
    if ending not in MESH_READERS:
        raise InputError(
            f"files ending in {ending or 'nothing'} are not known as meshes",
            source=path,
            expected=", ".join(MESH_READERS),
        )
    words = frozenset(" ".join(word.upper().strip("*$").split()) for word in ignored)
    if part is None:
        return MESH_READERS[ending](path, words)
    if ending == ".inp":
        return read_inp(path, words, part)
    imported = MESH_READERS[ending](path, words)
    try:
        return part_of(imported, part)
    except InputError as error:
        raise error.located(path) from None
