"""Rows of the table of forces: scalar measures of the motion of two markers.

What acts on one is its law; without one it is a measure that others read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sidtool.formats.scene import SceneFile, marker_names, marker_reference

from ...functions.native import Native
from ...functions.pool import Pool
from ...space import layout as at
from ...space.layout import IntTable
from ..ingredients import Reference
from ..joints import joint_parts
from .force_laws import Law


@dataclass(frozen=True, eq=False)
class Programmed:
    """The law of a row of the table of forces.

    reads : of all outputs that it reads: which of its measures, and the output as a
        function of that and its rate
    natives : callables in it, whose addresses its code holds
    """

    reads: Mapping[str, tuple[int, Callable[[float, float], float]]]
    natives: tuple[Native, ...]


@dataclass(frozen=True, eq=False)
class Element:
    """One row of the force table.

    kind : see `space.layout`
    a, b : markers; a given force has no `a`
    data : direction or components; of a sum of measures their number, then weights
    function : row of its function of time, -1 for none
    coordinate : joint and coordinate that are its measure, if they are
    turn : entry of Work.turn that is its measure, -1 for none, see `turns`
    code : instructions of its law, see `kernels.forces.programs`; empty for none
    programmed : what is known of that law
    rates : of a drive, how many rows behind it those of its two derivatives are
    is_read : no force, but a measure for the next row that has a law
    sampled : time between samples of its law [s], 0 for one that acts all the time
    """

    name: str
    kind: int
    a: Reference | None
    b: Reference
    data: tuple[float, ...]
    law: Law
    function: int = -1
    coordinate: tuple[str, str] | None = None
    turn: int = -1
    code: tuple[float, ...] = ()
    programmed: Programmed | None = None
    rates: tuple[int, int] | None = None
    is_read: bool = False
    sampled: float = 0.0

    @property
    def acts(self) -> bool:
        """Whether it is a force on bodies; else a measure, or a law of a state or a
        drive."""
        return not self.is_read and self.kind < at.COORDINATE


def joint_coordinate(scene: SceneFile, joint: str, coordinate: str) -> Element:
    """What measures a coordinate of a joint, without a force."""
    connects = scene.joints[joint]
    parts = joint_parts(connects, scene.dimension == "planar")
    part = parts.coordinates[coordinate]
    a, b = (marker_reference(text) for text in marker_names(connects))
    if part.swapped:
        a, b = b, a
    data, key = tuple(map(float, part.data)), (joint, coordinate)
    return Element(joint, _MEASURES[part.kind], a, b, data, Law(), coordinate=key)


#: The measure that is the coordinate of a primitive constraint.
_MEASURES = {at.ANGLE: at.TWIST, at.ALONG: at.SLIDE, at.DISTANCE: at.SPAN}


def force_table(
    elements: tuple[Element, ...],
    markers: dict[Reference, int],
    order: Sequence[str],
    pool: Pool,
) -> IntTable:
    """The table of forces, without their rows in Newton matrices.

    order : names of bodies, as in their table
    """
    table = np.full((len(elements), at.N_FORCE), -1, np.int64)
    for k, (row, element) in enumerate(zip(table, elements, strict=True)):
        row[at.F_KIND], row[at.F_SAMPLED] = element.kind, 0
        if element.kind == at.COORDINATE:
            row[at.F_B] = order.index(element.b[0])
            row[at.F_DATA] = int(element.data[0])
        elif element.kind == at.PRESCRIBED:
            row[[at.F_A, at.F_B]] = k + np.array(element.rates or (0, 0))
        else:
            row[at.F_A] = -1 if element.a is None else markers[element.a]
            row[at.F_B] = markers[element.b]
            row[at.F_DATA] = pool.add(element.data)
        row[at.F_LAW] = pool.add(element.law.packed())
        row[at.F_TIME] = element.function
        row[at.F_TURN] = element.turn
        if element.kind == at.COMBINED:
            table[k - int(element.data[0]) : k, at.F_OWNER] = k
        if element.code:
            row[at.F_CODE] = pool.add(element.code)
            read = int(element.code[0])
            table[k - read : k, at.F_OWNER] = k
            row[at.F_SAMPLED] = int(element.sampled > 0.0)
    return table


def most_read(elements: Sequence[Element]) -> int:
    """The largest number of measures that a law reads."""
    return max((int(e.code[0]) for e in elements if e.code), default=0)
