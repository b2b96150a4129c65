"""Reference files: what they say, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.reference import read_reference

_HEAD = 'format = "sidtool reference"\nversion = 1\n'


def _written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_toml(tmp_path: Path) -> None:
    text = _HEAD + (
        '[[frequencies]]\nname = "paper"\nhertz = [31.8, 200.6]\ntolerance = 0.01\n'
        '[[blocks]]\nblock = "J"\nrow = 3\nvalue = 5.5\n'
    )
    reference = read_reference(_written(tmp_path, "r.toml", text))
    assert reference.frequencies[0].numbers == (1, 2)
    assert reference.frequencies[0].tolerance == 0.01
    assert (reference.blocks[0].row, reference.blocks[0].value) == (3, 5.5)
    assert reference.blocks[0].tolerance is None


def test_csv_says_the_same_as_toml(tmp_path: Path) -> None:
    csv = (
        "# measured on the bench\n"
        "quantity,mode,value,tolerance,name,row,node,column\n"
        "frequency,1,31.8,0.01,paper,,,\n\n"
        "frequency,3,200.6,0.01,paper,,,\n"
        "mass,,7.5,,,,,\n"
        "phi,,0.25,1e-6,,2,4,1\n"
    )
    toml = _HEAD + (
        'title = "r"\n[[frequencies]]\nname = "paper"\nhertz = [31.8, 200.6]\n'
        'modes = [1, 3]\ntolerance = 0.01\n[[blocks]]\nblock = "mass"\nvalue = 7.5\n'
        '[[blocks]]\nblock = "phi"\nnode = "4"\nrow = 2\ncolumn = 1\nvalue = 0.25\n'
        "tolerance = 1e-6\n"
    )
    assert read_reference(_written(tmp_path, "r.csv", csv)) == read_reference(
        _written(tmp_path, "r.toml", toml)
    )


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("r.toml", _HEAD, "at least one table"),
        ("r.toml", 'format = "sidtool model"\nversion = 1\n', "sidtool reference"),
        ("r.toml", _HEAD + '[[blocks]]\nblock = "Jx"\nvalue = 1.0\n', "mdCM, J, Ct"),
        ("r.toml", _HEAD + '[[blocks]]\nblock = "phi"\nvalue = 1.0\n', "node"),
        ("r.toml", _HEAD + '[[blocks]]\nblock = "J"\nrow = 0\nvalue = 1.0\n', "row"),
        ("r.toml", _HEAD + '[[frequencies]]\nname = "a"\nhertz = []\n', "hertz"),
        (
            "r.toml",
            _HEAD + '[[frequencies]]\nname = "a"\nhertz = [1.0]\nmodes = [1, 2]\n',
            "as many mode numbers",
        ),
        ("r.csv", "", "is empty"),
        ("r.csv", "quantity,weight\nJ,1\n", "line 1: the header is quantity, weight"),
        ("r.csv", "quantity,value\n", "at least one table"),
        ("r.csv", "quantity,value\nJ\n", "line 2: found 1 cells"),
        ("r.csv", "quantity,value\nJ,\n", "line 2: value is missing"),
        ("r.csv", "quantity,value\nJ,many\n", "line 2, column value: found 'many'"),
        ("r.csv", "quantity,value\nJ,nan\n", "finite"),
        ("r.csv", "quantity,value\nJx,1\n", "line 2, block: found 'Jx'"),
        ("r.csv", "quantity,value\nfrequency,1\n", "line 2, column mode: is missing"),
    ],
)
def test_bad_files_end_in_one_message(
    tmp_path: Path, name: str, text: str, expected: str
) -> None:
    path = _written(tmp_path, name, text)
    with pytest.raises(InputError) as caught:
        read_reference(path)
    assert str(path) in str(caught.value) and expected in str(caught.value)


@pytest.mark.parametrize("name", ["none.csv", "none.toml"])
def test_missing_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=name):
        read_reference(tmp_path / name)


def test_bytes_that_are_not_text(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_bytes(b"quantity,value\nJ,\xff\xfe\n")
    with pytest.raises(InputError, match="cannot be read"):
        read_reference(path)
