"""Run the code blocks of a page as a reader would."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import pytest

from sidtool.api.scene import read
from sidtool.cli.main import run
from tests.places import ROOT

#: The exit status that a page promises for the commands that follow it.
_STATUS = re.compile(r"exit\s+status\s+(\d)")
#: Indent, language and code of a block.
BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)
_FILE = re.compile(r"# (in )?(\S+\.toml)\n")
#: Commands that install, or need what a test does not have: their grammar is looked at.
_NOT_RUN = ("pip", "mpirun", "export", "eval", "git", "source")
_SLOW = ("warmup", "demo")


def blocks(text: str) -> Iterator[tuple[str, str, str]]:
    """(language, code, text since the last block) of every block of a page."""
    end = 0
    for match in BLOCK.finditer(text):
        indent = len(match[1])
        code = "".join(line[indent:] for line in match[3].splitlines(keepends=True))
        yield match[2], code, text[end : match.start()]
        end = match.end()


_NEEDS = re.compile(r"<!-- needs: (\w+) -->\s*$")


def run_page(page: Path, folder: Path, packages: Collection[str] = ()) -> int:
    """Every block of a page, one after the other, in a folder.

    A block behind a line `<!-- needs: NAME -->` is run if `packages` has the name.

    `sh`: commands; `python`: one program all over the page; `toml`: a file, which its
    first line names, or with "in" an addition to one, that can be read afterwards.

    Returns
    -------
    how many blocks there were
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    found = list(blocks(page.read_text(encoding="utf-8")))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for language, code, before in found:
            needed = _NEEDS.search(before)
            if needed and needed[1] not in packages:
                continue
            if language == "sh":
                _run_lines(code, before, patch)
            elif language == "python":
                exec(compile(code, str(page), "exec"), names)
            elif language == "toml":
                _write(code)
            else:
                assert language in ("", "text"), f"{page.name}: not run: {language}"
    return len(found)


def _run_lines(code: str, before: str, patch: pytest.MonkeyPatch) -> None:
    promised = _STATUS.search(before)
    for line in code.splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["cd"]:
            patch.chdir(words[1])
        elif words:
            assert run_line(line) == (int(promised[1]) if promised else 0), line


def _write(code: str) -> None:
    name = _FILE.match(code)
    assert name, f"no file is named by the first line of {code[:60]!r}"
    path = Path(name[2])
    path.write_text(
        (path.read_text(encoding="utf-8") + "\n" if name[1] else "") + code,
        encoding="utf-8",
    )
    if re.search(r'^format = "sidtool', path.read_text(encoding="utf-8"), re.MULTILINE):
        read(path)


def run_line(line: str) -> int:
    """The exit status of a command."""
    words = shlex.split(line, comments=True)
    is_unit = any(word.endswith(".fmu") for word in words)  # needs a C compiler
    is_slow = words[:2] in [["sidtool", slow] for slow in _SLOW]
    if words[0] in _NOT_RUN or is_slow or is_unit:
        if sys.platform == "win32":
            return 0
        return subprocess.run(["bash", "-n", "-c", line], check=False).returncode
    if words[0] == "make":
        rules = (ROOT / "Makefile").read_text(encoding="utf-8")
        return 0 if f"\n{words[1]}:" in rules else 2
    if words[0] == "py":  # as on Windows
        assert words[1:3] in (["-m", "pip"], ["-m", "sidtool"], ["-m", "pytest"]), line
        return 0 if words[2] != "sidtool" else run_line(" ".join(words[2:]))
    if words[0] == "sidtool":
        return run(words[1:])
    if words[:2] == ["jupyter", "lab"]:
        run_notebook(Path(words[2]))
        return 0
    assert words[0] == "python" and len(words) == 2, f"not known how to run: {line}"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", words[1:])
        runpy.run_path(words[1], run_name="__main__")
    return 0


def run_notebook(path: Path) -> dict[str, Any]:
    """Run the code cells of a notebook, which is stored without outputs.

    Returns
    -------
    the variables after the last cell
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    for k, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"]):
        if cell["cell_type"] == "code":
            assert not cell["outputs"] and cell["execution_count"] is None
            exec(compile("".join(cell["source"]), f"{path}[{k}]", "exec"), names)
    return names
