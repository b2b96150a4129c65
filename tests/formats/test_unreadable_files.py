"""Files that are not there, folders in their place, and backslashes in TOML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.formats.field import read_field
from sidtool.formats.reference import read_rows
from sidtool.formats.result import read_result
from sidtool.formats.sid_files import read_sid
from sidtool.formats.storage import operating_system
from sidtool.formats.storage.unreadable import QUOTES, unreadable_error
from sidtool.formats.toml.reading import read_data
from sidtool.mesh.deck_text import read_lines
from tests.places import SLIDER_CRANK

READERS = [read_sid, read_data, read_field, read_result, read_lines, read_rows]
READERS += [sidtool.read]


@pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)
def test_a_folder_is_called_one(read: Any, tmp_path: Path) -> None:
    """Windows calls the opening of a folder a lack of permission."""
    with pytest.raises(InputError) as raised:
        read(tmp_path)
    assert raised.value.problem == "is a folder"
    assert raised.value.source == str(tmp_path)


@pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)
def test_a_path_that_a_backslash_in_toml_has_changed(read: Any, tmp_path: Path) -> None:
    with pytest.raises(InputError) as raised:
        read(tmp_path / "sub\rod.SID_FEM")
    assert raised.value.expected == QUOTES
    assert str(raised.value.source).endswith(r"sub\rod.SID_FEM")


def test_a_lack_of_permission_on_a_folder_is_no_answer(tmp_path: Path) -> None:
    error = PermissionError(13, "Permission denied")
    assert unreadable_error(tmp_path, None, error).problem == "is a folder"
    (tmp_path / "file").write_bytes(b"")
    assert (
        "Permission denied" in unreadable_error(tmp_path / "file", None, error).problem
    )


def test_a_path_that_is_too_long_for_windows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(operating_system, "WINDOWS", True)
    path = tmp_path / ("n" * 200) / ("m" * 200)
    error = FileNotFoundError(2, "No such file or directory")
    assert "Windows takes 259" in unreadable_error(path, None, error).problem


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        (r'"sub\rod_q4.SID_FEM"', True),
        (r'"sub\new.SID_FEM"', True),
        (r'"C:\Users\someone\rod.SID_FEM"', True),
        (r'"C:\work\rod.SID_FEM"', True),
        (r"'C:\work\rod.SID_FEM'", False),
        ('"C:/work/rod.SID_FEM"', False),
    ],
)
def test_backslashes_in_toml(text: str, remedy: bool, tmp_path: Path) -> None:
    """The error says how to write such a path."""
    content = (SLIDER_CRANK / "slider_crank.toml").read_text(encoding="utf-8")
    path = tmp_path / "scene.toml"
    path.write_text(content.replace('"rod_q4.SID_FEM"', text), encoding="utf-8")
    with pytest.raises(InputError) as raised:
        sidtool.simulate(path)
    assert (raised.value.expected == QUOTES) == remedy


def test_a_mesh_file_with_a_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "mesh.inp").write_bytes(b"\xef\xbb\xbf*NODE\r\n1, 0., 0., 0.\r\n")
    assert read_lines(tmp_path / "mesh.inp") == ["*NODE", "1, 0., 0., 0."]
