"""Cache of values computed from immutable objects."""

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

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
