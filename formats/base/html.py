"""HTML tables for notebooks and reports."""

from collections.abc import Iterable, Sequence
from html import escape as escape_markup

from .errors import printable


def html_table(
    rows: Iterable[Sequence[object]], header: Sequence[str] = (), title: str = ""
) -> str:
    """A table; cells are texts, which are escaped."""
    caption = f"<caption>{_text(title)}</caption>" if title else ""
    header_row = f"<thead>{_row(header, 'th')}</thead>" if header else ""
    body = "".join(_row(row, "td") for row in rows)
    return f"<table>{caption}{header_row}<tbody>{body}</tbody></table>"


def _row(cells: Sequence[object], tag: str) -> str:
    return f"<tr>{''.join(f'<{tag}>{_text(cell)}</{tag}>' for cell in cells)}</tr>"


def escape(text: str) -> str:
    """Escape a text for a page: no markup, no control characters."""
    return escape_markup(printable(text))


def _text(cell: object) -> str:
    return escape(str(cell))
