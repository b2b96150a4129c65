"""What several commands share: checks of targets, progress that shows up late."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from formats.errors import InputError

#: Runs shorter than this show no progress bar [s].
PATIENCE = 1.0

existing = click.Path(path_type=Path)
target = click.Path(path_type=Path)


def check_target(path: Path | None) -> None:
    """Refuse a file that cannot be written before any work is done.

    Raises
    ------
    InputError : the folder does not exist, or the name is that of a folder.
    """
    if path is None:
        return
    if path.is_dir():
        raise InputError("is a folder", source=path, expected="the name of a file")
    folder = path.parent
    if not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise InputError(
            "cannot be written here",
            source=path,
            expected=f"{folder} to be a folder with permission to write",
        )


@contextmanager
def progress_bar(text: str) -> Iterator[Callable[[float], None] | None]:
    """Yield a function that takes the share done, 0 to 1; None without a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    bar = _LateBar(text)
    try:
        yield bar
    finally:
        bar.close()


class _LateBar:
    """A bar of rich that appears once the run has lasted longer than `PATIENCE`."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._begin = time.monotonic()
        self._progress: Any = None

    def __call__(self, share: float) -> None:
        if self._progress is None and time.monotonic() - self._begin > PATIENCE:
            self._open()
        if self._progress is not None:
            self._progress.update(self._task, completed=share)

    def close(self) -> None:
        if self._progress is not None:
            self._progress.stop()

    def _open(self) -> None:
        from rich.console import Console
        from rich.progress import Progress

        self._progress = Progress(console=Console(stderr=True), transient=True)
        self._task = self._progress.add_task(self._text, total=1.0)
        self._progress.start()
