"""References of the source to the theory page exist."""

from __future__ import annotations

import re
from pathlib import Path

from sidtool.formats.sid_files import read_sid
from sidtool.validate.checks import check
from tests.places import ROOT

TEXT = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "examples" / "slider_crank" / "rod_q4.SID_FEM"
#: Books and papers, whose own equations are cited beside them.
FOREIGN = re.compile(r"(SIAM|Hulbert|Wanner)[^.]*,\s+(sec|eq)", re.DOTALL)


def sources() -> list[Path]:
    folders = ("formats", "solver", "sidtool", "tests", "benchmarks", "examples")
    return [
        path
        for folder in folders
        for path in sorted((ROOT / folder).rglob("*.py"))
        if path != Path(__file__)
    ]


def cited(pattern: str) -> set[tuple[str, int]]:
    found = set()
    for path in sources():
        for match in re.finditer(pattern, path.read_text(encoding="utf-8")):
            before = path.read_text(encoding="utf-8")[: match.start()][-160:]
            if not FOREIGN.search(before + match[0]):
                numbers = re.findall(r"\d+", match[0])
                found |= {(path.name, int(number)) for number in numbers}
    return found


def test_equations_are_numbered_once_and_in_order() -> None:
    tags = [int(tag) for tag in re.findall(r"\\tag\{(\d+)\}", TEXT)]
    assert tags == list(range(1, len(tags) + 1))


def test_sections_are_numbered_in_order() -> None:
    heads = [int(head) for head in re.findall(r"^## (\d+)\.", TEXT, re.MULTILINE)]
    assert heads == list(range(1, len(heads) + 1))


def test_cited_equations_exist() -> None:
    last = TEXT.count("\\tag{")
    found = cited(r"\beqs?\.\s+\(\d+\)((,| and| to)\s+\(\d+\))*")
    assert len(found) > 20
    assert {entry for entry in found if not 1 <= entry[1] <= last} == set()


def test_cited_sections_exist() -> None:
    last = len(re.findall(r"^## \d+\.", TEXT, re.MULTILINE))
    found = cited(r"\btheory,\s+section\s+\d+")
    assert len(found) > 4
    assert {entry for entry in found if not 1 <= entry[1] <= last} == set()
    assert cited(r"(sid-format|format),\s+section\s+\d+") == set()


def test_every_identity_of_the_checker_is_stated() -> None:
    names = [entry.id for entry in check(read_sid(EXAMPLE))]
    assert len(names) > 15
    for name in names:
        assert re.search(rf"^\| {name} \|", TEXT, re.MULTILINE), name
