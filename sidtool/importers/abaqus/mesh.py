"""Mesh of a deck: body, section of every element, node sets.

Shells of *SHELL SECTION have corner nodes and homogeneous sections.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.model import Material

from ...mesh.connections import RawShell, ShellSection
from ...mesh.deck_text import parse_numbers
from ...mesh.imported_mesh import (
    ImportedMesh,
    RawCoupling,
    RawElement,
    assemble_mesh,
    check_defined,
    collapse_element,
    find_undefined_members,
    mesh_of_points,
    unread_keyword_notes,
)
from ...mesh.materials import ElasticMaterial
from .couplings import couplings_of, masses_of, reference_labels
from .deck import (
    POINTS,
    REFERENCES,
    Deck,
    Element,
    Member,
    Namespace,
    Section,
    unsupported_element_text,
)
from .equations import equations_of, ties_of
from .instances import place_nodes
from .keywords import BY_CALCULIX, Block
from .materials import material_name, materials_of
from .surfaces import surface_nodes

#: Names of places of the nodes, as shares of the thickness from the middle.
_OFFSETS = {"SPOS": 0.5, "SNEG": -0.5}
#: Parameters that a deck needs CalculiX for.
_BEYOND = ("COMPOSITE", "NODAL THICKNESS")
#: Parameters without effect on small displacements of one homogeneous layer.
_IDLE = ("CONTROLS", "POISSON", "SECTION INTEGRATION", "STACK DIRECTION")
#: Share of the transverse shear stiffness of a homogeneous thickness.
_SHEAR_FACTOR = 5 / 6


def read_shell_section(deck: Deck, block: Block) -> None:
    """Read the thickness, the material and the offset of shells.

    Raises
    ------
    InputError : it has layers, a thickness of nodes, or none.
    """
    options = block.options
    if beyond := [key for key in _BEYOND if key in options]:
        raise InputError(
            f"*SHELL SECTION has {beyond[0]}, which is not supported",
            place=block.place,
            expected=f"one material and one thickness, or {BY_CALCULIX}",
        )
    words, place = block.rows[0] if block.rows else ([], block.place)
    thickness = parse_numbers(words[:1] or [""], place, "a thickness")[0]
    if thickness <= 0:
        raise InputError(
            f"*SHELL SECTION has the thickness {thickness:g}",
            place=place,
            expected="one above zero",
        )
    word = options.get("OFFSET", "0").upper()
    offset = _OFFSETS.get(word)
    if offset is None:
        offset = parse_numbers([word], block.place, "OFFSET")[0]
    deck.unread_keywords |= {
        f"{k} of *SHELL SECTION": None for k in _IDLE if k in options
    }
    elset, material = (deck.name(options.get(k, "")) for k in ("ELSET", "MATERIAL"))
    axes = options.get("ORIENTATION", "")
    deck.scope.sections.append(
        Section(
            elset,
            material,
            thickness,
            block.place,
            deck.own_name(axes) if axes else "",
            is_shell=True,
            offset=offset,
        )
    )


def shells_of(
    elements: Sequence[Element],
    sections: Mapping[int, Section],
    materials: Mapping[str, ElasticMaterial],
    nodes: Mapping[int, tuple[float, float, float]],
) -> tuple[RawShell, ...]:
    """Return the shells with their sections.

    Parameters
    ----------
    sections : by the labels of elements
    materials : by name, only complete ones

    Raises
    ------
    InputError : a material has directions, or a node is not defined.
    """
    made: dict[Section, ShellSection] = {}
    shells = []
    for element in elements:
        section = sections[element.label]
        if section not in made:
            made[section] = _shell_section(section, materials.get(section.material))
        kind, labels = collapse_element(element.type.shell_kind, element.nodes)
        check_defined(element.label, labels, nodes, element.place)
        own = made[section]
        shells.append(RawShell(element.label, kind, tuple(labels), element.place, own))
    return tuple(shells)


def _shell_section(section: Section, material: ElasticMaterial | None) -> ShellSection:
    t = section.thickness
    assert t is not None
    zero = np.zeros((3, 3))
    if material is None:
        shear = np.zeros((2, 2))
        return ShellSection(zero, zero, zero, shear, (0.0,) * 3, t, complete=False)
    if not isinstance(material, Material):
        raise InputError(
            f"material {section.material} of shells is not isotropic",
            place=section.place,
            expected=f"*ELASTIC of E and nu, or {BY_CALCULIX}",
        )
    e, nu, rho = material.youngs_modulus, material.poissons_ratio, material.density
    law = np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]]) * (e / (1 - nu**2))
    shear = _SHEAR_FACTOR * law[2, 2] * t * np.eye(2)
    masses = (rho * t, 0.0, rho * t**3 / 12)
    middle = ShellSection(law * t, zero, law * t**3 / 12, shear, masses, t)
    return middle.shifted(-section.offset * t)


def mesh_of(deck: Deck) -> ImportedMesh:
    """Return the mesh of the one part of a deck, with notes on what was ignored.

    Raises
    ------
    InputError : there are several parts, sections that contradict each other, or
        elements that are no solids.
    """
    body, instance = _body_scope(deck)
    sections = _section_by_element(deck, body)
    elements, plates, name_only = _split_elements(body, sections)
    raw = [
        _raw_element(deck, element, sections.get(element.label)) for element in elements
    ]
    nodes = _with_reference_nodes(deck, body)
    turning = bool(plates)
    equations, beams = equations_of(deck, body, instance, nodes, turning=turning)
    couplings = [*couplings_of(deck, body, instance), *beams]
    masses = tuple(masses_of(deck, body, instance))
    ties = tuple(ties_of(deck, body, instance))
    sets = _all_node_sets(deck, body, instance)
    if plates and not raw:
        mesh = mesh_of_points(nodes, sets)
    else:
        mesh = assemble_mesh(nodes, raw, sets)
    states = {element.type.state for element in elements} or {None}
    if len(states) > 1:
        raise InputError("mixes plane stress and plane strain", expected="one of them")
    state = next(iter(states))
    materials = materials_of(deck, sections.values(), instance, state)
    shells = shells_of(plates, sections, materials, nodes)
    if shells:
        _check_couplings_of_shells(couplings)
    return ImportedMesh(
        mesh,
        materials,
        state,
        tuple(_reading_notes(deck, body, [*elements, *plates], name_only)),
        tuple(couplings),
        masses,
        tuple(equations),
        ties,
        shells=shells,
        undefined=undefined_set_members(deck, body, sets, instance),
    )


def _check_couplings_of_shells(couplings: Iterable[RawCoupling]) -> None:
    """Refuse couplings that need surfaces, or directions of axes of their own."""
    for coupling in couplings:
        if coupling.reference is None:
            what, instead = "has no reference node", "REF NODE"
        elif coupling.by_area:
            what = "weighs the nodes of a surface of elements"
            instead = "a *SURFACE, TYPE=NODE beside shells"
        elif coupling.directions not in ("123", "123456"):
            what = f"holds the directions {coupling.directions}"
            instead = "1 to 3 or 1 to 6 beside shells"
        else:
            continue
        raise InputError(
            f"{coupling.name} {what}", place=coupling.place, expected=instead
        )


def _with_reference_nodes(
    deck: Deck, body: Namespace
) -> dict[int, tuple[float, float, float]]:
    """Return the nodes of the body and those of the assembly."""
    own = reference_labels(deck, body)
    for given, label in own.items():
        if given != label:
            deck.diagnostics.append(
                diagnose("N118", what=f"node {given} of the assembly is called {label}")
            )
    ((instance, _),) = deck.instances.items() or [("", "")]
    return place_nodes(body.nodes, deck.placement.get(instance, [])) | {
        label: deck.assembly.nodes[n] for n, label in own.items()
    }


def _body_scope(deck: Deck) -> tuple[Namespace, str]:
    """The scope that holds the elements, and the instance it is."""
    if not deck.instances:
        if deck.parts and not deck.assembly.elements:
            if len(deck.parts) == 1:
                return next(iter(deck.parts.values())), ""
            raise InputError(
                f"has {len(deck.parts)} parts and no instance",
                expected="an *INSTANCE that names the part which is the body",
            )
        return deck.assembly, ""
    points = (*POINTS, *REFERENCES)
    own = [e for e in deck.assembly.elements.values() if e.given not in points]
    if own:
        element = own[0]
        raise InputError(
            f"element {element.label} ({element.given}) belongs to the assembly",
            place=element.place,
            expected="elements of the part only",
        )
    ((instance, part),) = deck.instances.items()
    return deck.parts[part], instance


def _section_by_element(deck: Deck, body: Namespace) -> dict[int, Section]:
    """The section of every element that has one."""
    section_of: dict[int, Section] = {}
    for section in body.sections:
        if section.elset not in body.elsets:
            raise InputError(
                f"names the element set {section.elset!r}, which is not defined",
                place=section.place,
                expected="an *ELSET of this file",
            )
        if section.material not in deck.materials:
            raise InputError(
                f"names the material {section.material!r}, which is not defined",
                place=section.place,
                expected="a *MATERIAL of this file",
            )
        for _, label in body.elsets[section.elset]:
            known = section_of.setdefault(label, section)
            if known is section:
                continue
            if replace(section, elset=known.elset, place=known.place) != known:
                raise InputError(
                    f"element {label} has another section already ({known.place})",
                    place=section.place,
                    expected="one section for every element",
                )
    return section_of


def _split_elements(
    body: Namespace, sections: dict[int, Section]
) -> tuple[list[Element], list[Element], list[Element]]:
    """Return the solid or plane elements of the body, its shells, and elements of lower
    dimension that only name nodes.
    """
    elements = list(body.elements.values())
    top = max((e.type.dimension for e in elements if e.type.kind), default=3)
    solids, plates, name_only = [], [], []
    for element in elements:
        section = sections.get(element.label)
        if element.given in REFERENCES:
            continue
        of_shell = section is not None and section.is_shell
        if element.type.kind and element.type.dimension == top and not of_shell:
            solids.append(element)
        elif element.type.shell_kind and of_shell and top == 3:
            plates.append(element)
        elif section is not None or element.type.dimension >= top:
            raise _no_solid_elements(element)
        else:
            name_only.append(element)
    if name_only and not solids and not plates:
        raise _no_solid_elements(name_only[0])
    return solids, plates, name_only


def _no_solid_elements(element: Element) -> InputError:
    if element.type.kind:
        return InputError(
            "mixes plane and solid elements",
            place=element.place,
            expected="elements of one dimension",
        )
    return unsupported_element_text(element.given, element.place)


def _raw_element(deck: Deck, element: Element, section: Section | None) -> RawElement:
    kind = element.type.kind
    assert kind is not None
    return RawElement(
        element.label,
        kind,
        element.nodes,
        element.place,
        material=material_name(deck, section) if section else None,
        thickness=section.thickness if section and element.type.state else None,
        formulation=element.type.formulation,
    )


def _all_node_sets(deck: Deck, body: Namespace, instance: str) -> dict[str, list[int]]:
    """Return node sets by name; those of the assembly come first and are marked."""
    sets: dict[str, list[int]] = {}
    scopes = [body] if body is deck.assembly else [deck.assembly, body]
    for scope in scopes:
        own = "" if scope is body else instance
        for name, nodes in node_sets(deck, scope, body, own).items():
            if name not in sets:
                sets[name] = nodes
            elif set(nodes) != set(sets[name]):
                part = f"{instance or body.name}.{name}"
                sets[part] = nodes
                deck.diagnostics.append(
                    diagnose("N118", what=f"set {name} of the part is called {part}")
                )
    return sets


def node_sets(
    deck: Deck, scope: Namespace, body: Namespace, instance: str
) -> dict[str, list[int]]:
    """The nodes of the body in all sets of a scope, element sets after node sets."""
    sets = {
        name: _labels_of_group(group, instance) for name, group in scope.nsets.items()
    }
    for name, group in scope.elsets.items():
        known = map(body.elements.get, _labels_of_group(group, instance))
        nodes = chain.from_iterable(e.nodes for e in known if e is not None)
        sets.setdefault(name, list(dict.fromkeys(nodes)))
    for name in scope.surfaces:
        on_faces = surface_nodes(deck, scope, body, instance, name)
        if on_faces is not None:
            sets.setdefault(name, on_faces)
    return sets


def undefined_set_members(
    deck: Deck, body: Namespace, sets: Mapping[str, Iterable[int]], instance: str = ""
) -> dict[str, str]:
    """Sets with members that the deck does not define, and the first of them."""
    elsets: dict[str, list[int]] = {}
    for scope in {id(s): s for s in (deck.assembly, body)}.values():
        own = "" if scope is body else instance
        for name, group in scope.elsets.items():
            if name not in scope.nsets:
                elsets.setdefault(name, []).extend(_labels_of_group(group, own))
    there = body.elements.keys() | deck.outside
    undefined = find_undefined_members(there, elsets, "element")
    return find_undefined_members(body.nodes, sets) | {
        name: member for name, member in undefined.items() if name in sets
    }


def _labels_of_group(group: Iterable[Member], instance: str) -> list[int]:
    return [label for owner, label in group if owner == instance]


def _reading_notes(
    deck: Deck, body: Namespace, elements: list[Element], name_only: list[Element]
) -> Iterable[Diagnostic]:
    """Return what was read, replaced and ignored (N110 to N119)."""
    given = Counter(element.given for element in elements)
    kinds = {element.given: element.type for element in elements}
    used = set(chain.from_iterable(element.nodes for element in elements))
    yield diagnose(
        "N110",
        elements=len(elements),
        given=len(body.elements),
        kinds=[f"{count} {name}" for name, count in given.items()],
        used=len(used),
        nodes=len(body.nodes),
    )
    for name, count in given.items():
        if kinds[name].replaced:
            replacement = kinds[name].replaced
            yield diagnose("N114", type=name, replacement=replacement, count=count)
    idle = [element.given for element in name_only if element.given not in POINTS]
    if deck.masses:
        names = dict.fromkeys(f"*{each.block.keyword}" for each in deck.masses)
        yield diagnose("N135", keywords=list(names))
    elif massless := len(name_only) - len(idle):
        reason = f"{' and '.join(POINTS)} without mass"
        yield diagnose("N111", count=massless, reason=reason)
    for name, count in Counter(idle).items():
        yield diagnose("N111", count=count, reason=f"{name} without a section")
    for part in deck.parts.values():
        if part is not body and not deck.chosen:
            yield diagnose("N119", what=f"part {part.name}, which has no instance,")
    yield from deck.diagnostics
    yield from unread_keyword_notes(deck.unread_keywords)
