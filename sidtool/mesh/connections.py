"""Connections between nodes of a mesh file: bars, shells, springs, ties, equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

Vector = tuple[float, float, float]
#: Places along a bar from 0 to 1 and values there, linear between them.
SectionProfile = tuple[tuple[float, float], ...]

#: The coefficients of the displacements x, y, z of a node, by its label.
Term = tuple[int, tuple[float, float, float]]
Indices = NDArray[np.int64]


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

    area: SectionProfile
    iy: SectionProfile = ()
    iz: SectionProfile = ()
    torsion: SectionProfile = ()
    extra: SectionProfile = ()
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
    pins : directions 1 to 6 of the axes by `y_axis` that are released at either end
    e, g, density : of its material, zero if the file does not state them
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


@dataclass(frozen=True)
class RawEquation:
    """A sum of displacements and rotations that is zero.

    Attributes
    ----------
    terms : the first one is that which follows from the others
    rotations : the coefficients of the rotations of nodes
    """

    terms: tuple[Term, ...]
    place: str
    rotations: tuple[Term, ...] = ()


@dataclass(frozen=True)
class RawTie:
    """A surface that is tied to another one.

    Attributes
    ----------
    slave, master : faces by the labels of their nodes: corners, then the middles of the
        edges from the first corner on
    slave_nodes : labels of nodes that are tied one by one, if the slave is no surface
        of faces
    tolerance : how far apart they may be, in the unit of the file; None for a share of
        the size of the faces
    """

    name: str
    slave: tuple[tuple[int, ...], ...]
    master: tuple[tuple[int, ...], ...]
    slave_nodes: tuple[int, ...]
    tolerance: float | None
    place: str


@dataclass(frozen=True, eq=False)
class Coupling:
    """Nodes coupled to a reference point.

    Attributes
    ----------
    rigid : whether the nodes are one rigid piece (RBE2); else the point takes their
        mean motion (RBE3)
    nodes : rows of the positions of the body
    weights : (n, n) weights of the nodes in the mean, equal if None
    position : (3,) of the reference point [m]; None for the centre of the nodes
    markers : markers of the model file at the reference point
    """

    name: str
    rigid: bool
    nodes: Indices
    position: Array | None
    markers: tuple[str, ...] = ()
    weights: sp.csr_matrix | None = None


@dataclass(frozen=True, eq=False)
class PointMass:
    """A mass at a node of the body, or at the reference point of a coupling.

    Attributes
    ----------
    node : row of the positions, None at a coupling
    coupling : name of the coupling
    mass : [kg]
    offset : (3,) from the node [m]
    inertia : (3, 3) about its centre, axes of the model [kg m^2]
    """

    node: int | None
    coupling: str | None
    mass: float
    offset: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations that all rigid motions of the body satisfy.

    Attributes
    ----------
    matrix : (k, ndof) sparse; ``matrix @ u = 0``
    dependent : (k,) preferred dependent degree of freedom of each equation
    """

    matrix: sp.csr_matrix
    dependent: NDArray[np.int64]


class NamedSets(dict[str, NDArray[np.int64]]):
    """Node sets by name; access to a missing or incomplete set is refused.

    Attributes
    ----------
    undefined : set -> its members that the file does not define, as text
    """

    def __init__(
        self,
        sets: Mapping[str, NDArray[np.int64]] | None = None,
        undefined: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(sets or {})
        self.undefined = dict(undefined or {})

    def __getitem__(self, name: str) -> NDArray[np.int64]:
        if name in self.undefined:
            raise InputError(
                f"the set {name!r} names {self.undefined[name]}, which the file does "
                "not define",
                expected="a set of nodes and elements of the file",
            )
        return super().__getitem__(name)

    def __missing__(self, name: str) -> NoReturn:
        known = ", ".join(sorted(self)) or "none (the file names no set)"
        raise InputError(f"there is no node set {name!r}", expected=f"one of {known}")


@dataclass(frozen=True, eq=False)
class ShellSection:
    """Stiffness and mass of a shell per area, in its material axes.

    Strains are xx, yy and the engineering shear xy, of the surface of the nodes.

    Attributes
    ----------
    membrane, coupling, bending : (3, 3) of N = A e + B k, M = B e + D k
    shear : (2, 2) of the transverse shear forces, xz and yz
    masses : (3,) integral of rho, rho z and rho z^2 through the thickness
    thickness : for pictures
    flexural : True if it resists bending; a membrane has no moments at nodes
    complete : whether its materials have E, nu and a density
    """

    membrane: Array
    coupling: Array
    bending: Array
    shear: Array
    masses: tuple[float, float, float]
    thickness: float
    flexural: bool = True
    complete: bool = True

    def shifted(self, offset: float) -> ShellSection:
        """Return the section with its reference surface moved by -offset along the
        normal.

        Parameters
        ----------
        offset : of the layers from the nodes
        """
        a, b, d, z = self.membrane, self.coupling, self.bending, offset
        m0, m1, m2 = self.masses
        return ShellSection(
            a,
            b + z * a,
            d + 2 * z * b + z**2 * a,
            self.shear,
            (m0, m1 + z * m0, m2 + 2 * z * m1 + z**2 * m0),
            self.thickness,
            self.flexural,
            self.complete,
        )

    def scaled(self, stress: float, length: float, density: float) -> ShellSection:
        """In other units, by the factors of stress, length and density."""
        m0, m1, m2 = self.masses
        return ShellSection(
            self.membrane * (stress * length),
            self.coupling * (stress * length**2),
            self.bending * (stress * length**3),
            self.shear * (stress * length),
            (
                m0 * density * length,
                m1 * density * length**2,
                m2 * density * length**3,
            ),
            self.thickness * length,
            self.flexural,
            self.complete,
        )


@dataclass(frozen=True, eq=False)
class RawShell:
    """A shell element, in the units of the file.

    Attributes
    ----------
    kind : tri3 or quad4; panel for a shear panel
    nodes : labels of its nodes
    section : its stiffness and mass per area
    axis : direction whose projection on the element is the material axis x; None if the
        angle defines it
    angle : of the material axis x from the first edge [rad]
    """

    label: int
    kind: str
    nodes: tuple[int, ...]
    place: str
    section: ShellSection
    axis: Vector | None = None
    angle: float = 0.0


@dataclass(frozen=True, eq=False)
class RawSpring:
    """A spring between the motions of two nodes, in the units of the file.

    Attributes
    ----------
    nodes : labels; the second one None for the ground
    axes : (3, 3) rows x, y, z of its directions
    stiffness : (6,) along and about its axes; (1,) with `components`
    location : (3,) where both ends are joined, as arms of the nodes; None where they
        are joined component by component
    components : those of each end from 0 that a spring of components joins
    """

    label: int
    nodes: tuple[int, int | None]
    place: str
    axes: tuple[Array, Array]
    stiffness: tuple[float, ...]
    location: Array | None = None
    components: tuple[int, int] | None = None
