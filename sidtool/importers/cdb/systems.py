"""Coordinate systems of an ANSYS archive: of elements, and of the nodes' directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError

from ..imported import integers, numbers
from .content import Content, System

Array = NDArray[np.float64]


def axes_of(angles: tuple[float, ...]) -> Array:
    """(3, 3) whose rows are the axes of a system that is turned by THXY, THYZ, THZX."""
    (c, cx, cy), (s, sx, sy) = np.cos(np.radians(angles)), np.sin(np.radians(angles))
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return np.asarray((about_z @ about_x @ about_y).T, float)


def read_local(content: Content, words: list[str]) -> None:
    """LOCAL, number, kind, origin, angles, or these behind LOC and ANG of R5.0.

    It becomes the system that further nodes are given in.
    """
    part = "".join(words[2:3]).upper() if words[1].upper().startswith("R5") else ""
    begin = 3 if part else 1
    label, kind = integers(
        [word or "0" for word in [*words[begin:], ""][:2]], content.place, "a system"
    )
    rest = [word or "0" for word in [*words[begin + 2 :], *[""] * 6][:6]]
    values = tuple(numbers(rest, content.place))
    known = content.systems.get(label, System(kind))
    if part == "ANG":
        content.systems[label] = System(kind, known.origin, values[:3])
    elif part == "LOC":
        content.systems[label] = System(kind, values[:3], known.angles)
    elif not part:
        content.systems[label] = System(kind, values[:3], values[3:])
    elif values[:2] not in ((0.0, 0.0), (1.0, 1.0)) or any(values[2:]):
        raise InputError(
            f"LOCAL {label} has parameters",
            place=content.place,
            expected="a circular system",
        )
    content.current["CSYS"] = label


def system_of(content: Content, label: int, place: str) -> System:
    """One of the file, or one of those that ANSYS has from the start.

    Raises
    ------
    InputError : it is not defined, or neither Cartesian nor cylindrical.
    """
    found = content.systems.get(label, System(label) if label in (0, 1) else None)
    if found is None or found.kind not in (0, 1):
        what = "is not defined" if found is None else f"is of kind {found.kind}"
        raise InputError(
            f"the system {label} {what}",
            place=place,
            expected="a Cartesian or cylindrical system of LOCAL",
        )
    return found
