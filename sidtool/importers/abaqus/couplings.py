"""*COUPLING, *RIGID BODY and *MASS of a deck."""

from collections.abc import Iterator
from dataclasses import replace

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_label
from sidtool.formats.diagnostics import diagnose

from ...mesh.deck_text import parse_integers, parse_numbers
from ...mesh.imported_mesh import RawCoupling, RawMass, find_undefined_members
from .deck import REFERENCES, CouplingDefinition, Deck, Namespace, resolve_name
from .keywords import Block
from .surfaces import defined_elements, resolve_nodes, surface_nodes

_DISPLACEMENTS = {1, 2, 3}
_ALL = "123456"
#: Parameters with node sets of *RIGID BODY -> directions of the nodes that it holds.
_OF_NODES = {"NSET": _ALL, "TIE NSET": _ALL, "PIN NSET": "123"}
#: Numbers of *ROTARY INERTIA: I11, I22, I33, I12, I13, I23.
_MOMENTS = 6


def read_coupling(deck: Deck, block: Block) -> None:
    """*COUPLING, *RIGID BODY, *KINEMATIC COUPLING, *DISTRIBUTING COUPLING."""
    deck.coupling_definitions.append(CouplingDefinition(block, deck.scope))


def read_coupling_kind(deck: Deck, block: Block) -> None:
    """Read *KINEMATIC or *DISTRIBUTING after its *COUPLING."""
    if (
        not deck.coupling_definitions
        or deck.coupling_definitions[-1].block.keyword != "COUPLING"
    ):
        raise InputError(
            f"*{block.keyword} stands alone",
            place=block.place,
            expected="a *COUPLING right before it",
        )
    deck.coupling_definitions[-1].kind = block


def read_mass(deck: Deck, block: Block) -> None:
    deck.masses.append(CouplingDefinition(block, deck.scope))


def reference_labels(deck: Deck, body: Namespace) -> dict[int, int]:
    """Return the numbers of the nodes of the assembly, if the body is a part."""
    if body is deck.assembly:
        return {}
    last = max(body.nodes, default=0)
    return {n: n if n not in body.nodes else last + n for n in deck.assembly.nodes}


def couplings_of(deck: Deck, body: Namespace, instance: str) -> list[RawCoupling]:
    """The couplings of the body.

    Raises
    ------
    InputError : a set is unknown, or a coupling constrains some directions only.
    """
    couplings = []
    used = {n for e in body.elements.values() for n in e.nodes} if deck.chosen else None
    for i, definition in enumerate(deck.coupling_definitions, start=1):
        try:
            made = _make_couplings(deck, definition, body, instance, i)
            if used is not None and all(used.isdisjoint(c.nodes) for c in made):
                deck.diagnostics.append(diagnose("N119", what=made[0].name))
                continue
            couplings += made
        except InputError as error:
            place = error.place or definition.block.place
            raise InputError(
                error.problem, place=place, expected=error.expected
            ) from None
    return couplings


def _make_couplings(
    deck: Deck,
    definition: CouplingDefinition,
    body: Namespace,
    instance: str,
    number: int,
) -> list[RawCoupling]:
    """Return the couplings of a keyword, one for the nodes of the same directions."""
    block, options = definition.block, definition.block.options
    name = deck.name(options.get("CONSTRAINT NAME", "")) or f"{block.keyword} {number}"
    rigid = definition.kind is None or definition.kind.keyword == "KINEMATIC"
    reference = options.get("REF NODE")
    if block.keyword == "DISTRIBUTING COUPLING":
        own, node = _weighted_nodes(deck, definition, body, instance)
        return [RawCoupling(name, False, tuple(dict.fromkeys(own)), node, block.place)]
    if block.keyword == "COUPLING":
        if definition.kind is None:
            raise InputError(
                "*COUPLING has no kind", place=block.place, expected="*KINEMATIC"
            )
        surface = options.get("SURFACE", "")
        nodes = _surface_coupling(deck, definition, body, instance, surface)
        free = not rigid and not deck.masses  # means resist no motion of the body
        held = _directions(name, definition.kind.rows, definition.kind.place, free)
        if not rigid and held[:3] != "123":
            deck.unread_keywords[
                f"directions {held} of {name}: its reference node takes the mean "
                "motion in all directions"
            ] = None
        groups = {held if rigid else _ALL: nodes}
    elif block.keyword == "KINEMATIC COUPLING":
        groups = {}
        for words, place in block.rows:
            own = resolve_nodes(deck, definition.scope, instance, words[0])
            held = _directions(name, [(words[1:], place)], place)
            groups.setdefault(held, []).extend(own)
    else:
        groups = _rigid_body_couplings(deck, definition, body, instance)
    label = (
        None
        if reference is None
        else _reference_label(deck, definition, body, instance, reference)
    )
    by_area = not rigid and _is_element_surface(
        deck, definition, options.get("SURFACE", "")
    )
    return [
        RawCoupling(
            name,
            rigid,
            tuple(dict.fromkeys(nodes)),
            label,
            block.place,
            turns=held == _ALL,
            by_area=by_area,
            directions=held,
        )
        for held, nodes in groups.items()
    ]


