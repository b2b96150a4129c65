"""What a mesh file says of nodes that depend on each other."""

from __future__ import annotations

from dataclasses import dataclass

#: The coefficients of the displacements x, y, z of a node, by its label.
Term = tuple[int, tuple[float, float, float]]


@dataclass(frozen=True)
class RawEquation:
    """A sum of displacements that is zero.

    Attributes
    ----------
    terms : the first one is that which follows from the others
    """

    terms: tuple[Term, ...]
    place: str


@dataclass(frozen=True)
class RawTie:
    """A surface that is held on another.

    Attributes
    ----------
    slave, master : faces by the labels of their nodes: corners, then the middles of the
        edges from the first corner on
    slave_nodes : labels of nodes that are held one by one, where the slave is no
        surface of faces
    tolerance : how far apart they may be, in the unit of the file; None for a share of
        the size of the faces
    """

    name: str
    slave: tuple[tuple[int, ...], ...]
    master: tuple[tuple[int, ...], ...]
    slave_nodes: tuple[int, ...]
    tolerance: float | None
    place: str
