"""Nodes, node sets and masses of a deck whose elements need not be known here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .imported import EVERYTHING, RawMass
from .inp.couplings import masses_of
from .inp.mesh import node_sets
from .inp.reading import read_deck


@dataclass(frozen=True)
class DeckNames:
    """Nodes of a deck by number, node sets by name, how many elements, and masses."""

    nodes: dict[int, tuple[float, float, float]]
    sets: dict[str, list[int]]
    elements: int
    masses: tuple[RawMass, ...]


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
    return DeckNames(body.nodes, sets, len(body.elements), masses)
