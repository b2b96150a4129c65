"""CONM1, CONM2, CMASS1, CMASS2 and PMASS of Nastran bulk data."""

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.sid_mass import skew

from ...mesh.imported_mesh import RawMass
from .cards import Card
from .content import BulkData, CoordinateSystems, duplicate_error

#: Relative difference of masses in several directions that counts as rounding.
_ROUNDING = 1e-6


def pmass(content: BulkData, card: Card) -> None:
    """PID1, M1, PID2, M2, PID3, M3, PID4, M4."""
    for at in (0, 2, 4, 6):
        if card.word(at):
            label = card.integer(at, "a property")
            if label in content.scalar_masses:
                raise duplicate_error("property", label, card)
            content.scalar_masses[label] = card.real(at + 1, "a mass")


def point_masses(content: BulkData) -> list[RawMass]:
    """Return the masses of all cards at nodes, in the units of the file.

    Masses of CMASS1 and CMASS2 at one node are put together. Those in its directions 1
    to 3 must be equal, those in 4 to 6 are moments of inertia about its axes.
    """
    masses: list[RawMass] = []
    scalar: dict[int, list[tuple[int, float, str]]] = {}
    for card in content.mass_cards:
        with content.stops.collect_errors():
            if card.name in ("CMASS1", "CMASS2"):
                mass, node, component = _scalar_mass(content, card)
                if mass:
                    scalar.setdefault(node, []).append((component, mass, card.place))
            elif card.name == "CONM1":
                masses.append(_read_conm1(card, content.frames))
            else:
                masses.append(_read_conm2(card, content.frames))
    for node, entries in scalar.items():
        with content.stops.collect_errors():
            masses.append(_joined(content, node, entries))
    return masses


def _scalar_mass(content: BulkData, card: Card) -> tuple[float, int, int]:
    """EID, PID or M, G1, C1, G2, C2 as a mass, its node and its component from 0.

    Raises
    ------
    InputError : it has no property, acts between two nodes, or at no node.
    """
    label = card.label(0, "an element")
    if card.name == "CMASS2":
        mass = card.real(1, "a mass")
    else:
        property_ = card.integer(1, "a property", label)
        if property_ not in content.scalar_masses:
            raise InputError(
                f"CMASS1 {label} has the property {property_}, which is not defined",
                place=card.place,
                expected="a PMASS of this file",
            )
        mass = content.scalar_masses[property_]
    ends = [(card.integer(at, "a node", 0), at) for at in (2, 4)]
    nodes = [(node, at) for node, at in ends if node]
    if len(nodes) == 2 and mass:
        raise InputError(
            f"{card.name} {label} is a mass between the nodes {nodes[0][0]} and "
            f"{nodes[1][0]}, which resists their relative acceleration only",
            place=card.place,
            expected="masses at single nodes",
        )
    if not nodes:
        raise InputError(
            f"{card.name} {label} is at no node", place=card.place, expected="a node"
        )
    node, at = nodes[0]
    component = card.integer(at + 1, "a component", 0)
    if node not in content.nodes or component not in range(1, 7):
        raise InputError(
            f"{card.name} {label} is at component {component} of {node}",
            place=card.place,
            expected="components 1 to 6 of nodes (GRID)",
        )
    return mass, node, component - 1


def _joined(
    content: BulkData, node: int, entries: list[tuple[int, float, str]]
) -> RawMass:
    """Return the masses in single directions of a node as one rigid mass.

    Raises
    ------
    InputError : they differ by direction.
    """
    values, place = np.zeros(6), entries[0][2]
    for component, mass, _ in entries:
        values[component] += mass
    system = content.direction_system(node)
    axes = np.array([content.frames.direction(node, system, i) for i in (1, 2, 3)])
    inertia = axes.T @ np.diag(values[3:]) @ axes
    _check_isotropic(f"the scalar masses at node {node}", values[:3], place)
    return RawMass(node, float(values[0]), place, inertia=_six(inertia))


