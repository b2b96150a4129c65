"""MP and MPDATA of an ANSYS archive."""

from __future__ import annotations

from sidtool.formats.errors import InputError
from sidtool.formats.model import Material

from ..imported import integers, numbers
from .content import Content

_CONSTANTS = {"EX": "e", "NUXY": "nu", "PRXY": "nu", "DENS": "rho", "GXY": "g"}
#: Properties that a linear elastic isotropic body does not ask for.
_OTHER_CONSTANTS = ("ALPX", "CTEX", "REFT", "KXX", "C", "MU", "DMPR", "DAMP", "BETD")


def read_property(content: Content, words: list[str]) -> None:
    """MP, name, material, value, or MPDATA, R5.0, n, name, material, start, values.

    The values of MPDATA at further temperatures follow in lines of their own.

    Raises
    ------
    InputError : a linear elastic isotropic body has no such property.
    """
    start = 1
    if words[0].upper() == "MPDATA":
        skip = 3 if words[1].upper().startswith("R5") else 1
        name, number, begin, *values = words[skip:]
        start = integers([begin or "1"], content.place, "a place in the table")[0]
    else:
        name, number, *values = words[1:]
    name, given = name.upper(), [value for value in values if value]
    material = integers([number], content.place, "a material")[0]
    if name not in _CONSTANTS:
        if name not in _OTHER_CONSTANTS:
            raise InputError(
                f"property {name} of material {material} is not supported",
                place=content.place,
                expected=f"one of {', '.join([*_CONSTANTS, *_OTHER_CONSTANTS])}",
            )
        content.said[f"property {name}"] = None
        return
    found = numbers(given, content.place, "a constant")
    table = content.tables.setdefault((material, _CONSTANTS[name]), [])
    if not 1 <= start <= len(table) + 1:
        raise InputError(
            f"MPDATA of {name} begins at entry {start} behind {len(table)}",
            place=content.place,
            expected="a table without gaps",
        )
    table[start - 1 :] = found
    constants = content.constants.setdefault(material, {})
    constants.pop(_CONSTANTS[name], None)
    if len(set(table)) == 1:
        constants[_CONSTANTS[name]] = table[0]


def materials_of(content: Content) -> dict[str, Material]:
    """The isotropic materials that are complete and constant."""
    materials = {}
    for number, table in content.constants.items():
        e, nu, rho = (table.get(key, 0.0) for key in ("e", "nu", "rho"))
        if "nu" not in table and "g" in table:
            nu = e / (2 * table["g"]) - 1
        if e > 0 and rho > 0 and -1 < nu < 0.5:
            materials[str(number)] = Material(
                youngs_modulus=e, poissons_ratio=nu, density=rho
            )
    return materials
