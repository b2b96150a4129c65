"""Damaged ASCII files: one clear message, or the body that still stands there."""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.sid_ascii.writer import STYLES
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.storage.hdf5_files import check_finite
from tests.bodies import particle_body

BODY = particle_body(2, 6, nodes=2, stiffening=True)
Damage = Callable[[random.Random, list[str]], list[str]]


def some_line(rng: random.Random, lines: list[str], pattern: str) -> int:
    """The number of a line that contains the pattern."""
    return rng.choice([n for n, line in enumerate(lines) if re.search(pattern, line)])


def replaced(lines: list[str], number: int, *by: str) -> list[str]:
    return [*lines[:number], *by, *lines[number + 1 :]]


def cut(rng: random.Random, lines: list[str]) -> list[str]:
    text = "\n".join(lines).rstrip()
    return text[: rng.randrange(len(text))].split("\n")


def value(text: str) -> Damage:
    """Something else in the place of a number."""

    def put(rng: random.Random, lines: list[str]) -> list[str]:
        number = some_line(rng, lines, r"^ +(m[01]\(|mass )")
        return replaced(lines, number, lines[number].partition("=")[0] + "= " + text)

    return put


def count(rng: random.Random, lines: list[str]) -> list[str]:
    """Another number of rows, columns or elastic coordinates."""
    number = some_line(rng, lines, "^ +(nrow|ncol|nq|nelastq) ")
    key, _, old = lines[number].partition("=")
    others = {1, 4, 5, 7, 13, 100000, 10**9, 10**30} - {int(old)}
    return replaced(lines, number, f"{key}= {rng.choice(sorted(others))}")


def index(rng: random.Random, lines: list[str]) -> list[str]:
    """An index that is out of range."""
    number = some_line(rng, lines, r"m[01]\(")
    spans = [m.span() for m in re.finditer(r"\d+ *(?=[,)])", lines[number])]
    start, end = rng.choice(spans)
    wrong = rng.choice(["0", "99", "40000", "99999999999"])
    return replaced(lines, number, lines[number][:start] + wrong + lines[number][end:])


def doubled_line(rng: random.Random, lines: list[str]) -> list[str]:
    number = rng.randrange(1, len(lines))
    return [*lines[:number], lines[number], *lines[number:]]


def block_span(rng: random.Random, lines: list[str]) -> tuple[int, int]:
    """First line and end of a node entry or a body block."""
    names = "origin|phi|psi|AP|mdCM|mCM|J|mmi|Ct|Cr|Me|Gr|Ge|Oe|ksigma|Ke|De"
    start = some_line(rng, lines, rf"^ +({names})$")
    closing = f"end {lines[start].strip()}"
    end = next(n for n in range(start, len(lines)) if lines[n].strip() == closing)
    return start, end + 1


def doubled_block(rng: random.Random, lines: list[str]) -> list[str]:
    start, end = block_span(rng, lines)
    return lines[:end] + lines[start:end] + lines[end:]


def lost_block(rng: random.Random, lines: list[str]) -> list[str]:
    start, end = block_span(rng, lines)
    return lines[:start] + lines[end:]


def control_byte(rng: random.Random, lines: list[str]) -> list[str]:
    number = rng.randrange(len(lines))
    where = rng.randrange(len(lines[number]) + 1)
    byte = chr(rng.choice([0, 1, 7, 8, 14, 27, 31, 127]))
    line = lines[number][:where] + byte + lines[number][where:]
    return replaced(lines, number, line)


def endless_line(rng: random.Random, lines: list[str]) -> list[str]:
    number = rng.randrange(len(lines))
    filler = rng.choice([" ", "9", "x", "= 1", "("])
    return replaced(lines, number, lines[number] + filler * 10**6)


def garbled_keyword(rng: random.Random, lines: list[str]) -> list[str]:
    keyword = r"^ +(end )?(part|refmod|frame|node|origin|phi|psi|AP|Ct|Me|Ke)$"
    number = some_line(rng, lines, keyword)
    return replaced(lines, number, lines[number] + rng.choice("xq0=("))


#: What no reader may accept.
FATAL: dict[str, tuple[int, Damage]] = {
    "cut": (100, cut),
    "nan": (12, value("NaN")),
    "infinite": (12, value("Infinity")),
    "overflow": (12, value("1.0D+999")),
    "words": (12, value("many")),
    "two numbers": (12, value("1.0 2.0")),
    "underscore": (12, value("1_0.0")),
    "no value": (12, value("")),
    "wrong count": (50, count),
    "index out of range": (50, index),
    "doubled line": (50, doubled_line),
    "doubled block": (24, doubled_block),
    "lost block": (24, lost_block),
    "control byte": (40, control_byte),
    "endless line": (8, endless_line),
    "garbled keyword": (32, garbled_keyword),
}


def swapped_lines(rng: random.Random, lines: list[str]) -> list[str]:
    first, second = rng.sample(range(len(lines)), 2)
    lines = list(lines)
    lines[first], lines[second] = lines[second], lines[first]
    return lines


def lost_line(rng: random.Random, lines: list[str]) -> list[str]:
    return replaced(lines, rng.randrange(len(lines)))


def any_byte(rng: random.Random, lines: list[str]) -> list[str]:
    number = rng.randrange(len(lines))
    line = lines[number] or " "
    where = rng.randrange(len(line))
    changed = line[:where] + chr(rng.randrange(256)) + line[where + 1 :]
    return replaced(lines, number, changed)


