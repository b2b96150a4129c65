"""PSHELL and PCOMP of Nastran bulk data as sections of shells; MAT2 and MAT8."""

from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ...mesh.connections import RawShell, ShellSection
from ...mesh.deck_text import parse_integers
from ...mesh.imported_mesh import collapse_element
from .cards import Card, is_real, real_number
from .content import BulkData, PlaneLaw, Property, duplicate_error
from .properties import corner_thicknesses, new_name

#: Transverse shear stiffness without MID3, as a multiple of the in-plane shear
#: stiffness.
_UNSHEARED = 100.0
_KINDS = ("quad4", "tri3")
#: Fields after the nodes of CQUAD4 and CTRIA3.
_ANGLE, _OFFSET = 0, 1


def mat2(content: BulkData, card: Card) -> None:
    """MID, G11, G12, G13, G22, G23, G33, RHO."""
    name = new_name(content, card)
    a, b, c, d, e, f = (card.real(i, "a constant") for i in range(1, 7))
    law = np.array([[a, b, c], [b, d, e], [c, e, f]])
    rho = content.density_of(name, card.real(7, "a density"))
    content.plane[name] = PlaneLaw(law, np.zeros((2, 2)), rho)
    content.materials[name] = None


def mat8(content: BulkData, card: Card) -> None:
    """MID, E1, E2, NU12, G12, G1Z, G2Z, RHO.

    Raises
    ------
    InputError : a strain takes no energy.
    """
    name = new_name(content, card)
    e1, e2, nu, g, g1, g2 = (card.real(i, "a constant") for i in range(1, 7))
    share = 1 - nu**2 * e2 / e1 if e1 else 0.0
    if min(e1, e2, g, share) <= 0:
        raise InputError(
            f"MAT8 {name} has E1 = {e1:g}, E2 = {e2:g}, NU12 = {nu:g}, G12 = {g:g}",
            place=card.place,
            expected="E1, E2 and G12 above zero, and NU12^2 E2 below E1",
        )
    law = np.array([[e1, nu * e2, 0], [nu * e2, e2, 0], [0, 0, g * share]]) / share
    shear = np.diag([g1 or _UNSHEARED * g, g2 or _UNSHEARED * g])
    rho = content.density_of(name, card.real(7, "a density"))
    content.plane[name] = PlaneLaw(law, shear, rho)
    content.materials[name] = None


def pcomp(content: BulkData, card: Card) -> None:
    """PID, Z0, NSM, SB, FT, TREF, GE, LAM, MID1, T1, THETA1, SOUT1, MID2, ...

    PCOMPG has a line of eight fields for a layer: its number, MID, T, THETA, SOUT.
    """
    label = card.integer(0, "a property")
    if label in content.properties:
        raise duplicate_error("property", label, card)
    content.properties[label] = Property(
        "PCOMP", None, card.place, flat=True, layered=True
    )
    content.shell_cards[label] = card


def shells_of(content: BulkData) -> tuple[RawShell, ...]:
    """The shells with their sections.

    Raises
    ------
    InputError : a shell has properties that the elements of sidtool do not have.
    """
    sections: dict[int, ShellSection] = {}
    shells = []
    for label, property_, kind, nodes, place in content.elements:
        if not kind.startswith(("quad", "tri")):
            continue
        kind, nodes = collapse_element(kind, nodes)
        if kind not in _KINDS:
            raise InputError(
                f"element {label} has nodes in the middle of its edges",
                place=place,
                expected="CQUAD4 and CTRIA3 of corners beside bars, springs, solids "
                'and layers; geometry.engine = "calculix" takes such shells alone',
            )
        undefined = next((n for n in nodes if n not in content.nodes), None)
        if undefined is not None:
            raise InputError(
                f"element {label} names node {undefined}, which is not defined",
                place=place,
                expected="a node of this file",
            )
        with content.stops.collect_errors():
            _check_property(content, label, kind, property_, place)
            if property_ not in sections:
                sections[property_] = _section(content, property_, place)
            shells.append(
                _shell(content, (label, kind, nodes, place), sections[property_])
            )
    return tuple(shells)


def _check_property(
    content: BulkData, label: int, kind: str, property_: int, place: str
) -> None:
    """Refuse shells with properties of shear panels, and panels with others."""
    card, panel = content.shell_cards.get(property_), label in content.panels
    if card is None:
        return
    if panel != (card.name == "PSHEAR") or (panel and kind != "quad4"):
        raise InputError(
            f"element {label} ({kind}) has the property {card.name} {property_}",
            place=place,
            expected="PSHEAR for CSHEAR of four nodes, and PSHELL, PCOMP or PCOMPG for "
            "shells",
        )