def _is_element_surface(deck: Deck, definition: CouplingDefinition, word: str) -> bool:
    """Check whether a coupling is weighted by the areas of a surface of elements.

    Raises
    ------
    InputError : weights decrease with the distance from the reference node.
    """
    assert definition.kind is not None
    method = definition.kind.options.get("WEIGHTING METHOD", "UNIFORM").upper()
    if method != "UNIFORM":
        raise InputError(
            f"*DISTRIBUTING has WEIGHTING METHOD={method}",
            place=definition.kind.place,
            expected="UNIFORM",
        )
    scope, own = resolve_name(deck, definition.scope, word)
    parts = scope.surfaces.get(deck.name(own), []) if scope else []
    return bool(parts) and all(part.kind == "ELEMENT" for part in parts)


def _surface_coupling(
    deck: Deck,
    definition: CouplingDefinition,
    body: Namespace,
    instance: str,
    word: str,
) -> list[int]:
    scope, own = resolve_name(deck, definition.scope, word)
    if scope is None:
        return []
    name = deck.name(own)
    if name in scope.surfaces:
        nodes = surface_nodes(deck, scope, body, instance, name)
        if nodes is not None:
            return nodes
    raise InputError(
        f"names the surface {word!r}, which is none of element faces or nodes",
        place=definition.block.place,
        expected="a *SURFACE of faces S1, S2, ... of solids, of sides SPOS, SNEG or "
        "edges E1, E2, ... of shells, or of nodes",
    )


def _weighted_nodes(
    deck: Deck, definition: CouplingDefinition, body: Namespace, instance: str
) -> tuple[list[int], int]:
    """Return the nodes of *DISTRIBUTING COUPLING, and that of its element DCOUP3D.

    Raises
    ------
    InputError : it has not one element, or nodes of different weights.
    """
    block = definition.block
    name = deck.name(block.options.get("ELSET", ""))
    labels = [label for _, label in definition.scope.elsets.get(name, [])]
    elements = defined_elements(deck, body, labels, f"the coupling {name!r}")
    elements = [each for each in elements if each.given in REFERENCES]
    weights = {
        parse_numbers(words[1:2] or [""], place, "a weight")[0]
        for words, place in block.rows
    }
    if len(elements) != 1 or len(weights) != 1 or min(weights) <= 0:
        raise InputError(
            f"*DISTRIBUTING COUPLING has {len(elements)} elements DCOUP3D and "
            f"{len(weights)} different weights",
            place=block.place,
            expected="one element DCOUP3D, and nodes of one weight above zero",
        )
    nodes = [
        n
        for words, _ in block.rows
        for n in resolve_nodes(deck, definition.scope, instance, words[0])
    ]
    return nodes, elements[0].nodes[0]


def _rigid_body_couplings(
    deck: Deck, definition: CouplingDefinition, body: Namespace, instance: str
) -> dict[str, list[int]]:
    """Return the nodes of a rigid body by their directions that it holds."""
    options = definition.block.options
    groups: dict[str, list[int]] = {}
    for key, held in _OF_NODES.items():
        if key in options:
            own = resolve_nodes(deck, definition.scope, instance, options[key])
            groups.setdefault(held, []).extend(own)
    if groups:
        return groups
    name = deck.name(options.get("ELSET", ""))
    group = definition.scope.elsets.get(name)
    if group is None:
        raise InputError(
            f"there is no element set {name!r}", expected="an *ELSET of this file"
        )
    labels = [label for owner, label in group if owner in (instance, "")]
    known = defined_elements(deck, body, labels, f"the rigid body {name!r}")
    return {_ALL: [n for element in known for n in element.nodes]}


def _directions(
    name: str, rows: list[tuple[list[str], str]], place: str, free: bool = False
) -> str:
    """Return the directions of lines of the first and the last one; without lines all
    are constrained.

    Parameters
    ----------
    free : whether displacements may be free

    Raises
    ------
    InputError : a displacement is free, or a direction is none.
    """
    held: set[int] = set()
    for words, where in rows:
        given = parse_integers([w for w in words if w], where, "a direction")
        if len(given) > 2:
            raise InputError(
                f"{name} has a line of {len(given)} directions",
                place=where,
                expected="the first and the last one",
            )
        last = min(given[-1], 7) if given else 0
        held |= set(range(given[0], last + 1)) if given else {*range(1, 7)}
    least = {*held} if free else _DISPLACEMENTS
    if rows and not least <= held <= {*range(1, 7)}:
        listed = ", ".join(map(str, sorted(held)))
        raise InputError(
            f"{name} holds the directions {listed}",
            place=place,
            expected="1 to 3, with or without rotations",
        )
    return "".join(map(str, sorted(held))) or _ALL


