"""Equations between displacements: *EQUATION, *MPC, *TRANSFORM and *TIE of a deck."""

from collections.abc import Container, Iterable, Iterator, Sequence

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import diagnose

from ...mesh.connections import RawEquation, RawTie, Term
from ...mesh.deck_text import parse_integers, parse_numbers
from ...mesh.imported_mesh import RawCoupling, find_undefined_members
from .couplings import labels_named
from .deck import CouplingDefinition, Deck, Namespace, resolve_name
from .instances import place_nodes
from .keywords import Block
from .surfaces import resolve_nodes, surface_faces

Rows = list[tuple[list[str], str]]

_PER_TERM = 3
#: Directions of displacements; those of rotations follow.
_DISPLACEMENTS = 3

#: Number of nodes of the supported types of *MPC.
_NODES = {"TIE": 2, "PIN": 2, "LINK": 2, "BEAM": 2, "LINEAR": 3}
_IGNORABLE = 'geometry.ignore = ["TIE"] leaves it out'


def read_equation(deck: Deck, block: Block) -> None:
    """Store *EQUATION, *MPC and *TRANSFORM, whose sets may be defined later."""
    deck.equations.append(CouplingDefinition(block, deck.scope))


class TransformedAxes:
    """Axes of nodes by *TRANSFORM, which define the directions of equations."""

    def __init__(
        self, deck: Deck, body: Namespace, instance: str, positions: Container[int]
    ) -> None:
        self._systems: dict[int, tuple[str, Array, str]] = {}
        for definition in deck.equations:
            if definition.block.keyword == "TRANSFORM":
                self._add(deck, definition, body, instance, positions)

    def _add(
        self,
        deck: Deck,
        definition: CouplingDefinition,
        body: Namespace,
        instance: str,
        positions: Container[int],
    ) -> None:
        block = definition.block
        values = [x for words, place in block.rows for x in parse_numbers(words, place)]
        kind = (block.options.get("TYPE") or "R").upper()
        if len(values) != 6 or kind not in ("R", "C"):
            raise InputError(
                f"*TRANSFORM of type {kind} has {len(values)} coordinates",
                place=block.place,
                expected="type R or C and two points",
            )
        name = block.options.get("NSET", "")
        labels = labels_named(deck, definition, body, instance, name)
        if undefined := find_undefined_members(positions, {name: labels}):
            raise InputError(
                f"*TRANSFORM of {name!r} names {undefined[name]}, which is not defined",
                place=block.place,
                expected="nodes of this file",
            )
        # Transformations of a part turn with its instance.
        scope = definition.scope
        owner = instance if scope is body else scope.name
        placement = [] if scope is deck.assembly else deck.placement.get(owner, [])
        u, v, w, x, y, z = values
        points = {0: (u, v, w), 1: (x, y, z), 2: (0.0, 0.0, 0.0)}
        a, b, origin = map(np.array, place_nodes(points, placement).values())
        pair = np.concatenate([a - origin, b - origin] if kind == "R" else [a, b])
        for label in labels:
            self._systems[label] = (kind, pair, block.place)

    def direction(self, label: int, number: int, position: Sequence[float]) -> Array:
        """The unit vector of a direction 1 to 3 at a node."""
        if label not in self._systems:
            return np.eye(3)[number - 1]
        kind, values, place = self._systems[label]
        a, b = values[:3], values[3:]
        if kind == "R":
            x, normal = a, np.cross(a, b)
        else:
            normal = b - a
            arm = np.asarray(position) - a
            square = max(float(normal @ normal), 1e-300)
            x = arm - normal * (arm @ normal) / square
        lengths = np.linalg.norm(x), np.linalg.norm(normal)
        if min(lengths) <= 1e-12 * max(*lengths, np.linalg.norm(position)):
            raise InputError(
                f"*TRANSFORM gives node {label} no axes",
                place=place,
                expected="points apart from each other, and nodes off the axis",
            )
        x, z = x / lengths[0], normal / lengths[1]
        axis: Array = np.stack([x, np.cross(z, x), z])[number - 1]
        return axis


