"""Cache of values computed from immutable objects.

Contents of a SID as named numbers: to compare two SIDs and to compute a digest.
"""

import hashlib
from collections.abc import Callable, Iterator
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from ..base.sid import NODE_SHAPES, SID, Array, Taylor

Thing = TypeVar("Thing")
Found = TypeVar("Found")
More = ParamSpec("More")


def cached_by_identity(
    find: Callable[Concatenate[Thing, More], Found],
) -> Callable[Concatenate[Thing, More], Found]:
    """Cache a function of an immutable object, such as a SID, and of plain values.

    Arrays that it returns become read-only; its results must not refer to the object.
    """
    known: WeakKeyDictionary[Any, dict[Any, Found]] = WeakKeyDictionary()

    @wraps(find)
    def cached(thing: Thing, /, *more: More.args, **named: More.kwargs) -> Found:
        of_thing = known.get(thing)
        if of_thing is None:
            of_thing = known.setdefault(thing, {})
        key = (more, *named.items()) if named else more
        if key not in of_thing:
            value = find(thing, *more, **named)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            of_thing[key] = value
        return of_thing[key]

    return cached


def numbers_by_entry(sid: SID) -> Iterator[tuple[str, Array]]:
    """All numbers of a SID by their places in it, such as "Ke m0" and "node 3 phi m1".

    Titles, labels, the dialect of the file and what wrote it are no part of the body.
    """
    yield "mass", np.array(sid.mass)
    for name, block in (sid.blocks | dict(sid.extra)).items():
        yield from _expansion_parts(name, block)
    for node in sid.nodes:
        for name in NODE_SHAPES:
            entry = getattr(node, name)
            if entry is not None:
                yield from _expansion_parts(f"node {node.id} {name}", entry)
    for section in sid.sections:
        for place, values in numbers_by_entry(section.part):
            yield f"section {section.name} {place}", values


def content_digest(sid: SID) -> str:
    """Equal for SIDs of the same numbers."""
    digest = hashlib.sha256()
    for place, values in numbers_by_entry(sid):
        digest.update(f"{place} {values.shape}".encode())
        digest.update(np.ascontiguousarray(values, float).tobytes())
    return digest.hexdigest()


def differing_entries(one: SID, other: SID) -> list[str]:
    """Places whose numbers differ, or that only one of two SIDs has."""
    left, right = dict(numbers_by_entry(one)), dict(numbers_by_entry(other))
    return [
        place
        for place in dict.fromkeys([*left, *right])
        if place not in left
        or place not in right
        or not np.array_equal(left[place], right[place], equal_nan=True)
    ]


def _expansion_parts(name: str, block: Taylor) -> Iterator[tuple[str, Array]]:
    for part in ("m0", "m1", "mn"):
        values = getattr(block, part)
        if values is not None:
            yield f"{name} {part}", values
