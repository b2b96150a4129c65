"""Endings of file names, and whether one says what a file holds."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from .errors import InputError

_HDF5 = (".h5", ".hdf5")


@dataclass(frozen=True)
class Written:
    """A kind of file that is written, or a folder, which has no endings.

    name : how messages call it
    endings : in small letters, the usual one first
    chooses : the ending says how it is written, so that there has to be one of these;
        else all that are not those of another kind will do
    """

    name: str
    endings: tuple[str, ...]
    chooses: bool = False


WRITTEN = {
    "sid": Written("a SID", (".sid_fem", ".sid", ".fem", *_HDF5, ".txt", ".dat")),
    "result": Written("a result (HDF5)", _HDF5),
    "field": Written("a full field (HDF5)", _HDF5),
    "table": Written("a table (CSV)", (".csv", ".txt", ".dat")),
    "sweep": Written("a table of a sweep (CSV)", (".csv", ".txt", ".dat")),
    "modes": Written("modes (JSON)", (".json",)),
    "study": Written("a study (JSON)", (".json",)),
    "folder": Written("a folder", ()),
    "page": Written("a page (HTML)", (".html",), chooses=True),
    "film": Written("a film (GIF or MP4)", (".gif", ".mp4"), chooses=True),
    "picture": Written(
        "a picture (PNG, SVG or PDF)", (".png", ".svg", ".pdf"), chooses=True
    ),
    "export": Written(
        "a file for ParaView (VTKHDF or PVD)", (".vtkhdf", ".pvd"), chooses=True
    ),
}
#: Endings of files that people or other programs write.
_OTHERS = {".toml", ".py", ".inp", ".msh", ".bdf", ".jpg", ".jpeg", ".vtk", ".vtu"}
_KNOWN = _OTHERS.union(*(kind.endings for kind in WRITTEN.values()))


def check_ending(path: str | os.PathLike[str], kind: str, place: str = "") -> None:
    """Refuse a name whose ending does not fit what is to be written there.

    kind : a key of `WRITTEN`
    place : the option or argument that the name came from

    Raises
    ------
    InputError : the ending is that of another kind, or missing where it chooses.
    """
    written, ending = WRITTEN[kind], Path(path).suffix.lower()
    if ending in written.endings or not (written.chooses or ending in _KNOWN):
        return
    if not written.endings:
        raise InputError(
            f"is to be {written.name}, and the ending {ending} is that of a file",
            source=path,
            place=place,
            expected="a name without an ending, such as " + Path(path).stem,
        )
    said = f"the ending {ending} does not say" if ending else "it has no ending to say"
    expected = f"an ending such as {written.endings[0]}"
    if written.chooses:
        expected = f"an ending out of {', '.join(written.endings)}"
    raise InputError(
        f"is to hold {written.name}, which {said}",
        source=path,
        place=place,
        expected=expected,
    )


def kind_by_ending(path: str | os.PathLike[str] | None, *kinds: str) -> str:
    """Of kinds that may stand in a file the one that its ending says, else the
    first."""
    ending = "" if path is None else Path(path).suffix.lower()
    return next((k for k in kinds if ending in WRITTEN[k].endings), kinds[0])
