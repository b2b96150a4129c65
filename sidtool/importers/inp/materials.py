"""*MATERIAL, *ELASTIC and *ORIENTATION of a deck as elastic materials."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.model import Material

from ...frontends.anisotropic import (
    AnisotropicMaterial,
    ElasticMaterial,
    check_definite_law,
    orthotropic_law,
)
from ..imported import numbers
from .blocks import Block
from .deck import Deck, Section, twice
from .keywords import BY_CALCULIX

Array = NDArray[np.float64]

#: How many constants the types of *ELASTIC have.
_COUNTS = {
    "ISOTROPIC": 2,
    "ENGINEERING CONSTANTS": 9,
    "ORTHOTROPIC": 9,
    "ANISOTROPIC": 21,
}
#: Rows of a law in the order of Abaqus (11, 22, 33, 12, 13, 23) by ours.
_ORDER = (0, 1, 2, 3, 5, 4)


def read_elastic(deck: Deck, block: Block) -> None:
    """*ELASTIC and *DENSITY of the material above.

    Raises
    ------
    InputError : it stands alone or twice, or is of another type.
    """
    table = deck.materials.get(deck.material)
    if not block.rows or table is None:
        raise InputError(
            f"*{block.keyword} stands alone",
            place=block.place,
            expected="a *MATERIAL before it and a line of numbers after it",
        )
    if block.keyword in table:
        raise twice(f"*{block.keyword} of material", deck.material, block.place)
    rows = [
        numbers([word or "0" for word in words], place) for words, place in block.rows
    ]
    kind = " ".join(block.options.get("TYPE", "ISOTROPIC").upper().split())
    fitting = [
        name
        for name in _COUNTS
        if "".join(name.split()).startswith("".join(kind.split()))
    ]
    if kind == "ORTHO":
        fitting = ["ORTHOTROPIC"]
    if len(fitting) != 1 or len(kind) < 3:
        raise InputError(
            f"elasticity of type {kind} is not supported",
            place=block.place,
            expected=f"{', '.join(_COUNTS)}, or {BY_CALCULIX}",
        )
    if block.keyword == "ELASTIC" and fitting != ["ISOTROPIC"]:
        rows = list(_joined(rows, _COUNTS[fitting[0]]))
        deck.kinds[deck.material] = fitting[0]
    table[block.keyword] = rows


def _joined(rows: list[list[float]], count: int) -> Iterable[list[float]]:
    """The constants of every temperature, which go over lines of eight numbers."""
    lines = -(-(count + 1) // 8)
    for start in range(0, len(rows), lines):
        yield [value for row in rows[start : start + lines] for value in row]


def read_orientation(deck: Deck, block: Block) -> None:
    name = deck.own_name(block.options.get("NAME", ""))
    if name in deck.orientations:
        raise twice("orientation", name, block.place)
    deck.orientations[name] = block


def material_name(deck: Deck, section: Section) -> str:
    """The material of a section, with its axes where these matter."""
    if section.material not in deck.kinds or not section.orientation:
        return section.material
    return f"{section.material} along {section.orientation}"


def materials_of(
    deck: Deck, sections: Iterable[Section], turned: bool
) -> dict[str, ElasticMaterial]:
    """The materials of the sections that are complete and constant.

    Parameters
    ----------
    turned : whether the body is turned in its assembly

    Raises
    ------
    InputError : constants are not those of a material, or its axes are no constant
        rectangular ones.
    """
    result: dict[str, ElasticMaterial] = {}
    for section in sorted(set(sections), key=lambda s: (s.material, s.orientation)):
        name, table = material_name(deck, section), deck.materials[section.material]
        elastic, density = table.get("ELASTIC", []), table.get("DENSITY", [])
        if name in result or len(elastic) != 1 or len(density) != 1:
            continue
        kind = deck.kinds.get(section.material)
        if kind is None:
            if len(elastic[0]) >= 2:
                result[name] = _isotropic(name, elastic[0], density[0][0])
            continue
        try:
            law = _law(kind, elastic[0])
        except InputError as error:
            raise InputError(
                f"material {name}: {error.problem}", expected=error.expected
            ) from None
        if density[0][0] <= 0:
            raise InputError(
                f"material {name} has the density {density[0][0]:g}",
                expected="a density above zero",
            )
        material = AnisotropicMaterial(law, density[0][0])
        if turned:
            raise InputError(
                f"material {name} is not isotropic in an instance that is turned",
                place=section.place,
                expected="a part that is not turned, for example by geometry.part",
            )
        if section.orientation:
            material = material.turned(_axes(deck, section))
        result[name] = material
    return result


def _isotropic(name: str, elastic: list[float], rho: float) -> Material:
    e, nu = elastic[:2]
    if e <= 0 or rho <= 0 or not -1 < nu < 0.5:
        raise InputError(
            f"material {name} has E = {e:g}, nu = {nu:g}, density {rho:g}",
            expected="E and density above zero, nu between -1 and 0.5",
        )
    return Material(youngs_modulus=e, poissons_ratio=nu, density=rho)


def _law(kind: str, values: list[float]) -> Array:
    count = _COUNTS[kind]
    if len(values) not in (count, count + 1):
        raise InputError(
            f"elasticity of type {kind} has {len(values)} constants",
            expected=f"{count}, and a temperature",
        )
    given = np.array(values[:count])
    if kind == "ENGINEERING CONSTANTS":
        return orthotropic_law(given)
    law = np.zeros((6, 6))
    if kind == "ORTHOTROPIC":
        law[[0, 0, 1, 0, 1, 2, 3, 4, 5], [0, 1, 1, 2, 2, 2, 3, 4, 5]] = given
    else:
        columns = [(i, j) for j in range(6) for i in range(j + 1)]
        law[tuple(np.array(columns).T)] = given
    law = law + np.triu(law, 1).T
    law = law[np.ix_(_ORDER, _ORDER)]
    check_definite_law(law)
    return law


def _axes(deck: Deck, section: Section) -> Array:
    """(3, 3) the axes of a material as rows: point a on x, point b in the plane x y."""
    block = deck.orientations.get(section.orientation)
    if block is None:
        raise InputError(
            f"names the orientation {section.orientation!r}, which is not defined",
            place=section.place,
            expected="an *ORIENTATION of this file",
        )
    system = block.options.get("SYSTEM", "RECTANGULAR").upper()
    definition = block.options.get("DEFINITION", "COORDINATES").upper()
    rows = [numbers([w or "0" for w in words], place) for words, place in block.rows]
    first = [*(rows[0] if rows else []), *[0.0] * 9][:9]
    a, b, origin = np.array(first).reshape(3, 3)
    x, z = a - origin, np.cross(a - origin, b - origin)
    constant = "RECTANGULAR".startswith(system) and definition == "COORDINATES"
    size = np.linalg.norm(a - origin) * np.linalg.norm(b - origin)
    if not constant or len(rows) > 2 or np.linalg.norm(z) <= 1e-9 * size or size == 0:
        raise InputError(
            f"*ORIENTATION {section.orientation} is no constant rectangular system",
            place=block.place,
            expected="SYSTEM=RECTANGULAR by two points that are not in line with the "
            f"origin, or {BY_CALCULIX}",
        )
    axes = np.stack([x, np.cross(z, x), z])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    if len(rows) == 2 and any(rows[1]):
        axes = _turned(axes, rows[1], block.place)
    return axes


def _turned(axes: Array, line: list[float], place: str) -> Array:
    """Turned about one of the axes by degrees."""
    axis, angle = [*line, 0.0][:2]
    if axis not in (1.0, 2.0, 3.0):
        raise InputError(
            f"*ORIENTATION turns about axis {axis:g}", place=place, expected="1, 2 or 3"
        )
    j, k = int(axis) % 3, (int(axis) + 1) % 3
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turned = axes.copy()
    turned[j], turned[k] = c * axes[j] + s * axes[k], c * axes[k] - s * axes[j]
    return turned