def _shell(
    content: BulkData,
    element: tuple[int, str, list[int], str],
    section: ShellSection,
) -> RawShell:
    label, kind, nodes, place = element
    name = next(k for k in _KINDS if k[0] == kind[0])
    own = content.shell_fields.get(label, [])
    words = [*own, "", ""]
    *corners, flag = corner_thicknesses(name, own)
    unit = section.thickness if flag == "1" else 1.0
    given = [
        unit * real_number(w, "a thickness", place) if w else section.thickness
        for w in corners[: len(nodes)]
    ]
    if any(w for w in corners) and section.thickness > 0:
        section = _thicker(section, float(np.mean(given)) / section.thickness)
    if words[_OFFSET]:
        section = section.shifted(real_number(words[_OFFSET], "an offset", place))
    axis, angle = None, 0.0
    word = words[_ANGLE]
    if word and is_real(word):
        angle = float(np.radians(real_number(word, "an angle", place)))
    elif word:
        (system,) = parse_integers([word], place, "an angle or a system")
        _, axes = content.frames.frame(system, place)
        if system and not content.frames.is_rectangular(system, place):
            centre = np.mean([content.nodes[n] for n in nodes], axis=0)
            origin, axes = content.frames.frame(system, place)
            arm = centre - origin
            arm = arm - (arm @ axes[2]) * axes[2]
            axes = np.array([arm / (np.linalg.norm(arm) or 1.0)])
        x, y, z = axes[0].tolist()
        axis = (x, y, z)
    kind = "panel" if label in content.panels else kind
    return RawShell(label, kind, tuple(nodes), place, section, axis, angle)


def _thicker(section: ShellSection, ratio: float) -> ShellSection:
    """A homogeneous section of another thickness."""
    m0, m1, m2 = section.masses
    return replace(
        section,
        membrane=section.membrane * ratio,
        coupling=section.coupling * ratio**2,
        bending=section.bending * ratio**3,
        shear=section.shear * ratio,
        masses=(m0 * ratio, m1 * ratio**2, m2 * ratio**3),
        thickness=section.thickness * ratio,
    )


def _section(content: BulkData, label: int, place: str) -> ShellSection:
    card = content.shell_cards.get(label)
    if card is None:
        raise InputError(
            f"a shell has the property {label}",
            place=place,
            expected="PSHELL, PCOMP or PCOMPG",
        )
    if card.name == "PSHEAR":
        return _panel(content, card)
    return _layered(content, card) if card.name != "PSHELL" else _plain(content, card)


def _panel(content: BulkData, card: Card) -> ShellSection:
    """PID, MID, T, NSM."""
    t, zero = card.real(2, "a thickness"), np.zeros((3, 3))
    law = _law(content, card, card.integer(1, "a material"))
    mass = law.density * t + card.real(3, "a mass per area") * content.weight
    masses = (mass, 0.0, 0.0)
    complete = _is_complete(content, law)
    return ShellSection(
        law.law * t, zero, zero, np.eye(2), masses, t, flexural=False, complete=complete
    )


def _law(content: BulkData, card: Card, label: int) -> PlaneLaw:
    law = content.plane.get(str(label))
    if law is None:
        raise InputError(
            f"{card.name} {card.word(0)} has the material {label}",
            place=card.place,
            expected="MAT1, MAT2 or MAT8",
        )
    return replace(law, density=law.density * content.weight_of(str(label)))


def _plain(content: BulkData, card: Card) -> ShellSection:
    """PID, MID1, T, MID2, 12I/T**3, MID3, TS/T, NSM, Z1, Z2, MID4."""
    t = card.real(2, "a thickness")
    membrane, bending, shear, mixed = (
        card.integer(i, "a material", 0) for i in (1, 3, 5, 10)
    )
    if t <= 0 or bending < 0:
        raise InputError(
            f"PSHELL {card.word(0)} has the thickness {t:g} and MID2 {bending}",
            place=card.place,
            expected="a thickness above zero, and no plane strain (MID2 = -1)",
        )
    zero, depth = np.zeros((3, 3)), card.real(4, "a ratio", 1.0) * t**3 / 12
    a, d, b = zero, zero, zero
    rho, complete = 0.0, True
    if membrane:
        law = _law(content, card, membrane)
        a, rho, complete = law.law * t, law.density, _is_complete(content, law)
    if bending:
        law = _law(content, card, bending)
        d = law.law * depth
        rho = rho if membrane else law.density
        complete = complete and law.law[2, 2] > 0
    if mixed:
        b = _law(content, card, mixed).law * t**2
    base = _law(content, card, shear or bending or membrane)
    if shear:
        across = base.transverse * card.real(6, "a ratio", 5 / 6) * t
    else:
        across = np.eye(2) * (base.law[2, 2] * t * _UNSHEARED)
    extra = card.real(7, "a mass per area") * content.weight
    mass = rho * t + extra
    masses = (mass, 0.0, mass * t**2 / 12)
    if not membrane:
        raise InputError(
            f"PSHELL {card.word(0)} has no membrane",
            place=card.place,
            expected="MID1",
        )
    return ShellSection(a, b, d, across, masses, t, bool(bending), complete)


