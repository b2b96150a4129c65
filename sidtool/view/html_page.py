"""Pages of HTML that need no other files."""

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sidtool import __version__
from sidtool.formats.base.html import escape
from sidtool.formats.storage.atomic import atomic_path

from ..plot.figure import figure_style

_STYLE = """
@page { size: A4; margin: 18mm 15mm; }
body { font: 10.5pt/1.45 "DejaVu Sans", Arial, sans-serif; color: #111;
       max-width: 180mm; margin: 1.5em auto; padding: 0 1em; }
h1 { font-size: 17pt; margin: 0; }
h2 { font-size: 12.5pt; margin: 1.6em 0 .4em; border-bottom: 1px solid #888;
     break-after: avoid; }
table { border-collapse: collapse; margin: .5em 0; font-size: 9pt; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: 2px 8px 2px 0;
         border-bottom: 1px solid #ddd; overflow-wrap: break-word; }
td:first-child { white-space: nowrap; }
thead { display: table-header-group; }
tr, figure { break-inside: avoid; }
figure { margin: .5em 0; } figure svg, figure img { max-width: 100%; height: auto; }
figcaption { font-size: 9pt; color: #444; }
.pictures { display: grid; grid-template-columns: 1fr 1fr 1fr; gap: 4px; }
.state { font-weight: bold; } .bad { color: #a00; }
"""


def write_page(path: str | Path, title: str, parts: Iterable[str]) -> None:
    """Write a page with a title, plain text, and the markup of its parts.

    Raises
    ------
    OSError : it cannot be written.
    """
    page = (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        f'<meta name="generator" content="sidtool {__version__}">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>"
        f"<body>{''.join(parts)}</body></html>\n"
    )
    with atomic_path(path) as temporary:
        Path(temporary).write_text(page, encoding="utf-8")


def figure_markup(figure: Any) -> str:
    """Return the markup of a figure of matplotlib, as vectors."""
    stream = io.StringIO()
    with figure_style():
        figure.savefig(stream, format="svg", metadata={"Date": None})
    svg = stream.getvalue()
    return f"<figure>{svg[svg.index('<svg') :]}</figure>"
