"""Finished points of a study, kept by content: none is computed again."""

from __future__ import annotations

import json
import zipfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.storage.atomic import atomic_path

from ..accuracy.cached import key_of
from ..made import digest_of
from .measuring import Course
from .tasks import Converted, Run

#: How points are measured; those of another way are not used.
METHOD = 4
#: Keys of [accuracy] that a setting replaces.
SETTING = {"integrator", "rtol", "step", "wanted"}


class Store:
    """A folder of finished points, or nothing at all.

    folder : made with the first point
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder

    def course(self, task: Run) -> Course | None:
        """The run, if it was made before."""
        found = self._read(_run_key(task))
        if found is None:
            return None
        numbers, values = found
        times = np.array(numbers.pop("times"))
        for key in ("names", "rounding", "notes", "warnings"):
            numbers[key] = tuple(numbers[key])
        return Course(values=values, times=times, **numbers)

    def keep_course(self, task: Run, made: Course) -> None:
        numbers = {
            "names": made.names,
            "rounding": made.rounding,
            "seconds": made.seconds,
            "steps": made.steps,
            "message": made.message,
            "notes": made.notes,
            "warnings": made.warnings,
            "times": made.times.tolist(),
        }
        self._write(_run_key(task), numbers, made.values)

    def converted(self, model: ModelFile) -> Converted | None:
        """The SID of a model, if it was converted before."""
        found = self._read(_model_key(model))
        if found is None or self.folder is None:
            return None
        made = Converted(None, **found[0])
        if made.message:
            return made
        with suppress(InputError):
            return replace(made, sid=read_sid(self._sid(model)))
        return None

    def keep_converted(self, model: ModelFile, made: Converted) -> None:
        numbers = {
            "dofs": made.dofs,
            "seconds": made.seconds,
            "message": made.message,
        }
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        if made.sid is not None:
            write_sid(self._sid(model), made.sid)
        self._write(_model_key(model), numbers, np.zeros((0, 0)))

    def _sid(self, model: ModelFile) -> Path:
        assert self.folder is not None
        return self.folder / f"{_model_key(model)}.h5"

    def _read(self, key: str) -> tuple[dict[str, Any], np.ndarray] | None:
        if self.folder is None:
            return None
        try:
            with np.load(self.folder / f"{key}.npz", allow_pickle=False) as file:
                return json.loads(str(file["numbers"])), file["values"]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def _write(self, key: str, numbers: dict[str, Any], values: np.ndarray) -> None:
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        with (
            atomic_path(self.folder / f"{key}.npz", keep_beside=False) as temporary,
            temporary.open("wb") as stream,
        ):
            np.savez(stream, numbers=np.array(json.dumps(numbers)), values=values)


def _run_key(task: Run) -> str:
    accuracy = task.scene.accuracy.model_dump_json(exclude=SETTING)
    how = METHOD, task.setting, task.once, accuracy
    return f"run-{key_of(task.scene, task.sids, how, {})}"


def _model_key(model: ModelFile) -> str:
    return f"body-{METHOD}-{digest_of(model)}"
