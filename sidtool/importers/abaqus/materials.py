"""*MATERIAL, *ELASTIC and *ORIENTATION of a deck as elastic materials."""

from collections.abc import Iterable

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import diagnose
from sidtool.formats.model import Material

from ...mesh.deck_text import parse_numbers
from ...mesh.materials import (
    AnisotropicMaterial,
    CylindricalMaterial,
    ElasticMaterial,
    check_positive_definite,
    orthotropic_law,
)
from .deck import Deck, Section, duplicate_error
from .instances import place_nodes
from .keywords import BY_CALCULIX, Block

#: How many constants the types of *ELASTIC have.
_COUNTS = {
    "ISOTROPIC": 2,
    "ENGINEERING CONSTANTS": 9,
    "ORTHOTROPIC": 9,
    "ANISOTROPIC": 21,
    "LAMINA": 6,
}
#: Rows of a law in the order of Abaqus (11, 22, 33, 12, 13, 23) by ours.
_ORDER = (0, 1, 2, 3, 5, 4)


def read_elastic(deck: Deck, block: Block) -> None:
    """Read *ELASTIC and *DENSITY of the material above.

    Raises
    ------
    InputError : there is no material, or it is defined twice, or is of another type.
    """
    table = deck.materials.get(deck.material)
    if not block.rows or table is None:
        raise InputError(
            f"*{block.keyword} stands alone",
            place=block.place,
            expected="a *MATERIAL before it and a line of numbers after it",
        )
    if block.keyword in table:
        raise duplicate_error(
            f"*{block.keyword} of material", deck.material, block.place
        )
    rows = [
        parse_numbers([word or "0" for word in words], place)
        for words, place in block.rows
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
    count = _COUNTS[fitting[0]] if block.keyword == "ELASTIC" else 1
    if block.keyword == "ELASTIC" and fitting != ["ISOTROPIC"]:
        rows = list(_join_rows(rows, count))
        deck.kinds[deck.material] = fitting[0]
    if (longest := max(map(len, rows))) > count + 1:
        raise InputError(
            f"*{block.keyword} of material {deck.material} has {longest} numbers",
            place=block.place,
            expected=f"{count} with decimal points, and a temperature",
        )
    table[block.keyword] = rows


def _join_rows(rows: list[list[float]], count: int) -> Iterable[list[float]]:
    """The constants of every temperature, which go over lines of eight numbers."""
    lines = -(-(count + 1) // 8)
    for start in range(0, len(rows), lines):
        yield [value for row in rows[start : start + lines] for value in row]


def read_orientation(deck: Deck, block: Block) -> None:
    name = deck.own_name(block.options.get("NAME", ""))
    if name in deck.orientations:
        raise duplicate_error("orientation", name, block.place)
    deck.orientations[name] = block


def material_name(deck: Deck, section: Section) -> str:
    """The material of a section, with its axes where these matter."""
    if section.material not in deck.kinds or not section.orientation:
        return section.material
    where = f" in {section.instance}" if section.instance else ""
    return f"{section.material} along {section.orientation}{where}"


def materials_of(
    deck: Deck,
    sections: Iterable[Section],
    instance: str,
    state: str | None,
) -> dict[str, ElasticMaterial]:
    """The materials of the sections that are complete and constant.

    Parameters
    ----------
    instance : that is the body, if it is a single one
    state : of plane elements

    Raises
    ------
    InputError : constants are not those of a material, or its axes are neither
        rectangular nor cylindrical ones.
    """
    result: dict[str, ElasticMaterial] = {}
    order = sorted(set(sections), key=lambda s: (s.material, s.orientation, s.instance))
    for section in order:
        name = material_name(deck, section)
        widths = {"ELASTIC": _COUNTS[deck.kinds.get(section.material, "ISOTROPIC")]}
        elastic, density = (
            _constants_at_temperature(deck, section.material, key, widths.get(key, 1))
            for key in ("ELASTIC", "DENSITY")
        )
        if not density and deck.density is not None:
            density = [[deck.density]]
        if name in result or len(elastic) != 1 or len(density) != 1:
            continue
        kind = deck.kinds.get(section.material)
        if kind is None:
            if len(elastic[0]) >= 2:
                result[name] = _isotropic_material(name, elastic[0], density[0][0])
            continue
        if kind == "LAMINA" and state != "plane_stress":
            raise InputError(
                f"material {name} is a LAMINA", expected="elements of plane stress"
            )
        try:
            law = _elasticity_law(kind, elastic[0])
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
        placement = deck.placement.get(section.instance or instance, [])
        if section.orientation:
            material = _orient_material(material, deck, section, placement)
        elif any(any(line[6:]) for line in placement):
            raise InputError(
                f"material {name} has no axes in an instance that is turned",
                place=section.place,
                expected="an *ORIENTATION in its part",
            )
        result[name] = material
    return result


def _constants_at_temperature(
    deck: Deck, material: str, key: str, count: int
) -> list[list[float]]:
    """Return the constants at the initial temperature, which is zero by default.

    They are interpolated linearly between the lines of a table and constant beyond, as
    in Abaqus and CalculiX. Different values are refused where nodes have different
    temperatures.
    """
    rows = deck.materials[material].get(key, [])
    if len(rows) < 2 or any(len(row) not in (count, count + 1) for row in rows):
        return rows
    values = np.array([row[:count] for row in rows])
    if np.ptp(values, axis=0).max() == 0:
        return [values[0].tolist()]
    places = np.array([row[count] if len(row) > count else 0.0 for row in rows])
    if len(deck.temperatures) > 1 or (np.diff(places) <= 0).any():
        return rows
    at = next(iter(deck.temperatures), 0.0)
    place = f"*{key} of material {material}"
    note = diagnose("N120", place=place, what=f"of {len(rows)} temperatures, at {at:g}")
    if note not in deck.diagnostics:
        deck.diagnostics.append(note)
    return [[float(np.interp(at, places, column)) for column in values.T]]


def _isotropic_material(name: str, elastic: list[float], rho: float) -> Material:
    e, nu = elastic[:2]
    if e <= 0 or rho <= 0 or not -1 < nu < 0.5:
        raise InputError(
            f"material {name} has E = {e:g}, nu = {nu:g}, density {rho:g}",
            expected="E and density above zero, nu between -1 and 0.5",
        )
    return Material(youngs_modulus=e, poissons_ratio=nu, density=rho)


def _elasticity_law(kind: str, values: list[float]) -> Array:
    count = _COUNTS[kind]
    if len(values) not in (count, count + 1):
        raise InputError(
            f"elasticity of type {kind} has {len(values)} constants",
            expected=f"{count}, and a temperature",
        )
    given = np.array(values[:count])
    if kind == "ENGINEERING CONSTANTS":
        return orthotropic_law(given)
    if kind == "LAMINA":  # the missing constants have no effect in plane stress
        e1, e2, nu12, g12, g13, g23 = given
        return orthotropic_law([e1, e2, e2, nu12, 0.0, 0.0, g12, g13, g23])
    law = np.zeros((6, 6))
    if kind == "ORTHOTROPIC":
        law[[0, 0, 1, 0, 1, 2, 3, 4, 5], [0, 1, 1, 2, 2, 2, 3, 4, 5]] = given
    else:
        columns = [(i, j) for j in range(6) for i in range(j + 1)]
        law[tuple(np.array(columns).T)] = given
    law = law + np.triu(law, 1).T
    law = law[np.ix_(_ORDER, _ORDER)]
    check_positive_definite(law)
    return law


def _orient_material(
    material: AnisotropicMaterial,
    deck: Deck,
    section: Section,
    placement: list[list[float]],
) -> AnisotropicMaterial:
    """The material in the axes of its section, which move with their instance.

    Rectangular: point a on x, point b in the plane x y. Cylindrical: both on the axis,
    own axes the radius, the circumference and the axis.
    """
    block = deck.orientations.get(section.orientation)
    if block is None:
        raise InputError(
            f"names the orientation {section.orientation!r}, which is not defined",
            place=section.place,
            expected="an *ORIENTATION of this file",
        )
    system = block.options.get("SYSTEM", "RECTANGULAR").upper()
    definition = block.options.get("DEFINITION", "COORDINATES").upper()
    rows = [
        parse_numbers([w or "0" for w in words], place) for words, place in block.rows
    ]
    first = [*(rows[0] if rows else []), *[0.0] * 9][:9]
    a, b, c = (tuple(x) for x in np.array(first).reshape(3, 3).tolist())
    axes_by_number = {0: a, 1: b, 2: c}
    points = np.array(list(place_nodes(axes_by_number, placement).values()))
    further = rows[1] if len(rows) == 2 and any(rows[1]) else [3.0, 0.0]
    cylindrical = len(system) > 0 and "CYLINDRICAL".startswith(system)
    axes = _cylinder_axes(points) if cylindrical else _rectangular_axes(points)
    known = cylindrical or "RECTANGULAR".startswith(system)
    if not known or definition != "COORDINATES" or len(rows) > 2 or axes is None:
        raise InputError(
            f"*ORIENTATION {section.orientation} is neither a rectangular nor a "
            "cylindrical system",
            place=block.place,
            expected="SYSTEM=RECTANGULAR by two points that are not in line with the "
            "origin, SYSTEM=CYLINDRICAL by two points of the axis, or "
            f"{BY_CALCULIX}",
        )
    if not cylindrical:
        return material.turned(_rotate_axes(axes, further, block.place))
    own = material.turned(_rotate_axes(np.eye(3), further, block.place))
    return CylindricalMaterial(own.law, own.density, points[0], axes[2])


def _rectangular_axes(points: Array) -> Array | None:
    """(3, 3) axes as rows: point a on x, point b in the plane x y, the origin."""
    a, b, origin = points
    x, z = a - origin, np.cross(a - origin, b - origin)
    size = np.linalg.norm(a - origin) * np.linalg.norm(b - origin)
    if np.linalg.norm(z) <= 1e-9 * size or size == 0:
        return None
    axes = np.stack([x, np.cross(z, x), z])
    return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True), float)


def _cylinder_axes(points: Array) -> Array | None:
    """(3, 3) whose last row is the direction from point a to point b."""
    axis = points[1] - points[0]
    length = float(np.linalg.norm(axis))
    return np.vstack([np.zeros((2, 3)), axis / length]) if length > 0 else None


def _rotate_axes(axes: Array, line: list[float], place: str) -> Array:
    """Rotate about one of the axes by an angle in degrees."""
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
