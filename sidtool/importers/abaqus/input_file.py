"""Abaqus and CalculiX input files (.inp): nodes, elements, sets, materials.

This module reads *NODE, *ELEMENT, their generation, *NSET, *ELSET, *MATERIAL with
*ELASTIC and *DENSITY, *ORIENTATION, *SOLID SECTION, *SHELL SECTION, *SURFACE,
*COUPLING, *RIGID BODY, *MASS, *TIE, *EQUATION, *MPC, *INCLUDE and every *PART with its
*INSTANCE. The effect of all other keywords is defined in `keywords`.
"""

from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import diagnose

from ...mesh.deck_text import RefusalCollector, parse_integers, parse_numbers
from ...mesh.imported_mesh import LEFT_OUT, ONLY_NODES, ImportedMesh
from .couplings import read_coupling, read_coupling_kind, read_mass
from .deck import (
    Deck,
    Element,
    ElementType,
    Namespace,
    Section,
    duplicate_error,
    element_type,
    extend_set,
    read_elset,
    read_nset,
    unsupported_element_text,
)
from .equations import read_equation, read_tie
from .instances import merge_instances
from .keywords import Block, UnreadKeyword, keyword_effect, read_blocks, spelled_out
from .materials import read_elastic, read_orientation
from .node_generation import read_elcopy, read_elgen, read_ncopy, read_nfill, read_ngen
from .shells import read_shell_section
from .surfaces import read_surface, read_system, to_global

_REMARKS = {
    "damping": " (damping is that of the model file)",
    "ignored": LEFT_OUT,
}
_OF_SECTION = ("ELSET", "MATERIAL")
_IDLE = ("CONTROLS", "REF NODE", "OFFSET")


def read_inp(
    path: str | Path,
    ignored: frozenset[str] = frozenset(),
    part: str | None = None,
    density: float | None = None,
) -> ImportedMesh:
    """Read the mesh of an Abaqus or CalculiX input file.

    Parameters
    ----------
    ignored : keywords that are ignored on purpose, in capitals
    part : the instance, or the set of elements, that is the body; None for all
    density : density of materials without *DENSITY, in the units of the file

    Raises
    ------
    InputError : the file is not valid; the error names file, line and expectation.
    """
    from .mesh import mesh_of

    try:
        deck = read_deck(Path(path), ignored)
        deck.density = density
        return mesh_of(merge_instances(deck, part))
    except InputError as error:
        raise error.located(path) from None


def read_deck(path: Path, ignored: frozenset[str] = frozenset()) -> Deck:
    """Read the contents of a deck; see `read_inp`."""
    deck = Deck(names_only=ONLY_NODES in ignored)
    deck.scope = deck.assembly
    stops, in_step = RefusalCollector(), False
    for block in read_blocks(path):
        in_step = block.keyword == "STEP" or (in_step and block.keyword != "END STEP")
        try:
            kind = keyword_effect(block, ignored, in_step)
        except UnreadKeyword as error:
            stops.add(error, block.keyword)
            continue
        if kind == "read":
            with stops.collect_errors():
                block = spelled_out(block)
                _READERS.get(block.keyword, _skip_keyword)(deck, block)
        elif kind == "step":
            deck.unread_keywords["all steps"] = None
        else:
            deck.unread_keywords[f"*{block.keyword}" + _REMARKS.get(kind, "")] = None
            if kind == "without effect" and block.keyword == "INITIAL CONDITIONS":
                with stops.collect_errors():
                    _initial_temperatures(deck, block)
    stops.check()
    deck.close_gaps()
    return deck


def _initial_temperatures(deck: Deck, block: Block) -> None:
    """*INITIAL CONDITIONS, TYPE=TEMPERATURE: a node or a set, and its temperature."""
    if block.options.get("TYPE", "").upper() == "TEMPERATURE":
        for words, place in block.rows:
            deck.temperatures.add(parse_numbers(words[1:2] or [""], place)[0])


def _skip_keyword(deck: Deck, block: Block) -> None:
    """Skip a keyword that only opens or closes a block."""


def _read_part(deck: Deck, block: Block) -> None:
    name = deck.name(block.options.get("NAME", ""))
    if name in deck.parts:
        raise duplicate_error("part", name, block.place)
    deck.scope = deck.parts.setdefault(name, Namespace(name))


def _read_assembly(deck: Deck, block: Block) -> None:
    deck.scope = deck.assembly


def _read_instance(deck: Deck, block: Block) -> None:
    name = deck.name(block.options.get("NAME", ""))
    part = deck.name(block.options.get("PART", ""))
    if name in deck.instances:
        raise duplicate_error("instance", name, block.place)
    if part not in deck.parts:
        raise InputError(
            f"names the part {part!r}, which is not defined",
            place=block.place,
            expected="a *PART of this file",
        )
    deck.instances[name] = part
    deck.placement[name] = [
        parse_numbers(_blank_as_zero(words), place) for words, place in block.rows
    ]
    deck.scope = deck.parts[part]


