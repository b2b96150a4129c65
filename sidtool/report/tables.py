"""Plain text tables that look the same on a terminal and in a file."""

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from itertools import zip_longest
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sidtool.formats.base.errors import InputError, printable
from sidtool.formats.base.html import html_table
from sidtool.formats.storage.operating_system import LINE_CONTINUATION
from sidtool.formats.text import WIDTH, wrapped

#: Values below this fraction of the largest one are printed as zero.
_ROUNDING = 1e-12
#: Texts in tables are not made narrower than this.
_NARROWEST_TEXT = 16


def format_numbers(values: ArrayLike, size: float = 0.0, between: str = ", ") -> str:
    """Format numbers with six digits; values negligible against the largest, or `size`,
    are 0.
    """
    numbers = np.asarray(values, float)
    nothing = _ROUNDING * max(size, np.abs(numbers).max(initial=0.0))
    return between.join(f"{v:.6g}" if abs(v) > nothing else "0" for v in numbers)


def without_rounding(values: ArrayLike, units: Sequence[str]) -> NDArray[np.float64]:
    """Return values in which those that are rounding are 0.

    Parameters
    ----------
    values : (n,) or (n, k)
    units : n units; a value is negligible against the largest one with its unit, and an
        angle against 1 rad
    """
    numbers = np.array(values, float)
    for unit in set(units):
        rows = [i for i, other in enumerate(units) if other == unit]
        part, least = numbers[rows], 1.0 if unit == "rad" else 0.0
        size = np.abs(part, where=np.isfinite(part), out=np.zeros_like(part))
        nothing = _ROUNDING * max(least, size.max(initial=0.0))
        numbers[rows] = np.where(np.abs(part) <= nothing, 0.0, part)
    return numbers


def import_optional(name: str) -> Any:
    """Import an optional package.

    Raises
    ------
    InputError : the package is not installed.
    """
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        raise InputError(
            f"{name} is not installed", expected=f"pip install {name}"
        ) from None


class TextBlock(str):
    """A table as text, with its HTML representation."""

    html: str

    def __new__(cls, text: str, html: str) -> Self:
        block = super().__new__(cls, text)
        block.html = html
        return block


def text_table(
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    most: int | None = None,
    rest: str = "more (-v prints all)",
    brief: bool = False,
) -> TextBlock:
    """Return aligned columns under a header and a line; numbers right, texts left.

    Texts continue below where a line would not fit on a screen.

    Parameters
    ----------
    most : largest number of rows of the text, if it is limited; pages hold all
    rest : text behind the number of rows that are left out
    brief : one line for each row; texts that do not fit end in "..."
    """
    whole = [[printable(cell) for cell in row] for row in rows]
    body = whole if most is None or len(whole) <= most + 1 else whole[:most]
    columns = list(zip(header, *body, strict=True))
    widths = [max(map(len, column)) for column in columns]
    right = [all(_is_number(cell) for cell in column[1:]) for column in columns]
    widths = _widths_on_screen(widths, right)
    lines = [list(header), ["-" * width for width in widths], *body]
    if brief:
        lines = [
            [_shortened(*cell) for cell in zip(c, widths, right, strict=True)]
            for c in lines
        ]
    text = "\n".join(_table_lines(cells, widths, right) for cells in lines)
    if whole[len(body) :]:
        text += f"\n... and {len(whole) - len(body)} {rest}"
    return TextBlock(text, html_table(whole, header))


def name_with_unit(name: str, unit: str) -> str:
    """Return a name with its unit in brackets, if there is one."""
    return f"{name} [{unit}]" if unit else name


def title_line(title: str, outcome: str) -> str:
    """Return a title with what became of its work, which ends at the right."""
    name = printable(title or "(no title)")
    return f"{name}  {outcome.rjust(WIDTH - len(name) - 2)}"


def named_values(entries: Iterable[tuple[str, str]]) -> TextBlock:
    """Return names and their values, aligned; long values continue below."""
    pairs = [(name, printable(text)) for name, text in entries]
    width = max((len(name) for name, _ in pairs), default=0)
    indent = " " * (width + 2)
    lines = "\n".join(
        wrapped(f"{name:<{width}}  {text}", indent) if text else name
        for name, text in pairs
    )
    return TextBlock(lines, html_table(pairs))


def set_options(
    scene: Mapping[str, float], models: Mapping[str, Mapping[str, float]]
) -> list[str]:
    """Return options of the command line that change a scene, and models by body.

    Options that do not fit on a line continue on others as a shell reads them.
    """
    lines = []
    named = {"Scene": scene} | {f"Model of {body}": models[body] for body in models}
    for name, changes in named.items():
        options = [f"--set {key}={value!r}" for key, value in changes.items()]
        line = f"{name}: {' '.join(options)}"
        if len(line) > WIDTH:
            line = f"{name}:\n    " + LINE_CONTINUATION.join(options)
        lines += [line] if options else []
    return lines


def _widths_on_screen(widths: Sequence[int], right: Sequence[bool]) -> list[int]:
    """Return the widths of columns, the widest texts narrowed to fit on a screen."""
    fitted = list(widths)
    texts = [i for i, numeric in enumerate(right) if not numeric]
    for column in sorted(texts, key=lambda i: -fitted[i]):
        excess = sum(fitted) + 2 * (len(fitted) - 1) - WIDTH
        if excess > 0:
            narrow = min(fitted[column], _NARROWEST_TEXT)
            fitted[column] = max(fitted[column] - excess, narrow)
    return fitted


def _shortened(cell: str, width: int, numeric: bool) -> str:
    fits = numeric or len(cell) <= width
    return cell if fits else cell[: width - 3].rstrip(" ,(") + "..."


def _table_lines(
    cells: Sequence[str], widths: Sequence[int], right: Sequence[bool]
) -> str:
    """Return a row of a table, in several lines where texts do not fit."""
    parts = [
        [cell]
        if numeric or len(cell) <= width
        else textwrap.wrap(cell, width, break_long_words=False, break_on_hyphens=False)
        for cell, width, numeric in zip(cells, widths, right, strict=True)
    ]
    lines = []
    for row in zip_longest(*parts, fillvalue=""):
        padded = (
            cell.rjust(width) if numeric else cell.ljust(width)
            for cell, width, numeric in zip(row, widths, right, strict=True)
        )
        lines.append("  ".join(padded).rstrip())
    return "\n".join(lines)


def _is_number(cell: str) -> bool:
    return not cell or cell[0] in "+-.0123456789"


def label_without_frequency(label: str, frequency: float) -> str:
    """Return a label without the frequency [Hz] that it names, if it is this one."""
    parts = re.split(r" : ([\d.]+) Hz,? ?", label, maxsplit=1)
    if len(parts) < 3 or abs(float(parts[1]) - frequency) > 1e-3 * frequency:
        return label
    return ", ".join(filter(None, parts[::2]))
