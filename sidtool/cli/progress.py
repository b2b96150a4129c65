"""Progress of long computations on a terminal: stage, fraction, remaining time."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sidtool.formats.base.progress import TimeEstimate, has_listener, use_listener

from .common import is_quiet, print_on_stderr

#: Minimum duration before progress is shown [s].
MIN_DURATION = 1.0


@contextmanager
def show_progress() -> Iterator[None]:
    """Show the progress of the context on a terminal, unless --quiet is given."""
    if not sys.stderr.isatty():
        yield
        return
    bar = ProgressBar()
    try:
        with use_listener(bar):
            yield
    finally:
        bar.close()


class ProgressBar:
    """Progress line below all others, shown once work has lasted longer than
    `MIN_DURATION`.

    It also appears for work that reports nothing, such as one factorisation. A known
    fraction is shown as a bar with the remaining time; otherwise the line shows the
    elapsed time. A fraction that decreases marks the start of another stage.
    """

    def __init__(self) -> None:
        self._begin: float | None = None
        self._share: float | None = None
        self._pace = TimeEstimate()
        self._progress: Any = None
        self._task_fields: dict[str, Any] = {}
        self._lock, self._closed = threading.Lock(), False
        self._timer: threading.Timer | None = None

    def __call__(self, text: str, share: float | None) -> None:
        now = time.monotonic()
        self._begin = now if self._begin is None else self._begin
        anew = share is None or self._share is None or share < self._share
        self._share = share
        if anew:
            self._pace = TimeEstimate()
        if share is not None:
            self._pace.at(now, share)
        self._task_fields = {
            "description": text,
            "total": None if share is None else 1.0,
            "completed": share or 0.0,
            "left": _format_duration(self._pace.left()),
        }
        if is_quiet():
            return
        if self._timer is None:
            self._timer = threading.Timer(MIN_DURATION, self._open)
            self._timer.daemon = True
            self._timer.start()
        with self._lock:
            if self._progress is not None:
                if anew:
                    self._progress.reset(self._task)
                self._progress.update(self._task, **self._task_fields)

    def close(self) -> None:
        """Remove the progress line."""
        if self._timer is not None:
            self._timer.cancel()
        with self._lock:
            self._closed = True
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
        )

        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("left {task.fields[left]}"),
        )
        with self._lock:
            if self._closed:
                return
            console = Console(stderr=True)
            progress = Progress(*columns, console=console, transient=True)
            self._task = progress.add_task("", total=None, left="")
            progress.update(self._task, **self._task_fields)
            progress.start()
            self._progress = progress


def _format_duration(seconds: float | None) -> str:
    """Return a duration as hours, minutes and seconds."""
    if seconds is None:
        return "-:--:--"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02}"


class StageTimes:
    """Durations of the stages of a conversion, in their order."""

    def __init__(self) -> None:
        self._begins: list[tuple[float, str]] = []

    def __call__(self, text: str) -> None:
        """Begin a stage, or report the progress of the last one."""
        name = text.partition(":")[0].partition(",")[0]
        if not self._begins or self._begins[-1][1] != name:
            self._begins.append((time.monotonic(), name))

    def seconds(self) -> list[tuple[str, float]]:
        """Return names and durations [s]; the last stage ends now."""
        begins = [at for at, _ in self._begins]
        ends = [*begins[1:], time.monotonic()]
        return [
            (name, end - begin)
            for (begin, name), end in zip(self._begins, ends, strict=True)
        ]


class StageLines:
    """Print stages with their time, at most one line for each `MIN_DURATION`, if no
    progress bar is shown.
    """

    def __init__(self) -> None:
        self._begin = self._printed = time.monotonic()

    def __call__(self, text: str) -> None:
        now = time.monotonic()
        if now - self._printed < MIN_DURATION or is_quiet() or has_listener():
            return
        self._printed = now
        print_on_stderr(f"{now - self._begin:6.1f} s  {text}")
