"""The walk of a SID from `simulate` to the first step: down, and never up again.

On the stack of calls every file is one stretch: what it hands down to another file does
not call back into it. Who reads from the top never comes to a file that was left.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

import sidtool
from sidtool import formats, solver
from sidtool.formats.storage.cache import cached_by_identity
from sidtool.solver.simulation.run_loop import Run
from sidtool.solver.system.system import System

from .sidtool.api.test_compiled import ARM, FOUNDING

OURS = tuple(
    str(Path(str(room.__file__)).resolve().parent) + os.sep
    for room in (sidtool, solver, formats)
)
#: They call what they are given, once, and keep what it finds.
PASSING_ON = {
    cached_by_identity(len).__code__,  # type: ignore[attr-defined]
    System.cached.__code__,
    System.cached_by_topology.__code__,
}


class FirstStep(Exception):
    """The walk ends here."""


@cache
def ours(code: CodeType) -> str:
    """The file of a function of this repository; nothing for others, and where one is
    imported."""
    file = str(Path(code.co_filename).resolve())
    return file if file.startswith(OURS) and code.co_name != "<module>" else ""


def files_above(frame: FrameType | None) -> Iterator[str]:
    """Files of a call and of those that led to it, as far as they are ours: what
    pydantic calls has begun there."""
    while frame is not None and (file := ours(frame.f_code)):
        if frame.f_code not in PASSING_ON:
            yield file
        frame = frame.f_back


def walk(scene: sidtool.Scene, monkeypatch: pytest.MonkeyPatch) -> tuple[int, set[str]]:
    """How many times a file called another one, and files that were entered again."""
    calls, again = [0], set()

    def look(frame: FrameType, event: str, argument: Any) -> None:
        if event != "call" or not ours(frame.f_code):
            return
        files = list(files_above(frame))
        if len(files) > 1 and files[0] != files[1]:
            calls[0] += 1
            if files[0] in files[1:]:
                again.add(" < ".join(Path(file).name for file in files))

    def first_step(run: Run) -> int:
        raise FirstStep

    monkeypatch.setattr(Run, "_make_steps", first_step)
    # A collection of garbage closes unfinished generators of other tests: calls here.
    gc.disable()
    sys.setprofile(look)
    try:
        with pytest.raises(FirstStep):
            scene.simulate()
    finally:
        sys.setprofile(None)
        gc.enable()
    return calls[0], again


def founding(folder: Path) -> sidtool.Scene:
    return sidtool.Scene.load(FOUNDING / "slider_crank.toml")


def rubbing_arm_with_a_law(folder: Path) -> sidtool.Scene:
    (folder / "arm.toml").write_text(ARM, encoding="utf-8")
    return sidtool.Scene.load(folder / "arm.toml")


@pytest.mark.parametrize("load", [founding, rubbing_arm_with_a_law])
def test_no_file_is_entered_twice_on_the_way_down(
    load: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls, again = walk(load(tmp_path), monkeypatch)
    assert calls > 500
    assert again == set()
