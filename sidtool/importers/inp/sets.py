"""Node and element sets of a deck, by number, range or name of another set."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from sidtool.formats.errors import InputError

from ..imported import MOST_MEMBERS, integers
from .blocks import Block
from .deck import Deck, Member


def read_nset(deck: Deck, block: Block) -> None:
    if "NSET" not in block.options:
        raise InputError("has no name", place=block.place, expected="NSET=NAME")
    name = block.options["NSET"]
    if "UNSORTED" in block.options:
        deck.unsorted.add(deck.own_name(name))
    if "ELSET" not in block.options:
        return _members(deck, block, name, "nsets")
    elset = deck.name(block.options["ELSET"])
    known = deck.scope.elements
    members = deck.scope.elsets.get(elset)
    if members is None:
        raise _undefined_set(elset, block.place)
    lost = next((e for _, e in members if e not in known), None)
    if lost is not None:
        raise InputError(
            f"the set {elset!r} names element {lost}, which is not defined",
            place=block.place,
            expected="a set of elements above",
        )
    nodes = dict.fromkeys(n for _, e in members for n in known[e].nodes)
    return extend(deck, deck.scope.nsets, name, list(nodes))


def read_elset(deck: Deck, block: Block) -> None:
    if "ELSET" not in block.options:
        raise InputError("has no name", place=block.place, expected="ELSET=NAME")
    _members(deck, block, block.options["ELSET"], "elsets")


def _members(deck: Deck, block: Block, name: str, which: str) -> None:
    instance = deck.name(block.options.get("INSTANCE", ""))
    if instance and instance not in deck.instances:
        raise InputError(
            f"names the instance {instance!r}, which is not defined",
            place=block.place,
            expected="an *INSTANCE above",
        )
    found: list[Member] = []
    for words, place in block.rows:
        if "GENERATE" in block.options:
            spread = [(instance, n) for n in spanned(words, place)]
            gaps = deck.scope.gaps.setdefault((which, deck.name(name)), set())
            gaps.update(spread)
            found += spread
            continue
        for word in filter(None, words):
            found += members_of(deck, which, instance, word, place)
    group = getattr(deck.scope, which)
    group.setdefault(deck.name(name), []).extend(found)


def spanned(words: Sequence[str], place: str) -> range:
    """The numbers of first, last and step."""
    values = integers([word for word in words if word], place, "first, last, step")
    first, last, step = (*values, 1)[:3] if len(values) > 1 else (1, 0, 0)
    if step < 1 or last < first or (last - first) // step > MOST_MEMBERS:
        found = ", ".join(words)
        raise InputError(f"found {found!r}", place=place, expected="first, last, step")
    return range(first, last + 1, step)


def members_of(
    deck: Deck, which: str, instance: str, word: str, place: str
) -> list[Member]:
    """A number or the name of a set, with or without its instance before a point."""
    own = getattr(deck.scope, which)
    if not instance and deck.name(word) in own:
        return list(own[deck.name(word)])
    head, point, tail = word.rpartition(".")
    if point and deck.name(head) in deck.instances:
        instance, word = deck.name(head), tail
    if word.removeprefix("-").isdecimal():
        return [(instance, label) for label in integers([word], place, "a number")]
    if instance in deck.instances:
        own = getattr(deck.parts[deck.instances[instance]], which)
    if deck.name(word) not in own:
        raise _undefined_set(word, place)
    return [(instance, label) for _, label in own[deck.name(word)]]


def extend(
    deck: Deck, sets: dict[str, list[Member]], name: str, labels: Iterable[int]
) -> None:
    sets.setdefault(deck.name(name), []).extend(("", label) for label in labels)


def _undefined_set(name: str, place: str) -> InputError:
    return InputError(
        f"names the set {name!r}, which is not defined",
        place=place,
        expected="numbers or the name of a set above",
    )
