"""Rotations between markers in space, of which two orientations tell no full turns.

Each that something depends on is one row of `space.layout.System.turn`. Those whose
angle matters are counted: the angle itself stands at the end of z_I and is renewed
after every step, to the nearest one that the orientations allow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..functions.pool import Pool
from ..space import layout as at
from ..space.layout import IntTable
from .forces.elements import Element
from .ingredients import Reference

#: Joint and coordinate.
Coordinate = tuple[str, str]


@dataclass(frozen=True)
class Turn:
    """The rotation from marker a to marker b.

    name : of its angle, after the force or joint that needs it first
    kind : TWIST, TILT, LEAN or SPIN, see `space.layout`
    data : directions of all but TILT
    entry : its first entry of Work.turn
    counted : whether its angle is known beyond half a turn
    rest : the angle at the start is the one nearest to this [rad]
    drive : row of the function that prescribes it and stands for rest, -1 for none
    """

    name: str
    kind: int
    a: Reference
    b: Reference
    data: tuple[float, ...]
    entry: int
    counted: bool
    rest: float = 0.0
    drive: int = -1

    @property
    def angles(self) -> tuple[str, ...]:
        """Names of its entries."""
        if self.kind != at.TILT:
            return (self.name,)
        return tuple(f"{self.name}_{axis}" for axis in "xyz")


def with_turns(
    forces: Sequence[Element],
    coordinates: Mapping[Coordinate, Element],
    drives: Mapping[Coordinate, int],
) -> tuple[tuple[Element, ...], dict[Coordinate, Element], tuple[Turn, ...]]:
    """Forces and joint coordinates of a spatial scene, with their entries of Work.turn.

    Parameters
    ----------
    coordinates : what outputs and events look at
    drives : rows of the functions that prescribe coordinates of joints
    """
    springs = [e for e in forces if _has_spring(e) and e.coordinate]
    book = _Book(drives, {e.coordinate: e.law.rest for e in reversed(springs)})
    known = {key: book.counted(element) for key, element in coordinates.items()}
    counted = [book.counted(e) if _depends_on_angle(e) else e for e in forces]
    return tuple(book.rated(e) for e in counted), known, tuple(book.turns)


def _depends_on_angle(element: Element) -> bool:
    return element.kind == at.TILT or _has_spring(element) or element.is_read


def _has_spring(element: Element) -> bool:
    return len(element.law.stiffness.starts) > 0


class _Book:
    """Collects rotations; the counted ones have to come first.

    rests : of the first spring in each coordinate, from which outputs count, too
    """

    def __init__(
        self,
        drives: Mapping[Coordinate, int],
        rests: Mapping[Coordinate | None, float],
    ) -> None:
        self.drives, self.rests = drives, rests
        self.turns: list[Turn] = []

    def counted(self, element: Element) -> Element:
        """The element with an entry where its angle is counted."""
        if element.kind not in (at.TWIST, at.TILT):
            return element
        drive = self.drives.get(element.coordinate, -1) if element.coordinate else -1
        rest = element.law.rest
        if not _has_spring(element):
            rest = self.rests.get(element.coordinate, rest)
        rest = rest if drive < 0 else 0.0
        same = [t for t in self._at(element) if (t.rest, t.drive) == (rest, drive)]
        turn = same[0] if same else self._add(element, True, rest, drive)
        component = int(np.argmax(element.data)) if element.kind == at.TILT else 0
        return replace(element, turn=turn.entry + component)

    def rated(self, element: Element) -> Element:
        """The element with an entry for its rate, if it has none and needs one."""
        if element.kind not in (at.TWIST, at.LEAN, at.SPIN) or element.turn >= 0:
            return element
        known = self._at(element)
        turn = known[0] if known else self._add(element, False)
        return replace(element, turn=turn.entry)

    def _at(self, element: Element) -> list[Turn]:
        """What is known of the rotation of an element."""
        place = _place(element)
        return [t for t in self.turns if (t.kind, t.a, t.b, t.data) == place]

    def _add(
        self, element: Element, counted: bool, rest: float = 0.0, drive: int = -1
    ) -> Turn:
        what = element.coordinate[1] if element.coordinate else "turn"
        entry = sum(len(turn.angles) for turn in self.turns)
        kind, a, b, data = _place(element)
        name = f"{element.name}.{what}"
        self.turns.append(Turn(name, kind, a, b, data, entry, counted, rest, drive))
        return self.turns[-1]


def _place(element: Element) -> tuple[int, Reference, Reference, tuple[float, ...]]:
    assert element.a is not None
    data = () if element.kind == at.TILT else element.data
    return element.kind, element.a, element.b, data


def turn_table(
    turns: Sequence[Turn], markers: Mapping[Reference, int], pool: Pool
) -> IntTable:
    """The table of rotations."""
    rows = [
        (t.kind, markers[t.a], markers[t.b], pool.add(t.data), t.entry) for t in turns
    ]
    return np.array(rows, np.int64).reshape(-1, at.N_TURN)