def equations_of(
    deck: Deck,
    body: Namespace,
    instance: str,
    positions: dict[int, tuple[float, float, float]],
    *,
    turning: bool,
) -> tuple[list[RawEquation], list[RawCoupling]]:
    """The equations of the body, and *MPC of type BEAM as rigid couplings.

    Parameters
    ----------
    turning : whether the body has nodes with rotations

    Raises
    ------
    InputError : a node or a direction is unknown, or an *MPC of another type, or an
        equation names a mean rotation.
    """
    rotating: set[int] = set()
    axes = TransformedAxes(deck, body, instance, positions)
    equations: list[RawEquation] = []
    beams: list[RawCoupling] = []
    last = 2 * _DISPLACEMENTS if turning else _DISPLACEMENTS
    for definition in deck.equations:
        try:
            if definition.block.keyword == "EQUATION":
                equations += _make_equations(
                    deck, definition, body, instance, positions, axes, last
                )
            elif definition.block.keyword == "MPC":
                constraints = _multi_point_constraints(
                    deck, definition, body, instance, positions, turning
                )
                for one in constraints:
                    held = beams if isinstance(one, RawCoupling) else equations
                    held.append(one)  # type: ignore[arg-type]
                for word in _mean_rotations(definition.block.rows):
                    rotating.update(
                        labels_named(deck, definition, body, instance, word)
                    )
        except InputError as error:
            place = error.place or definition.block.place
            raise InputError(
                error.problem, place=place, expected=error.expected
            ) from None
    for equation in equations:
        for label, _ in (*equation.terms, *equation.rotations):
            if label in rotating:
                raise InputError(
                    f"an equation names node {label}, which stands for a mean rotation",
                    place=equation.place,
                    expected="equations without nodes of *MPC MEANROT",
                )
    return equations, beams


def _make_equations(
    deck: Deck,
    definition: CouplingDefinition,
    body: Namespace,
    instance: str,
    positions: dict[int, tuple[float, float, float]],
    axes: TransformedAxes,
    last: int,
) -> Iterator[RawEquation]:
    for rows in _equation_terms(definition.block.rows):
        place = rows[0][1]
        terms = [
            _equation_term(deck, definition, body, instance, words, where, last)
            for words, where in rows
        ]
        if deck.chosen and not all(labels for labels, _, _ in terms):
            deck.diagnostics.append(diagnose("N119", what=f"an equation ({place})"))
            continue
        length = max(len(labels) for labels, _, _ in terms)
        if any(len(labels) not in (1, length) for labels, _, _ in terms):
            raise InputError(
                "names sets of different sizes",
                place=place,
                expected="sets of as many nodes each, or single nodes",
            )
        for i in range(length):
            chosen = [
                (labels[i if len(labels) > 1 else 0], number, share)
                for labels, number, share in terms
            ]
            missing = [label for label, _, _ in chosen if label not in positions]
            if missing:
                raise InputError(
                    f"names node {missing[0]}, which is not defined",
                    place=place,
                    expected="a node of this file",
                )
            parts: tuple[list[Term], list[Term]] = ([], [])
            for n, number, share in chosen:
                axis = axes.direction(n, (number - 1) % 3 + 1, positions[n])
                term = (n, _three_components(share * axis))
                parts[number > _DISPLACEMENTS].append(term)
            yield RawEquation(tuple(parts[0]), place, tuple(parts[1]))


def _equation_terms(rows: Rows) -> Iterator[Rows]:
    """The terms of every equation: node or set, direction and coefficient."""
    rest = iter(rows)
    for words, place in rest:
        given = [word for word in words if word]
        (count,) = parse_integers(given[:1] or [""], place, "the number of terms")
        terms: Rows = []
        while len(terms) < count:
            line, where = next(rest, ([], place))
            fields = [word for word in line if word]
            if not fields or len(fields) % _PER_TERM:
                raise InputError(
                    f"an equation of {count} terms has {len(terms)} and "
                    f"{len(fields)} entries",
                    place=where,
                    expected="a node, a direction and a coefficient for every term",
                )
            terms += [
                (fields[i : i + _PER_TERM], where)
                for i in range(0, len(fields), _PER_TERM)
            ]
        if count < 1 or len(terms) > count:
            raise InputError(
                f"an equation of {count} terms has {len(terms)}",
                place=place,
                expected="as many terms as it says",
            )
        yield terms


