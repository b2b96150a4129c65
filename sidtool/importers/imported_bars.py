"""What a mesh file says of bars and rods between two nodes."""

from __future__ import annotations

from dataclasses import dataclass

Vector = tuple[float, float, float]
#: Places along a bar from 0 to 1 and values there, linear between them.
Course = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class BarSection:
    """Cross-sections of a bar or rod, which has no second moments.

    Attributes
    ----------
    area, iy, iz, torsion, extra : course of the area, the second moments about y and z,
        the torsion constant and of further mass per length
    shear : shear areas by y and z divided by the area
    turn : of the principal axes, which iy and iz are about, from the y axis of the bar
        towards its z axis [rad]
    """

    area: Course
    iy: Course = ()
    iz: Course = ()
    torsion: Course = ()
    extra: Course = ()
    shear: tuple[float, float] = (1.0, 1.0)
    turn: float = 0.0

    @property
    def uniform(self) -> bool:
        """Whether all but the further mass is the same everywhere."""
        return all(len(c) < 2 for c in (self.area, self.iy, self.iz, self.torsion))


@dataclass(frozen=True)
class RawBar:
    """A straight bar, in the units of the file.

    Attributes
    ----------
    nodes, offsets : labels of the nodes of its ends, and the ends from them
    y_axis : a direction in the plane of its axes x and y; None for a rod, which has
        neither bending nor shear
    pins : directions 1 to 6 of its axes that either end does not pass on to its node
    e, g, density : of its material, zero where the file does not say them
    """

    label: int
    nodes: tuple[int, int]
    place: str
    y_axis: Vector | None
    e: float
    g: float
    density: float
    section: BarSection
    offsets: tuple[Vector, Vector] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    pins: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())
