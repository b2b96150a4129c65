"""One odd line in a long file: read as it stands, or named by its number."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.sid_files import read_sid, write_sid
from tests.bodies import particle_body
from tests.formats.sids import assert_same


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    body = particle_body(5, 70, nodes=70, seed=3, stiffening=True)
    path = tmp_path_factory.mktemp("long") / "body.SID_FEM"
    write_sid(path, body)
    assert path.stat().st_size > 3 << 18
    return path.read_text(encoding="utf-8").split("\n")


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory, lines: list[str]) -> SID:
    return _read(tmp_path_factory.mktemp("expected"), lines)


def _entries(lines: list[str]) -> list[int]:
    return [k for k, line in enumerate(lines) if re.match(r" +m[01]\(", line)]


def _read(folder: Path, lines: list[str]) -> SID:
    path = folder / "odd.SID_FEM"
    path.write_text("\n".join(lines), encoding="utf-8")
    return read_sid(path)


def _fortran(line: str) -> list[str]:
    key, _, value = line.partition("=")
    return [f"{key}={value.replace('D', '')}"]


SAME: dict[str, Callable[[str], list[str]]] = {
    "no exponent letter": _fortran,
    "capitals and blanks": lambda line: [line.replace("m", "M").replace(",", " , ")],
    "a blank line": lambda line: [line, " ", ""],
    "no indent": lambda line: [line.strip()],
    "a Windows end": lambda line: [line + "\r"],
}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("habit", SAME)
def test_an_odd_line_is_read_as_the_others(
    tmp_path: Path, lines: list[str], expected: SID, habit: str, seed: int
) -> None:
    odd = list(lines)
    chosen = random.Random(seed).sample(_entries(lines), 1 + 200 * (seed % 2))
    for k in sorted(chosen, reverse=True):
        odd[k : k + 1] = SAME[habit](odd[k])
    assert_same(_read(tmp_path, odd), expected, 0.0)


def _without_key(line: str) -> str:
    return line.partition("=")[2]


WRONG: dict[str, Callable[[str], str]] = {
    "no number": lambda line: line.partition("=")[0] + "= 1.0x",
    "not finite": lambda line: line.partition("=")[0] + "= nan",
    "too large": lambda line: line.partition("=")[0] + "= 1.0D+999",
    "underscores": lambda line: line.partition("=")[0] + "= 1_0.5",
    "two numbers": lambda line: line + " = 3.0",
    "no key": _without_key,
    "no value": lambda line: line.partition("=")[0],
    "an unknown key": lambda line: line.replace("m", "k"),
    "an index too many": lambda line: line.replace("(", "(1,1,"),
    "an index of nothing": lambda line: re.sub(r"\( *\d+", "( 99", line),
}


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("mistake", WRONG)
def test_a_wrong_line_is_named(
    tmp_path: Path, lines: list[str], mistake: str, seed: int
) -> None:
    k = random.Random(seed).choice(_entries(lines))
    odd = [*lines[:k], WRONG[mistake](lines[k]), *lines[k + 1 :]]
    with pytest.raises(InputError, match=rf"line {k + 1}\b"):
        _read(tmp_path, odd)


@pytest.mark.parametrize("seed", range(2))
def test_an_entry_that_stands_twice_is_named(
    tmp_path: Path, lines: list[str], seed: int
) -> None:
    k = random.Random(seed).choice(_entries(lines))
    with pytest.raises(InputError, match=rf"line {k + 2}\b.*again"):
        _read(tmp_path, [*lines[: k + 1], *lines[k:]])
