"""Runs what stands in the code blocks of a page, as its reader would."""

from __future__ import annotations

import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from sidtool.cli import run

#: The exit status that a page promises for the commands that follow it.
_STATUS = re.compile(r"exit\s+status\s+(\d)")
_BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)


def blocks(text: str) -> Iterator[tuple[str, str, str]]:
    """(language, code, text since the last block) of every block of a page."""
    end = 0
    for match in _BLOCK.finditer(text):
        indent = len(match[1])
        code = "".join(line[indent:] for line in match[3].splitlines(keepends=True))
        yield match[2], code, text[end : match.start()]
        end = match.end()


def run_commands(page: Path, folder: Path) -> None:
    """The `sh` blocks of a page, in a folder: `sidtool` and `python SCRIPT`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for language, code, before in blocks(page.read_text(encoding="utf-8")):
            promised = _STATUS.search(before)
            for line in code.splitlines() if language == "sh" else ():
                status = run_line(line)
                assert status == (int(promised[1]) if promised else 0), line


def run_line(line: str) -> int:
    """The exit status of a command."""
    words = shlex.split(line, comments=True)
    if words[:1] == ["sidtool"]:
        return run(words[1:])
    assert words[0] == "python" and len(words) == 2, f"not known how to run: {line}"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", words[1:])
        runpy.run_path(words[1], run_name="__main__")
    return 0