def _is_complete(content: BulkData, law: PlaneLaw) -> bool:
    heavy = law.density > 0 or content.density == 0
    return heavy and bool(np.linalg.eigvalsh(law.law)[0] > 0)


def _shear_stiffness(
    plies: list[tuple[Array, Array, float, float]], a: Array, b: Array, d: Array
) -> Array:
    """Return the transverse shear stiffness (2, 2) of the laminate with A, B and D.

    The shear stresses are in equilibrium with the stresses of cylindrical bending in
    both directions; their energy is that of the shear forces (K. Rohwer, "Improved
    transverse shear stiffness for layered finite elements", DFVLR-FB 88-32, 1988). A
    homogeneous thickness has the factor 5/6.

    Parameters
    ----------
    plies : law, law of the transverse shear, bottom and top of each
    """
    inverse = np.linalg.inv(np.block([[a, b], [b, d]]))
    stretch, bend = inverse[:3, 3:], inverse[3:, 3:]
    soft, below = np.zeros((2, 2)), np.zeros((3, 3))
    points, weights = np.polynomial.legendre.leggauss(3)
    for law, across, bottom, top in plies:
        half = (top - bottom) / 2
        for x, weight in zip((*points, 1.0), (*weights, 0.0), strict=True):
            z = bottom + half * (1 + x)
            area, moment = z - bottom, (z**2 - bottom**2) / 2
            flow = below + law @ (area * stretch + moment * bend)
            shares = np.array([[flow[0, 0], flow[2, 1]], [flow[2, 0], flow[1, 1]]])
            soft = soft + weight * half * shares.T @ np.linalg.solve(across, shares)
        below = flow
    return np.asarray(np.linalg.inv(soft))


def _layered(content: BulkData, card: Card) -> ShellSection:
    symmetric = card.word(7).upper()
    if symmetric not in ("", "SYM", "MEM", "SMEAR"):
        raise InputError(
            f"{card.name} {card.word(0)} has LAM = {symmetric}",
            place=card.place,
            expected="blank, SYM, MEM or SMEAR",
        )
    layers: list[tuple[int, float, float]] = []
    step, start = (8, 9) if card.name == "PCOMPG" else (4, 8)
    for at in range(start, len(card.words), step):
        if not any(card.words[at : at + 3]):
            continue
        material, depth = (layers[-1][:2]) if layers else (0, 0.0)
        layers.append(
            (
                card.integer(at, "a material", material),
                card.real(at + 1, "a thickness", depth),
                card.real(at + 2, "an angle"),
            )
        )
    if not layers or min(depth for _, depth, _ in layers) <= 0:
        raise InputError(
            f"{card.name} {card.word(0)} has no layer, or one without thickness",
            place=card.place,
            expected="MID, T and THETA of every layer",
        )
    if symmetric == "SYM":
        layers += layers[::-1]
    t = sum(depth for _, depth, _ in layers)
    bottom = card.real(1, "a place", -t / 2)
    a, b, d = np.zeros((3, 3, 3))
    rigid = _UNSHEARED * np.eye(2)
    plies = []
    masses, z, complete = np.zeros(3), bottom, True
    for label, depth, angle in layers:
        law = _law(content, card, label)
        own, across = law.turned(np.radians(angle))
        top = z + depth
        first, second = (top**2 - z**2) / 2, (top**3 - z**3) / 3
        a, b, d = a + own * depth, b + own * first, d + own * second
        plies.append((own, across if across.any() else own[2, 2] * rigid, z, top))
        masses = masses + law.density * np.array([depth, first, second])
        complete = complete and _is_complete(content, law)
        z = top
    shear = _shear_stiffness(plies, a, b, d) if complete else np.eye(2)
    if symmetric == "MEM":
        b, d = np.zeros((2, 3, 3))
    if symmetric == "SMEAR":
        b, d = np.zeros((3, 3)), a * t**2 / 12
        shear = a[2, 2] * rigid
    extra = card.real(2, "a mass per area") * content.weight
    middle = bottom + t / 2
    masses = masses + extra * np.array([1.0, middle, middle**2 + t**2 / 12])
    m0, m1, m2 = masses.tolist()
    flexural = symmetric != "MEM"
    return ShellSection(a, b, d, shear, (m0, m1, m2), t, flexural, complete)
