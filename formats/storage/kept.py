"""What is found of objects that never change: looked for once, kept as long as they."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

Thing = TypeVar("Thing")
Found = TypeVar("Found")
More = ParamSpec("More")


def kept(
    find: Callable[Concatenate[Thing, More], Found],
) -> Callable[Concatenate[Thing, More], Found]:
    """A function of an object that never changes, such as a SID, and of plain values.

    Arrays that it finds are read-only; nothing that it finds may hold the object.
    """
    known: WeakKeyDictionary[Any, dict[Any, Found]] = WeakKeyDictionary()

    @wraps(find)
    def found(thing: Thing, /, *more: More.args, **named: More.kwargs) -> Found:
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

    return found