def noise(rng: random.Random, lines: list[str]) -> list[str]:
    start = rng.randrange(len(lines))
    junk = "".join(chr(rng.randrange(32, 256)) for _ in range(rng.randrange(200)))
    return [*lines[:start], junk, *lines[start + rng.randrange(3) :]]


#: What may leave a readable file.
DOUBTFUL: dict[str, tuple[int, Damage]] = {
    "swapped lines": (80, swapped_lines),
    "lost line": (60, lost_line),
    "any byte": (120, any_byte),
    "noise": (50, noise),
}


def canonical_lines(folder: Path, dialect: str) -> list[str]:
    write_sid(folder / "whole.SID_FEM", BODY, dialect)
    return (folder / "whole.SID_FEM").read_text(encoding="utf-8").splitlines()


def read_lines(folder: Path, lines: list[str]) -> SID | InputError:
    path = folder / "damaged.SID_FEM"
    path.unlink(missing_ok=True)  # to shorten a file takes much longer
    path.write_bytes("\n".join(lines).encode("latin-1"))
    try:
        return read_sid(path)
    except InputError as error:
        return error


def judge(error: InputError, folder: Path) -> None:
    """File, line and expectation are named, in one line of readable length."""
    assert error.source == str(folder / "damaged.SID_FEM")
    assert error.place is not None
    assert re.fullmatch(r"line \d+", error.place)
    assert error.expected
    assert "\n" not in str(error)
    assert len(str(error)) < 500


@pytest.mark.parametrize("damage", FATAL)
def test_fatal_damage_is_always_noticed(tmp_path: Path, damage: str) -> None:
    number, harm = FATAL[damage]
    rng = random.Random(damage)
    files = [canonical_lines(tmp_path, dialect) for dialect in STYLES]
    for turn in range(number):
        found = read_lines(tmp_path, harm(rng, files[turn % len(files)]))
        assert isinstance(found, InputError)
        judge(found, tmp_path)


@pytest.mark.parametrize("damage", DOUBTFUL)
def test_any_damage_gives_a_message_or_a_whole_body(
    tmp_path: Path, damage: str
) -> None:
    """A file that still follows the grammar is read; its numbers are finite."""
    number, harm = DOUBTFUL[damage]
    rng = random.Random(damage)
    outcomes: Counter[str] = Counter()
    files = [canonical_lines(tmp_path, dialect) for dialect in STYLES]
    for turn in range(number):
        found = read_lines(tmp_path, harm(rng, files[turn % len(files)]))
        outcomes[type(found).__name__] += 1
        if isinstance(found, InputError):
            judge(found, tmp_path)
        else:
            check_finite(found)
    assert outcomes["InputError"] > number / 10


def test_the_line_is_the_right_one(tmp_path: Path) -> None:
    lines = canonical_lines(tmp_path, "fembs")
    number = next(n for n, line in enumerate(lines) if "m1( 3, 2, 1)" in line)
    wrong = replaced(lines, number, lines[number].replace("m1( 3", "m1( 4"))
    found = read_lines(tmp_path, wrong)
    assert isinstance(found, InputError)
    assert found.place == f"line {number + 1}"
    assert "out of range" in found.problem


def test_absurd_sizes_are_refused_before_memory_is_taken(tmp_path: Path) -> None:
    lines = canonical_lines(tmp_path, "fembs")
    huge = [re.sub(r"(nelastq|nq|ncol) +=    2", r"\1 = 900000000", s) for s in lines]
    found = read_lines(tmp_path, huge)
    assert isinstance(found, InputError)
    assert "nelastq" in found.problem
    block = ["Kgeo", "nrow = 900000000", "ncol = 900000000", "end Kgeo"]
    found = read_lines(tmp_path, [*lines[:-2], *block, *lines[-2:]])
    assert isinstance(found, InputError)
    judge(found, tmp_path)


@pytest.mark.parametrize("name", ["body.SID_FEM", "body.h5"])
def test_what_is_no_sid_file_at_all(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    with pytest.raises(InputError, match="no such file"):
        read_sid(path)
    for content in (b"", b"\n\n", b"format = 1\n", b"\x89PNG\r\n\x1a\n", b"\xff" * 9):
        path.write_bytes(content)
        with pytest.raises(InputError, match=re.escape(str(path))):
            read_sid(path)
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match="is a folder"):
        read_sid(path)
    with pytest.raises(InputError, match="is a folder"):
        write_sid(path, BODY)
    with pytest.raises(InputError, match="cannot write here"):
        write_sid(tmp_path / "nowhere" / name, BODY)


def test_unknown_blocks_cannot_ask_for_the_memory(tmp_path: Path) -> None:
    """A thousand small blocks that declare large matrices, and one that is in use."""
    path = tmp_path / "body.SID_FEM"
    write_sid(path, particle_body(2, 6))
    head, end, tail = path.read_text(encoding="utf-8").rpartition(" end modal")
    block = "new{0}\n nrow = {1}\n ncol = {1}\n m0(1,1) = 1.0\nend new{0}\n"
    path.write_text(head + "\n" + block.format(1, 40) + end + tail, encoding="utf-8")
    assert read_sid(path).extra["new1"].shape == (40, 40)
    many = "".join(block.format(i, 900) for i in range(1000))
    path.write_text(head + "\n" + many + end + tail, encoding="utf-8")
    with pytest.raises(InputError, match="unknown blocks before it declare many zeros"):
        read_sid(path)
