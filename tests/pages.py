"""Tables of pages that the program writes."""

from __future__ import annotations

from html.parser import HTMLParser


class _Tables(HTMLParser):
    """Rows of the table below each heading; a page may refer to nothing outside."""

    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, list[list[str]]] = {}
        self.heading, self.within = "", ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            outside = name in ("src", "href", "xlink:href") and value
            assert not outside or value[0] == "#" or value.startswith("data:"), value
        if tag == "h2":
            self.heading = ""
        if tag == "tr":
            self.found.setdefault(self.heading, []).append([])
        if tag in ("td", "th"):
            self.found[self.heading][-1].append("")
        if tag in ("h2", "td", "th", "style"):
            self.within = tag

    def handle_endtag(self, tag: str) -> None:
        if tag == self.within:
            self.within = ""

    def handle_data(self, data: str) -> None:
        if self.within == "h2":
            self.heading += data
        elif self.within in ("td", "th"):
            self.found[self.heading][-1][-1] += data


def tables_of(page: str) -> dict[str, list[list[str]]]:
    """Rows of cells of the tables of a page, by the heading before them."""
    parser = _Tables()
    parser.feed(page)
    return parser.found
