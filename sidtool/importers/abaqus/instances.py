"""Instances of parts as one body, or the instance that is selected by name."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_label
from sidtool.formats.diagnostics import diagnose

from ...mesh.deck_text import parse_numbers
from ...mesh.imported_mesh import find_undefined_members
from .deck import CouplingDefinition, Deck, Element, Member, Namespace, SurfacePart
from .keywords import Block

_Places = dict[int, tuple[float, float, float]]


def merge_instances(deck: Deck, part: str | None) -> Deck:
    """Return the deck with one instance at most, and only the selected elements.

    Several instances are merged to one flat body. Their sets and surfaces are named
    INSTANCE.SET, and numbers that occur twice are shifted, with a note.

    Parameters
    ----------
    part : name of an instance, or of a set of elements; None for everything

    Raises
    ------
    InputError : there is no such instance or set.
    """
    name = None if part is None else deck.name(part)
    if name in deck.instances:
        others = tuple(other for other in deck.instances if other != name)
        deck.diagnostics += [
            diagnose("N119", what=f"instance {other}") for other in others
        ]
        chosen = {name: deck.instances[name]} if name is not None else {}
        scopes = [deck.assembly, *(deck.parts[part] for part in chosen.values())]

        def in_chosen_scopes(
            definitions: list[CouplingDefinition],
        ) -> list[CouplingDefinition]:
            return [
                definition
                for definition in definitions
                if any(definition.scope is s for s in scopes)
            ]

        return replace(
            deck,
            instances=chosen,
            chosen=True,
            unused_instances=others,
            coupling_definitions=in_chosen_scopes(deck.coupling_definitions),
            masses=in_chosen_scopes(deck.masses),
            equations=in_chosen_scopes(deck.equations),
            ties=in_chosen_scopes(deck.ties),
        )
    if len(deck.instances) > 1:
        deck = _merge_to_one_scope(deck)
    if name is None:
        return deck
    ((instance, own),) = deck.instances.items() or [("", "")]
    body = deck.parts[own] if own else deck.assembly
    members = [*body.elsets.get(name, []), *deck.assembly.elsets.get(name, [])]
    labels = {label for owner, label in members if owner in ("", instance)}
    if not labels:
        known = ", ".join([*deck.instances, *body.elsets][:20]) or "none"
        raise InputError(
            f"there is no instance and no element set {part!r}",
            place="geometry.part",
            expected=f"one of {known}",
        )
    there = body.elements.keys() | deck.assembly.elements.keys()
    if missing := find_undefined_members(there, {name: sorted(labels)}, "element"):
        raise InputError(
            f"the part {name!r} names {missing[name]}, which the file does not define",
            place="geometry.part",
            expected="elements of this file",
        )
    left = len(body.elements) - len(labels)
    deck.outside = frozenset(body.elements) - labels
    deck.diagnostics.append(diagnose("N119", what=f"{left} elements outside {name}"))
    body.elements = {n: e for n, e in body.elements.items() if n in labels}
    body.sections = [
        section
        for section in body.sections
        if any(n in labels for _, n in body.elsets.get(section.elset, []))
    ]
    deck.chosen = True
    return deck


def placement_lines(block: Block) -> list[list[float]]:
    """A shift, and two points of an axis with an angle in degrees, of *INSTANCE or
    *NCOPY. A blank line before the axis is a zero shift.

    Raises
    ------
    InputError : the lines are others.
    """
    lines: list[list[float]] = []
    for words, place in block.rows:
        line = parse_numbers([word or "0" for word in words], place)
        if not lines and len(line) > 3:
            lines.append([])
        has_axis = len(line) == 7 and (line[:3] != line[3:6] or line[6] == 0.0)
        if len(lines) > 1 or not (has_axis if lines else True):
            raise InputError(
                f"*{block.keyword} has a line of {len(line)} numbers",
                place=place,
                expected="a shift of 3 numbers, then two points of an axis and an "
                "angle (7 numbers)",
            )
        lines.append(line)
    return lines


def place_nodes(nodes: _Places, placement: list[list[float]]) -> _Places:
    """Return the nodes of a part in the position of its instance: translated, then
    rotated.

    The second line of an instance holds two points of the axis, placed already, and
    the angle in degrees.
    """
    lines = [[*line, *[0.0] * 7][:7] for line in placement]
    if not nodes or not any(any(line) for line in lines):
        return nodes
    places = np.array(list(nodes.values())) + lines[0][:3]
    if len(lines) > 1 and lines[1][6]:
        from scipy.spatial.transform import (
            Rotation,
        )  # the import takes a quarter of a second

        a, b = np.array(lines[1][:3]), np.array(lines[1][3:6])
        turn = np.radians(lines[1][6]) * (b - a) / np.linalg.norm(b - a)
        places = a + Rotation.from_rotvec(turn).apply(places - a)
    return {n: (x, y, z) for n, (x, y, z) in zip(nodes, places.tolist(), strict=True)}


def _merge_to_one_scope(deck: Deck) -> Deck:
    """All instances in one scope, the assembly's own nodes and elements last."""
    flat = Namespace()
    own: dict[str, Namespace] = {}
    for name, part in deck.instances.items():
        own[name] = _add_instance(deck, flat, name, deck.parts[part])
    _add_assembly(deck, flat)
    scopes: dict[int, list[Namespace]] = {id(deck.assembly): [flat]}
    for name, part in deck.instances.items():
        scopes.setdefault(id(deck.parts[part]), []).append(own[name])

    def moved(definitions: Iterable[CouplingDefinition]) -> list[CouplingDefinition]:
        return [
            replace(definition, scope=scope)
            for definition in definitions
            for scope in scopes.get(id(definition.scope), [])
        ]

    used = set(deck.instances.values())
    deck.diagnostics += [
        diagnose("N119", what=f"part {part}, which has no instance,")
        for part in deck.parts
        if part not in used
    ]
    return replace(
        deck,
        assembly=flat,
        scope=flat,
        parts={},
        instances={},
        coupling_definitions=moved(deck.coupling_definitions),
        masses=moved(deck.masses),
        equations=moved(deck.equations),
        ties=moved(deck.ties),
    )