def _read_nodes(deck: Deck, block: Block) -> None:
    system = block.options.get("SYSTEM", "R").upper()
    if system not in ("R", "C", ""):
        raise InputError(
            f"uses the system {system} of coordinates",
            place=block.place,
            expected="Cartesian or cylindrical ones (C)",
        )
    labels = []
    for words, place in block.rows:
        (label,) = parse_integers(words[:1], place, "a node number")
        values = parse_numbers(_blank_as_zero(words[1:]), place, "coordinates")
        if len(values) > 6:
            raise InputError(
                f"node {label} has {len(values)} coordinates",
                place=place,
                expected="at most 3, and 3 of a normal",
            )
        if label in deck.scope.nodes:
            raise duplicate_error("node", label, place)
        x, y, z = (*values, 0.0, 0.0, 0.0)[:3]
        if system == "C":  # radius and degrees
            x, y = x * np.cos(np.radians(y)), x * np.sin(np.radians(y))
        deck.scope.nodes[label] = to_global(deck, (float(x), float(y), z))
        labels.append(label)
    if "NSET" in block.options:
        extend_set(deck, deck.scope.nsets, block.options["NSET"], labels)


def _read_elements(deck: Deck, block: Block) -> None:
    given = block.options.get("TYPE", "").upper()
    kind = element_type(given)
    if kind is None:
        raise unsupported_element_text(given, block.place, by_calculix=deck.names_only)
    labels = []
    for words, place in _element_records(deck, block, kind, given):
        label, *nodes = parse_integers(words, place, "element and node numbers")
        if label in deck.scope.elements:
            raise duplicate_error("element", label, place)
        deck.scope.elements[label] = Element(label, kind, given, nodes, place)
        labels.append(label)
    if "ELSET" in block.options:
        extend_set(deck, deck.scope.elsets, block.options["ELSET"], labels)


def _element_records(
    deck: Deck, block: Block, kind: ElementType, given: str
) -> list[tuple[list[str], str]]:
    """Yield the words of every element, which may extend over several lines."""
    records: list[tuple[list[str], str]] = []
    further = {len(words) - 1 for words, _ in block.rows}
    if kind.count > 1 and min(further, default=0) > kind.count:
        what = f"{', '.join(map(str, sorted(further)))} nodes, of which the first "
        what += f"{kind.count} are those of the element, as in CalculiX"
        deck.diagnostics.append(diagnose("N120", place=f"lines of {given}", what=what))
        return [(words[: kind.count + 1], place) for words, place in block.rows]
    for words, place in block.rows:
        open_ = records and len(records[-1][0]) <= kind.count
        if open_:
            records[-1][0].extend(words)
        else:
            records.append((list(words), place))
    for words, place in records:
        if len(words) == kind.count + 1:
            continue
        if kind.kind is None:
            raise unsupported_element_text(given, block.place)
        raise InputError(
            f"element {words[0]!r} ({given}) has {len(words) - 1} nodes",
            place=place,
            expected=f"{kind.count} nodes",
        )
    return records


def _read_material(deck: Deck, block: Block) -> None:
    deck.material = deck.name(block.options.get("NAME", ""))
    if deck.material in deck.materials:
        raise duplicate_error("material", deck.material, block.place)
    deck.materials[deck.material] = {}


def _read_section(deck: Deck, block: Block) -> None:
    elset, material = (deck.name(block.options.get(k, "")) for k in _OF_SECTION)
    thickness = None
    if block.rows and any(block.rows[0][0]):
        words, place = block.rows[0]
        thickness = parse_numbers(_blank_as_zero(words[:1]), place)[0] or None
    deck.unread_keywords |= {
        f"{k} of *SOLID SECTION": None for k in _IDLE if k in block.options
    }
    given = block.options.get("ORIENTATION", "")
    axes = deck.own_name(given) if given else ""
    deck.scope.sections.append(Section(elset, material, thickness, block.place, axes))


_READERS = {
    "PART": _read_part,
    "END PART": _read_assembly,
    "ASSEMBLY": _read_assembly,
    "INSTANCE": _read_instance,
    "END INSTANCE": _read_assembly,
    "NODE": _read_nodes,
    "ELEMENT": _read_elements,
    "NGEN": read_ngen,
    "NFILL": read_nfill,
    "NCOPY": read_ncopy,
    "ELGEN": read_elgen,
    "ELCOPY": read_elcopy,
    "NSET": read_nset,
    "ELSET": read_elset,
    "MATERIAL": _read_material,
    "ELASTIC": read_elastic,
    "DENSITY": read_elastic,
    "SOLID SECTION": _read_section,
    "SHELL SECTION": read_shell_section,
    "SURFACE": read_surface,
    "KINEMATIC": read_coupling_kind,
    "DISTRIBUTING": read_coupling_kind,
    **dict.fromkeys(("MASS", "ROTARY INERTIA"), read_mass),
    "SYSTEM": read_system,
    "ORIENTATION": read_orientation,
    "TIE": read_tie,
    **dict.fromkeys(("EQUATION", "MPC", "TRANSFORM"), read_equation),
    **dict.fromkeys(("COUPLING", "RIGID BODY", "KINEMATIC COUPLING"), read_coupling),
    "DISTRIBUTING COUPLING": read_coupling,
}


def _blank_as_zero(words: list[str]) -> list[str]:
    """A blank field is zero."""
    return [word or "0" for word in words]
