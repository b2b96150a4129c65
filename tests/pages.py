"""Pages of HTML that the program writes, as tests read them."""

from __future__ import annotations

from html.parser import HTMLParser

VOID = {"meta", "img", "br", "path", "use"}


class Page(HTMLParser):
    """A page whose tags are closed and that refers to nothing outside.

    Attributes
    ----------
    headings : texts of h1 and h2
    tables : rows of cells below each heading
    cells : texts of all cells of data
    images : number of pictures
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.headings: list[str] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.cells: list[str] = []
        self.images = 0
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            outside = name in ("src", "href", "xlink:href") and value
            assert not outside or value[0] == "#" or value.startswith("data:"), value
        self.images += tag in ("img", "svg")
        if tag not in VOID:
            self._open.append(tag)
        if tag in ("h1", "h2"):
            self.headings.append("")
        elif tag == "tr":
            self.tables.setdefault(self.headings[-1], []).append([])
        elif tag in ("td", "th"):
            self.tables[self.headings[-1]][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        within = self._open[-1] if self._open else ""
        if within in ("h1", "h2"):
            self.headings[-1] += data
        elif within in ("td", "th"):
            self.tables[self.headings[-1]][-1][-1] += data
        if within == "td":
            self.cells.append(data)
