"""Contents of an ANSYS archive, and its coordinate systems."""

from dataclasses import dataclass, field

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ...mesh.deck_text import RefusalCollector, parse_integers, parse_numbers


@dataclass(frozen=True)
class LocalSystem:
    """A system of LOCAL.

    Attributes
    ----------
    kind : 0 Cartesian, 1 cylindrical, 2 spherical, 3 toroidal
    origin, angles : in the global system; about z, x and y in turn [degrees]
    """

    kind: int
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    angles: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass
class ConstraintEquation:
    """A CE: nodes, labels of directions and factors."""

    place: str
    terms: list[tuple[int, str, float]] = field(default_factory=list)


@dataclass
class ArchiveContent:
    """The lines of an archive, and their content.

    Attributes
    ----------
    density : of materials without DENS
    turned : node -> angles of its directions, if they are not zero
    systems : of LOCAL
    stops : reasons to refuse the file
    sums, coupled, reals : CE, CP by number and direction, and R
    """

    lines: list[str]
    at: int = 0
    density: float | None = None
    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    types: dict[int, int] = field(default_factory=dict)
    options: dict[tuple[int, int], int] = field(default_factory=dict)
    elements: list[tuple[list[int], str]] = field(default_factory=list)
    constants: dict[int, dict[str, float]] = field(default_factory=dict)
    tables: dict[tuple[int, str], list[float]] = field(default_factory=dict)
    sets: dict[str, list[int]] = field(default_factory=dict)
    parts: dict[str, list[int]] = field(default_factory=dict)
    current: dict[str, int] = field(default_factory=dict)
    unread_keywords: dict[str, None] = field(default_factory=dict)
    branches: int = 0
    turned: dict[int, tuple[float, ...]] = field(default_factory=dict)
    systems: dict[int, LocalSystem] = field(default_factory=dict)
    sums: dict[int, ConstraintEquation] = field(default_factory=dict)
    coupled: dict[tuple[str, str], tuple[str, list[int]]] = field(default_factory=dict)
    reals: dict[int, list[float]] = field(default_factory=dict)
    stops: RefusalCollector = field(default_factory=RefusalCollector)

    @property
    def place(self) -> str:
        """Location of the current line."""
        return f"line {self.at}"

    def next(self) -> str:
        """The next line.

        Raises
        ------
        InputError : the file ends.
        """
        if self.at >= len(self.lines):
            raise InputError("ends inside a block", expected="the rest of the block")
        self.at += 1
        return self.lines[self.at - 1]


def axes_of(angles: tuple[float, ...]) -> Array:
    """(3, 3) whose rows are the axes of a system that is turned by THXY, THYZ, THZX."""
    (c, cx, cy), (s, sx, sy) = np.cos(np.radians(angles)), np.sin(np.radians(angles))
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return np.asarray((about_z @ about_x @ about_y).T, float)


def read_local(content: ArchiveContent, words: list[str]) -> None:
    """LOCAL, number, kind, origin, angles, or these behind LOC and ANG of R5.0.

    It becomes the system that further nodes are given in.
    """
    part = "".join(words[2:3]).upper() if words[1].upper().startswith("R5") else ""
    begin = 3 if part else 1
    label, kind = parse_integers(
        [word or "0" for word in [*words[begin:], ""][:2]], content.place, "a system"
    )
    rest = [word or "0" for word in [*words[begin + 2 :], *[""] * 6][:6]]
    values = tuple(parse_numbers(rest, content.place))
    known = content.systems.get(label, LocalSystem(kind))
    if part == "ANG":
        content.systems[label] = LocalSystem(kind, known.origin, values[:3])
    elif part == "LOC":
        content.systems[label] = LocalSystem(kind, values[:3], known.angles)
    elif not part:
        content.systems[label] = LocalSystem(kind, values[:3], values[3:])
    elif values[:2] not in ((0.0, 0.0), (1.0, 1.0)) or any(values[2:]):
        raise InputError(
            f"LOCAL {label} has parameters",
            place=content.place,
            expected="a circular system",
        )
    content.current["CSYS"] = label


def system_of(content: ArchiveContent, label: int, place: str) -> LocalSystem:
    """Return a system of the file, or a predefined one of ANSYS.

    Raises
    ------
    InputError : it is not defined, or neither Cartesian nor cylindrical.
    """
    system = content.systems.get(label, LocalSystem(label) if label in (0, 1) else None)
    if system is None or system.kind not in (0, 1):
        what = "is not defined" if system is None else f"is of kind {system.kind}"
        raise InputError(
            f"the system {label} {what}",
            place=place,
            expected="a Cartesian or cylindrical system of LOCAL",
        )
    return system
