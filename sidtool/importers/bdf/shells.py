"""Shells and solids of Nastran bulk data as a deck that CalculiX discretises."""

from __future__ import annotations

from pathlib import Path

from sidtool.formats.errors import InputError

from ..inp.elements import deck_type
from .reading import BulkData, bulk_data

_PER_LINE = 12


def deck_of_bulk(path: Path, ignored: frozenset[str]) -> str:
    """A flat deck of the nodes, elements, properties and sets of bulk data.

    Parameters
    ----------
    ignored : cards that are left out on purpose, in capitals

    Raises
    ------
    InputError : names file, line and what CalculiX is not given.
    """
    try:
        content = bulk_data(path, ignored, shells=True)
        return "".join((_nodes(content), _elements(content), _sections(content)))
    except InputError as error:
        raise error.located(path) from None


def _nodes(content: BulkData) -> str:
    places = [held.place for held in content.couplings]
    places += [mass.place for mass in content.masses]
    if places:
        raise InputError(
            "couplings and masses beside shells are not supported",
            place=places[0],
            expected="shells and solids alone; geometry.ignore leaves cards out",
        )
    rows = (f"{n}, {x!r}, {y!r}, {z!r}\n" for n, (x, y, z) in content.nodes.items())
    sets = "".join(
        f"*NSET, NSET={name}\n{_listed(nodes)}" for name, nodes in content.sets.items()
    )
    return f"*NODE\n{''.join(rows)}{sets}"


def _elements(content: BulkData) -> str:
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
        f"*ELEMENT, TYPE={deck_type(kind)}, ELSET=P{property_}{kind}\n{''.join(rows)}"
        for (kind, property_), rows in blocks.items()
    )


def _sections(content: BulkData) -> str:
    lines = []
    for name, own in content.materials.items():
        if own is not None:
            lines.append(
                f"*MATERIAL, NAME=M{name}\n*ELASTIC\n{own.youngs_modulus!r}, "
                f"{own.poissons_ratio!r}\n*DENSITY\n{own.density * content.weight!r}\n"
            )
    used = dict.fromkeys((k, p, place) for _, p, k, _, place in content.elements)
    done = set()
    for kind, property_, place in used:
        material, depth = content.properties.get(property_, ("", None))
        flat = kind.startswith(("quad", "tri"))
        if content.materials.get(material) is None or (flat and depth is None):
            raise InputError(
                f"property {property_} has no complete material and thickness",
                place=place,
                expected="PSHELL or PSOLID, and MAT1 with E, nu and RHO",
            )
        if (kind, property_) in done:
            continue
        done.add((kind, property_))
        section = "SHELL SECTION" if flat else "SOLID SECTION"
        head = f"*{section}, ELSET=P{property_}{kind}, MATERIAL=M{material}\n"
        lines.append(head + (f"{depth!r}\n" if flat else "\n"))
    return "".join(lines)


def _listed(nodes: list[int]) -> str:
    return "".join(f"{n},\n" for n in nodes)
