"""*TIE of a deck: surfaces that are held on others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from sidtool.formats.errors import InputError

from ..imported import numbers, undefined_members
from ..imported_ties import RawTie
from .blocks import Block
from .deck import Deck, Hold, Scope, owner_of
from .surfaces import nodes_named, surface_faces

_IGNORABLE = 'geometry.ignore = ["TIE"] leaves it out'


def read_tie(deck: Deck, block: Block) -> None:
    """Kept by its words, since surfaces may stand behind it."""
    deck.ties.append(Hold(block, deck.scope))


def ties_of(deck: Deck, body: Scope, instance: str) -> Iterator[RawTie]:
    """The ties of the body.

    Raises
    ------
    InputError : a surface is unknown or no surface of solids, or the tie is one of
        cyclic symmetry.
    """
    for hold in deck.ties:
        options, place = hold.block.options, hold.block.place
        if "CYCLIC SYMMETRY" in options:
            raise InputError(
                "*TIE of a cyclic symmetry is not supported",
                place=place,
                expected=f"a mesh of the whole body; {_IGNORABLE}",
            )
        given = options.get("POSITION TOLERANCE")
        tolerance = numbers([given], place)[0] if given else None
        name = deck.name(options.get("NAME", "")) or "TIE"
        for words, where in hold.block.rows:
            pair = [word for word in words if word]
            if len(pair) < 2:
                raise InputError(
                    f"*TIE has the line {', '.join(words)!r}",
                    place=where,
                    expected="a slave and a master surface",
                )
            slave, slave_nodes = _side(deck, hold, body, instance, pair[0], where)
            master, single = _side(deck, hold, body, instance, pair[1], where)
            if deck.chosen:
                used = {n for e in body.elements.values() for n in e.nodes}
                slave_nodes = tuple(n for n in slave_nodes if n in used)
                if not master or not (slave or slave_nodes):
                    deck.remarks.append(f"*TIE {name} holds other parts: left out")
                    continue
            if single or not master or not (slave or slave_nodes):
                raise InputError(
                    f"*TIE {name} has no faces of the body on both sides",
                    place=where,
                    expected=f"a master of faces, a slave of faces or nodes; "
                    f"{_IGNORABLE}",
                )
            yield RawTie(name, slave, master, slave_nodes, tolerance, where)


def _side(
    deck: Deck, hold: Hold, body: Scope, instance: str, word: str, place: str
) -> tuple[tuple[tuple[int, ...], ...], tuple[int, ...]]:
    scope, own = owner_of(deck, hold.scope, word)
    if scope is None:
        return (), ()
    name = deck.name(own)
    if name in scope.surfaces:
        found = surface_faces(deck, scope, body, instance, name)
        if found is not None:
            faces = dict.fromkeys(tuple(face) for face in found[0])
            return tuple(faces), _defined(deck, body, found[1], word, place)
    elif name in scope.nsets:
        nodes = nodes_named(deck, scope, instance, own)
        return (), _defined(deck, body, nodes, word, place)
    raise InputError(
        f"names the surface {word!r}, which is not one of solids here",
        place=place,
        expected=f"a *SURFACE of faces S1, S2, ... or nodes; {_IGNORABLE}",
    )


def _defined(
    deck: Deck, body: Scope, nodes: Iterable[int], word: str, place: str
) -> tuple[int, ...]:
    """The nodes of the body among these; those of the assembly are none.

    Raises
    ------
    InputError : the file does not define one.
    """
    elsewhere = deck.assembly.nodes.keys() - body.nodes.keys()
    found = tuple(n for n in nodes if n not in elsewhere)
    if lost := undefined_members(body.nodes, {word: found}):
        raise InputError(
            f"the surface {word!r} names {lost[word]}, which is not defined",
            place=place,
            expected="nodes of this file",
        )
    return found
