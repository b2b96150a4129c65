"""The encoding of a terminal never ends a command."""

from __future__ import annotations

import errno
import io
import os
import subprocess
import sys
from pathlib import Path

import click
import pytest

from sidtool.cli import main
from sidtool.formats.storage import operating_system
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK

TITLE = (
    "\N{GREEK SMALL LETTER OMEGA} \N{RIGHTWARDS ARROW} \N{CJK UNIFIED IDEOGRAPH-8F74}"
)


TWICE = """
import io, sys
from sidtool.cli.main import main
name, *encodings = sys.argv[1:]
for encoding in encodings:
    sys.stdout = io.TextIOWrapper(sys.stdout.detach(), encoding)
    for option in ([], ["--json"]):
        sys.argv[1:] = ["info", name, *option]
        try:
            main()
        except SystemExit as end:
            assert end.code == 0
        print("end of output")
"""
#: Of terminals: the first is that with which the process starts.
ENCODINGS = ["cp1252", "cp850", "utf-8"]


def test_text_beyond_the_code_page_is_escaped(tmp_path: Path) -> None:
    """It ended in a UnicodeEncodeError."""
    scene = (SLIDER_CRANK / "slider_crank.toml").read_text(encoding="utf-8")
    lines = [line for line in scene.splitlines() if not line.startswith("title")]
    text = "\n".join([f'title = "{TITLE}"', *lines])
    sid = SLIDER_CRANK / "rod_q4.SID_FEM"
    path = tmp_path / "scene.toml"
    path.write_text(text.replace("rod_q4.SID_FEM", sid.as_posix()), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", TWICE, str(path), *ENCODINGS],
        env=os.environ | {"PYTHONIOENCODING": ENCODINGS[0], "PYTHONUTF8": "0"},
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr
    parts = done.stdout.split(b"end of output")
    for encoding, text, data in zip(ENCODINGS, parts[::2], parts[1::2], strict=False):
        expected = TITLE if encoding == "utf-8" else r"\u2192"
        assert expected in text.decode(encoding)
        assert r"\u2192" in data.decode(encoding)


def test_an_invalid_argument_of_a_file_is_no_closed_pipe(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows says of a closed pipe what it says of many things."""

    def fail(*arguments: object, **more: object) -> None:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(operating_system, "WINDOWS", True)
    monkeypatch.setattr(main.cli, "main", fail)
    assert main.run(["info"]) == 1
    assert "Invalid argument" in unwrapped(capsys.readouterr().err)

    class Closed(io.StringIO):
        write = fail  # type: ignore[assignment]

    closed = Closed()
    monkeypatch.setattr(main.cli, "main", lambda *_, **__: click.echo("x", file=closed))
    monkeypatch.setattr(main, "_quit_quietly", lambda: 0)
    assert main.run(["info"]) == 0
