"""Shells with rotational degrees of freedom, and springs of a mesh file."""

from __future__ import annotations

from dataclasses import dataclass

from sidtool.formats.base.taylor import Array

from .connections import Vector


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
    kind : tri3 or quad4
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
    stiffness : (6,) along and about its axes
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
