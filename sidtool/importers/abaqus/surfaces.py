"""*SURFACE and *SYSTEM of a deck: faces of elements, coordinate system of nodes."""

from collections.abc import Iterable

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_label

from ...mesh.deck_text import parse_numbers
from .deck import Deck, Element, Namespace, SurfacePart, resolve_name
from .keywords import Block

#: Corners of the faces S1, S2, ... by the shape of an element.
_FACES = {
    "hex": ("1234", "5876", "1562", "2673", "3784", "4851"),
    "tet": ("123", "142", "243", "341"),
    "wedge": ("123", "465", "1254", "2365", "3146"),
    "quad": ("12", "23", "34", "41"),
    "tri": ("12", "23", "31"),
}
#: Corners at both ends of the edges, in the order of their middle nodes.
_EDGES = {
    "hex": ("12", "23", "34", "41", "56", "67", "78", "85", "15", "26", "37", "48"),
    "tet": ("12", "23", "31", "14", "24", "34"),
    "wedge": ("12", "23", "31", "45", "56", "64", "14", "25", "36"),
    "quad": ("12", "23", "34", "41"),
    "tri": ("12", "23", "31"),
}
#: Sides of shells.
_SIDES = ("SPOS", "SNEG", "")

Point = tuple[float, float, float]


def read_surface(deck: Deck, block: Block) -> None:
    """Store the words of a surface, because sets may be defined later."""
    name = deck.name(block.options.get("NAME", ""))
    kind = block.options.get("TYPE", "ELEMENT").upper()
    if kind not in ("ELEMENT", "NODE"):
        deck.unread_keywords[f"*SURFACE, TYPE={kind}"] = None
        return
    parts = deck.scope.surfaces.setdefault(name, [])
    for words, place in block.rows:
        if words and words[0]:
            face = words[1].upper() if len(words) > 1 else ""
            parts.append(SurfacePart(kind, words[0], face, place))


def surface_nodes(
    deck: Deck, scope: Namespace, body: Namespace, instance: str, name: str
) -> list[int] | None:
    """The nodes of the body on a surface; None if it is no surface of solids."""
    faces = surface_faces(deck, scope, body, instance, name)
    if faces is None:
        return None
    nodes = dict.fromkeys([*(n for face in faces[0] for n in face), *faces[1]])
    outside = deck.assembly.nodes.keys() - body.nodes.keys()
    return [n for n in nodes if n not in outside]


def surface_faces(
    deck: Deck, scope: Namespace, body: Namespace, instance: str, name: str
) -> tuple[list[list[int]], list[int]] | None:
    """Faces of solids by their nodes, and single nodes; None for other surfaces.

    The corners of a face come first, then the middles of its edges.
    """
    on_faces: list[list[int]] = []
    nodes: list[int] = []
    for part in scope.surfaces[name]:
        if part.kind == "NODE":
            if is_label(part.word) or deck.name(part.word) in scope.nsets:
                nodes += resolve_nodes(deck, scope, instance, part.word)
                continue
            return None
        for element in _surface_elements(deck, scope, body, instance, part.word):
            on_face = _face_nodes(element, part.face)
            if on_face is None:
                return None
            on_faces.append(on_face)
    return on_faces, nodes


def resolve_nodes(deck: Deck, scope: Namespace, instance: str, word: str) -> list[int]:
    """A node by its number, or the nodes of a set, of the instance that is the body.

    Raises
    ------
    InputError : there is no such set.
    """
    if is_label(word):
        return [int(word) + scope.first[0]]
    head, point, tail = word.rpartition(".")
    if point and is_label(tail):
        name = deck.name(head)
        if name == instance or name in scope.instances:
            return [int(tail) + scope.instances.get(name, (0, 0))[0]]
    owner, word = resolve_name(deck, scope, word)
    if owner is None:
        return []
    scope = owner
    owners = {instance, ""} if scope.name or scope is deck.assembly else {instance}
    if deck.name(word) not in scope.nsets:
        raise InputError(
            f"there is no node set {word!r}", expected="an *NSET of this file"
        )
    group = scope.nsets[deck.name(word)]
    return list(dict.fromkeys(label for owner, label in group if owner in owners))


def _surface_elements(
    deck: Deck, scope: Namespace, body: Namespace, instance: str, word: str
) -> list[Element]:
    owner, own = resolve_name(deck, scope, word)
    if owner is None:
        return []
    group = owner.elsets.get(deck.name(own))
    if group is None:
        number = word.rpartition(".")[2]
        if not is_label(number):
            raise InputError(
                f"there is no element set {word!r}", expected="an *ELSET of this file"
            )
        group = [("", int(number))]
    labels = [label for owner, label in group if owner in (instance, "")]
    return defined_elements(deck, body, labels, f"the surface of {word!r}")


