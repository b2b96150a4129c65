"""Rotations between markers in space, counted over full turns.

Two orientations do not determine full turns. Each rotation that something depends on is
a row of `SystemArrays.rotation_counter`. Where its angle is needed it is counted: the
angle is an entry at the end of z_I and is updated after every step to the nearest one
that the orientations allow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..functions.function_table import RealData
from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from .build_inputs import MarkerKey
from .force_rows import ForceRow

#: Joint and coordinate.
Coordinate = tuple[str, str]


@dataclass(frozen=True)
class CountedRotation:
    """The rotation from marker a to marker b.

    Attributes
    ----------
    name
        Of its angle, after its joint; after the force that needs it, if it is between
        markers or begins at another angle than the first one.
    kind
        Kind of its measure, see `dynamics.force_measures`.
    data
        Directions; a rotation vector has none.
    entry
        Its first row of `WorkArrays.rotation_counter`.
    is_counted
        Whether its angle is known beyond half a turn.
    rest
        The angle at the start is the one nearest to this [rad].
    drive
        Row of the function that prescribes it and stands for rest, -1 for none.
    """

    name: str
    kind: int
    a: MarkerKey
    b: MarkerKey
    data: tuple[float, ...]
    entry: int
    is_counted: bool
    rest: float = 0.0
    drive: int = -1

    @property
    def angles(self) -> tuple[str, ...]:
        """Names of its entries."""
        if self.kind != at.ROTATION_VECTOR_MEASURE:
            return (self.name,)
        return tuple(f"{self.name}_{axis}" for axis in "xyz")


def assign_rotation_counters(
    forces: Sequence[ForceRow],
    coordinates: Mapping[Coordinate, ForceRow],
    drives: Mapping[Coordinate, int],
) -> tuple[
    tuple[ForceRow, ...], dict[Coordinate, ForceRow], tuple[CountedRotation, ...]
]:
    """Forces and joint coordinates of a spatial scene, with their rows of
    `WorkArrays.rotation_counter`.

    Parameters
    ----------
    coordinates
        What outputs and events look at.
    drives
        Rows of the functions that prescribe coordinates of joints.
    """
    springs = [e for e in forces if _has_spring(e) and e.coordinate]
    table = RotationTable(drives, {e.coordinate: e.law.rest for e in reversed(springs)})
    known = {key: table.with_counter(element) for key, element in coordinates.items()}
    counted = [table.with_counter(e) if _depends_on_angle(e) else e for e in forces]
    return tuple(table.rated(e) for e in counted), known, tuple(table.rotations)


def _depends_on_angle(element: ForceRow) -> bool:
    return (
        element.kind == at.ROTATION_VECTOR_MEASURE
        or _has_spring(element)
        or element.is_measure
    )


def _has_spring(element: ForceRow) -> bool:
    return len(element.law.stiffness.starts) > 0


class RotationTable:
    """Collects rotations; the counted ones have to come first.

    Attributes
    ----------
    rest_angles
        Of the first spring in each coordinate, from which outputs count, too.
    """

    def __init__(
        self,
        drives: Mapping[Coordinate, int],
        rest_angles: Mapping[Coordinate | None, float],
    ) -> None:
        self.drives, self.rest_angles = drives, rest_angles
        self.rotations: list[CountedRotation] = []

    def with_counter(self, element: ForceRow) -> ForceRow:
        """The element with an entry where its angle is counted."""
        if element.kind not in (at.ANGLE_MEASURE, at.ROTATION_VECTOR_MEASURE):
            return element
        drive = self.drives.get(element.coordinate, -1) if element.coordinate else -1
        rest_angle = element.law.rest
        if not _has_spring(element):
            rest_angle = self.rest_angles.get(element.coordinate, rest_angle)
        rest_angle = rest_angle if drive < 0 else 0.0
        same = [
            t for t in self._at(element) if (t.rest, t.drive) == (rest_angle, drive)
        ]
        rotation = same[0] if same else self._add(element, True, rest_angle, drive)
        component = (
            int(np.argmax(element.data))
            if element.kind == at.ROTATION_VECTOR_MEASURE
            else 0
        )
        return replace(element, rotation_entry=rotation.entry + component)

    def rated(self, element: ForceRow) -> ForceRow:
        """The element with an entry for its rate, if it has none and needs one."""
        if (
            element.kind
            not in (
                at.ANGLE_MEASURE,
                at.DIRECTION_COSINE_MEASURE,
                at.ANGULAR_VELOCITY_MEASURE,
            )
            or element.rotation_entry >= 0
        ):
            return element
        known = self._at(element)
        rotation = known[0] if known else self._add(element, False)
        return replace(element, rotation_entry=rotation.entry)

    def _at(self, element: ForceRow) -> list[CountedRotation]:
        """What is known of the rotation of an element."""
        key = _rotation_key(element)
        return [t for t in self.rotations if (t.kind, t.a, t.b, t.data) == key]

    def _add(
        self, element: ForceRow, counted: bool, rest_angle: float = 0.0, drive: int = -1
    ) -> CountedRotation:
        joint, coordinate = element.coordinate or (element.name, "turn")
        entry = sum(len(rotation.angles) for rotation in self.rotations)
        kind, a, b, data = _rotation_key(element)
        # The first one begins at the first spring of its joint, whatever is recorded.
        is_first = not any(t.is_counted for t in self._at(element))
        name = f"{joint if is_first else element.name}.{coordinate}"
        self.rotations.append(
            CountedRotation(name, kind, a, b, data, entry, counted, rest_angle, drive)
        )
        return self.rotations[-1]


def _rotation_key(
    element: ForceRow,
) -> tuple[int, MarkerKey, MarkerKey, tuple[float, ...]]:
    assert element.a is not None
    data = () if element.kind == at.ROTATION_VECTOR_MEASURE else element.data
    return element.kind, element.a, element.b, data


def rotation_table(
    rotations: Sequence[CountedRotation],
    markers: Mapping[MarkerKey, int],
    real_data: RealData,
) -> IntTable:
    """The table of rotations."""
    rows = [
        (t.kind, markers[t.a], markers[t.b], real_data.add(t.data), t.entry)
        for t in rotations
    ]
    return np.array(rows, np.int64).reshape(-1, at.N_ROTATION_COUNTER)
