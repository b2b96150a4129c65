"""Files of bodies for other programs, by their endings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.file_names import check_ending
from sidtool.formats.storage.atomic import atomic_path

from .craig_bampton import (
    Superelement,
    check_linear_body,
    node_numbers,
    superelement_of_sid,
)
from .exudyn import exudyn_arrays
from .mbdyn import mbdyn_text
from .nastran import dmig_text, op4_text
from .openfast import extptfm_text
from .simscape import write_simscape


@dataclass(frozen=True)
class BodyFormat:
    """A file that holds a superelement, or a body with a floating frame.

    Attributes
    ----------
    program : that reads it
    write_element : writes a superelement, or None
    write_body : writes a SID with some of its nodes, or None
    """

    program: str
    write_element: Callable[[Path, Superelement], None] | None = None
    write_body: Callable[[Path, SID, Sequence[str]], None] | None = None


def _text_of_element(
    text_of: Callable[[Superelement], str],
) -> Callable[[Path, Superelement], None]:
    def write(path: Path, element: Superelement) -> None:
        path.write_text(text_of(element), encoding="ascii", newline="\n")

    return write


def _write_mbdyn(path: Path, sid: SID, nodes: Sequence[str]) -> None:
    text = mbdyn_text(sid, nodes, node_numbers(nodes))
    path.write_text(text, encoding="ascii", newline="\n")


def _write_exudyn(path: Path, sid: SID, nodes: Sequence[str]) -> None:
    arrays: dict[str, Any] = dict(exudyn_arrays(sid, nodes))
    with path.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


_DMIG = BodyFormat("Nastran (DMIG)", write_element=_text_of_element(dmig_text))
#: One line adds a format.
BODY_FORMATS: dict[str, BodyFormat] = {
    ".mat": BodyFormat("Simscape Multibody", write_element=write_simscape),
    ".op4": BodyFormat("Nastran (OUTPUT4)", write_element=_text_of_element(op4_text)),
    ".dmig": _DMIG,
    ".bdf": _DMIG,
    ".dat": BodyFormat(
        "OpenFAST (ExtPtfm)", write_element=_text_of_element(extptfm_text)
    ),
    ".fem": BodyFormat("MBDyn", write_body=_write_mbdyn),
    ".npz": BodyFormat("Exudyn", write_body=_write_exudyn),
}


def write_body(
    path: Path,
    sid: SID,
    nodes: Sequence[str],
    *,
    names: Mapping[str, str] | None = None,
    fixed: Sequence[str] = (),
) -> Superelement | None:
    """Write a body in the format of the ending.

    Parameters
    ----------
    nodes : ids of the nodes of the SID that other bodies are connected to
    names : node id -> name of the interface
    fixed : names of interfaces of a superelement that do not move

    Returns
    -------
    the superelement, or None if the format holds shape functions and integrals

    Raises
    ------
    InputError : the ending is unknown, or the body does not suit the format.
    """
    check_ending(path, "body")
    kind = BODY_FORMATS[path.suffix.lower()]
    if kind.write_element is not None:
        element = superelement_of_sid(sid, nodes, names)
        if fixed:
            element = element.with_supports(fixed)
        with atomic_path(path) as temporary:
            kind.write_element(temporary, element)
        return element
    if fixed:
        raise InputError(
            f"is not possible for {kind.program}",
            place="fixed",
            expected="supports among the joints of the other program",
        )
    check_linear_body(sid)
    assert kind.write_body is not None
    with atomic_path(path) as temporary:
        kind.write_body(temporary, sid, nodes)
    return None
