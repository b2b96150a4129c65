"""Mesh files by their endings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path

from sidtool.formats.errors import InputError

from .imported import ImportedMesh
from .included import foreign_text_hidden
from .parts import part_of

Reader = Callable[..., ImportedMesh]

#: Ending -> module and function; one line adds a format. Only the reader that a file
#: needs is imported.
MESH_READERS = {
    ".inp": ("inp.reading", "read_inp"),
    ".msh": ("msh", "read_msh"),
    ".bdf": ("bdf.reading", "read_bdf"),
    ".nas": ("bdf.reading", "read_bdf"),
    ".dat": ("bdf.reading", "read_bdf"),
    ".cdb": ("cdb.reading", "read_cdb"),
}


def read_mesh(
    path: str | Path,
    ignored: Iterable[str] = (),
    part: str | None = None,
    density: float | None = None,
    *,
    bending: bool = False,
) -> ImportedMesh:
    """The mesh of a file.

    Parameters
    ----------
    ignored : keywords, cards or commands that are left out on purpose
    part : the instance, the set or component of elements, or the number of the
        property, that is the body; None for all
    density : of materials that the file gives none, in its units
    bending : whether plane elements of bulk data are shells, wherever they stand

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
    module, name = MESH_READERS[ending]
    reader: Reader = getattr(import_module(f".{module}", __package__), name)
    shells = {"bending": True} if bending else {}
    with foreign_text_hidden(Path(path)):
        if part is None:
            return reader(path, words, density=density, **shells)
        if ending == ".inp":
            return reader(path, words, part, density=density)
        imported = reader(path, words, density=density, **shells)
    try:
        return part_of(imported, part)
    except InputError as error:
        raise error.located(path) from None
