"""Reference problems of the validation page: bodies, motions, rotors.

Problems are set up as the tests do it, so that page and tests are of one source. A
problem is a function whose docstring is the title and the words of its section.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple


class Row(NamedTuple):
    """A quantity, what it should be by which source, and what it is."""

    quantity: str
    source: str
    reference: float
    found: float


Problem = Callable[[], Iterator[Row]]
