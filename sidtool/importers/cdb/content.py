"""What an ANSYS archive says of a body, as its commands are read one by one."""

from __future__ import annotations

from dataclasses import dataclass, field

from sidtool.formats.errors import InputError

from ..stops import Stops


@dataclass(frozen=True)
class System:
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
class Sum:
    """A CE: nodes, labels of directions and factors."""

    place: str
    terms: list[tuple[int, str, float]] = field(default_factory=list)


@dataclass
class Content:
    """The lines of an archive, and what was read of them.

    Attributes
    ----------
    density : of materials without DENS
    turned : node -> angles of its directions, where these are not zero
    systems : of LOCAL
    stops : what refuses the file
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
    said: dict[str, None] = field(default_factory=dict)
    branches: int = 0
    turned: dict[int, tuple[float, ...]] = field(default_factory=dict)
    systems: dict[int, System] = field(default_factory=dict)
    sums: dict[int, Sum] = field(default_factory=dict)
    coupled: dict[tuple[str, str], tuple[str, list[int]]] = field(default_factory=dict)
    reals: dict[int, list[float]] = field(default_factory=dict)
    stops: Stops = field(default_factory=Stops)

    @property
    def place(self) -> str:
        """Where the reader is."""
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