def defined_elements(
    deck: Deck, body: Namespace, labels: Iterable[int], who: str
) -> list[Element]:
    """The elements of the body among these.

    Raises
    ------
    InputError : the file does not define one.
    """
    there = (body.elements, deck.outside, deck.assembly.elements)
    for label in labels:
        if not any(label in known for known in there):
            raise InputError(
                f"{who} names element {label}, which is not defined",
                expected="elements of this file",
            )
    return [body.elements[label] for label in labels if label in body.elements]


def _face_nodes(element: Element, face: str) -> list[int] | None:
    """Return the nodes of a face S1, S2, ... of a solid or a plane element, or of a
    side SPOS, SNEG or an edge E1, E2, ... of a shell; None for other names.

    Edge k of a shell has the nodes k and k + 1, the last one the first node.

    Raises
    ------
    InputError : the element has fewer faces or edges.
    """
    is_shell = bool(element.type.shell_kind)
    if is_shell and face in _SIDES:
        return element.nodes
    kind = element.type.shell_kind if is_shell else element.type.kind
    shape = (kind or "").rstrip("0123456789")
    letter, number = ("E" if is_shell else "S"), face[1:]
    if shape not in _FACES or face[:1] != letter or not is_label(number):
        return None
    if not 1 <= int(number) <= len(_FACES[shape]):
        raise InputError(
            f"element {element.label} has no {'edge' if is_shell else 'face'} {face}",
            place=element.place,
            expected=f"{letter}1 to {letter}{len(_FACES[shape])}",
        )
    corners = _FACES[shape][int(number) - 1]
    count = max(int(c) for c in "".join(_FACES[shape]))
    middle = {frozenset(edge): count + i for i, edge in enumerate(_EDGES[shape])}
    around = zip(corners, corners[1:] + corners[:1], strict=True)
    ends = dict.fromkeys(frozenset(pair) for pair in around)
    return [
        *(element.nodes[int(c) - 1] for c in corners),
        *(element.nodes[middle[e]] for e in ends if middle[e] < len(element.nodes)),
    ]


def read_system(deck: Deck, block: Block) -> None:
    """The origin, a point of x, and on a second line one of the plane x y.

    Without the last point z is that of the deck, and with the origin only all axes are.
    Without numbers nodes are in the system of the deck again.

    Raises
    ------
    InputError : the points give no axes.
    """
    given = [
        parse_numbers([word or "0" for word in words], place)
        for words, place in block.rows
    ]
    values = [value for row in given for value in row]
    deck.system = None
    if not values:
        return
    if len(values) not in (3, 6, 9):
        raise InputError(
            f"*SYSTEM has {len(values)} coordinates",
            place=block.place,
            expected="one, two or three points",
        )
    points = np.array(values).reshape(-1, 3)
    x, y = np.eye(3)[:2]
    if len(points) > 1:
        x = points[1] - points[0]
        y = points[2] - points[0] if len(points) > 2 else np.cross([0.0, 0.0, 1.0], x)
    z = np.cross(x, y)
    if not np.linalg.norm(z) > 1e-9 * np.linalg.norm(x) * np.linalg.norm(y):
        raise InputError(
            "*SYSTEM gives no axes",
            place=block.place,
            expected="an origin, a point of x and one of the plane x y",
        )
    axes = np.stack([x, np.cross(z, x), z])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    deck.system = (deck.scope, np.vstack([points[0], axes]))


def has_system(deck: Deck) -> bool:
    """Check for a current *SYSTEM; it ends with its part, instance or assembly."""
    return deck.system is not None and deck.system[0] is deck.scope


def to_global(deck: Deck, point: Point) -> Point:
    """Return a point of the current system in that of the deck."""
    if deck.system is None or not has_system(deck):
        return point
    origin, *axes = deck.system[1]
    x, y, z = origin + np.array(point) @ np.array(axes)
    return float(x), float(y), float(z)


def check_no_system(deck: Deck, block: Block) -> None:
    """Refuse keywords with points or shifts in a *SYSTEM."""
    if has_system(deck):
        raise InputError(
            f"*{block.keyword} stands behind *SYSTEM",
            place=block.place,
            expected="an empty *SYSTEM before it",
        )