def _add_instance(deck: Deck, flat: Namespace, name: str, part: Namespace) -> Namespace:
    """The scope of an instance, which is added to the flat one as well."""
    shift = (
        _number_offset(flat.nodes, part.nodes),
        _number_offset(flat.elements, part.elements),
    )
    if any(shift):
        what = f"instance {name}: {shift[0]} is added to its node numbers, {shift[1]} "
        what += "to its element numbers"
        deck.diagnostics.append(diagnose("N118", what=what))
    nodes = place_nodes(part.nodes, deck.placement.get(name, []))
    scope = Namespace(
        name,
        {n + shift[0]: place for n, place in nodes.items()},
        {n + shift[1]: _renumber_element(e, shift) for n, e in part.elements.items()},
        {key: _shift_numbers(group, shift[0]) for key, group in part.nsets.items()},
        {key: _shift_numbers(group, shift[1]) for key, group in part.elsets.items()},
        first=shift,
    )
    for key, faces in part.surfaces.items():
        scope.surfaces[key] = [_renumber_face(face, shift) for face in faces]
    flat.instances[name] = shift
    flat.nodes |= scope.nodes
    flat.elements |= scope.elements
    flat.nsets |= {deck.name(f"{name}.{key}"): g for key, g in scope.nsets.items()}
    flat.elsets |= {deck.name(f"{name}.{key}"): g for key, g in scope.elsets.items()}
    for key, faces in scope.surfaces.items():
        flat.surfaces[deck.name(f"{name}.{key}")] = [
            face if is_label(face.word) else replace(face, word=f"{name}.{face.word}")
            for face in faces
        ]
    flat.sections += [
        replace(section, elset=deck.name(f"{name}.{section.elset}"), instance=name)
        for section in part.sections
    ]
    return scope


def _add_assembly(deck: Deck, flat: Namespace) -> None:
    """Add the contents of the assembly: its own nodes, and sets of its instances."""
    own = deck.assembly
    shift = (
        _number_offset(flat.nodes, own.nodes),
        _number_offset(flat.elements, own.elements),
    )
    if shift[0]:
        what = f"{shift[0]} is added to node numbers of the assembly"
        deck.diagnostics.append(diagnose("N118", what=what))
    flat.first = shift
    flat.nodes |= {n + shift[0]: place for n, place in own.nodes.items()}
    flat.elements |= {
        n + shift[1]: _renumber_element(e, shift) for n, e in own.elements.items()
    }
    for which, groups in ((0, own.nsets), (1, own.elsets)):
        target = flat.elsets if which else flat.nsets
        for key, group in groups.items():
            target[key] = [
                ("", n + (flat.instances[owner][which] if owner else shift[which]))
                for owner, n in group
            ]
    for key, faces in own.surfaces.items():
        flat.surfaces[key] = [
            _renumber_face(face, shift, flat.instances, deck) for face in faces
        ]
    flat.sections += own.sections


def _number_offset(known: Iterable[int], more: Iterable[int]) -> int:
    """Return the offset that separates new numbers from the existing ones."""
    there = set(known)
    return max(there, default=0) if there & set(more) else 0


def _renumber_element(element: Element, shift: tuple[int, int]) -> Element:
    nodes = [n + shift[0] for n in element.nodes]
    return replace(element, label=element.label + shift[1], nodes=nodes)


def _shift_numbers(group: Iterable[Member], shift: int) -> list[Member]:
    return [("", n + shift) for _, n in group]


def _renumber_face(
    face: SurfacePart,
    shift: tuple[int, int],
    instances: dict[str, tuple[int, int]] | None = None,
    deck: Deck | None = None,
) -> SurfacePart:
    """A line of a surface by the numbers of the flat body."""
    which = 0 if face.kind == "NODE" else 1
    head, point, tail = face.word.rpartition(".")
    if point and is_label(tail) and instances is not None and deck is not None:
        shift = instances.get(deck.name(head), shift)
        return replace(face, word=str(int(tail) + shift[which]))
    if is_label(face.word):
        return replace(face, word=str(int(face.word) + shift[which]))
    return face