def _check_isotropic(what: str, masses: Array, place: str) -> None:
    if np.ptp(masses) > _ROUNDING * np.abs(masses).max():
        listed = ", ".join(f"{mass:.4g}" for mass in masses)
        raise InputError(
            f"{what} are {listed} in its three directions; a body in large motion has "
            "one mass in all",
            place=place,
            expected="equal masses in directions 1, 2 and 3, or CONM2",
        )


def _six(tensor: Array) -> tuple[float, float, float, float, float, float]:
    """Return xx, yy, zz, xy, yz, zx of a symmetric tensor."""
    i = tensor.tolist()
    return (i[0][0], i[1][1], i[2][2], i[0][1], i[1][2], i[2][0])


def _mass_axes(card: Card, frames: CoordinateSystems, system: int) -> Array:
    """Return the axes (rows) of the system of a mass.

    Raises
    ------
    InputError : they depend on position.
    """
    if system < 0 or (system and not frames.is_rectangular(system, card.place)):
        raise InputError(
            f"{card.name} {card.word(0)} is given in the system {card.word(2)}",
            place=card.place,
            expected="the basic system or a rectangular one",
        )
    return frames.frame(system, card.place)[1]


def _read_conm1(card: Card, frames: CoordinateSystems) -> RawMass:
    """EID, G, CID, and the lower triangle M11, M21, M22, M31, ... of its mass matrix.

    Raises
    ------
    InputError : it is not the mass matrix of a rigid body.
    """
    node = card.integer(1, "a node")
    axes = _mass_axes(card, frames, card.integer(2, "a system", 0))
    matrix = np.zeros((6, 6))
    matrix[np.tril_indices(6)] = [card.real(i, "a mass") for i in range(3, 24)]
    mass, static = float(matrix[0, 0]), matrix[3:, :3]
    _check_isotropic(
        f"masses of CONM1 {card.word(0)}", matrix.diagonal()[:3], card.place
    )
    arm = np.array([static[2, 1], static[0, 2], static[1, 0]])
    scale = np.abs(static).max() + abs(mass)
    other = np.abs(np.tril(matrix[:3, :3], -1)).max()
    if max(other, np.abs(static - skew(arm)).max()) > _ROUNDING * scale or (
        arm.any() and mass <= 0
    ):
        raise InputError(
            f"the matrix of CONM1 {card.word(0)} is not the one of a rigid body",
            place=card.place,
            expected="equal masses, and M41 to M63 that are mass times offset",
        )
    offset = arm / mass if arm.any() else arm
    own = np.tril(matrix[3:, 3:]) + np.tril(matrix[3:, 3:], -1).T
    own = own + mass * (skew(offset) @ skew(offset))
    x, y, z = axes.T @ offset
    return RawMass(
        node,
        mass,
        card.place,
        (float(x), float(y), float(z)),
        _six(axes.T @ own @ axes),
    )


def _read_conm2(card: Card, frames: CoordinateSystems) -> RawMass:
    """EID, G, CID, M, X1, X2, X3, blank, I11, I21, I22, I31, I32, I33.

    Products of inertia are integrals of x y dm there; offset and inertia are along the
    axes of the system CID. With CID = -1 the X are the place of the mass.

    Raises
    ------
    InputError : the axes of its system depend on position.
    """
    given = card.integer(2, "a system", 0)
    node, system = card.integer(1, "a node"), max(given, 0)
    axes = _mass_axes(card, frames, system if given >= -1 else given)
    offset = axes.T @ [card.real(i, "an offset") for i in (4, 5, 6)]
    x, y, z = offset - (frames.named(node, card.place) if given < 0 else np.zeros(3))
    i11, i21, i22, i31, i32, i33 = (card.real(i, "an inertia") for i in range(8, 14))
    own = np.array([[i11, -i21, -i31], [-i21, i22, -i32], [-i31, -i32, i33]])
    return RawMass(
        node,
        card.real(3, "a mass"),
        card.place,
        (float(x), float(y), float(z)),
        _six(axes.T @ own @ axes),
    )
