"""Nodes, node sets and masses of a deck whose elements need not be known here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .imported import EVERYTHING, LEFT_OUT, RawMass
from .inp.couplings import masses_of
from .inp.mesh import node_sets, undefined_of
from .inp.reading import read_deck


@dataclass(frozen=True)
class DeckNames:
    """What a deck calls its nodes.

    Attributes
    ----------
    nodes, sets : nodes by number, and node sets by name
    elements, masses : how many elements there are, and point masses
    undefined : set -> its members that the deck does not define, in words
    left_out : what `geometry.ignore` left out, as `notes_of_unread` takes it
    """

    nodes: dict[int, tuple[float, float, float]]
    sets: dict[str, list[int]]
    elements: int
    masses: tuple[RawMass, ...]
    undefined: dict[str, str]
    left_out: tuple[str, ...] = ()


def deck_names(path: Path, ignored: frozenset[str] = frozenset()) -> DeckNames:
    """What a flat deck calls its nodes.

    Parameters
    ----------
    ignored : keywords that are left out on purpose, in capitals

    Raises
    ------
    InputError : names file, line and expectation.
    """
    deck = read_deck(path, ignored | {EVERYTHING})
    body = deck.assembly
    sets, masses = node_sets(deck, body, body, ""), tuple(masses_of(deck, body, ""))
    undefined = undefined_of(deck, body, sets)
    chosen = {"".join(word.split()) for word in ignored}
    left_out = tuple(
        name
        for name in deck.said
        if name.endswith(LEFT_OUT)
        and "".join(name.removesuffix(LEFT_OUT).strip("*").split()) in chosen
    )
    return DeckNames(body.nodes, sets, len(body.elements), masses, undefined, left_out)
