"""The walk of a SID from `simulate` to the first step: down, and never up again.

On the stack of calls every file is one stretch: what it hands down to another file does
not call back into it. Who reads from the top never comes to a file that was left.
"""

from __future__ import annotations

import json
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

from .places import ROOT
from .processes import PythonProcess
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


def walk(scene: sidtool.Scene) -> tuple[int, list[str]]:
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

    with pytest.MonkeyPatch.context() as patch, pytest.raises(FirstStep):
        patch.setattr(Run, "_make_steps", first_step)
        sys.setprofile(look)
        try:
            scene.simulate()
        finally:
            sys.setprofile(None)
    return calls[0], sorted(again)


def founding(folder: Path) -> sidtool.Scene:
    return sidtool.Scene.load(FOUNDING / "slider_crank.toml")


def arm_with_friction_and_controller(folder: Path) -> sidtool.Scene:
    (folder / "arm.toml").write_text(ARM, encoding="utf-8")
    return sidtool.Scene.load(folder / "arm.toml")


SCENES = {load.__name__: load for load in (founding, arm_with_friction_and_controller)}


WALKS = """
import json, tempfile
from pathlib import Path
from tests.test_walk import SCENES, walk
with tempfile.TemporaryDirectory() as folder:
    print(json.dumps({name: walk(load(Path(folder))) for name, load in SCENES.items()}))
"""


@cache
def walks() -> dict[str, tuple[int, list[str]]]:
    """The walks of all scenes, in a process of their own: what other tests have left in
    caches would shorten them, and what is finalised meanwhile would be seen as calls.
    """
    with PythonProcess(WALKS, ROOT) as process:
        done = process.wait()
    assert done.status == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("name", SCENES)
def test_no_file_is_entered_twice_on_the_way_down(name: str) -> None:
    calls, again = walks()[name]
    assert calls > 1000
    assert again == []
