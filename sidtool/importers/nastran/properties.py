"""Properties and materials of Nastran: PSOLID, PSHELL, MAT1 and MAT9."""

from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import Material

from ...mesh.materials import (
    AnisotropicMaterial,
    CylindricalMaterial,
    ElasticMaterial,
    check_positive_definite,
)
from .cards import Card, real_number
from .content import BulkData, PlaneLaw, Property, duplicate_error

#: Fields after the nodes of a plane element: range of T1, T2, ..., and TFLAG.
_CORNERS = {
    "quad4": (4, 8, 3),
    "tri3": (5, 8, 4),
    "quad8": (0, 4, 6),
    "tri6": (2, 5, 5),
}
_ROUNDED = 1e-9


def fields_after_nodes(kind: str, words: list[str]) -> list[str]:
    """Return the fields of an element after its nodes, without zeros that are defaults.

    A thickness of zero at a corner is one, unless all of them are zero.
    """
    own = [word if word and not _is_zero(word) else "" for word in words]
    if kind in _CORNERS:
        first, end, _ = _CORNERS[kind]
        if any(own[first:end]):
            own[first:end] = words[first:end]
    return own


def _is_zero(word: str) -> bool:
    return bool(word) and not word.upper().strip("+-.0ED")


def corner_thicknesses(kind: str, words: list[str]) -> list[str]:
    """Return T1, T2, ... and TFLAG from the fields after the nodes of an element."""
    first, end, flag = _CORNERS[kind]
    padded = [*words, *[""] * (max(end, flag) + 1)]
    return [*padded[first:end], padded[flag]]


def other_properties(kind: str, words: list[str]) -> list[str]:
    """Return the other fields of an element after its nodes."""
    first, end, flag = _CORNERS[kind]
    return [w for i, w in enumerate(words) if i != flag and not first <= i < end]


def thickness_of(
    content: BulkData, label: int, given: Property | None, place: str
) -> float | None:
    """The thickness of an element: its own one, or that of its property.

    Raises
    ------
    InputError : it has another one at every corner.
    """
    depth = given.thickness if given else None
    *corners, flag = content.corners.get(label, [""])
    unit = (depth or 0.0) if flag == "1" else 1.0
    values = [
        unit * real_number(word, "a thickness", place) if word else depth or 0.0
        for word in corners
    ]
    if not values:
        return depth
    if max(values) - min(values) > _ROUNDED * max(values):
        raise InputError(
            f"element {label} has the thicknesses "
            f"{', '.join(f'{value:g}' for value in values)} at its corners",
            place=place,
            expected="one thickness for an element",
        )
    return values[0] or None


def read_psolid(content: BulkData, card: Card) -> None:
    """PID, MID, CORDM, IN, STRESS, ISOP, FCTN.

    Raises
    ------
    InputError : it is a fluid.
    """
    if card.word(6).upper() not in ("", "SMECH"):
        raise InputError(
            f"PSOLID {card.word(0)} is {card.word(6)}",
            place=card.place,
            expected="a structure (SMECH)",
        )
    _store_property(content, card, None, card.integer(2, "a coordinate system", 0))
    chosen = [word for word in (card.word(3), card.word(5)) if word]
    if chosen:
        content.unread_keywords[f"the integration {', '.join(chosen)} of PSOLID"] = None


def read_pshell(content: BulkData, card: Card) -> None:
    _store_property(content, card, card.real(2, "a thickness") or None)
    content.shell_cards[card.integer(0, "a property")] = card
    if content.shells and card.word(1):
        _check_bending(card)
        check_no_extra_mass(card.real(7, "a mass per area"), card.place)


def read_pshear(content: BulkData, card: Card) -> None:
    """PID, MID, T, NSM, F1, F2.

    Raises
    ------
    InputError : its edges resist stretch, or it has no thickness.
    """
    t, first, second = (card.real(i, "a number") for i in (2, 4, 5))
    if t <= 0 or first or second:
        raise InputError(
            f"PSHEAR {card.word(0)} has T = {t:g}, F1 = {first:g} and F2 = {second:g}",
            place=card.place,
            expected="T above zero, and rods (CROD) for the stretch of its edges",
        )
    _store_property(content, card, t)
    content.shell_cards[card.integer(0, "a property")] = card


def check_membrane(card: Card | None) -> None:
    """Check that a PSHELL is not a plate alone, which cannot be a plane element.

    Raises
    ------
    InputError : it has MID2 without MID1.
    """
    if card is not None and card.word(3) and not card.word(1):
        raise InputError(
            f"PSHELL {card.word(0)} has no membrane",
            place=card.place,
            expected="MID1",
        )


def check_no_extra_mass(extra: float, place: str) -> None:
    """Check that a PSHELL has no nonstructural mass.

    Raises
    ------
    InputError : it has one.
    """
    if extra:
        raise InputError(
            "has nonstructural mass",
            place=place,
            expected="densities that hold all mass, or shells (geometry.engine = "
            '"calculix")',
        )


def _check_bending(card: Card) -> None:
    """Check that a shell has one material through its thickness, with bending and
    shear.
    """
    one, bending = card.integer(1, "a material"), card.integer(3, "a material", 0)
    shear = card.integer(5, "a material", one)
    if bending != one or shear != one or card.real(4, "a ratio", 1.0) != 1.0:
        raise InputError(
            f"PSHELL {card.word(0)} has MID1 {one}, MID2 {bending}, MID3 {shear} and "
            f"12I/T3 {card.word(4) or 1}",
            place=card.place,
            expected="one material for membrane, bending and shear of a homogeneous "
            "thickness",
        )


