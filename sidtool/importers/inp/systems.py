"""*SYSTEM of a deck: the coordinate system of the nodes behind it."""

from __future__ import annotations

import numpy as np

from sidtool.formats.errors import InputError

from ..imported import numbers
from .blocks import Block
from .deck import Deck

Point = tuple[float, float, float]


def read_system(deck: Deck, block: Block) -> None:
    """The origin, a point of x, and on a second line one of the plane x y.

    Without the last one z is that of the deck, with the origin alone all axes are;
    without numbers nodes are in the system of the deck again.

    Raises
    ------
    InputError : the points give no axes.
    """
    given = [
        numbers([word or "0" for word in words], place) for words, place in block.rows
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


def holds(deck: Deck) -> bool:
    """Whether there is a *SYSTEM; it ends with its part, instance or assembly."""
    return deck.system is not None and deck.system[0] is deck.scope


def in_system(deck: Deck, point: Point) -> Point:
    """A point that is given in the system that holds, in that of the deck."""
    if deck.system is None or not holds(deck):
        return point
    origin, *axes = deck.system[1]
    x, y, z = origin + np.array(point) @ np.array(axes)
    return float(x), float(y), float(z)


def refuse_in_system(deck: Deck, block: Block) -> None:
    """Raises where a keyword gives points or shifts in a *SYSTEM."""
    if holds(deck):
        raise InputError(
            f"*{block.keyword} stands behind *SYSTEM",
            place=block.place,
            expected="an empty *SYSTEM before it",
        )
