"""File names: arguments that are paths, and endings that state the kind of a file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .base.errors import InputError

if TYPE_CHECKING:
    from .scene import SceneFile

#: Kinds that a command writes instead, by the ending.
INSTEAD = {
    "sweep": ("picture",),
    "response": ("picture",),
    "campbell": ("picture",),
    "optimisation": ("picture", "page"),
}


def path_of(value: Any, argument: str, instead: str = "") -> Path:
    """Return the path of an argument.

    Parameters
    ----------
    instead : what the argument may be beside the path of a file

    Raises
    ------
    InputError : it is none; names the argument.
    """
    try:
        return Path(value)
    except TypeError:
        raise InputError(
            f"is of the type {type(value).__name__}",
            place=argument,
            expected=f"{instead}, or the path of a file" if instead else "a path",
        ) from None


def scene_given(value: Any) -> SceneFile:
    """The scene that an argument is, or that its file holds.

    Raises
    ------
    InputError : it is neither, or the file is wrong.
    """
    from .scene import SceneFile, read_scene  # costs commands without one 0.2 s

    if isinstance(value, SceneFile):
        return value
    return read_scene(path_of(value, "scene", "a sidtool.Scene"))


_HDF5 = (".h5", ".hdf5")


@dataclass(frozen=True)
class OutputFileKind:
    """Kind of an output file, or a folder, which has no endings.

    Attributes
    ----------
    name : name in messages
    endings : in small letters, the usual one first
    chooses : the ending selects the format, so that one of these is required; else all
        endings are allowed that do not belong to another kind
    """

    name: str
    endings: tuple[str, ...]
    chooses: bool = False


OUTPUT_KINDS = {
    "sid": OutputFileKind(
        "a SID", (".sid_fem", ".sid", ".fem", *_HDF5, ".txt", ".dat")
    ),
    "result": OutputFileKind("a result (HDF5)", _HDF5),
    "field": OutputFileKind("a full field (HDF5)", _HDF5),
    "table": OutputFileKind("a table (CSV)", (".csv", ".txt", ".dat")),
    "sweep": OutputFileKind(
        "a table of a sweep (CSV) or its picture (PNG, SVG or PDF)",
        (".csv", ".txt", ".dat"),
        chooses=True,
    ),
    "stations": OutputFileKind("stations of a beam (CSV)", (".csv",), chooses=True),
    "modes": OutputFileKind("modes (JSON)", (".json",)),
    "state_space": OutputFileKind(
        "a state space (NPZ, MAT, JSON or FMU)",
        (".npz", ".mat", ".json", ".fmu"),
        chooses=True,
    ),
    "campbell": OutputFileKind(
        "a Campbell diagram (CSV or JSON) or its picture (PNG, SVG or PDF)",
        (".csv", ".json"),
        chooses=True,
    ),
    "response": OutputFileKind(
        "a frequency response (CSV or JSON) or its picture (PNG, SVG or PDF)",
        (".csv", ".json"),
        chooses=True,
    ),
    "derivatives": OutputFileKind("a SID with derivatives (HDF5)", _HDF5, chooses=True),
    "study": OutputFileKind("a study (JSON)", (".json",)),
    "optimisation": OutputFileKind(
        "numbers (JSON), their picture (PNG, SVG or PDF) or a report (HTML)",
        (".json",),
        chooses=True,
    ),
    "unit": OutputFileKind("a functional mock-up unit (FMU)", (".fmu",), chooses=True),
    "folder": OutputFileKind("a folder", ()),
    "page": OutputFileKind("a page (HTML)", (".html",), chooses=True),
    "film": OutputFileKind("a film (GIF or MP4)", (".gif", ".mp4"), chooses=True),
    "picture": OutputFileKind(
        "a picture (PNG, SVG or PDF)", (".png", ".svg", ".pdf"), chooses=True
    ),
    "export": OutputFileKind(
        "a file for ParaView (VTKHDF or PVD)", (".vtkhdf", ".pvd"), chooses=True
    ),
    "body": OutputFileKind(
        "a body for another program",
        (".mat", ".op4", ".dmig", ".bdf", ".dat", ".fem", ".npz"),
        chooses=True,
    ),
}
#: Endings of files that people or other programs write.
_OTHERS = {".toml", ".py", ".inp", ".msh", ".bdf", ".jpg", ".jpeg", ".vtk", ".vtu"}
_KNOWN = _OTHERS.union(*(kind.endings for kind in OUTPUT_KINDS.values()))


def check_ending(path: str | os.PathLike[str], kind: str, place: str = "") -> None:
    """Refuse a name whose ending does not fit what is to be written there.

    kind : a key of `OUTPUT_KINDS`
    place : the option or argument that the name came from

    Raises
    ------
    InputError : the ending is that of another kind, or missing where it chooses.
    """
    written, ending = OUTPUT_KINDS[kind], Path(path).suffix.lower()
    if ending in written.endings or not (written.chooses or ending in _KNOWN):
        return
    if not written.endings:
        raise InputError(
            f"is to be {written.name}, and the ending {ending} is that of a file",
            source=path,
            place=place,
            expected="a name without an ending, such as " + Path(path).stem,
        )
    reason = (
        f"the ending {ending} does not say" if ending else "it has no ending to say"
    )
    expected = f"an ending such as {written.endings[0]}"
    if written.chooses:
        others = [OUTPUT_KINDS[other].endings for other in INSTEAD.get(kind, ())]
        expected = f"an ending out of {', '.join(sum(others, written.endings))}"
    raise InputError(
        f"is to hold {written.name}, which {reason}",
        source=path,
        place=place,
        expected=expected,
    )


def kind_by_ending(path: str | os.PathLike[str] | None, *kinds: str) -> str:
    """Return the kind, of those that may be in a file, that its ending states, or the
    first.
    """
    ending = "" if path is None else Path(path).suffix.lower()
    return next((k for k in kinds if ending in OUTPUT_KINDS[k].endings), kinds[0])
