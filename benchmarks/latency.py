"""What a user waits for beside the solution: compiling once, then imports."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from sidtool.formats.result import read_result

from .machine import describe_machine
from .report import Report, Table

EXAMPLE = Path(__file__).parents[1] / "examples" / "slider_crank" / "slider_crank.toml"
FIRST, LATER = 3, 5


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """First runs with an empty cache each, then later ones; nothing is plotted.

    One run before them writes the byte code of all packages, as installing them does.
    """
    first, worked, later, solved = [], [], [], []
    with tempfile.TemporaryDirectory() as made:
        _simulate(Path(made) / "installing", Path(made))
        for k in range(FIRST):
            cache = Path(made) / f"cache{k}"
            before = _processor_seconds()
            seconds, _ = _simulate(cache, Path(made))
            first.append(seconds)
            worked.append(_processor_seconds() - before)
            say(f"  first: {seconds:.1f} s")
        for _ in range(LATER):
            seconds, solution = _simulate(cache, Path(made))
            later.append(seconds)
            solved.append(solution)
            say(f"  later: {seconds:.2f} s")
    rows = [
        ["the first, with compiling", *_spread(first, 1)],
        ["the same in seconds of the processor", *_spread(worked, 1)],
        ["later ones", *_spread(later, 2)],
        ["of which the solution", *_spread(solved, 2)],
    ]
    caption = "Seconds of `sidtool simulate`, from the call to the file:"
    return Report(
        title="The founding slider-crank on the command line",
        tables=[Table(caption, ["run", "least", "median", "most"], rows, True)],
        machine=describe_machine(),
    )


def _simulate(cache: Path, folder: Path) -> tuple[float, float]:
    """Seconds of a run as a user starts it, and of its solution."""
    result = folder / "result.h5"
    command = [sys.executable, "-m", "sidtool", "simulate", str(EXAMPLE)]
    surroundings = os.environ | {
        "NUMBA_CACHE_DIR": str(cache),
        "PYTHONPYCACHEPREFIX": str(folder / "bytecode"),
        "PYTHONDONTWRITEBYTECODE": "",
    }
    began = time.perf_counter()
    subprocess.run(
        [*command, "-o", str(result)],
        env=surroundings,
        check=True,
        capture_output=True,
    )
    seconds = time.perf_counter() - began
    return seconds, float(read_result(result).counters["seconds"])


def _processor_seconds() -> float:
    """Of all runs so far: other programs make a run longer, and hardly these."""
    used = os.times()
    return used.children_user + used.children_system


def _spread(seconds: list[float], digits: int) -> list[str]:
    values = min(seconds), statistics.median(seconds), max(seconds)
    return [f"{value:.{digits}f}" for value in values]
