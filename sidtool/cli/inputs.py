"""A SID that comes through a pipe: read once into a file that goes at the end."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from pathlib import Path
from typing import Any

import click


class Piped(click.Path):
    """The path of a file; of a pipe or a device, that of a copy of what it tells."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Path:
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        if ctx is None or not _is_pipe(path):
            return path
        folder = Path(tempfile.mkdtemp(prefix="sidtool-"))
        ctx.call_on_close(lambda: shutil.rmtree(folder, ignore_errors=True))
        copy = folder / path.name
        with path.open("rb") as source, copy.open("wb") as target:
            shutil.copyfileobj(source, target)
        return copy


def _is_pipe(path: Path) -> bool:
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or stat.S_ISSOCK(mode)


piped = Piped()
