"""What a terminal shows of long work: what is done, how much, how long it will take."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sidtool.formats.progress import listening

from .common import is_quiet

#: Work that takes less shows nothing [s].
PATIENCE = 1.0


@contextmanager
def progress_shown() -> Iterator[None]:
    """Shows what is reached inside, on a terminal and unless --quiet is given."""
    if not sys.stderr.isatty():
        yield
        return
    bar = Bar()
    try:
        with listening(bar):
            yield
    finally:
        bar.close()


class Bar:
    """A line below all others, once work has lasted longer than `PATIENCE`.

    A share that is known is a bar with the time left; else there is the time passed.
    """

    def __init__(self) -> None:
        self._begin: float | None = None
        self._text = ""
        self._progress: Any = None

    def __call__(self, text: str, share: float | None) -> None:
        now = time.monotonic()
        self._begin = now if self._begin is None else self._begin
        if is_quiet() or now - self._begin < PATIENCE:
            return
        if self._progress is None:
            self._open()
        if text != self._text:
            self._text = text
            self._progress.reset(self._task, description=text, completed=0)
        total = None if share is None else 1.0
        self._progress.update(self._task, total=total, completed=share or 0.0)

    def close(self) -> None:
        """Leaves nothing behind."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def _open(self) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            Progress,
            TaskProgressColumn,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        console = Console(stderr=True)
        self._progress = Progress(*columns, console=console, transient=True)
        self._task = self._progress.add_task("", total=None)
        self._progress.start()