def labels_named(
    deck: Deck,
    definition: CouplingDefinition,
    body: Namespace,
    instance: str,
    word: str,
) -> list[int]:
    """Return the numbers of a node or a set of a coupling, including those of the
    assembly.
    """
    own = reference_labels(deck, body)
    if definition.scope is body or not own or "." in word:
        return resolve_nodes(deck, definition.scope, instance, word)
    group = definition.scope.nsets.get(deck.name(word), [])
    if is_label(word):
        group = [("", int(word))]
    single = [n for owner, n in group if owner == ""]
    undefined = find_undefined_members(own, {word: single})
    if undefined and definition.scope is deck.assembly:
        raise InputError(
            f"{word!r} names {undefined[word]}, which is not defined",
            place=definition.block.place,
            expected="nodes of this file",
        )
    return [
        own[n] if o == "" else n
        for o, n in group
        if o == instance or (o == "" and n in own)
    ]


def _reference_label(
    deck: Deck,
    definition: CouplingDefinition,
    body: Namespace,
    instance: str,
    word: str,
) -> int:
    """Return the number of a reference node."""
    labels = labels_named(deck, definition, body, instance, word)
    if len(labels) != 1:
        raise InputError(
            f"the reference node {word!r} is {len(labels)} nodes",
            place=definition.block.place,
            expected="one node",
        )
    return labels[0]


def masses_of(deck: Deck, body: Namespace, instance: str) -> Iterator[RawMass]:
    """The masses of elements of type MASS, and the inertia of those of ROTARYI.

    Raises
    ------
    InputError : a set is unknown, or has no mass.
    """
    own = reference_labels(deck, body)
    places: dict[tuple[str, int, int], str] = {}
    for definition in deck.masses:
        block = definition.block
        elset = deck.name(block.options.get("ELSET", ""))
        group = definition.scope.elsets.get(elset)
        if group is None or not block.rows:
            raise InputError(
                f"*{block.keyword} names {elset!r} and has {len(block.rows)} lines",
                place=block.place,
                expected="an *ELSET of its elements, and a line of numbers",
            )
        lump = _read_lumped_mass(block)
        turned = any(any(line[6:]) for rows in deck.placement.values() for line in rows)
        if turned and any(lump.inertia) and definition.scope is not deck.assembly:
            raise InputError(
                "*ROTARY INERTIA is in a part whose instance is turned",
                place=block.place,
                expected="elements ROTARYI of the assembly",
            )
        for owner, label in dict.fromkeys(group):
            is_in_assembly = definition.scope is not body and owner == ""
            scope = definition.scope if is_in_assembly else body
            known = defined_elements(
                deck,
                scope,
                [label] if is_in_assembly or owner in ("", instance) else [],
                elset,
            )
            if known:
                there = places.setdefault(
                    (block.keyword, id(scope), label), block.place
                )
                if there != block.place:
                    raise InputError(
                        f"element {label} has *{block.keyword} already ({there})",
                        place=block.place,
                        expected="one for every element",
                    )
                node = scope.elements[label].nodes[0]
                yield replace(
                    lump, node=own.get(node, node) if is_in_assembly else node
                )


def _read_lumped_mass(block: Block) -> RawMass:
    """Read a line of *MASS or *ROTARY INERTIA, without its node."""
    words, place = block.rows[0]
    most = 1 if block.keyword == "MASS" else _MOMENTS
    if len(block.rows) > 1 or any(words[most:]):
        raise InputError(
            f"*{block.keyword} has {len(block.rows)} lines of {len(words)} numbers",
            place=place,
            expected=f"one line of at most {most}",
        )
    values = parse_numbers(
        [word or "0" for word in words], place, "a mass or an inertia"
    )
    if block.keyword == "MASS":
        return RawMass(0, values[0], block.place)
    xx, yy, zz, *products = [*values, *[0.0] * _MOMENTS][:_MOMENTS]
    if any(products):
        raise InputError(
            "*ROTARY INERTIA has products of inertia",
            place=place,
            expected="moments about the global axes, or a rigid body in the scene, "
            "fixed to a marker",
        )
    return RawMass(0, 0.0, block.place, inertia=(xx, yy, zz, 0.0, 0.0, 0.0))
