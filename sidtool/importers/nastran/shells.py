"""Shells and solids of Nastran bulk data as a deck that CalculiX discretises."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError

from ...mesh.imported_mesh import RawMass
from ...mesh.materials import AnisotropicMaterial, CylindricalMaterial, ElasticMaterial
from ..abaqus.deck import calculix_type
from ..calculix_engine import is_installed
from .bulk_data import bulk_data
from .cards import Card
from .constraints import equations_of
from .content import BulkData
from .properties import material_name, materials_of

_PER_LINE = 12
#: Unknowns of the solids of CalculiX (S8R) by each corner of quadrilaterals, and how
#: many take minutes.
_UNKNOWNS_PER_NODE, _LARGEST_MESH = 21, 150_000
#: Tolerance for the rounded factor 5/6 in decks.
_ROUNDED = 1e-3
#: Rows of a law in the order of CalculiX (11, 22, 33, 12, 13, 23) by ours.
_ORDER = (0, 1, 2, 3, 5, 4)


def deck_of_bulk(
    path: Path, ignored: frozenset[str], density: float | None = None
) -> str:
    """Write the nodes, elements, properties and sets of bulk data as a flat deck.

    Parameters
    ----------
    ignored : cards that are ignored on purpose, in capitals
    density : density of materials whose RHO is blank or zero, in the units of the file

    Raises
    ------
    InputError : CalculiX cannot represent the content; the error names file and line.
    """
    try:
        content = bulk_data(path, ignored, shells=True, density=density)
        result = []
        for part in (_node_lines, _element_lines, _section_lines, _mass_lines):
            with content.stops.collect_errors():
                result.append(part(content))
        content.stops.check()
        return "".join(result)
    except InputError as error:
        raise error.located(path) from None


def is_bulk(file: str | Path) -> bool:
    """Whether a file is bulk data by its ending."""
    return Path(file).suffix.lower() in (".bdf", ".nas", ".dat")


def beyond_calculix(
    path: Path,
    ignored: Iterable[str],
    density: float | None = None,
    *,
    order: int | None = None,
) -> str:
    """Return why the elements of sidtool are used: content that a CalculiX deck has
    not, matrices of minutes, or no CalculiX; "" for none. Shells of sidtool have corner
    nodes only, so decks with CQUAD8 or CTRIA6 are left to CalculiX.

    Parameters
    ----------
    order : of the elements that CalculiX is to take, whatever its matrices cost

    Raises
    ------
    InputError : the file is not valid; the error names file, line and expectation.
    """
    if not is_bulk(path):
        return ""
    words = frozenset(" ".join(word.upper().strip("*$").split()) for word in ignored)
    try:
        content = bulk_data(path, words, density=density)
    except InputError as error:
        raise error.located(path) from None
    if any(kind in ("quad8", "tri6") for _, _, kind, *_ in content.elements):
        return ""
    flat = {kind.startswith(("quad", "tri")) for _, _, kind, *_ in content.elements}
    cards = [c for c in content.shell_cards.values() if c.name == "PSHELL"]
    angles = {label: words[:1] for label, words in content.shell_fields.items()}
    held = (
        ("bars", content.bars),
        ("springs", content.springs),
        ("shear panels", content.panels),
        ("couplings", content.couplings),
        ("layers", any(p.layered for p in content.properties.values())),
        ("shells and solids", len(flat) > 1),
        (
            "masses with inertia",
            [m for m in content.masses if any((*m.offset, *m.inertia))],
        ),
        ("sections that are not homogeneous", [c for c in cards if not _is_plain(c)]),
        (
            "shells with offsets or thicknesses of their own",
            [w for n, w in content.shell_fields.items() if any(w[len(angles[n]) :])],
        ),
    )
    beyond = ", ".join(what for what, is_present in held if is_present)
    if True not in flat and not beyond:
        return ""
    if beyond or not is_installed():
        return beyond or "CalculiX (ccx) is not installed"
    size = _UNKNOWNS_PER_NODE * len(
        {n for *_, nodes, _ in content.elements for n in nodes}
    )
    if order is None and size > _LARGEST_MESH:
        return f"about {size} degrees of freedom of the solids of CalculiX"
    return ""


def _extent(mass: RawMass) -> tuple[float, ...]:
    return (*mass.offset, *mass.inertia)


def _is_plain(card: Card) -> bool:
    """Whether a PSHELL is one material with 5/6 of its shear and no further mass."""
    one = card.word(1)
    alike = card.word(3) == one and card.word(5) in ("", one)
    values = (card.real(i, "a number", d) for i, d in ((4, 1.0), (6, 5 / 6), (7, 0.0)))
    ratio, shear, extra = values
    near = abs(shear - 5 / 6) < _ROUNDED
    return alike and ratio == 1 and near and not extra and not card.word(10)


def _node_lines(content: BulkData) -> str:
    places = [held.place for held in content.couplings]
    places += [m.place for m in content.masses if any((*m.offset, *m.inertia))]
    places += [card.place for card in content.bars]
    places += [equation.place for equation in equations_of(content)]
    if places:
        raise InputError(
            "bars, couplings, MPC and CONM2 with offset or inertia are not handed to "
            "CalculiX",
            place=places[0],
            expected="shells and solids alone; geometry.ignore leaves cards out, and "
            "rigid bodies, beams and ties may be joined at markers instead",
        )
    rows = (f"{n}, {x!r}, {y!r}, {z!r}\n" for n, (x, y, z) in content.nodes.items())
    sets = "".join(
        f"*NSET, NSET={name}\n{_number_lines(nodes)}"
        for name, nodes in content.sets.items()
    )
    return f"*NODE\n{''.join(rows)}{sets}"


def _element_lines(content: BulkData) -> str:
    blocks: dict[tuple[str, int], list[str]] = {}
    for label, property_, kind, nodes, _ in content.elements:
        rows = blocks.setdefault((kind, property_), [])
        words = [str(label), *map(str, nodes)]
        rows += [
            ", ".join(words[i : i + _PER_LINE])
            + (",\n" if i + _PER_LINE < len(words) else "\n")
            for i in range(0, len(words), _PER_LINE)
        ]
    return "".join(
        f"*ELEMENT, TYPE={calculix_type(kind)}, "
        f"ELSET=P{property_}{kind}\n{''.join(rows)}"
        for (kind, property_), rows in blocks.items()
    )


def _section_lines(content: BulkData) -> str:
    materials = materials_of(content)
    number = {name: i for i, name in enumerate(materials, 1)}
    lines = [_material_lines(number[name], own) for name, own in materials.items()]
    used = dict.fromkeys((k, p, place) for _, p, k, _, place in content.elements)
    done = set()
    for kind, property_, place in used:
        given = content.properties.get(property_)
        name = material_name(content, given) if given else ""
        flat = kind.startswith(("quad", "tri"))
        depth = given.thickness if given else None
        if name not in materials or (flat and depth is None):
            raise InputError(
                f"property {property_} has no complete material and thickness",
                place=place,
                expected="PSHELL or PSOLID, and MAT1 with E, nu and RHO",
            )
        if isinstance(materials[name], CylindricalMaterial):
            raise InputError(
                f"PSOLID {property_} has cylindrical material axes",
                place=place,
                expected="solids alone, without geometry.engine",
            )
        if (kind, property_) in done:
            continue
        done.add((kind, property_))
        section = "SHELL SECTION" if flat else "SOLID SECTION"
        head = f"*{section}, ELSET=P{property_}{kind}, MATERIAL=M{number[name]}\n"
        lines.append(head + (f"{depth!r}\n" if flat else "\n"))
    return "".join(lines)


def _mass_lines(content: BulkData) -> str:
    first = 1 + max((label for label, *_ in content.elements), default=0)
    return "".join(
        f"*ELEMENT, TYPE=MASS, ELSET=MASS{i}\n{i}, {mass.node}\n*MASS, ELSET=MASS{i}\n"
        f"{mass.mass * content.weight!r}\n"
        for i, mass in enumerate(content.masses, first)
    )


def _material_lines(number: int, own: ElasticMaterial) -> str:
    head, tail = f"*MATERIAL, NAME=M{number}\n", f"*DENSITY\n{own.density!r}\n"
    if not isinstance(own, AnisotropicMaterial):
        return f"{head}*ELASTIC\n{own.youngs_modulus!r}, {own.poissons_ratio!r}\n{tail}"
    law = own.law[np.ix_(_ORDER, _ORDER)]
    words = [repr(float(law[i, j])) for j in range(6) for i in range(j + 1)]
    rows = [", ".join(words[i : i + 8]) + "\n" for i in range(0, len(words), 8)]
    return f"{head}*ELASTIC, TYPE=ANISO\n{''.join(rows)}{tail}"


def _number_lines(nodes: list[int]) -> str:
    return "".join(f"{n},\n" for n in nodes)
