"""Nodes and node sets of a deck whose elements need not be known here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .imported import EVERYTHING
from .inp.mesh import node_sets
from .inp.reading import read_deck


@dataclass(frozen=True)
class DeckNames:
    """Nodes of a deck by number, node sets by name, and how many elements it has."""

    nodes: dict[int, tuple[float, float, float]]
    sets: dict[str, list[int]]
    elements: int


def deck_names(path: Path) -> DeckNames:
    """What a flat deck calls its nodes.

    Raises
    ------
    InputError : names file, line and expectation.
    """
    deck = read_deck(path, frozenset((EVERYTHING,)))
    body = deck.assembly
    return DeckNames(body.nodes, node_sets(deck, body, body, ""), len(body.elements))