def _equation_term(
    deck: Deck,
    definition: CouplingDefinition,
    body: Namespace,
    instance: str,
    words: list[str],
    place: str,
    last: int,
) -> tuple[list[int], int, float]:
    labels = labels_named(deck, definition, body, instance, words[0])
    (number,) = parse_integers(words[1:2], place, "a direction")
    (share,) = parse_numbers(words[2:], place, "a coefficient")
    if not 1 <= number <= last:
        turns = "nodes of solids have no others" if last == _DISPLACEMENTS else ""
        raise InputError(
            f"an equation has the direction {number}",
            place=place,
            expected=f"directions 1 to {last}" + (f": {turns}" if turns else ""),
        )
    if not labels and not deck.chosen:
        raise InputError(
            f"an equation names {words[0]!r}, which is empty",
            place=place,
            expected="nodes",
        )
    return labels, number, share


def _multi_point_constraints(
    deck: Deck,
    definition: CouplingDefinition,
    body: Namespace,
    instance: str,
    positions: dict[int, tuple[float, float, float]],
    turning: bool,
) -> Iterator[RawEquation | RawCoupling]:
    is_mean = False
    for words, place in definition.block.rows:
        kind, *names = [word for word in words if word]
        is_mean = kind.upper() == "MEANROT" or (is_mean and kind == "0")
        if is_mean:
            deck.unread_keywords["*MPC MEANROT: a mean rotation holds nothing"] = None
            continue
        groups = [
            labels_named(deck, definition, body, instance, name) for name in names
        ]
        if deck.chosen and not all(groups):
            deck.diagnostics.append(diagnose("N119", what=f"*MPC ({place})"))
            continue
        length = max(map(len, groups), default=0)
        wanted = _NODES.get(kind.upper())
        if wanted is None or len(groups) != wanted:
            raise InputError(
                f"*MPC of type {kind} with {len(groups)} nodes is not supported",
                place=place,
                expected=f"{', '.join(_NODES)}; geometry.ignore = "
                '["MPC"] leaves it out',
            )
        if any(len(group) not in (1, length) for group in groups):
            raise InputError(
                "names sets of different sizes", place=place, expected="equal ones"
            )
        for i in range(length):
            nodes = [group[i if len(group) > 1 else 0] for group in groups]
            if missing := [n for n in nodes if n not in positions]:
                raise InputError(
                    f"names node {missing[0]}, which is not defined",
                    place=place,
                    expected="a node of this file",
                )
            if kind.upper() == "BEAM":
                yield RawCoupling("MPC BEAM", True, (nodes[0],), nodes[1], place)
            else:
                places = [np.array(positions[n]) for n in nodes]
                held = list(_multi_point_equations(kind.upper(), nodes, places, place))
                yield from held
                if turning and kind.upper() in ("TIE", "LINEAR"):
                    yield from (RawEquation((), place, own.terms) for own in held)


def _mean_rotations(rows: Rows) -> Iterator[str]:
    """The last node of each *MPC MEANROT, whose displacement is a rotation."""
    kind, last = "", ""
    for words, _ in [*rows, (["END"], "")]:
        given = [word for word in words if word]
        if given[0] != "0":
            if kind == "MEANROT":
                yield last
            kind = given[0].upper()
        last = given[-1]


def _multi_point_equations(
    kind: str, nodes: list[int], places: list[Array], place: str
) -> Iterator[RawEquation]:
    if kind == "LINK":
        along = _three_components(places[0] - places[1])
        back = _three_components(places[1] - places[0])
        yield RawEquation(((nodes[0], along), (nodes[1], back)), place)
        return
    shares = [-1.0]
    if kind == "LINEAR":
        line = places[2] - places[1]
        share = float((places[0] - places[1]) @ line / max(float(line @ line), 1e-300))
        shares = [share - 1.0, -share]
    for axis in np.eye(3):
        rest = zip(nodes[1:], shares, strict=True)
        terms = tuple((n, _three_components(share * axis)) for n, share in rest)
        yield RawEquation(((nodes[0], _three_components(axis)), *terms), place)