def _store_property(
    content: BulkData, card: Card, thickness: float | None, system: int = 0
) -> None:
    label = card.integer(0, "a property")
    if label in content.properties:
        raise duplicate_error("property", label, card)
    flat = card.name in ("PSHELL", "PSHEAR")
    blank = flat and not card.word(1)
    material = "" if blank else str(card.integer(1, "a material"))
    content.properties[label] = Property(
        material,
        thickness,
        card.place,
        system,
        flat,
        extra=card.real(7, "a mass per area") if card.name == "PSHELL" else 0.0,
    )


#: MAT9 has its upper triangle row by row after its number.
_ROWS, _COLUMNS = np.triu_indices(6)
_DENSITY = 1 + len(_ROWS)


def read_mat1(content: BulkData, card: Card) -> None:
    name = new_name(content, card)
    e, g, nu, rho = (card.real(i, "a constant") for i in (1, 2, 3, 4))
    rho = content.density_of(name, rho)
    if not card.word(1):
        e = 2 * g * (1 + nu)
    elif not card.word(3) and g:
        nu = e / (2 * g) - 1
    _note_damping(content, card, 7)
    shear = g if card.word(2) else e / (2 * (1 + nu)) if nu > -1 else 0.0
    content.moduli[name] = (e, shear, rho)
    law = np.zeros((3, 3))
    if -1 < nu < 1:
        law[:2, :2] = e / (1 - nu**2) * np.array([[1.0, nu], [nu, 1.0]])
        law[2, 2] = shear
    content.plane[name] = PlaneLaw(law, shear * np.eye(2), rho)
    sound = e > 0 and rho > 0 and -1 < nu < 0.5
    content.materials[name] = (
        Material(youngs_modulus=e, poissons_ratio=nu, density=rho) if sound else None
    )


def read_mat9(content: BulkData, card: Card) -> None:
    """MID, G11, G12, ..., G16, G22, ..., G66, RHO, A1 to A6, TREF, GE.

    The strains are xx, yy, zz, xy, yz, zx with engineering shears, as ours.

    Raises
    ------
    InputError : a strain takes no energy.
    """
    name = new_name(content, card)
    law = np.zeros((6, 6))
    values = [card.real(1 + i, "a constant") for i in range(len(_ROWS))]
    law[_ROWS, _COLUMNS] = law[_COLUMNS, _ROWS] = values
    try:
        check_positive_definite(law)
    except InputError as error:
        raise InputError(
            f"MAT9 {name}: {error.problem}", place=card.place, expected=error.expected
        ) from None
    _note_damping(content, card, _DENSITY + 8)
    rho = content.density_of(name, card.real(_DENSITY, "a density"))
    content.materials[name] = AnisotropicMaterial(law, rho) if rho > 0 else None


def new_name(content: BulkData, card: Card) -> str:
    """The number of a material.

    Raises
    ------
    InputError : it is defined twice.
    """
    name = str(card.integer(0, "a material"))
    if name in content.materials:
        raise duplicate_error("material", name, card)
    return name


def _note_damping(content: BulkData, card: Card, place: int) -> None:
    if card.real(place, "a damping"):
        content.unread_keywords[
            f"GE of {card.name} (damping is that of the model file)"
        ] = None


def material_name(content: BulkData, given: Property) -> str:
    """The material of a property, with its axes where these matter."""
    own = content.materials.get(given.material)
    if not given.system or not isinstance(own, AnisotropicMaterial):
        return given.material
    return f"{given.material} along {given.system}"


def materials_of(content: BulkData) -> dict[str, ElasticMaterial]:
    """Complete materials by the names of `material_name`, WTMASS in their densities.

    Raises
    ------
    InputError : the axes of a material are those of elements or of a sphere, or a
        shell has one of solids.
    """
    result: dict[str, ElasticMaterial] = {}
    for name, own in content.materials.items():
        factor = content.weight_of(name)
        if isinstance(own, Material):
            density = own.density * factor
            result[name] = own.model_copy(update={"density": density})
        elif own is not None:
            result[name] = replace(own, density=own.density * factor)
    for label, given in content.properties.items():
        own, name = result.get(given.material), material_name(content, given)
        if given.thickness is not None and isinstance(own, AnisotropicMaterial):
            raise InputError(
                f"PSHELL {label} has the MAT9 {given.material}",
                place=given.place,
                expected="MAT1 for shells",
            )
        if isinstance(own, AnisotropicMaterial) and name not in result:
            result[name] = _orient_material(own, content, given)
    return result


def _orient_material(
    own: AnisotropicMaterial, content: BulkData, given: Property
) -> AnisotropicMaterial:
    """Along the system of a property; of a cylindrical one along r, theta and z."""
    system = content.systems.get(given.system)
    if given.system < 0 or (system is not None and system.kind == "S"):
        raise InputError(
            f"material {given.material} is not isotropic, and its axes (CORDM "
            f"{given.system}) are those of elements or of a sphere",
            place=given.place,
            expected="a rectangular or cylindrical system",
        )
    origin, axes = content.frames.frame(given.system, given.place)
    if system is not None and system.kind == "C":
        return CylindricalMaterial(own.law, own.density, origin, axes[2])
    return own.turned(axes)
