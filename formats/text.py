"""Text for a screen: lines that fit on it, and counts with their nouns."""

import re
import textwrap
from bisect import bisect_left
from collections.abc import Callable, Iterable
from functools import cache

#: Columns and lines of a screen.
WIDTH, HEIGHT = 100, 45
#: Stands for a space at which no line ends.
_FIXED_SPACE = "\x00"


def wrapped(text: str, indent: str = "", first: str = "") -> str:
    """Return a text as lines that fit on a screen.

    indent : of all lines but the first
    first : indent of the first line
    """
    return textwrap.fill(
        text,
        WIDTH,
        initial_indent=first,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def wrapped_lines(text: str, names: Iterable[str] = ()) -> str:
    """Return a text whose lines continue below, indented, where they do not fit.

    names : files and keys in it, which stay whole
    """
    fixed = text
    for name in names:
        fixed = fixed.replace(name, name.replace(" ", _FIXED_SPACE))
    lines = (_continued(line) for line in fixed.split("\n"))
    return "\n".join(lines).replace(_FIXED_SPACE, " ")


def _continued(line: str) -> str:
    if len(line) <= WIDTH:
        return line
    text = line.lstrip(" ")
    first = line[: len(line) - len(text)]
    return wrapped(text, f"{first}    ", first)


def fit_on_screen(
    describe: Callable[[int | None], str], most: int, verbose: bool
) -> str:
    """Return a text with as many rows in each of its tables as fit on a screen.

    Parameters
    ----------
    describe : returns the text with at most so many rows in each table, or with all
    most : largest number of rows; the least is 1, whatever its lines
    verbose : all rows
    """
    if verbose:
        return describe(None)
    texts = cache(describe)

    def exceeds(rows: int) -> bool:
        return len(texts(rows).splitlines()) > HEIGHT

    if exceeds(most):
        most = max(1, bisect_left(range(most), True, lo=1, key=exceeds) - 1)
    return texts(most)


def counted_noun(count: int, noun: str) -> str:
    """Return a count with its noun, as in "1 mode", "2 degrees of freedom"."""
    return f"{count} {noun if count == 1 else _plural(noun)}"


def _plural(noun: str) -> str:
    word, of, rest = noun.partition(" of ")
    ending = "es" if word.endswith(("s", "x", "ch")) else "s"
    return re.sub("(?<=[^aeiou])y$", "ie", word) + ending + of + rest
