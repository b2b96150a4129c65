"""Processes that run code of tests: copies of one that has imported the program.

A copy takes 20 ms, a new process 0.6 s, most of it for imports. Windows has no copies:
there each is new.
"""

from __future__ import annotations

import faulthandler
import io
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from tests.places import posix

CONTEXT: Any = multiprocessing.get_context(
    "spawn" if sys.platform == "win32" else "forkserver"
)
CONTEXT.set_forkserver_preload(
    [
        "tests.processes",
        "sidtool.cli.main",
        "sidtool.cli.convert",
        "sidtool.cli.simulate",
        "sidtool.cli.study",
        "sidtool.api.study",
        "sidtool.pipeline.model_to_sid",
        "sidtool.solver.compiler.precompile",
        "sidtool.solver.simulation.run_loop",
        "sidtool.solver.simulation.simulate",
    ]
)


def _run(code: str, folder: str, output: str) -> None:
    """Run code in a folder; what it prints goes to files."""
    os.chdir(folder)
    for number, name in ((1, "stdout"), (2, "stderr")):
        file = os.open(os.path.join(output, name), os.O_WRONLY)
        os.dup2(file, number)
        os.close(file)
        stream = io.TextIOWrapper(os.fdopen(number, "wb", closefd=False), "utf-8")
        setattr(sys, name, stream)
    faulthandler.enable()
    exec(code, {"__name__": "__main__"})


class Ended(NamedTuple):
    """Exit status and output of a process."""

    status: int
    stdout: str
    stderr: str


class PythonProcess:
    """A process that runs code in a folder, like `python -c`."""

    def __init__(self, code: str, folder: Path) -> None:
        self._files = tempfile.TemporaryDirectory()
        self._output = Path(self._files.name)
        for name in ("stdout", "stderr"):
            (self._output / name).touch()
        arguments = code, str(folder), self._files.name
        self._process: BaseProcess = CONTEXT.Process(target=_run, args=arguments)

    def __enter__(self) -> PythonProcess:
        self._process.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.kill()
        self._process.join()
        self._files.cleanup()

    def read(self, name: str = "stdout") -> str:
        """What it has printed so far."""
        return (self._output / name).read_text(encoding="utf-8")

    def wait_for_line(self, start: str = "") -> str:
        """The first line with a start that it prints; nothing if it ends before."""
        while True:
            alive = self.is_alive()
            for line in self.read().splitlines(keepends=True):
                if line.startswith(start) and line.endswith("\n"):
                    return line.rstrip("\n")
            if not alive:
                return ""
            time.sleep(0.01)

    def is_alive(self) -> bool:
        return self._process.is_alive()

    def kill(self) -> None:
        """End it without a signal that it could answer."""
        self._process.kill()

    @posix
    def send_signal(self, number: int) -> None:
        assert self._process.pid is not None
        os.kill(self._process.pid, number)

    def wait(self) -> Ended:
        """Wait for its end; the exit status is negative after a signal.

        One that goes on is ended, and says where it was.
        """
        self._process.join(60.0)
        if hangs := self.is_alive():
            self.send_signal(signal.SIGABRT)
            self._process.join(10.0)
        output, errors = self.read("stdout"), self.read("stderr")
        assert not hangs and self._process.exitcode is not None, errors
        return Ended(self._process.exitcode, output, errors)
