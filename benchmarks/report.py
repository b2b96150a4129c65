"""What a benchmark found, as text, as a page and as a section of the README."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from sidtool.formats.storage.atomic import atomic_path
from sidtool.report.tables import text_table

NOTE = (
    "Ratios compare the best settings found, ours out of more settings than the "
    "others'. The line of scipy and IDA ends after a run of more than 4 s, Exudyn's "
    "with its smallest step here: *not reached* gives the longest run made and does "
    "not say that the program cannot. What decides a ratio is timed again by turns "
    "unless it takes more than 4 s, which then rests on one or two runs. scipy and "
    "IDA call kernels from Python, which costs them most of their time. On a "
    "machine with other load ratios of short runs vary, up to a factor of two."
)
START, END = "<!-- bench:begin -->", "<!-- bench:end -->"


@dataclass(frozen=True)
class Table:
    """One table; `summary` ones go to docs/speed.md."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    summary: bool = False

    def text(self) -> str:
        return f"{self.caption}\n\n{text_table(self.header, self.rows)}"

    def markdown(self) -> str:
        lines = [self.header, ["---"] * len(self.header), *self.rows]
        grid = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
        return f"{self.caption}\n\n{grid}"


@dataclass(frozen=True)
class Report:
    """Tables and remarks of one benchmark; `plot` is the name of a picture beside."""

    title: str
    tables: Sequence[Table]
    remarks: Sequence[str] = ()
    plot: str = ""
    machine: str = ""

    def text(self) -> str:
        parts = [self.title, "=" * len(self.title)]
        parts += [t.text() for t in self.tables]
        return "\n\n".join([*parts, *self.remarks])

    def markdown(self) -> str:
        parts = [f"## {self.title}", *(t.markdown() for t in self.tables)]
        parts += self.remarks
        if self.plot:
            parts.append(f"![{self.title}]({self.plot})")
        parts.append(f"Measured on: {self.machine}")
        return "\n\n".join(parts)

    def summary(self) -> str:
        """The part for docs/speed.md; empty when no table asks for it."""
        chosen = [t.markdown() for t in self.tables if t.summary]
        if not chosen:
            return ""
        return "\n\n".join([f"**{self.title}**", *chosen, f"({self.machine})"])


def save(folder: Path, name: str, report: Report) -> None:
    """Keeps what was measured beside its picture."""
    with atomic_path(folder / f"{name}.json") as temporary:
        temporary.write_text(
            json.dumps(asdict(report), indent=1) + "\n", encoding="utf-8"
        )


def load(folder: Path, names: Iterable[str]) -> dict[str, Report]:
    """The newest report of every benchmark that has run, in the order of the names."""
    reports = {}
    for name in names:
        path = folder / f"{name}.json"
        if path.is_file():
            content = json.loads(path.read_text(encoding="utf-8"))
            content["tables"] = [Table(**entry) for entry in content["tables"]]
            reports[name] = Report(**content)
    return reports


def write_page(path: Path, reports: Mapping[str, Report]) -> None:
    """All reports as one page of markdown."""
    head = "# Speed against error\n\nWritten by `python -m benchmarks`. " + NOTE
    with atomic_path(path) as temporary:
        pages = [head, *(report.markdown() for report in reports.values())]
        temporary.write_text("\n\n".join(pages) + "\n", encoding="utf-8")


def write_section(
    path: Path, reports: Mapping[str, Report], note: bool = False
) -> None:
    """Replaces what stands between the markers of a page.

    Raises
    ------
    ValueError : the markers are not there.
    """
    text = path.read_text(encoding="utf-8")
    if text.count(START) != 1 or text.count(END) != 1:
        raise ValueError(f"{path} needs {START} and {END} once")
    before, rest = text.split(START)
    after = rest.split(END)[1]
    parts = [report.summary() for report in reports.values()]
    parts.append(NOTE if note else "")
    body = "\n\n".join(part for part in parts if part)
    with atomic_path(path) as temporary:
        temporary.write_text(f"{before}{START}\n{body}\n{END}{after}", encoding="utf-8")
