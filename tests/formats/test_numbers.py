"""Decimal numbers as text, in files and on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import integer_of_text, is_label, real_of_text
from sidtool.formats.model.stations import read_stations
from sidtool.formats.reference import read_rows
from sidtool.formats.scene.outputs import parse_output
from sidtool.formats.scene.signal_files import read_columns
from sidtool.formats.toml.expressions import parse_expression
from sidtool.sensitivity.measurements import read_measurements

#: A digit of another script.
FOREIGN = "\N{ARABIC-INDIC DIGIT THREE}"
#: What `float` converts, and what it does not.
OTHERS = ("1_0", FOREIGN, "nan", "-Infinity", "1e999", "0x1p3", "1 0", "")


def test_decimal_numbers() -> None:
    assert [real_of_text(x) for x in (" -1.5e-3 ", ".5", "2.")] == [-1.5e-3, 0.5, 2.0]
    assert integer_of_text("-12") == -12
    for word in OTHERS:
        with pytest.raises(ValueError):
            real_of_text(word)
    for word in (*OTHERS, "1.", "1" * 5000):
        with pytest.raises(ValueError):
            integer_of_text(word)
    labels = ("12", "-1", "1_0", FOREIGN, "\N{SUPERSCRIPT TWO}", "1" * 19)
    assert [x for x in labels if is_label(x)] == ["12"]


@pytest.mark.parametrize("word", ["1_0", FOREIGN, "inf"])
def test_words_of_tables(tmp_path: Path, word: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f"t,x\n0,1\n\n1,{word}\n", encoding="utf-8")
    for read in (lambda x: read_columns(x, ["t", "x"]), read_measurements):
        with pytest.raises(InputError) as caught:
            read(path)
        assert caught.value.place == "line 4"
    path.write_text(f"0,{word}\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_columns(path, [1, 2])
    assert caught.value.place == "line 1"  # no header
    path.write_text(f"quantity,value\nmass,{word}\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_rows(path)
    assert caught.value.place == "line 2, column value"
    path.write_text(f"position,EA\n0,1\n1,{word}\n", encoding="utf-8")
    with pytest.raises(InputError, match="found"):
        read_stations(path)


def test_digits_of_other_scripts_in_names_and_formulas() -> None:
    for text in (FOREIGN, f"2 + 1{FOREIGN}", "1_0"):
        with pytest.raises(InputError):
            parse_expression(text, {})
    assert parse_output("rod.q13").quantity == "q13"
    with pytest.raises(InputError):
        parse_output(f"rod.q1{FOREIGN}")


@pytest.mark.parametrize("word", ["1_0", FOREIGN, "nan", "inf"])
def test_words_of_options(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    for option in ("--rtol", "--step"):
        assert run(["simulate", "no.toml", option, word]) == 2
        assert f"{word!r} is not a finite number" in capsys.readouterr().err