def _three_components(vector: Array) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def read_tie(deck: Deck, block: Block) -> None:
    """Store the words of a tie, because surfaces may be defined later."""
    deck.ties.append(CouplingDefinition(block, deck.scope))


def ties_of(deck: Deck, body: Namespace, instance: str) -> Iterator[RawTie]:
    """The ties of the body.

    Raises
    ------
    InputError : a surface is unknown or no surface of solids, or the tie is one of
        cyclic symmetry.
    """
    for definition in deck.ties:
        options, place = definition.block.options, definition.block.place
        if "CYCLIC SYMMETRY" in options:
            raise InputError(
                "*TIE of a cyclic symmetry is not supported",
                place=place,
                expected=f"a mesh of the whole body; {_IGNORABLE}",
            )
        given = options.get("POSITION TOLERANCE")
        tolerance = parse_numbers([given], place)[0] if given else None
        name = deck.name(options.get("NAME", "")) or "TIE"
        for words, where in definition.block.rows:
            pair = [word for word in words if word]
            if len(pair) < 2:
                raise InputError(
                    f"*TIE has the line {', '.join(words)!r}",
                    place=where,
                    expected="a slave and a master surface",
                )
            slave, slave_nodes = _tie_side(
                deck, definition, body, instance, pair[0], where
            )
            master, single = _tie_side(deck, definition, body, instance, pair[1], where)
            if deck.chosen:
                used = {n for e in body.elements.values() for n in e.nodes}
                slave_nodes = tuple(n for n in slave_nodes if n in used)
                if not master or not (slave or slave_nodes):
                    deck.diagnostics.append(diagnose("N119", what=f"*TIE {name}"))
                    continue
            if single or not master or not (slave or slave_nodes):
                raise InputError(
                    f"*TIE {name} has no faces of the body on both sides",
                    place=where,
                    expected=f"a master of faces, a slave of faces or nodes; "
                    f"{_IGNORABLE}",
                )
            yield RawTie(name, slave, master, slave_nodes, tolerance, where)


def _tie_side(
    deck: Deck,
    definition: CouplingDefinition,
    body: Namespace,
    instance: str,
    word: str,
    place: str,
) -> tuple[tuple[tuple[int, ...], ...], tuple[int, ...]]:
    scope, own = resolve_name(deck, definition.scope, word)
    if scope is None:
        return (), ()
    name = deck.name(own)
    if name in scope.surfaces:
        side_faces = surface_faces(deck, scope, body, instance, name)
        if side_faces is not None:
            faces = dict.fromkeys(tuple(face) for face in side_faces[0])
            return tuple(faces), _body_nodes(deck, body, side_faces[1], word, place)
    elif name in scope.nsets:
        nodes = resolve_nodes(deck, scope, instance, own)
        return (), _body_nodes(deck, body, nodes, word, place)
    raise InputError(
        f"names the surface {word!r}, which is none of element faces or nodes",
        place=place,
        expected=f"a *SURFACE of faces S1, S2, ... or nodes; {_IGNORABLE}",
    )


def _body_nodes(
    deck: Deck, body: Namespace, nodes: Iterable[int], word: str, place: str
) -> tuple[int, ...]:
    """Return the nodes of the body among these, without those of the assembly.

    Raises
    ------
    InputError : the file does not define one.
    """
    outside = deck.assembly.nodes.keys() - body.nodes.keys()
    body_nodes = tuple(n for n in nodes if n not in outside)
    if undefined := find_undefined_members(body.nodes, {word: body_nodes}):
        raise InputError(
            f"the surface {word!r} names {undefined[word]}, which is not defined",
            place=place,
            expected="nodes of this file",
        )
    return body_nodes
