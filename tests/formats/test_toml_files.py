"""Wrong files end in one message: the file, the place, what was found and expected."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import load, validate_data
from tests.places import posix


class Line(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    type: Literal["line"]
    axis: tuple[float, float] = (1.0, 0.0)
    count: int = 1


class Weight(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    type: Literal["weight"]
    mass: Annotated[float, Field(gt=0, description="the mass [kg]")]


class Thing(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    format: Literal["thing"]
    parts: dict[str, Annotated[Line | Weight, Field(discriminator="type")]]
    lines: list[Line] = []


def written(folder: Path, text: str | bytes, name: str = "thing.toml") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_toml_and_json_say_the_same(tmp_path: Path) -> None:
    toml = written(tmp_path, 'format = "thing"\n[parts.a]\ntype = "weight"\nmass = 2\n')
    json = written(
        tmp_path,
        '{"format": "thing", "parts": {"a": {"type": "weight", "mass": 2}}}',
        "thing.json",
    )
    assert load(toml, Thing) == load(json, Thing)
    assert load(toml, Thing).parts["a"] == Weight(type="weight", mass=2.0)


def test_all_that_is_wrong_is_told_at_once(tmp_path: Path) -> None:
    parts = {"a": {"type": "line", "count": True}, "b": {"type": "weight", "mass": -1}}
    parts |= {f"c{k}": {"type": "weight"} for k in range(9)}
    text = json.dumps({"format": "thing", "parts": parts})
    with pytest.raises(InputError) as error:
        load(written(tmp_path, text, "thing.json"), Thing)
    first, *others = str(error.value).splitlines()
    assert "parts.a.count: found true; expected a whole number" in first
    assert (
        others[0] == "  also parts.b.mass: found -1; expected a number greater than 0"
    )
    assert others[1] == "  also parts.c0.mass: is missing; expected the mass [kg]"
    assert others[-1] == "  also 4 more problems in this file"


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"type": "weight"}, "parts.a.mass: is missing; expected the mass [kg]"),
        (
            {"type": "weight", "mas": 1.0},
            "parts.a.mas: is not a known key; expected mass",
        ),
        (
            {"type": "weight", "mass": -1.5},
            "parts.a.mass: found -1.5; expected a number greater than 0",
        ),
        (
            {"type": "weight", "mass": "10 kg"},
            "parts.a.mass: found '10 kg'; expected a number",
        ),
        (
            {"type": "weight", "mass": True},
            "parts.a.mass: found true; expected a number",
        ),
        (
            {"type": "wait", "mass": 1.0},
            "parts.a.type: found 'wait'; expected one of 'line', 'weight'",
        ),
        ({"mass": 1.0}, "parts.a.type: is missing;"),
        (
            {"type": "line", "axis": [1.0, float("nan")]},
            "parts.a.axis[1]: found nan; expected a finite number",
        ),
        (
            {"type": "line", "axis": [1.0]},
            "parts.a.axis[1]: is missing; expected one more entry",
        ),
        (
            {"type": "line", "axis": [1.0, 2.0, 3.0]},
            "parts.a.axis: found [1.0, 2.0, 3.0]; expected at most 2 entries",
        ),
        (
            {"type": "line", "count": 1.5},
            "parts.a.count: found 1.5; expected a whole number",
        ),
        (7, "parts.a: found 7; expected a table"),
    ],
)
def test_what_does_not_fit_is_named(part: object, message: str) -> None:
    with pytest.raises(InputError) as raised:
        validate_data({"format": "thing", "parts": {"a": part}}, Thing, source="f.toml")
    assert str(raised.value).startswith(f"f.toml: {message}")


def test_the_wrong_kind_of_file_is_said_first() -> None:
    with pytest.raises(InputError, match="format: found 'model'.*expected 'thing'"):
        validate_data({"format": "model", "something": 1}, Thing)


def test_entries_of_lists_are_counted_from_zero() -> None:
    lines = [{"type": "line"}, {"type": "line", "axs": 1}]
    with pytest.raises(InputError, match=r"lines\[1\].axs: .*expected axis"):
        validate_data({"format": "thing", "parts": {}, "lines": lines}, Thing)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"markers": "a"}, r"forces.f.markers: .*; expected marker$"),
        ({"force": [1, True]}, r"forces.f.force\[1\]: found true"),
        (
            {"marker": "a", "function": {"type": "sum", "parts": [{"type": "sum"}]}},
            r"forces.f.function.parts\[0\].type: found 'sum'",
        ),
        (
            {"function": {"type": "constant", "valu": 1}},
            "forces.f.function.valu: .*; expected value\\b",
        ),
    ],
)
def test_a_kind_of_table_with_a_key_of_the_same_name(
    wrong: dict[str, object], message: str
) -> None:
    """What was wrong beside the list `force` of a force was told as in that list."""
    force = {"type": "force", "force": [1.0, 0.0]} | wrong
    scene = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 1.0, "output_step": 0.1},
        "bodies": {"a": {"mass": 1.0}},
        "forces": {"f": force},
    }
    with pytest.raises(InputError, match=message):
        validate_data(scene, SceneFile)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.toml", b"x = [1,\ny = 2", "line 2, column"),
        ("a.toml", b"x = 1\nx = 2\n", "a.toml: line 2, column"),
        ("a.toml", b"x = '\xff'", "byte 5 is not text; expected a UTF-8 text file"),
        ("a.json", b'{"x": 1,}', "a.json: line 1, column"),
        ("a.json", b'{"x": 1, "x": 2}', "x: appears twice"),
        (
            "a.json",
            b"{" + b",".join(b'"k%d": 1' % i for i in range(30_000)) + b', "k9": 1}',
            "k9: appears twice",
        ),
        (
            "b.json",
            b"{"
            + b",".join(b'"k%d": 1' % i for i in range(30_000))
            + b', "k29999": 1}',
            "k29999: appears twice",
        ),
        ("a.toml", b" " * 1_000_000 + b"$", "a.toml: line 1"),
        ("a.json", b"[1]", "holds no table"),
        ("a.json", b"[" * 100_000, "a.json"),
        ("a.toml", b"x = " + b"[" * 100_000, "a.toml"),
        ("a.json", b'{"x": ' + b"9" * 5000 + b"}", "a.json"),
        ("a.toml", b"lines = 0x" + b"f" * 9000, "lines: found an integer of more than"),
        ("a.toml", b"x." * 300 + b"y = 1", "line 1: has a key of more than 50 parts"),
        ("a.toml", b"\n[ " + b"'x' . " * 90 + b"y]", "line 2: has a key of more than"),
        ("a.toml", b"x = {" + b"a.b." * 90 + b"c = 1}", "line 1: has a key of more"),
        ("a.json", b'{"a":' * 90 + b"1" + b"}" * 90, "is nested too deeply"),
        ("a.json", b'{"x": ' + b"9" * 30 + b"}", "x: found an integer of more than 64"),
        ("a.toml", b'x = "a\\u0000b"', "x: .*holds the character NUL"),
        ("a.toml", b"", "format: is missing.*expected 'thing'"),
    ],
)
def test_broken_text_is_placed(
    tmp_path: Path, name: str, content: bytes, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        load(written(tmp_path, content, name), Thing)


def test_files_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        load(tmp_path / "none.toml", Thing)
    with pytest.raises(InputError, match="is a folder"):
        load(tmp_path, Thing)


@posix
def test_a_pipe_is_no_file_to_wait_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(InputError, match="is a pipe or a device"):
        load(tmp_path / "pipe.toml", Thing)


def test_texts_with_many_points_are_texts(tmp_path: Path) -> None:
    text = "a. " * 40 + "b" * 40
    (tmp_path / "a.toml").write_text(
        f'format = "{text}"\nlines = {{}}', encoding="utf-8"
    )
    with pytest.raises(InputError, match="format: found"):
        load(tmp_path / "a.toml", Thing)
