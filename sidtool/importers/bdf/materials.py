"""MAT1 and MAT9 of Nastran bulk data, and the axes of what is not isotropic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.model import Material

from ...frontends.anisotropic import (
    AnisotropicMaterial,
    CylindricalMaterial,
    ElasticMaterial,
    check_definite_law,
)
from .cards import Card
from .content import BulkData, PlaneLaw, Property, twice

#: MAT9 has its upper triangle row by row behind its number.
_ROWS, _COLUMNS = np.triu_indices(6)
_DENSITY = 1 + len(_ROWS)


def mat1(content: BulkData, card: Card) -> None:
    name = new_name(content, card)
    e, g, nu, rho = (card.real(i, "a constant") for i in (1, 2, 3, 4))
    rho = content.density_of(name, rho)
    if not card.word(1):
        e = 2 * g * (1 + nu)
    elif not card.word(3) and g:
        nu = e / (2 * g) - 1
    _damping(content, card, 7)
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


def mat9(content: BulkData, card: Card) -> None:
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
        check_definite_law(law)
    except InputError as error:
        raise InputError(
            f"MAT9 {name}: {error.problem}", place=card.place, expected=error.expected
        ) from None
    _damping(content, card, _DENSITY + 8)
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
        raise twice("material", name, card)
    return name


def _damping(content: BulkData, card: Card, place: int) -> None:
    if card.real(place, "a damping"):
        content.said[f"GE of {card.name} (damping is that of the model file)"] = None


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
            result[name] = _oriented(own, content, given)
    return result


def _oriented(
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
